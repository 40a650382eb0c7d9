//! Flights with a companion that knows the truth.

use crate::support::{Loop, Wish};
use mavlink::dialects::ardupilotmega::MavCmd;
use stockpilot_sim::autopilot::{ParamTable, ParamValue, Px4Mode};

/// Position, velocity and acceleration along a way of `length_m` at 1.5 m/s and 1.5 m/s².
fn trapezoid(length_m: f64, t_s: f64) -> (f64, f64, f64) {
    let (v, a) = (1.5, 1.5);
    let ramp_s = v / a;
    let total_s = length_m / v + ramp_s;
    if t_s < ramp_s {
        (0.5 * a * t_s * t_s, a * t_s, a)
    } else if t_s < total_s - ramp_s {
        (v * t_s - 0.5 * v * ramp_s, v, 0.0)
    } else if t_s < total_s {
        let left_s = total_s - t_s;
        (length_m - 0.5 * a * left_s * left_s, a * left_s, -a)
    } else {
        (length_m, 0.0, 0.0)
    }
}

#[test]
fn square_is_tracked_and_the_vehicle_comes_home() {
    let mut params = ParamTable::indoor();
    // Nothing delays ODOMETRY in this loop.
    assert!(params.set("EKF2_EV_DELAY", ParamValue::Real(0.0)));
    let mut flight = Loop::new(params, 1);
    flight.take_off(3.0);
    let corners = [[3.0, 2.0], [7.0, 2.0], [7.0, 6.0], [3.0, 6.0], [3.0, 2.0]];
    let mut worst_m: f64 = 0.0;
    for leg in corners.windows(2) {
        let way = [leg[1][0] - leg[0][0], leg[1][1] - leg[0][1]].map(|d: f64| d / 4.0);
        let start = flight.now();
        // 4 m at 1.5 m/s with ramps of 1 s take 3.67 s; then half a second of rest.
        while flight.now().seconds_since(start) < 4.2 {
            let (s, v, a) = trapezoid(4.0, flight.now().seconds_since(start));
            let position = [leg[0][0] + way[0] * s, leg[0][1] + way[1] * s, 3.0];
            let wish = Wish {
                position,
                velocity: [way[0] * v, way[1] * v, 0.0],
                accel: [way[0] * a, way[1] * a, 0.0],
            };
            flight.wish = Some(wish);
            flight.step();
            let place = flight.place();
            let error = (0..3).map(|i| (place[i] - position[i]).powi(2)).sum::<f64>().sqrt();
            worst_m = worst_m.max(error);
        }
    }
    println!("worst tracking error {worst_m:.3} m");
    assert!(worst_m < 0.10, "tracking error {worst_m} m");

    assert_eq!(flight.command(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]).len(), 1);
    assert_eq!(flight.stub.mode(), Px4Mode::Land);
    flight.wish = None;
    assert!(flight.run_until(12.0, |l| !l.stub.is_armed()), "armed at {:?}", flight.place());
    for text in ["Takeoff detected", "Landing detected", "Disarmed by landing"] {
        assert!(flight.heard_text(text), "{text} is missing in {:?}", flight.texts());
    }
    assert!(flight.vehicle.collision().is_none());
    let place = flight.place();
    assert!((place[0] - 3.0).hypot(place[1] - 2.0) < 0.3, "landed at {place:?}");
}

#[test]
fn hover_stays_within_centimetres_in_gusts() {
    let mut flight = Loop::new(ParamTable::indoor(), 2);
    flight.odometry_sigma_m = 0.02;
    flight.take_off(3.0);
    flight.run(5.0);
    let mut squares = [0.0; 3];
    let mut worst_m: f64 = 0.0;
    for _ in 0..20_000 {
        flight.step();
        let place = flight.place();
        let errors = [place[0] - 3.0, place[1] - 2.0, place[2] - 3.0];
        for (square, error) in squares.iter_mut().zip(errors) {
            *square += error * error / 20_000.0;
        }
        worst_m = errors.iter().fold(worst_m, |worst, error| worst.max(error.abs()));
    }
    let rms = squares.map(f64::sqrt);
    println!("hover rms {rms:.3?} m, worst {worst_m:.3} m");
    assert!(rms.iter().all(|rms| *rms < 0.04), "rms {rms:?} m");
    assert!(worst_m < 0.12, "worst {worst_m} m");
}
