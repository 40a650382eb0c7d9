//! Long work takes its time in virtual time, and nothing waits for it that does not need it.

use crate::support::short_survey;
use std::collections::BTreeMap;
use stockpilot::pilot::{Action, Event, Job};
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::{Planner, Scenario};

/// A job, and between which times it was under way, s.
struct Done {
    is_search: bool,
    from_s: f64,
    to_s: f64,
}

#[test]
fn a_solve_that_begins_during_a_search_is_back_before_it() {
    const SEED: u64 = 21;
    println!("SEED={SEED}");
    let scenario = Scenario { planner: Planner::Horizon, ..short_survey(SEED, 8) };
    let mut config = config(&scenario, Devices::none());
    config.planning.search_effort = 0.05;
    config.surface.solve_interval_s = Some(0.5);
    let mut flight = DirectFlight::with_config(&scenario, &config).expect("a flight");
    let (mut begun, mut done) = (BTreeMap::new(), Vec::new());
    while flight.summary().is_none() && flight.rig.now().seconds() < 25.0 {
        flight.step(&mut |now, seen| match seen {
            Witnessed::Action(Action::Start { id, job }) => {
                let is_search = matches!(job.as_ref(), Job::Plan(_));
                begun.insert(*id, (is_search, now.seconds()));
            }
            Witnessed::Event(Event::Finished { id, .. }) => {
                let (is_search, from_s) = begun.remove(id).expect("it has begun, and is back once");
                done.push(Done { is_search, from_s, to_s: now.seconds() });
            }
            _ => {}
        });
    }
    for Done { is_search, from_s, to_s } in &done {
        let takes_s = if *is_search { 0.8 } else { 0.1 };
        let late_s = to_s - from_s - takes_s;
        assert!((-1e-6..0.05).contains(&late_s), "search: {is_search}, {from_s} s to {to_s} s");
    }
    let searches = || done.iter().filter(|job| job.is_search);
    let n_overtaking = done
        .iter()
        .filter(|solve| !solve.is_search)
        .filter(|solve| searches().any(|s| s.from_s < solve.from_s && solve.to_s < s.to_s))
        .count();
    println!(
        "{} searches, {n_overtaking} solves of {} jobs overtook one",
        searches().count(),
        done.len()
    );
    assert!(searches().count() >= 2 && n_overtaking >= 2);
}
