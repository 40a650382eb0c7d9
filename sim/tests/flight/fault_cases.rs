//! Cases of the fault harness that guard a safety rule; `stockpilot-sim faults` runs all of them.

use stockpilot_sim::autopilot::Flavour;
use stockpilot_sim::faults::{CASES, run_case};

fn passes(number: u32) {
    let case = CASES.iter().find(|case| case.number == number).expect("that case");
    for flavour in Flavour::ALL {
        if case.only.is_none_or(|only| only == flavour) {
            let report = run_case(case, flavour, 40).expect("a flight");
            assert!(report.passed, "{report:#?}");
        }
    }
}

#[test]
fn a_companion_that_dies_and_comes_back_does_not_resume() {
    passes(1);
}

#[test]
fn an_autopilot_whose_estimate_drifts_away_is_told_to_land() {
    passes(26);
}

#[test]
fn an_origin_at_an_altitude_does_not_make_px4_climb_away() {
    passes(101);
}

#[test]
fn a_vehicle_that_hears_nothing_is_not_led_far_ahead_afterwards() {
    passes(34);
}

#[test]
fn a_vehicle_that_is_blown_towards_a_wall_is_led_away_from_it() {
    passes(35);
}

#[test]
fn no_setpoint_reaches_ardupilot_on_the_ground() {
    passes(105);
}

#[test]
fn every_number_of_the_matrix_is_there_once() {
    let numbers: Vec<u32> = CASES.iter().map(|case| case.number).collect();
    assert!(numbers.is_sorted_by(|a, b| a < b));
    assert!((1..=25).all(|number| numbers.contains(&number)), "{numbers:?}");
}
