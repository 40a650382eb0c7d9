//! What goes wrong in the middle of a survey, and what the flight does then.

use crate::support::Flight;
use std::time::Duration;
use stockpilot::mission::Phase;
use stockpilot_sim::lidar_faults::LidarFault;

/// Seconds from phase `from` to phase `to`, both entered exactly once.
fn seconds_between(flight: &Flight, from: Phase, to: Phase) -> f64 {
    let at =
        |phase| flight.seen.changes.iter().rev().find(|c| c.to == phase).expect("that phase").at;
    at(to).seconds_since(at(from))
}

#[test]
fn the_pilots_switch_ends_setpoints_and_nothing_is_commanded_afterwards() {
    let mut flight = Flight::in_survey(21);
    let switched_at = flight.now();
    flight.direct.rig.autopilot_mut().pilot_takes_over();
    flight.run(15.0);
    // The brain stamps with its last tick, up to 1/60 s before.
    let one_tick_before = switched_at.minus(Duration::from_millis(17));
    assert_eq!(
        flight.seen.phases_since(one_tick_before),
        [Phase::Abort],
        "{:?}",
        flight.seen.changes
    );
    assert!(flight.direct.rig.autopilot().is_with_pilot());
    let last = flight.seen.last_setpoint_at.expect("setpoints before the switch");
    let ended_after_s = last.seconds_since(switched_at);
    assert!(ended_after_s <= 0.05, "setpoints went on for {ended_after_s} s");
    let later = flight.seen.wire_commands.iter().filter(|(at, _)| *at >= switched_at).count();
    assert_eq!(later, 0, "{:?}", flight.seen.wire_commands);
    assert!(flight.direct.rig.vehicle().collision().is_none());
}

#[test]
fn covered_cameras_hold_then_land() {
    let mut flight = Flight::in_survey(22);
    let covered_at = flight.now();
    flight.direct.faults.is_camera_covered = true;
    let is_down = flight.run_until(60.0, |f| f.has_ended());
    assert!(is_down, "{:?}", flight.seen.changes);
    let phases = flight.seen.phases_since(covered_at);
    // Three seconds in the hold, before the autopilot's own failsafe for a lost position.
    assert_eq!(phases, [Phase::Hold, Phase::Land, Phase::Idle], "{:?}", flight.seen.changes);
    let waited_s = seconds_between(&flight, Phase::Hold, Phase::Land);
    assert!((2.9..3.1).contains(&waited_s), "held for {waited_s} s");
    let last_setpoint = flight.seen.last_setpoint_at.expect("setpoints in the hold");
    let landing_at =
        flight.seen.changes.iter().find(|c| c.to == Phase::Land).expect("a landing").at;
    assert!(last_setpoint <= landing_at.plus(Duration::from_millis(50)));
    assert!(!flight.direct.rig.autopilot().is_armed() && flight.direct.rig.autopilot().is_landed());
    assert!(flight.direct.summary().is_some_and(|summary| !summary.is_complete));
}

#[test]
fn uncovered_cameras_go_on_with_the_survey() {
    let mut flight = Flight::in_survey(23);
    let covered_at = flight.now();
    flight.direct.faults.is_camera_covered = true;
    assert!(flight.run_until(5.0, |f| f.phase() == Phase::Hold), "{:?}", flight.seen.changes);
    flight.run(1.5);
    flight.direct.faults.is_camera_covered = false;
    flight.run(4.0);
    assert_eq!(flight.seen.phases_since(covered_at), [Phase::Hold, Phase::Survey]);
    assert!(flight.direct.rig.vehicle().collision().is_none());
}

#[test]
fn a_silent_lidar_holds_then_returns_and_lands_on_the_pad() {
    let mut flight = Flight::in_survey(24);
    let silent_at = flight.now();
    flight.direct.faults.lidar = Some(LidarFault::Silent);
    let is_down = flight.run_until(120.0, |f| f.has_ended());
    assert!(is_down, "{:?}", flight.seen.changes);
    let phases = flight.seen.phases_since(silent_at);
    let expected = [Phase::Hold, Phase::Return, Phase::Land, Phase::Idle];
    assert_eq!(phases, expected, "{:?}", flight.seen.changes);
    let waited_s = seconds_between(&flight, Phase::Hold, Phase::Return);
    assert!((waited_s - 10.0).abs() < 0.1, "held for {waited_s} s");
    let place = flight.direct.rig.vehicle().hall_from_body().origin.coords;
    let pad = flight.direct.rig.world().pad.position.coords;
    // Half a metre of drift in a descent that the autopilot flies.
    assert!((place - pad).xy().norm() < 0.5, "{place:?} instead of {pad:?}");
    assert!(flight.direct.summary().is_some_and(|summary| !summary.is_complete));
}
