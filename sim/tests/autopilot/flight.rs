//! Flights with a companion that knows the truth.

use crate::support::{Loop, Wish};
use mavlink::dialects::ardupilotmega::{MavCmd, MavResult};
use std::time::Duration;
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

/// Flies a square of 4 m at 3 m height with feed-forward; returns the largest error, m.
fn worst_on_square_m(flight: &mut Loop) -> f64 {
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
            flight.wish = Some(Wish {
                position,
                velocity: [way[0] * v, way[1] * v, 0.0],
                accel: [way[0] * a, way[1] * a, 0.0],
            });
            flight.step();
            let place = flight.place();
            let error = (0..3).map(|i| (place[i] - position[i]).powi(2)).sum::<f64>().sqrt();
            worst_m = worst_m.max(error);
        }
    }
    worst_m
}

fn undelayed() -> ParamTable {
    let mut params = ParamTable::indoor();
    // Nothing delays ODOMETRY in this loop.
    assert!(params.set("EKF2_EV_DELAY", ParamValue::Real(0.0)));
    params
}

#[test]
fn square_is_tracked_and_the_vehicle_comes_home() {
    let mut flight = Loop::new(undelayed(), 1);
    let worst_m = worst_on_square_m(&mut flight);
    assert!(worst_m < 0.10, "tracking error {worst_m} m");

    let acks = flight.command(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]);
    assert_eq!(acks, [MavResult::MAV_RESULT_ACCEPTED]);
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
fn square_is_tracked_with_noisy_odometry_with_and_without_velocity() {
    for seed in 20..30 {
        for sends_velocity in [false, true] {
            let mut flight = Loop::new(undelayed(), seed);
            flight.odometry_sigma_m = 0.02;
            flight.sends_velocity = sends_velocity;
            let worst_m = worst_on_square_m(&mut flight);
            // Gusts of 0.3 m/s and 2 cm of noise on top of the noise-free bound.
            assert!(worst_m < 0.12, "{worst_m} m with seed {seed}, velocity {sends_velocity}");
        }
    }
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
    assert!(rms.iter().all(|rms| *rms < 0.04), "rms {rms:?} m");
    assert!(worst_m < 0.12, "worst {worst_m} m");
}

/// Largest distance between belief and truth on a way of 4 m along y at 1.5 m/s.
fn worst_belief_m(flight: &mut Loop, from_y_m: f64, direction: f64) -> f64 {
    let start = flight.now();
    let mut worst_m: f64 = 0.0;
    while flight.now().seconds_since(start) < 4.5 {
        let (s, v, a) = trapezoid(4.0, flight.now().seconds_since(start));
        flight.wish = Some(Wish {
            position: [3.0, from_y_m + direction * s, 3.0],
            velocity: [0.0, direction * v, 0.0],
            accel: [0.0, direction * a, 0.0],
        });
        flight.step();
        let believed = flight.stub.believed_motion().0.origin.coords;
        let place = flight.place();
        worst_m = worst_m.max((believed.y - place[1]).abs());
    }
    worst_m
}

#[test]
fn late_odometry_is_put_in_its_place_once_the_clocks_agree() {
    let mut flight = Loop::new(undelayed(), 13);
    flight.odometry_delay = Duration::from_millis(80);
    flight.take_off(3.0);
    // 80 ms at 1.5 m/s are 12 cm as long as the time of arrival is believed.
    let early_m = worst_belief_m(&mut flight, 2.0, 1.0);
    assert!(early_m > 0.06, "{early_m} m");
    // 500 answers at 10 Hz.
    flight.run(50.0);
    let late_m = worst_belief_m(&mut flight, 6.0, -1.0);
    assert!(late_m < 0.03, "{late_m} m");
}

#[test]
fn setpoints_into_the_ground_land_in_offboard() {
    let mut flight = Loop::new(ParamTable::indoor(), 14);
    flight.take_off(2.0);
    let mut z_m = 2.0;
    let mut has_landed = false;
    for _ in 0..12_000 {
        z_m = f64::max(z_m - 0.5e-3, -1.0);
        let mut wish = Wish::stay([3.0, 2.0, z_m]);
        wish.velocity[2] = -0.5;
        flight.wish = Some(wish);
        flight.step();
        has_landed |= flight.stub.is_landed();
    }
    assert!(has_landed, "at {:?}", flight.place());
    assert!(!flight.stub.is_armed(), "disarms 2 s after landing");
    assert!(flight.vehicle.is_on_ground() && flight.vehicle.collision().is_none());
}

#[test]
fn the_own_take_off_reaches_its_height_and_stays_there_without_an_origin() {
    let mut flight = Loop::new(ParamTable::indoor(), 15);
    flight.run(2.0);
    let acks = flight.command(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 3]);
    assert_eq!(acks, [MavResult::MAV_RESULT_ACCEPTED], "accepted even disarmed");
    assert_eq!(flight.arm(), [MavResult::MAV_RESULT_ACCEPTED]);
    flight.run(12.0);
    assert_eq!(flight.stub.mode(), Px4Mode::TakeOff);
    // MIS_TAKEOFF_ALT over the pad, where the body origin stands at 0.15 m.
    assert!((flight.place()[2] - 2.65).abs() < 0.15, "{:?}", flight.place());
}
