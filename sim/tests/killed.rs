//! A flight whose process is killed leaves a log that replays.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "tests may panic")]

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use stockpilot::config::Config;
use stockpilot::pilot::Pilot;
use stockpilot::record::replay::replay;
use stockpilot::record::{LogItem, LogReader};

const SPEED: f64 = 4.0;

#[test]
fn a_log_survives_sigkill_but_for_its_last_second_and_replays_identically() {
    let directory = tempfile::tempdir().unwrap();
    let mut program = Command::new(env!("CARGO_BIN_EXE_stockpilot-sim"))
        .args(["fly", "--world", "piles", "--seed", "5", "--speed", &SPEED.to_string(), "--log"])
        .arg(directory.path())
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut shown_s = 0.0;
    for line in BufReader::new(program.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        let seconds = line.split_once(" s ").and_then(|(t, _)| t.trim().parse::<f64>().ok());
        shown_s = seconds.unwrap_or(shown_s);
        // In the middle of the survey, with jobs behind it and one perhaps under way.
        if line.contains("survey") && shown_s > 20.0 {
            break;
        }
    }
    program.kill().unwrap();
    program.wait().unwrap();
    assert!(shown_s > 20.0, "the flight ended at {shown_s} s by itself");

    let log = std::fs::read_dir(directory.path())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.extension().is_some_and(|e| e == "mcap"))
        .expect("a log");
    let last_s = last_event_s(&log);
    // One second of the wall's clock is `SPEED` seconds of flight; one more for the progress line.
    assert!(last_s > shown_s - SPEED - 1.0, "the log ends at {last_s} s, shown were {shown_s} s");
    let report = replay(&log, |toml| {
        Config::from_toml(toml, &log).and_then(|config| config.pilot_settings()).map(Pilot::new)
    })
    .unwrap();
    assert!(report.identical, "{:?}", report.first_difference);
    assert!(!report.is_complete);
    assert!(report.results_compared > 500);
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
