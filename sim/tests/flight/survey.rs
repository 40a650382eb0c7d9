//! Flights without faults.

use crate::support::{Flight, short_survey};
use stockpilot::mission::Phase;
use stockpilot::pilot::Action;
use stockpilot_sim::campaign::{self, Witnessed};
use stockpilot_sim::report::RunReport;

/// The report, and every action in the order of the flight.
fn flown(seed: u64) -> (RunReport, Vec<String>) {
    let mut actions = Vec::new();
    let report = campaign::run(&short_survey(seed, 1), |at, seen| {
        let Witnessed::Action(action) = seen else { return };
        // Jobs and surfaces are long, and their volumes come in the reports.
        if !matches!(action, Action::Start { .. } | Action::SurfaceSolved(_)) {
            actions.push(format!("{at:?} {action:?}"));
        }
    })
    .expect("a flight with an end");
    (report, actions)
}

#[test]
fn a_short_survey_lands_by_itself_complete_and_twice_with_the_same_bits() {
    let ((report, actions), (again, actions_again)) = std::thread::scope(|scope| {
        let flights = [11, 11].map(|seed| scope.spawn(move || flown(seed)));
        let [first, second] = flights.map(|flight| flight.join().expect("no panic"));
        (first, second)
    });
    assert!(report.complete && !report.collided, "{report:?}");
    // At least one step on each of the seven edges of the square wave, and its start.
    assert_eq!(report.steps, 8);
    assert!(report.coverage > 0.3, "too little was measured: {report:?}");
    assert!(report.position_within_3_sigma > 0.95, "{}", report.position_within_3_sigma);

    assert!(actions.len() > 1_000, "only {} actions", actions.len());
    let parting = std::iter::zip(&actions, &actions_again).find(|(a, b)| a != b);
    assert!(parting.is_none(), "{parting:?}");
    assert_eq!(actions.len(), actions_again.len());
    let bits = |r: &RunReport| {
        [r.volume_m3, r.sigma_m3, r.path_length_m, r.sim_time_s, r.coverage].map(f64::to_bits)
    };
    assert_eq!(bits(&report), bits(&again));
}

#[test]
fn phases_follow_each_other_and_the_autopilot_stands_disarmed() {
    let mut flight = Flight::new(&short_survey(5, 3));
    assert!(flight.run_until(240.0, |f| f.has_ended()), "{:?}", flight.seen.changes);
    let phases: Vec<Phase> = flight.seen.changes.iter().map(|change| change.to).collect();
    let expected =
        [Phase::Preflight, Phase::TakeOff, Phase::Survey, Phase::Return, Phase::Land, Phase::Idle];
    assert_eq!(phases, expected, "{:?}", flight.seen.changes);
    assert!(flight.direct.rig.autopilot().is_landed() && !flight.direct.rig.autopilot().is_armed());
    // Nothing flies by itself again.
    let n_commands = flight.seen.commands.len();
    flight.run(5.0);
    assert_eq!(flight.phase(), Phase::Idle);
    assert_eq!(flight.seen.commands.len(), n_commands);
}
