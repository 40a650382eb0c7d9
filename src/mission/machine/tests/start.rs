//! From the wish to start until the vehicle is in the air.

use super::*;

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
