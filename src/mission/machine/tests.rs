//! Walks through the machine, and every way out of it.

mod hold;
mod start;

use super::*;
use crate::messages::{LandedState, Room, Severity, StorageState, TakeOff, VehicleState};
use crate::mission::guards::{PreflightFault, preflight_faults};
use std::time::Duration;

fn inputs(seconds: f64) -> Inputs {
    Inputs {
        now: Stamp::ZERO.plus(Duration::from_secs_f64(seconds)),
        vehicle: Some(vehicle(false, FlightMode::Hold, LandedState::OnGround)),
        is_autopilot_lost: false,
        has_position: true,
        is_late: false,
        has_samples: true,
        has_lidar: true,
        battery_ratio: Some(0.9),
        battery_heard_at: None,
        has_plan: true,
        has_gaps: false,
        is_plan_done: false,
        is_plan_complete: true,
        heading_error_rad: Some(0.1),
        position_sigma_m: Some(0.02),
        disagreement_m: Some(0.05),
        heading_disagreement_rad: Some(-0.03),
        intrusion_m: 0.0,
        off_track_m: Some(0.0),
        strayed_m: None,
        way_home_ratio: None,
        height_over_home_m: Some(0.0),
        is_trajectory_over: false,
        is_at_target: false,
        storage: None,
    }
}

fn vehicle(is_armed: bool, mode: FlightMode, landed: LandedState) -> VehicleState {
    VehicleState {
        at: Stamp::ZERO,
        is_armed,
        mode,
        landed,
        in_failsafe: false,
        is_ready: true,
        is_contested: false,
        is_mode_prompt: true,
        takes_off: TakeOff::BySetpoints,
    }
}

fn flying(seconds: f64) -> Inputs {
    Inputs {
        vehicle: Some(vehicle(true, FlightMode::Companion, LandedState::InAir)),
        ..inputs(seconds)
    }
}

/// A mission that is in the survey at 10 s.
fn surveying() -> Mission {
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    assert!(mission.on_operator(OperatorVerb::Start, &inputs(0.0), &mut effects));
    mission.step(&inputs(2.0), &mut effects);
    assert!(effects.contains(&Effect::Command(VehicleCommand::EnterCompanionMode)));
    let mut ready = inputs(4.0);
    ready.vehicle = Some(vehicle(false, FlightMode::Companion, LandedState::OnGround));
    mission.step(&ready, &mut effects);
    assert!(effects.contains(&Effect::Command(VehicleCommand::Arm)));
    mission.step(&flying(5.0), &mut effects);
    assert_eq!(mission.phase(), Phase::TakeOff);
    mission.step(&Inputs { is_at_target: true, ..flying(10.0) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Survey);
    mission
}

#[test]
fn a_whole_flight_ends_complete_and_idle() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    mission.step(&Inputs { is_plan_done: true, ..flying(60.0) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Return);
    mission.step(&Inputs { is_at_target: true, ..flying(70.0) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
    assert!(effects.contains(&Effect::Command(VehicleCommand::EnterLand)));
    let mut down = inputs(80.0);
    down.vehicle = Some(vehicle(false, FlightMode::Land, LandedState::OnGround));
    mission.step(&down, &mut effects);
    assert_eq!(mission.phase(), Phase::Idle);
    assert_eq!(effects.last(), Some(&Effect::Ended { is_complete: true }));
}

#[test]
fn the_pilots_mode_switch_ends_control_in_one_step_and_for_good() {
    for verb in [None, Some(OperatorVerb::Hold)] {
        let mut mission = surveying();
        let mut effects = Vec::new();
        if let Some(verb) = verb {
            mission.on_operator(verb, &flying(11.0), &mut effects);
        }
        effects.clear();
        let mut taken = flying(12.0);
        taken.vehicle = Some(vehicle(true, FlightMode::Pilot, LandedState::InAir));
        mission.step(&taken, &mut effects);
        assert_eq!(mission.phase(), Phase::Abort);
        assert!(!mission.phase().is_steering());
        // Even if the mode comes back by itself, nothing is commanded.
        effects.clear();
        for second in 13..40 {
            mission.step(&flying(f64::from(second)), &mut effects);
        }
        assert!(effects.is_empty(), "{effects:?}");
        assert!(!mission.on_operator(OperatorVerb::Resume, &flying(41.0), &mut effects));
    }
}

#[test]
fn a_pad_that_cannot_be_reached_is_landed_beside() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    assert!(mission.on_operator(OperatorVerb::Return, &flying(20.0), &mut effects));
    let beside = |seconds| Inputs { is_trajectory_over: true, ..flying(seconds) };
    mission.step(&beside(30.0), &mut effects);
    mission.step(&beside(39.0), &mut effects);
    assert_eq!(mission.phase(), Phase::Return);
    mission.step(&beside(40.1), &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
}

#[test]
fn a_survey_cut_short_by_the_planner_is_not_complete() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    let ran_out = Inputs { is_plan_done: true, is_plan_complete: false, ..flying(20.0) };
    mission.step(&ran_out, &mut effects);
    mission.step(&Inputs { is_at_target: true, ..flying(30.0) }, &mut effects);
    let mut down = inputs(40.0);
    down.vehicle = Some(vehicle(false, FlightMode::Land, LandedState::OnGround));
    mission.step(&down, &mut effects);
    assert_eq!(effects.last(), Some(&Effect::Ended { is_complete: false }));
}

#[test]
fn low_battery_returns_and_empty_battery_lands() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    mission.step(&Inputs { battery_ratio: Some(0.2), ..flying(20.0) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Return);
    let told = |seconds, heard_s, ratio| Inputs {
        battery_ratio: Some(ratio),
        battery_heard_at: Some(Stamp::ZERO.plus(Duration::from_secs_f64(heard_s))),
        ..flying(seconds)
    };
    // One wild word lands nobody, although no other comes for long, and two in a row no sooner than 2.5 s.
    for (seconds, heard_s, ratio) in [
        (25.0, 25.0, 0.0),
        (28.9, 25.0, 0.0),
        (29.0, 29.0, 0.2),
        (31.0, 31.0, 0.1),
        (33.0, 33.0, 0.1),
        (33.4, 33.0, 0.1),
    ] {
        mission.step(&told(seconds, heard_s, ratio), &mut effects);
        assert_eq!(mission.phase(), Phase::Return, "{seconds}");
    }
    mission.step(&told(33.6, 33.0, 0.1), &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
}

#[test]
fn whoever_takes_the_vehicle_out_of_a_landing_has_it() {
    let landing = |seconds, mode, landed| Inputs {
        vehicle: Some(vehicle(true, mode, landed)),
        ..inputs(seconds)
    };
    use FlightMode::{Companion, Hold, Land, Other, Pilot, Return};
    use LandedState::{InAir, OnGround};
    for mode in [Companion, Hold, Return, Pilot, Other(7)] {
        let mut mission = surveying();
        let mut effects = Vec::new();
        assert!(mission.on_operator(OperatorVerb::Land, &flying(20.0), &mut effects));
        mission.step(&landing(20.1, Companion, InAir), &mut effects);
        mission.step(&landing(20.5, Land, InAir), &mut effects);
        assert_eq!(mission.phase(), Phase::Land);
        effects.clear();
        mission.step(&landing(21.0, mode, InAir), &mut effects);
        assert_eq!(mission.phase(), Phase::Abort, "{mode:?}");
        (22..30).for_each(|s| mission.step(&landing(s.into(), mode, InAir), &mut effects));
        assert!(!effects.iter().any(|e| matches!(e, Effect::Command(_))), "{effects:?}");
    }
    // Also before the landing has begun; but how PX4 leaves on the ground what it has begun is its own
    // affair.
    for (has_begun, landed, phase) in [
        (false, InAir, Phase::Abort),
        (false, OnGround, Phase::Abort),
        (true, OnGround, Phase::Land),
    ] {
        let mut mission = surveying();
        let mut effects = Vec::new();
        assert!(mission.on_operator(OperatorVerb::Land, &flying(20.0), &mut effects));
        if has_begun {
            mission.step(&landing(20.2, Land, InAir), &mut effects);
        }
        mission.step(&landing(20.3, Hold, landed), &mut effects);
        assert_eq!(mission.phase(), phase);
    }
}

#[test]
fn wishes_are_idempotent_and_senseless_ones_refused() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    assert!(mission.on_operator(OperatorVerb::Start, &flying(11.0), &mut effects));
    assert!(effects.is_empty());
    assert!(mission.on_operator(OperatorVerb::Hold, &flying(12.0), &mut effects));
    assert!(mission.on_operator(OperatorVerb::Hold, &flying(13.0), &mut effects));
    assert_eq!(effects.len(), 1);
    assert!(mission.on_operator(OperatorVerb::Resume, &flying(14.0), &mut effects));
    assert_eq!(mission.phase(), Phase::Survey);
    let mut idle = Mission::new(Settings::default());
    assert!(!idle.on_operator(OperatorVerb::Land, &inputs(0.0), &mut effects));
}

#[test]
fn it_lands_where_the_autopilot_does_not_tell_its_place() {
    let untold = |seconds| Inputs { disagreement_m: None, ..flying(seconds) };
    let lands_at = |inputs: &dyn Fn(f64) -> Inputs| {
        let mut mission = surveying();
        let mut effects = Vec::new();
        (0..100).map(|tick| 11.0 + 0.1 * f64::from(tick)).find(|seconds| {
            mission.step(&inputs(*seconds), &mut effects);
            mission.phase() == Phase::Land
        })
    };
    let landed_s = lands_at(&untold).expect("a landing");
    assert!((landed_s - 14.0).abs() < 0.11, "{landed_s} s");
    // A gap of two seconds, a silent autopilot and a lost place of one's own are other rules' matter.
    assert_eq!(lands_at(&|s| if s % 2.5 < 2.0 { untold(s) } else { flying(s) }), None);
    assert_eq!(lands_at(&|s| Inputs { is_autopilot_lost: true, ..untold(s) }), None);
    // On the ground it is a reason not to start.
    let on_ground = Inputs { disagreement_m: None, ..inputs(0.0) };
    let faults = preflight_faults(&on_ground, &Settings::default());
    assert!(faults.contains(&PreflightFault::PositionUntold), "{faults:?}");
}

#[test]
fn an_autopilot_that_believes_to_be_elsewhere_is_told_to_land() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    let off = |seconds, metres| Inputs { disagreement_m: Some(metres), ..flying(seconds) };
    // A moment of it, and what is below the bound, change nothing.
    for (seconds, metres) in [(20.0, 0.6), (20.4, 0.6), (20.6, 0.4), (21.0, 0.6), (21.4, 3.0)] {
        mission.step(&off(seconds, metres), &mut effects);
        assert_eq!(mission.phase(), Phase::Survey, "{seconds} s");
    }
    mission.step(&off(21.5, 0.6), &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
    assert_eq!(effects.last(), Some(&Effect::Command(VehicleCommand::EnterLand)));
    // And before the start it is named with its measure.
    let mut idle = Mission::new(Settings::default());
    effects.clear();
    let on_ground = |seconds| Inputs { disagreement_m: Some(1.24), ..inputs(seconds) };
    idle.on_operator(OperatorVerb::Start, &on_ground(0.0), &mut effects);
    idle.step(&on_ground(61.0), &mut effects);
    let names = |e: &Effect| matches!(e, Effect::Say(_, text) if text.contains("1.2 m away"));
    assert!(effects.iter().any(names), "{effects:?}");
}

#[test]
fn an_autopilot_that_believes_to_be_turned_is_told_to_land() {
    let off = |seconds, degrees: f64| Inputs {
        heading_disagreement_rad: Some(degrees.to_radians()),
        ..flying(seconds)
    };
    for sign in [-1.0, 1.0] {
        let mut mission = surveying();
        let mut effects = Vec::new();
        // A moment of it, and what only forbids a start, change nothing.
        for (seconds, degrees) in
            [(20.0, 16.0), (20.4, 16.0), (20.6, 14.0), (21.0, 16.0), (21.4, 170.0)]
        {
            mission.step(&off(seconds, sign * degrees), &mut effects);
            assert_eq!(mission.phase(), Phase::Survey, "{seconds} s");
        }
        mission.step(&off(21.5, sign * 16.0), &mut effects);
        assert_eq!(mission.phase(), Phase::Land);
        assert_eq!(effects.last(), Some(&Effect::Command(VehicleCommand::EnterLand)));
        assert!(effects.iter().any(|e| matches!(e, Effect::Say(_, t) if t.contains("16 deg off"))));
    }
}

#[test]
fn the_way_home_begins_while_the_battery_reaches_for_it() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    let far = |seconds, battery, way_home| Inputs {
        battery_ratio: Some(battery),
        way_home_ratio: Some(way_home),
        ..flying(seconds)
    };
    // 0.12 for the landing and 1.5 × 0.2 for the way: 0.42.
    mission.step(&far(20.0, 0.43, 0.2), &mut effects);
    assert_eq!(mission.phase(), Phase::Survey);
    mission.step(&far(21.0, 0.41, 0.2), &mut effects);
    assert_eq!(mission.phase(), Phase::Return);
    let said = |e: &Effect| matches!(e, Effect::Say(_, text) if text.contains("way home"));
    assert!(effects.iter().any(said), "{effects:?}");
}

#[test]
fn a_companion_that_restarts_beside_a_flying_vehicle_does_nothing_but_land_it_when_asked() {
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    for second in 0..30 {
        mission.step(&flying(f64::from(second)), &mut effects);
    }
    assert!(effects.is_empty(), "{effects:?}");
    for verb in [OperatorVerb::Resume, OperatorVerb::Return, OperatorVerb::Hold] {
        assert!(!mission.on_operator(verb, &flying(30.0), &mut effects));
    }
    assert!(mission.on_operator(OperatorVerb::Land, &flying(31.0), &mut effects));
    assert_eq!(effects.last(), Some(&Effect::Command(VehicleCommand::EnterLand)));
}
