//! A last solve that fails leaves no final volume, and nobody is told one.

use crate::support::short_survey;
use stockpilot::config::Config;
use stockpilot::mapping::{SolveError, sparse_gp::GpError};
use stockpilot::pilot::{Action, Event, FlightSummary, Job, JobId, JobOutput, Pilot};
use stockpilot::record::{LogHeader, Recorder, read_accounts};
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::hall::{Devices, config};

/// What a flight has told the brain, and which solve was its last.
fn flown(seed: u64) -> (Config, Vec<(Stamp<Mono>, Event)>, JobId) {
    let scenario = short_survey(seed, 8);
    let config = config(&scenario, Devices::none());
    let mut flight = DirectFlight::with_config(&scenario, &config).expect("a flight");
    let (mut events, mut last_solve) = (Vec::new(), None);
    while flight.summary().is_none() && flight.rig.now().seconds() < 300.0 {
        flight.step(&mut |now, seen| match seen {
            Witnessed::Event(event) => events.push((now, event.clone())),
            Witnessed::Action(Action::Start { id, job }) => {
                if matches!(job.as_ref(), Job::SolveSurface(_)) {
                    last_solve = Some(*id);
                }
            }
            Witnessed::Action(_) | Witnessed::ToAutopilot(_) => {}
        });
    }
    (config, events, last_solve.expect("a solve after landing"))
}

/// The same events once more, the result of one job replaced: the summary, all that was reported as final,
/// and whether the log calls its volumes final.
fn again(
    config: &Config,
    events: &[(Stamp<Mono>, Event)],
    replaced: Option<&(JobId, JobOutput)>,
) -> (FlightSummary, Vec<String>, usize, bool) {
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("flight.mcap");
    let header = LogHeader { config_toml: config.to_toml().expect("TOML"), ..LogHeader::default() };
    let mut recorder = Recorder::create(&log, &header).expect("a log").waiting();
    let mut pilot = Pilot::new(config.pilot_settings().expect("valid"));
    let (mut summary, mut texts, mut n_final) = (None, Vec::new(), 0);
    for (now, event) in events {
        let event = match (event, replaced) {
            (Event::Finished { at, id, .. }, Some((wanted, output))) if id == wanted => {
                Event::Finished { at: *at, id: *id, output: Box::new(output.clone()) }
            }
            _ => event.clone(),
        };
        let mut actions = Vec::new();
        pilot.step(event, &mut actions);
        for action in actions {
            recorder.result(*now, &action);
            match action {
                Action::Ended(ended) => summary = Some(*ended),
                Action::Say(line) => texts.push(line.text),
                Action::ReportVolume(report) => n_final += usize::from(report.is_final),
                _ => {}
            }
        }
    }
    let _stats = recorder.close();
    let is_final = read_accounts(&log).expect("a log").is_final;
    (summary.expect("it has ended"), texts, n_final, is_final)
}

#[test]
fn volumes_of_a_flight_whose_last_solve_fails_are_not_final() {
    const SEED: u64 = 12;
    println!("SEED={SEED}");
    let (config, events, last_solve) = flown(SEED);
    let (summary, texts, n_final, is_final) = again(&config, &events, None);
    assert!(summary.is_final && is_final && n_final == 1, "{texts:?}");
    assert!(!texts.iter().any(|text| text.contains("no final volume")), "{texts:?}");
    let refused = JobOutput::SurfaceSolved(Err(SolveError::Grid(GpError::NotPositiveDefinite)));
    for output in [JobOutput::Died, refused] {
        let replaced = (last_solve, output);
        let (summary, texts, n_final, is_final) = again(&config, &events, Some(&replaced));
        assert!(!summary.is_final && !is_final, "{replaced:?}");
        assert_eq!(n_final, 0, "no volume goes to the ground as the final one: {replaced:?}");
        assert!(texts.iter().any(|text| text.contains("no final volume")), "{texts:?}");
    }
}
