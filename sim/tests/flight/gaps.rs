//! Another flight of the same survey, into what the first one left out.

use crate::support::{short_survey, timeless};
use mavlink::dialects::ardupilotmega::MavCmd;
use std::path::Path;
use std::time::Duration;
use stockpilot::config::{Config, SurfaceName};
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, FlightSummary, Outlook, Pilot};
use stockpilot::record::replay::replay;
use stockpilot::record::{LogHeader, Recorder};
use stockpilot::survey::{MergeOptions, merge_logs};
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::{Scenario, Surface};
use stockpilot_sim::world::World;

const SEED: u64 = 41;
/// A person calls the first flight home after so long in its survey: about half of the hall is seen.
const CUT_AFTER: Duration = Duration::from_secs(22);

/// A flight whose every event and result goes into a log.
struct Recorded {
    direct: DirectFlight,
    recorder: Recorder,
    phases: Vec<Phase>,
    starts: usize,
}

impl Recorded {
    fn new(scenario: &Scenario, config: &Config, log: &Path) -> Self {
        let config_toml = config.to_toml().expect("TOML");
        let header = LogHeader { config_toml, ..LogHeader::default() };
        Self {
            direct: DirectFlight::with_config(scenario, config).expect("a flight"),
            recorder: Recorder::create(log, &header).expect("a log").waiting(),
            phases: Vec::new(),
            starts: 0,
        }
    }

    fn step(&mut self) {
        let Self { direct, recorder, phases, starts } = self;
        direct.step(&mut |now, seen| match seen {
            Witnessed::Event(event) => recorder.event(now, event),
            Witnessed::Action(action) => {
                if let Action::PhaseChanged(change) = action {
                    phases.push(change.to);
                    *starts += usize::from(change.to == Phase::TakeOff);
                }
                recorder.result(now, action);
            }
            Witnessed::ToAutopilot(_) => {}
        });
    }

    /// Runs until `done`, at most for five minutes.
    fn run_until(&mut self, what: &str, done: impl Fn(&Self) -> bool) {
        let limit = self.now().plus(Duration::from_secs(300));
        while !done(self) {
            assert!(self.now() < limit, "no {what}: {:?} {:?}", self.phases, self.direct.texts());
            self.step();
        }
    }

    fn now(&self) -> Stamp<Mono> {
        self.direct.rig.now()
    }

    fn outlook(&self) -> Outlook {
        self.direct.outlook()
    }

    /// The summary of the flight that ends next.
    fn land(&mut self) -> FlightSummary {
        let before = self.direct.summary().map(|summary| summary.at);
        self.run_until("landing", |f| f.direct.summary().map(|summary| summary.at) != before);
        self.direct.summary().expect("it has landed").clone()
    }
}

#[test]
fn the_gaps_of_a_survey_cut_short_are_flown_on_its_kept_map() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("two-flights.mcap");
    let scenario = Scenario {
        world: World::piles(3).expect("a generated world"),
        surface: Surface::MaternField,
        ..short_survey(SEED, 50)
    };
    let mut config = config(&scenario, Devices::none());
    config.surface.method = SurfaceName::MaternField;
    config.surface.solve_interval_s = Some(30.0);
    let mut flight = Recorded::new(&scenario, &config, &log);

    // GIVEN a survey that a person has called home in its middle
    assert!(flight.outlook().gaps.is_empty());
    flight.run_until("survey", |f| f.direct.phase() == Phase::Survey);
    let cut_at = flight.now().plus(CUT_AFTER);
    flight.run_until("cut", |f| f.now() >= cut_at);
    flight.direct.operator_mut().ask(MavCmd::MAV_CMD_USER_4);
    let first = flight.land();
    let truth_m3 = flight.direct.report(&scenario, Duration::ZERO).expect("landed").volume_true_m3;
    let offered = flight.outlook().gaps;
    println!("SEED={SEED} first {:?} of {truth_m3}: {offered:#?}", first.volume);
    assert!(!first.is_complete && offered.iter().any(|gap| gap.is_in_reach));
    let area_m2: f64 = offered.iter().map(|gap| gap.area_m2).sum();
    // What lies beyond the legs that were flown, and most of what is not known.
    assert!(area_m2 > 50.0 && offered.iter().map(|gap| gap.share).sum::<f64>() > 0.5);
    let told = flight.direct.texts().iter().any(|text| text.contains("to fly: largest"));
    assert!(told, "{:?}", flight.direct.texts());

    // WHEN nobody asks, nothing flies
    let later = flight.now().plus(Duration::from_secs(20));
    flight.run_until("waiting", |f| f.now() >= later);
    assert_eq!((flight.direct.phase(), flight.starts), (Phase::Idle, 1));

    // WHEN it is asked for and called off, the survey is still there
    flight.direct.operator_mut().ask_for_gaps();
    flight.run_until("preflight", |f| f.direct.phase() == Phase::Preflight);
    flight.direct.operator_mut().ask(MavCmd::MAV_CMD_USER_4);
    flight.run_until("idle", |f| f.direct.phase() == Phase::Idle);
    assert_eq!(flight.outlook().gaps, offered);
    // A start that was called off is not taken up by what may be its repetition.
    let later = flight.now().plus(Duration::from_secs(12));
    flight.run_until("waiting", |f| f.now() >= later);

    // WHEN the gaps are asked for again, they are flown
    flight.direct.operator_mut().ask_for_gaps();
    let second = flight.land();
    println!("second {:?}: {:#?}", second.volume, flight.outlook().gaps);
    assert_eq!(flight.starts, 2);
    let flown = [Phase::Preflight, Phase::TakeOff, Phase::Survey, Phase::Return, Phase::Land];
    assert_eq!(flight.phases[flight.phases.len() - 6..][..5], flown);

    // THEN they are seen, on top of what was known
    assert!(second.is_complete && second.steps_done > 3);
    let left_m2: f64 = flight.outlook().gaps.iter().map(|gap| gap.area_m2).sum();
    assert!(left_m2 < 0.2 * area_m2, "{left_m2} m² of {area_m2} m² are left");
    let [before, after] = [&first.volume, &second.volume];
    assert!(after.coverage_ratio > before.coverage_ratio + 0.15);
    assert!(second.hits.used > first.hits.used + 10_000, "hits are added");
    assert!(after.sigma_m3 < 0.3 * before.sigma_m3, "{before:?} {after:?}");
    let off_m3 = |volume: f64| (volume - truth_m3).abs();
    assert!(off_m3(after.volume_m3) < 4.0 * after.sigma_m3, "{after:?} of {truth_m3}");
    assert!(off_m3(after.volume_m3) < off_m3(before.volume_m3));

    // THEN the log gives the same again, and its turns are one survey
    let stats = flight.recorder.close();
    assert_eq!(stats.lost_in_queue, 0);
    let again =
        replay(&log, |toml| Config::from_toml(toml, &log)?.pilot_settings().map(Pilot::new))
            .expect("a replay");
    assert!(again.identical && again.is_complete, "{again:?}");
    let merged = merge_logs(&[log], MergeOptions::default()).expect("one hall");
    assert_eq!(merged.logs[0].n_flights, 1);
    assert_eq!(timeless(&merged.accounts), timeless(&second.accounts));
}
