//! A flight whose process is killed, or asked to end, leaves a log that replays.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "tests may panic")]

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use stockpilot::config::Config;
use stockpilot::messages::OperatorVerb;
use stockpilot::pilot::{Event, Pilot};
use stockpilot::record::replay::{ReplayReport, replay};
use stockpilot::record::{LogItem, LogReader, RecordedEvent};
use tempfile::TempDir;

/// Times the clock of the wall. A busy machine may halt the flight for a good part of a second,
/// which the service takes as a silent autopilot if it is much longer in flight.
const SPEED: f64 = 2.0;

/// A flight in the middle of its survey, with jobs behind it and one perhaps under way.
struct Surveying {
    program: Child,
    /// Held open: nobody writes progress into a closed pipe.
    progress: BufReader<ChildStderr>,
    /// The flight's own clock as it was last shown, s.
    shown_s: f64,
    directory: TempDir,
}

impl Surveying {
    fn begin() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let mut program = Command::new(env!("CARGO_BIN_EXE_stockpilot-sim"))
            .args(["fly", "--world", "piles", "--seed", "5", "--speed", &SPEED.to_string()])
            .arg("--log")
            .arg(directory.path())
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let mut progress = BufReader::new(program.stderr.take().unwrap());
        let (mut shown_s, mut is_surveying) = (0.0, false);
        let mut shown = Vec::new();
        for line in progress.by_ref().lines() {
            let line = line.unwrap();
            let seconds = line.split_once(" s ").and_then(|(t, _)| t.trim().parse::<f64>().ok());
            shown_s = seconds.unwrap_or(shown_s);
            is_surveying = line.contains("survey") && shown_s > 20.0;
            shown.push(line);
            if is_surveying {
                break;
            }
        }
        if !is_surveying {
            program.wait().unwrap();
        }
        assert!(is_surveying, "the flight ended without a survey:\n{}", shown.join("\n"));
        Self { program, progress, shown_s, directory }
    }

    /// Waits for the end of the program; judges its log, which must hold all but `lost_s`.
    /// The replay, and the landing that was asked for.
    fn replay(mut self, lost_s: f64) -> (ReplayReport, Option<Landing>) {
        std::io::copy(&mut self.progress, &mut std::io::sink()).unwrap();
        self.program.wait().unwrap();
        let shown_s = self.shown_s;
        let log = std::fs::read_dir(self.directory.path())
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .find(|path| path.extension().is_some_and(|e| e == "mcap"))
            .expect("a log");
        let last_s = last_event_s(&log);
        assert!(last_s > shown_s - lost_s, "the log ends at {last_s} s, shown were {shown_s} s");
        let report = replay(&log, |toml| {
            Config::from_toml(toml, &log).and_then(|config| config.pilot_settings()).map(Pilot::new)
        })
        .unwrap();
        assert!(report.identical, "{:?}", report.first_difference);
        assert!(report.results_compared > 500);
        (report, Landing::asked_for(&log))
    }
}

#[test]
fn a_log_survives_sigkill_but_for_its_last_second_and_replays_identically() {
    let mut flight = Surveying::begin();
    flight.program.kill().unwrap();
    // One second of the wall's clock is `SPEED` seconds of flight; one more for the progress line.
    let (report, landing) = flight.replay(SPEED + 1.0);
    assert!(!report.is_complete && landing.is_none(), "{landing:?}");
}

#[test]
fn a_service_that_is_asked_to_end_in_flight_lands_first_and_closes_its_log() {
    let flight = Surveying::begin();
    let pid = flight.program.id().to_string();
    let asked = Command::new("kill").args(["-TERM", &pid]).status().unwrap();
    assert!(asked.success());
    // What is shown is rounded to a second.
    let (report, landing) = flight.replay(1.0);
    assert!(report.is_complete);
    let landing = landing.expect("a landing was asked for");
    // From 7 m, with a place of its own to the ground, and until the motors stand.
    assert!(landing.took_s > 5.0 && !landing.is_armed, "{landing:?}");
    assert!(landing.longest_without_fix_s < 0.5, "{landing:?}");
}

/// What the log has from the wish to land on.
#[derive(Debug)]
struct Landing {
    took_s: f64,
    longest_without_fix_s: f64,
    /// By the last heartbeat.
    is_armed: bool,
}

impl Landing {
    fn asked_for(log: &Path) -> Option<Self> {
        let mut landing: Option<Self> = None;
        let (mut asked_s, mut fix_s) = (0.0, 0.0);
        for item in LogReader::<BufReader<std::fs::File>>::open(log).unwrap() {
            let LogItem::Event { event, at } = item else { continue };
            let now_s = at.seconds();
            match (&event, &mut landing) {
                (RecordedEvent::Plain(Event::Operator(command)), None)
                    if command.verb == OperatorVerb::Land =>
                {
                    (asked_s, fix_s) = (now_s, now_s);
                    landing =
                        Some(Self { took_s: 0.0, longest_without_fix_s: 0.0, is_armed: true });
                }
                (RecordedEvent::Plain(Event::TagsSeen(_)), Some(_)) => fix_s = now_s,
                (RecordedEvent::Plain(Event::Vehicle(vehicle)), Some(landing)) => {
                    landing.is_armed = vehicle.is_armed;
                    landing.took_s = now_s - asked_s;
                }
                _ => {}
            }
            if let Some(landing) = &mut landing {
                landing.longest_without_fix_s = landing.longest_without_fix_s.max(now_s - fix_s);
            }
        }
        landing
    }
}

/// When the last readable event was taken in, s.
fn last_event_s(log: &Path) -> f64 {
    let events = LogReader::<BufReader<std::fs::File>>::open(log).unwrap();
    let last = events
        .filter_map(|item| match item {
            LogItem::Event { at, .. } => Some(at.seconds()),
            _ => None,
        })
        .last();
    last.expect("events")
}
