//! Holds: what brings them about, what ends them.

use super::*;

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
