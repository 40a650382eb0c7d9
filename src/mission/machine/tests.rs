//! Walks through the machine, and every way out of it.

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
fn no_survey_begins_without_room_for_its_log_and_none_ends_for_it() {
    let storage = StorageState {
        at: Stamp::ZERO,
        room: Room::TooLittle,
        free_bytes: Some(80_000_000),
        survey_bytes: 200_000_000,
        records_lost: 0,
        has_log_failed: false,
    };
    let failed = StorageState { room: Room::Enough, has_log_failed: true, ..storage };
    for (storage, word) in [(storage, "80 MB free"), (failed, "the log has failed")] {
        let mut mission = Mission::new(Settings::default());
        let mut effects = Vec::new();
        let full = |seconds| Inputs { storage: Some(storage), ..inputs(seconds) };
        mission.on_operator(OperatorVerb::Start, &full(0.0), &mut effects);
        (1..70).for_each(|second| mission.step(&full(f64::from(second)), &mut effects));
        assert!(!effects.iter().any(|effect| matches!(effect, Effect::Command(_))), "{effects:?}");
        let is_told =
            |effect: &Effect| matches!(effect, Effect::Say(_, text) if text.contains(word));
        assert!(effects.iter().any(is_told), "{effects:?}");
        // In the air the same changes nothing.
        let mut mission = surveying();
        effects.clear();
        for second in 11..40 {
            let full = Inputs { storage: Some(storage), ..flying(f64::from(second)) };
            mission.step(&full, &mut effects);
        }
        assert_eq!(mission.phase(), Phase::Survey);
        assert!(effects.is_empty(), "{effects:?}");
    }
}

#[test]
fn a_lost_fix_holds_then_lands() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    mission.step(&Inputs { has_position: false, ..flying(20.0) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Hold);
    mission.step(&Inputs { has_position: false, ..flying(22.9) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Hold);
    mission.step(&Inputs { has_position: false, ..flying(23.1) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
    assert_eq!(effects.last(), Some(&Effect::Command(VehicleCommand::EnterLand)));
}

#[test]
fn a_fix_that_comes_back_goes_on_with_the_survey() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    mission.step(&Inputs { has_position: false, ..flying(20.0) }, &mut effects);
    mission.step(&flying(21.0), &mut effects);
    assert_eq!(mission.phase(), Phase::Hold, "one good moment is not a recovery");
    mission.step(&flying(22.1), &mut effects);
    assert_eq!(mission.phase(), Phase::Survey);
}

#[test]
fn a_blink_late_in_a_hold_does_not_land() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    assert!(mission.on_operator(OperatorVerb::Hold, &flying(20.0), &mut effects));
    mission.step(&flying(60.0), &mut effects);
    mission.step(&Inputs { has_position: false, ..flying(61.0) }, &mut effects);
    mission.step(&flying(62.0), &mut effects);
    mission.step(&Inputs { has_position: false, ..flying(65.0) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Hold);
    mission.step(&Inputs { has_position: false, ..flying(68.1) }, &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
}

#[test]
fn a_mode_switch_in_the_preflight_calls_the_start_off() {
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    mission.on_operator(OperatorVerb::Start, &inputs(0.0), &mut effects);
    let on_ground = |seconds, mode| Inputs {
        vehicle: Some(vehicle(false, mode, LandedState::OnGround)),
        ..inputs(seconds)
    };
    mission.step(&on_ground(2.0, FlightMode::Pilot), &mut effects);
    mission.step(&on_ground(3.0, FlightMode::Companion), &mut effects);
    assert_eq!(mission.phase(), Phase::Preflight);
    effects.clear();
    mission.step(&on_ground(4.0, FlightMode::Pilot), &mut effects);
    assert_eq!(mission.phase(), Phase::Idle);
    for second in 5..30 {
        mission.step(&on_ground(f64::from(second), FlightMode::Pilot), &mut effects);
    }
    assert!(!effects.iter().any(|e| matches!(e, Effect::Command(_))), "{effects:?}");
}

#[test]
fn a_start_can_be_called_off_by_the_operator() {
    for verb in [OperatorVerb::Hold, OperatorVerb::Return, OperatorVerb::Land] {
        let mut mission = Mission::new(Settings::default());
        let mut effects = Vec::new();
        mission.on_operator(OperatorVerb::Start, &inputs(0.0), &mut effects);
        assert!(mission.on_operator(verb, &inputs(1.0), &mut effects));
        assert_eq!(mission.phase(), Phase::Idle);
    }
}

#[test]
fn a_hold_on_the_way_home_is_kept_in_spite_of_a_low_battery() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    let low = |seconds| Inputs { battery_ratio: Some(0.2), ..flying(seconds) };
    mission.step(&low(20.0), &mut effects);
    assert_eq!(mission.phase(), Phase::Return);
    assert!(mission.on_operator(OperatorVerb::Hold, &low(21.0), &mut effects));
    mission.step(&low(40.0), &mut effects);
    assert_eq!(mission.phase(), Phase::Hold);
    for seconds in [41.0, 43.6] {
        mission.step(&Inputs { battery_ratio: Some(0.1), ..flying(seconds) }, &mut effects);
    }
    assert_eq!(mission.phase(), Phase::Land);
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
fn a_vehicle_that_does_not_follow_holds_where_it_is_and_lands_the_third_time() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    let off = |seconds, off_m| Inputs { off_track_m: Some(off_m), ..flying(seconds) };
    // A gust is no reason.
    mission.step(&off(20.0, 1.5), &mut effects);
    mission.step(&off(20.2, 0.9), &mut effects);
    mission.step(&off(20.4, 1.5), &mut effects);
    assert_eq!(mission.phase(), Phase::Survey);
    for began in [30.0, 40.0] {
        mission.step(&off(began, 1.5), &mut effects);
        mission.step(&off(began + 0.31, 2.5), &mut effects);
        assert_eq!(mission.phase(), Phase::Hold);
        // Something stands where it is: it is led back, and the survey waits for it.
        mission.step(&off(began + 0.5, 2.5), &mut effects);
        mission.step(&off(began + 2.0, 2.5), &mut effects);
        assert_eq!(mission.phase(), Phase::Hold, "not while it is off");
        mission.step(&flying(began + 3.0), &mut effects);
        mission.step(&flying(began + 4.1), &mut effects);
        assert_eq!(mission.phase(), Phase::Survey);
    }
    mission.step(&off(50.0, 1.5), &mut effects);
    mission.step(&off(50.31, 1.5), &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
}

/// Held where it is each time that it is a metre off, which is not for ever.
#[test]
fn a_vehicle_that_does_not_keep_its_place_does_not_recover_and_lands_the_third_time() {
    let strayed = |seconds| Inputs { strayed_m: Some(1.1), ..flying(seconds) };
    for (verb, resumes) in [(Some(OperatorVerb::Hold), false), (None, true)] {
        let mut mission = surveying();
        let mut effects = Vec::new();
        if let Some(verb) = verb {
            assert!(mission.on_operator(verb, &flying(20.0), &mut effects));
        } else {
            mission.step(&Inputs { has_lidar: false, ..flying(20.0) }, &mut effects);
        }
        mission.step(&flying(20.5), &mut effects);
        mission.step(&strayed(21.4), &mut effects);
        mission.step(&flying(22.3), &mut effects);
        assert_eq!(mission.phase(), Phase::Hold, "not within a second after it strayed");
        mission.step(&strayed(23.2), &mut effects);
        mission.step(&flying(24.1), &mut effects);
        assert_eq!(mission.phase(), Phase::Hold);
        let mut calm = mission.clone();
        calm.step(&flying(25.2), &mut effects);
        assert_eq!(calm.phase() == Phase::Survey, resumes);
        let said = |e: &Effect| matches!(e, Effect::Say(_, text) if text.contains("1.1 m off"));
        assert_eq!(effects.iter().filter(|effect| said(effect)).count(), 2);
        mission.step(&strayed(24.5), &mut effects);
        assert_eq!(mission.phase(), Phase::Land);
    }
}

#[test]
fn a_hold_of_any_cause_lands_where_it_does_not_get_clear() {
    let mut mission = surveying();
    let mut effects = Vec::new();
    assert!(mission.on_operator(OperatorVerb::Hold, &flying(20.0), &mut effects));
    let near = |seconds, intrusion_m| Inputs { intrusion_m, ..flying(seconds) };
    // A gust that passes is no reason.
    for (seconds, intrusion_m) in [(30.0, 0.2), (32.0, 0.2), (32.5, 0.0), (33.0, 0.2), (35.9, 0.2)]
    {
        mission.step(&near(seconds, intrusion_m), &mut effects);
        assert_eq!(mission.phase(), Phase::Hold, "{seconds}");
    }
    mission.step(&near(36.1, 0.2), &mut effects);
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
fn a_start_called_off_while_arming_disarms() {
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    mission.on_operator(OperatorVerb::Start, &inputs(0.0), &mut effects);
    let mut ready = inputs(4.0);
    ready.vehicle = Some(vehicle(false, FlightMode::Companion, LandedState::OnGround));
    mission.step(&ready, &mut effects);
    assert_eq!(effects.last(), Some(&Effect::Command(VehicleCommand::Arm)));
    let called_off = mission.clone();
    let n_disarms = |effects: &[Effect]| {
        let disarm = Effect::Command(VehicleCommand::Disarm);
        effects.iter().filter(|effect| **effect == disarm).count()
    };
    assert!(mission.on_operator(OperatorVerb::Hold, &ready, &mut effects));
    assert_eq!(effects.last(), Some(&Effect::Command(VehicleCommand::Disarm)));
    // The answer to the question may have been that to the one before.
    let armed = |seconds, mode| Inputs {
        vehicle: Some(vehicle(true, mode, LandedState::OnGround)),
        ..inputs(seconds)
    };
    mission.step(&armed(4.5, FlightMode::Companion), &mut effects);
    assert_eq!(n_disarms(&effects), 1, "not faster than any command");
    mission.step(&armed(6.5, FlightMode::Companion), &mut effects);
    assert_eq!(n_disarms(&effects), 2);
    // Somebody else has it, or it was armed long afterwards.
    for (seconds, mode) in [(9.0, FlightMode::Pilot), (15.0, FlightMode::Companion)] {
        mission.step(&armed(seconds, mode), &mut effects);
        assert_eq!(n_disarms(&effects), 2);
    }

    // The patience ran out while the autopilot was about to arm.
    let (mut mission, mut effects) = (called_off, Vec::new());
    mission.step(&Inputs { now: inputs(61.0).now, ..ready }, &mut effects);
    assert_eq!((mission.phase(), n_disarms(&effects)), (Phase::Idle, 1));
}

#[test]
fn preflight_names_what_is_missing_and_gives_up() {
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    mission.on_operator(OperatorVerb::Start, &inputs(0.0), &mut effects);
    let blind = |seconds| Inputs { has_position: false, ..inputs(seconds) };
    mission.step(&blind(10.0), &mut effects);
    assert!(!effects.iter().any(|e| matches!(e, Effect::Command(_))));
    mission.step(&blind(61.0), &mut effects);
    assert_eq!(mission.phase(), Phase::Idle);
    let said = effects
        .iter()
        .any(|e| matches!(e, Effect::Say(Severity::Error, text) if text.contains("markers")));
    assert!(said, "{effects:?}");
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

/// Inputs of a vehicle that takes off by command.
fn by_command(seconds: f64, is_armed: bool, landed: LandedState, height_m: f64) -> Inputs {
    let state = vehicle(is_armed, FlightMode::Companion, landed);
    Inputs {
        vehicle: Some(VehicleState { takes_off: TakeOff::ByCommand, ..state }),
        height_over_home_m: Some(height_m),
        ..inputs(seconds)
    }
}

#[test]
fn a_take_off_by_command_has_no_setpoint_on_the_ground() {
    use LandedState::{InAir, OnGround, TakingOff};
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    assert!(mission.on_operator(
        OperatorVerb::Start,
        &by_command(0.0, false, OnGround, 0.0),
        &mut effects
    ));
    for second in [2.0, 4.0] {
        mission.step(&by_command(second, false, OnGround, 0.0), &mut effects);
        assert!(!mission.is_steering());
    }
    assert!(effects.contains(&Effect::Command(VehicleCommand::Arm)));
    mission.step(&by_command(5.0, true, OnGround, 0.0), &mut effects);
    effects.clear();
    mission.step(&by_command(5.1, true, OnGround, 0.0), &mut effects);
    assert_eq!(effects, [Effect::Command(VehicleCommand::TakeOff)]);
    // The first report of flight is not enough, nor is a height that a poor fix could show.
    for (landed, height_m) in [(TakingOff, 0.2), (InAir, 0.5), (OnGround, 0.9)] {
        mission.step(&by_command(6.0, true, landed, height_m), &mut effects);
        assert!(!mission.is_steering(), "{landed:?} {height_m}");
    }
    effects.clear();
    mission.step(&by_command(7.0, true, TakingOff, 0.75), &mut effects);
    assert_eq!(effects, [Effect::Lifted]);
    assert!(mission.is_steering());
}

#[test]
fn a_take_off_by_command_that_does_not_lift_lands() {
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    let on_ground = |seconds, is_armed| by_command(seconds, is_armed, LandedState::OnGround, 0.0);
    mission.on_operator(OperatorVerb::Start, &on_ground(0.0, false), &mut effects);
    mission.step(&on_ground(2.0, false), &mut effects);
    mission.step(&on_ground(3.0, true), &mut effects);
    assert_eq!(mission.phase(), Phase::TakeOff);
    assert!(mission.on_operator(OperatorVerb::Hold, &on_ground(4.0, true), &mut effects));
    assert_eq!(mission.phase(), Phase::Land);
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
fn no_start_with_an_autopilot_that_is_turned_or_does_not_tell_its_heading() {
    let no_start = |heading_disagreement_rad: Option<f64>| {
        let mut idle = Mission::new(Settings::default());
        let mut effects = Vec::new();
        let on_ground = |seconds| Inputs { heading_disagreement_rad, ..inputs(seconds) };
        idle.on_operator(OperatorVerb::Start, &on_ground(0.0), &mut effects);
        idle.step(&on_ground(2.0), &mut effects);
        let asked = effects.iter().any(|effect| matches!(effect, Effect::Command(_)));
        idle.step(&on_ground(61.0), &mut effects);
        let why = effects.iter().find_map(|effect| match effect {
            Effect::Say(_, text) if text.contains("no take-off") => Some(text.clone()),
            _ => None,
        });
        (asked, why.unwrap_or_default())
    };
    // 40°: the compass of a hall whose x axis points north-east.
    for degrees in [-40.0_f64, 11.0] {
        let (asked, why) = no_start(Some(degrees.to_radians()));
        assert!(!asked && why.contains(&format!("{:.0}° off", degrees.abs())), "{why}");
        assert!(why.contains("EKF2_EV_CTRL 15") && why.contains("EK3_SRC1_YAW 6"), "{why}");
    }
    let (asked, why) = no_start(None);
    assert!(!asked && why.contains("does not tell its heading"), "{why}");
    assert!(no_start(Some(9_f64.to_radians())).0);
}

#[test]
fn a_mode_switch_that_is_seen_late_is_told_before_the_start() {
    for is_mode_prompt in [true, false] {
        let mut mission = Mission::new(Settings::default());
        let mut effects = Vec::new();
        let state = vehicle(false, FlightMode::Companion, LandedState::OnGround);
        let on_ground = |seconds| Inputs {
            vehicle: Some(VehicleState { is_mode_prompt, ..state }),
            ..inputs(seconds)
        };
        mission.on_operator(OperatorVerb::Start, &on_ground(0.0), &mut effects);
        mission.step(&on_ground(2.0), &mut effects);
        let told = |e: &Effect| matches!(e, Effect::Say(_, t) if t.contains("seen up to 1 s late"));
        assert_eq!(effects.iter().any(told), !is_mode_prompt, "{effects:?}");
        assert!(effects.contains(&Effect::Command(VehicleCommand::Arm)), "it may fly");
    }
}

#[test]
fn too_near_to_something_holds_goes_on_when_clear_and_lands_when_not() {
    for (is_clear_again, phase) in [(true, Phase::Survey), (false, Phase::Land)] {
        let mut mission = surveying();
        let mut effects = Vec::new();
        let near = |seconds, intrusion_m| Inputs { intrusion_m, ..flying(seconds) };
        mission.step(&near(20.0, 0.1), &mut effects);
        assert_eq!(mission.phase(), Phase::Survey);
        mission.step(&near(20.1, 0.2), &mut effects);
        assert_eq!(mission.phase(), Phase::Hold);
        let later_m = if is_clear_again { 0.0 } else { 0.2 };
        for step in 1..=40 {
            mission.step(&near(20.1 + 0.1 * f64::from(step), later_m), &mut effects);
        }
        assert_eq!(mission.phase(), phase);
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

#[test]
fn the_preflight_tells_what_it_measured() {
    let mut mission = Mission::new(Settings::default());
    let mut effects = Vec::new();
    mission.on_operator(OperatorVerb::Start, &inputs(0.0), &mut effects);
    let ready = Inputs {
        vehicle: Some(vehicle(false, FlightMode::Companion, LandedState::OnGround)),
        ..inputs(4.0)
    };
    mission.step(&ready, &mut effects);
    let said: Vec<&String> = effects
        .iter()
        .filter_map(|e| match e {
            Effect::Say(_, text) => Some(text),
            _ => None,
        })
        .collect();
    let line = "preflight: battery 90 %, position sigma 2 cm, autopilot off by 5 cm and 2 deg, heading off by 6 deg, LiDAR on";
    assert_eq!(said, [line]);
}

/// While samples come late the autopilot drifts: a hold lasts one second, then it lands.
#[test]
fn late_samples_hold_shortly_and_land() {
    let mut mission = surveying();
    let late = |seconds| Inputs { has_position: false, is_late: true, ..flying(seconds) };
    let mut effects = Vec::new();
    mission.step(&late(20.0), &mut effects);
    assert_eq!(mission.phase(), Phase::Hold);
    mission.step(&late(20.9), &mut effects);
    assert_eq!(mission.phase(), Phase::Hold);
    mission.step(&late(21.1), &mut effects);
    assert_eq!(mission.phase(), Phase::Land);
}

#[test]
fn a_flight_into_gaps_needs_gaps_and_is_not_the_other_start() {
    let mut effects = Vec::new();
    let mut mission = Mission::new(Settings::default());
    assert!(!mission.on_operator(OperatorVerb::FlyGaps, &inputs(0.0), &mut effects));
    assert!(effects.is_empty() && mission.phase() == Phase::Idle);
    let with_gaps = |seconds| Inputs { has_gaps: true, ..inputs(seconds) };
    assert!(mission.on_operator(OperatorVerb::FlyGaps, &with_gaps(1.0), &mut effects));
    assert!(mission.phase() == Phase::Preflight && mission.is_into_gaps());
    // A repetition is under way already; a survey from the beginning is something else.
    assert!(mission.on_operator(OperatorVerb::FlyGaps, &with_gaps(2.0), &mut effects));
    assert!(!mission.on_operator(OperatorVerb::Start, &with_gaps(2.0), &mut effects));
    assert!(mission.is_into_gaps(), "the refused wish changed nothing");
    assert!(mission.on_operator(OperatorVerb::Return, &with_gaps(3.0), &mut effects));
    assert!(mission.on_operator(OperatorVerb::Start, &with_gaps(4.0), &mut effects));
    assert!(!mission.is_into_gaps());
    assert!(!mission.on_operator(OperatorVerb::FlyGaps, &with_gaps(5.0), &mut effects));
    // In the air nobody begins another flight.
    let mut mission = surveying();
    let in_the_air = Inputs { has_gaps: true, ..flying(11.0) };
    assert!(!mission.on_operator(OperatorVerb::FlyGaps, &in_the_air, &mut effects));
    assert!(mission.phase() == Phase::Survey && !mission.is_into_gaps());
}

#[test]
fn nobody_starts_where_dust_may_explode_and_nobody_has_released_it() {
    let settings = Settings { is_dust_cleared: false, ..Settings::default() };
    for verb in [OperatorVerb::Start, OperatorVerb::FlyGaps] {
        let mut mission = Mission::new(settings);
        let mut effects = Vec::new();
        let all_well = |seconds| Inputs { has_gaps: true, ..inputs(seconds) };
        let faults: Vec<PreflightFault> =
            mission.preflight_checks(&all_well(0.0)).into_iter().filter_map(|c| c.fault).collect();
        assert_eq!(faults, [PreflightFault::DustZone]);
        mission.on_operator(verb, &all_well(0.0), &mut effects);
        for tenth in 1..1_200 {
            mission.step(&all_well(f64::from(tenth) / 10.0), &mut effects);
        }
        assert_eq!(mission.phase(), Phase::Idle);
        let arm = Effect::Command(VehicleCommand::Arm);
        assert!(!effects.contains(&arm), "{effects:?}");
    }
}
