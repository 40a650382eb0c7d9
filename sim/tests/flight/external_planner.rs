//! Surveys whose waypoints a program outside chooses.

use crate::support::short_survey;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use stockpilot::config::Config;
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, Event, Pilot};
use stockpilot::record::replay::replay;
use stockpilot::record::{LogHeader, Recorder};
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::{Conditions, Planner, Scenario};

/// A survey planned by this program, which may take so long.
fn planned_by(program: &Path, n_steps: usize, time_limit_s: f64) -> (Scenario, Config) {
    let scenario = Scenario {
        planner: Planner::External,
        conditions: Conditions {
            planner_command: vec![program.to_str().expect("a path in UTF-8").to_owned()],
            ..Conditions::default()
        },
        ..short_survey(4, n_steps)
    };
    let mut config = config(&scenario, Devices::none());
    config.planning.external.as_mut().expect("a program").time_limit_s = time_limit_s;
    (scenario, config)
}

fn program(folder: &Path, text: &str) -> std::path::PathBuf {
    let path = folder.join("planner");
    std::fs::write(&path, text).expect("a file");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("executable");
    path
}

/// Flies to the end; every event and action goes to `witness`.
fn fly(
    scenario: &Scenario,
    config: &Config,
    mut witness: impl FnMut(stockpilot::time::Stamp<stockpilot::time::Mono>, Witnessed<'_>),
) -> DirectFlight {
    let mut flight = DirectFlight::with_config(scenario, config).expect("it fits");
    while flight.summary().is_none() && flight.rig.now().seconds() < 300.0 {
        flight.step(&mut witness);
    }
    assert!(flight.summary().is_some(), "no end: {:?}", flight.texts());
    flight
}

#[test]
fn the_example_flies_a_survey_and_a_replay_needs_no_program() {
    let folder = tempfile::tempdir().expect("a folder");
    let example = include_str!("../../../deploy/planners/nearest_unseen.py");
    let program = program(folder.path(), example);
    let (scenario, config) = planned_by(&program, 6, 60.0);
    let log = folder.path().join("flight.mcap");
    let header = LogHeader { config_toml: config.to_toml().expect("TOML"), ..LogHeader::default() };
    let mut recorder = Recorder::create(&log, &header).expect("a log").waiting();
    let mut n_asked = 0;
    let flight = fly(&scenario, &config, |now, witnessed| match witnessed {
        Witnessed::Event(event) => {
            let is_answer = |output: &stockpilot::pilot::JobOutput| output.outside().is_some();
            n_asked +=
                u32::from(matches!(event, Event::Finished { output, .. } if is_answer(output)));
            recorder.event(now, event);
        }
        Witnessed::Action(action) => recorder.result(now, action),
        Witnessed::ToAutopilot(_) => {}
    });
    let summary = flight.summary().expect("an end").clone();
    // The example keeps half a step in reserve for ways around, so it may end before the last one.
    assert!((4..=6).contains(&summary.steps_done), "{} {:?}", summary.steps_done, flight.texts());
    assert!(summary.volume.coverage_ratio > 0.1 && n_asked >= 1, "asked {n_asked} times");
    let stats = recorder.close();
    assert_eq!(stats.lost_in_queue, 0);

    std::fs::remove_file(&program).expect("it was there");
    let report = replay(&log, |toml| {
        Config::from_toml(toml, &log).and_then(|config| config.pilot_settings()).map(Pilot::new)
    })
    .expect("a replay");
    assert!(report.identical && report.is_complete, "{:?}", report.first_difference);
    assert!(report.results_compared > 500, "{}", report.results_compared);
}

#[test]
fn a_program_that_fails_is_told_and_the_vehicle_comes_home() {
    let folder = tempfile::tempdir().expect("a folder");
    for (text, reason) in [
        ("#!/bin/sh\nexit 7\n", "exit status: 7"),
        ("#!/bin/sh\nexec sleep 1000\n", "no answer within 0.5 s"),
        ("#!/bin/sh\nyes\n", "it says more than"),
    ] {
        let program = program(folder.path(), text);
        let (scenario, config) = planned_by(&program, 6, 0.5);
        let (mut phases, mut n_setpoints_in_survey) = (Vec::new(), 0);
        let flight = fly(&scenario, &config, |_, witnessed| match witnessed {
            Witnessed::Action(Action::PhaseChanged(change)) => phases.push(change.to),
            Witnessed::Action(Action::Steer(_)) if phases.last() == Some(&Phase::Survey) => {
                n_setpoints_in_survey += 1;
            }
            _ => {}
        });
        let told = flight.texts();
        let n_told = told.iter().filter(|line| line.contains(reason)).count();
        assert_eq!(n_told, 3, "{reason}: {told:?}");
        assert!(told.iter().any(|line| line.contains("ending the survey")), "{told:?}");
        assert!(phases.contains(&Phase::Return) && phases.contains(&Phase::Land), "{phases:?}");
        let summary = flight.summary().expect("an end");
        assert!(!summary.is_complete && summary.steps_done == 0, "{summary:?}");
    }
}
