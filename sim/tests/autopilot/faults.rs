//! Things that go wrong, and what PX4 v1.16.1 then does.

use crate::support::{Loop, Wish, origin};
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavMessage, MavResult};
use stockpilot_sim::autopilot::{ParamTable, ParamValue, Px4Mode};

fn hovering(seed: u64) -> Loop {
    let mut flight = Loop::new(ParamTable::indoor(), seed);
    flight.take_off(3.0);
    flight
}

#[test]
fn lost_setpoints_land_and_return_by_themselves() {
    let mut flight = hovering(3);
    let wish = flight.wish.take();
    flight.run(0.9);
    assert_eq!(flight.stub.mode(), Px4Mode::Offboard);
    flight.run(0.2);
    assert_eq!(flight.stub.mode(), Px4Mode::Land);
    assert!(flight.heard_text("Failsafe activated"));
    flight.received.clear();
    flight.run(1.1);
    let heartbeat = flight.last_heartbeat().unwrap();
    assert_eq!(heartbeat.custom_mode, 0x0604_0000);
    assert_eq!(heartbeat.system_status, m::MavState::MAV_STATE_CRITICAL);
    // The intention stays OFFBOARD, so resumed setpoints take over again.
    flight.wish = wish;
    flight.run(0.2);
    assert_eq!(flight.stub.mode(), Px4Mode::Offboard);
    flight.wish = None;
    assert!(flight.run_until(15.0, |l| !l.stub.is_armed()), "armed at {:?}", flight.place());
    assert!(flight.vehicle.is_on_ground());
    assert_eq!(flight.stub.mode(), Px4Mode::Offboard);
}

#[test]
fn the_parameter_decides_what_lost_setpoints_lead_to() {
    let mode_after_loss = |action: i32, has_origin: bool| {
        let mut flight = hovering(3);
        assert!(flight.stub.params_mut().set("COM_OBL_RC_ACT", ParamValue::Int(action)));
        if has_origin {
            flight.send(&origin(0));
        }
        flight.wish = None;
        flight.run(1.2);
        flight.stub.mode()
    };
    assert_eq!(mode_after_loss(0, false), Px4Mode::Position);
    assert_eq!(mode_after_loss(4, true), Px4Mode::Land);
    assert_eq!(mode_after_loss(5, true), Px4Mode::Loiter);
    assert_eq!(mode_after_loss(5, false), Px4Mode::Land, "Hold needs a global position");
}

#[test]
fn lost_position_is_noticed_after_five_seconds_and_ends_in_a_blind_descent() {
    let mut flight = hovering(4);
    flight.sends_odometry = false;
    flight.run(4.5);
    assert!(flight.stub.is_position_valid());
    assert_eq!(flight.stub.mode(), Px4Mode::Offboard);
    flight.run(1.0);
    assert!(!flight.stub.is_position_valid());
    assert_eq!(flight.stub.mode(), Px4Mode::Land);
    flight.received.clear();
    flight.run(1.1);
    let flags = flight.received.iter().rev().find_map(|message| match message {
        MavMessage::ESTIMATOR_STATUS(data) => Some(data.flags.bits()),
        _ => None,
    });
    assert_eq!(flags, Some(0xE5));
    assert!(flight.run_until(20.0, |l| !l.stub.is_armed()), "armed at {:?}", flight.place());
    assert!(flight.vehicle.is_on_ground());
    assert!(flight.vehicle.collision().is_none(), "{:?}", flight.vehicle.collision());
}

#[test]
fn short_gaps_of_odometry_are_survived() {
    for gap_s in [1.0, 3.0] {
        let mut flight = hovering(5);
        flight.sends_odometry = false;
        flight.run(gap_s);
        flight.sends_odometry = true;
        flight.run(6.0);
        assert_eq!(flight.stub.mode(), Px4Mode::Offboard);
        let place = flight.place();
        let error = [place[0] - 3.0, place[1] - 2.0, place[2] - 3.0];
        assert!(error.iter().all(|e| e.abs() < 0.15), "{error:?} m after {gap_s} s");
    }
}

#[test]
fn a_wrong_odometry_moves_the_vehicle_and_a_declared_jump_moves_it_at_once() {
    // Drifts by 0.5 m in 5 s: the vehicle follows, although it flies to the same setpoint.
    let mut drifting = hovering(6);
    for step in 0..5000 {
        drifting.odometry_error_m[0] = 0.5 * f64::from(step) / 5000.0;
        drifting.step();
    }
    drifting.run(4.0);
    assert!((drifting.place()[0] - 2.5).abs() < 0.1, "{:?}", drifting.place());

    let mut jumping = hovering(6);
    jumping.odometry_error_m = [0.0, 1.0, 0.0];
    jumping.reset_counter = 1;
    jumping.run(0.1);
    let believed = jumping.stub.believed_motion().0.origin.coords;
    assert!((believed.y - jumping.place()[1] - 1.0).abs() < 0.1);
    jumping.run(5.0);
    assert!((jumping.place()[1] - 1.0).abs() < 0.1, "{:?}", jumping.place());

    // The same jump undeclared is gated at first.
    let mut gated = hovering(6);
    gated.odometry_error_m = [0.0, 1.0, 0.0];
    gated.run(0.5);
    let believed = gated.stub.believed_motion().0.origin.coords;
    assert!((believed.y - gated.place()[1]).abs() < 0.1);
}

#[test]
fn an_idle_vehicle_disarms_ten_seconds_after_arming() {
    let mut flight = Loop::new(ParamTable::indoor(), 8);
    flight.run(2.0);
    flight.wish = Some(Wish::stay(flight.place()));
    flight.run(0.5);
    flight.set_mode(6.0, 0.0);
    assert_eq!(flight.arm(), [MavResult::MAV_RESULT_ACCEPTED]);
    flight.run(9.8);
    assert!(flight.stub.is_armed());
    flight.run(0.4);
    assert!(!flight.stub.is_armed());
    assert!(flight.heard_text("Disarmed by auto preflight disarming"));
}

#[test]
fn the_pilot_takes_over_and_the_setpoints_are_ignored() {
    let mut flight = hovering(9);
    flight.stub.pilot_switches_to(Px4Mode::Position);
    flight.wish = Some(Wish::stay([30.0, 2.0, 3.0]));
    flight.run(5.0);
    assert_eq!(flight.stub.mode(), Px4Mode::Position);
    assert!((flight.place()[0] - 3.0).abs() < 0.15);
}

#[test]
fn a_reboot_stops_the_motors_and_restarts_the_clock() {
    let mut flight = hovering(10);
    let before = flight.stub.boot_now();
    let now = flight.now();
    assert!(before.seconds() > 12.345);
    flight.stub.reboot(now);
    flight.received.clear();
    flight.run(1.9);
    assert!(flight.received.is_empty(), "silent while it boots");
    flight.run(1.5);
    assert!(!flight.stub.is_armed());
    assert!(flight.last_heartbeat().is_some());
    assert!(flight.stub.boot_now() < before);
}

#[test]
fn a_dead_autopilot_says_nothing_and_falls() {
    let mut flight = hovering(11);
    flight.stub.kill();
    flight.received.clear();
    flight.run(2.0);
    assert!(flight.received.is_empty());
    assert!(flight.vehicle.collision().is_some());
}

#[test]
fn an_origin_with_an_altitude_throws_the_height_after_a_gap() {
    let mut flight = hovering(12);
    flight.send(&origin(489_400));
    flight.sends_odometry = false;
    flight.run(1.0);
    flight.sends_odometry = true;
    flight.run(0.3);
    // Seen on PX4 v1.16.1: 489.4 m of origin gave z = +481 m.
    let believed = flight.stub.believed_motion().0.origin.coords;
    assert!(believed.z < -400.0, "{believed:?}");
}
