//! Flights without faults.

use crate::support::{Flight, short_survey};
use stockpilot::mission::Phase;
use stockpilot::pilot::Action;
use stockpilot_sim::campaign;

#[test]
fn a_short_survey_lands_by_itself_and_is_complete() {
    let report = campaign::run(&short_survey(3, 6), |_, _| {}).expect("a flight with an end");
    assert!(report.complete, "{report:?}");
    assert!(!report.collided, "{report:?}");
    // Whole steps on every edge of the square wave can make a few more than asked for.
    assert!((6..=8).contains(&report.steps), "{} steps", report.steps);
    assert!(report.coverage > 0.02, "nothing was measured: {report:?}");
    // Six steps see a corner of the hall only; the interval must say so.
    assert!(report.sigma_m3 > 0.0 && report.sigma_m3.is_finite());
    assert!(report.volume_m3.is_finite());
    assert!(report.position_within_3_sigma > 0.95, "{}", report.position_within_3_sigma);
}

/// Numbers of the report, and every action in the order of the flight.
fn flown(seed: u64) -> ([u64; 4], Vec<String>) {
    let mut actions = Vec::new();
    let report = campaign::run(&short_survey(seed, 1), |at, action| {
        // Jobs and surfaces are long, and their volumes come in the reports.
        if !matches!(action, Action::Start { .. } | Action::SurfaceSolved(_)) {
            actions.push(format!("{at:?} {action:?}"));
        }
    })
    .expect("a flight with an end");
    let numbers = [report.volume_m3, report.sigma_m3, report.path_length_m, report.sim_time_s];
    (numbers.map(f64::to_bits), actions)
}

#[test]
fn same_seed_same_bits_and_another_seed_others() {
    let (first, again, other) = std::thread::scope(|scope| {
        let [first, again, other] = [11, 11, 12].map(|seed| scope.spawn(move || flown(seed)));
        let joined =
            |flight: std::thread::ScopedJoinHandle<'_, _>| flight.join().expect("no panic");
        (joined(first), joined(again), joined(other))
    });
    assert!(first.1.len() > 1_000, "only {} actions", first.1.len());
    assert_eq!(first.0, again.0);
    let parting = std::iter::zip(&first.1, &again.1).find(|(a, b)| a != b);
    assert!(parting.is_none(), "{parting:?}");
    assert_eq!(first.1.len(), again.1.len());
    assert_ne!(first.0, other.0);
}

#[test]
fn phases_follow_each_other_and_the_autopilot_stands_disarmed() {
    let mut flight = Flight::new(&short_survey(5, 3));
    assert!(flight.run_until(240.0, |f| f.summary.is_some()), "{:?}", flight.changes);
    let phases: Vec<Phase> = flight.changes.iter().map(|change| change.to).collect();
    let expected =
        [Phase::Preflight, Phase::TakeOff, Phase::Survey, Phase::Return, Phase::Land, Phase::Idle];
    assert_eq!(phases, expected, "{:?}", flight.changes);
    assert!(flight.rig.autopilot().is_landed() && !flight.rig.autopilot().is_armed());
    // Nothing flies by itself again.
    let n_commands = flight.commands.len();
    flight.run(5.0);
    assert_eq!(flight.phase(), Phase::Idle);
    assert_eq!(flight.commands.len(), n_commands);
}
