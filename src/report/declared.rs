//! What named people have said before the motors turned, and what the configuration says of dust.

use super::content::{Column, Part, Table};
use super::words;
use crate::config::DustZone;
use crate::messages::{Declaration, OperatorVerb};
use crate::survey::{Flight, Reproduction};
use crate::time::{Mono, Stamp};
use serde::Serialize;

/// What each declaration says; whoever does not say all of it does not start.
const STATEMENTS: &str = "nobody is in the hall and nobody can walk in; the remote control is at hand, its mode and \
    kill switches are tried; machines stand, doors and fans are as in the last survey; the hall is no dust zone, or \
    a named person has released it";

/// A declaration in the JSON form.
#[derive(Debug, Serialize)]
pub(super) struct DeclarationData {
    declared_utc: Option<String>,
    /// On the log's clock.
    declared_at_ns: i64,
    declared_by: String,
    /// `start`, or `fly_gaps`.
    before: &'static str,
    /// All of it was said.
    statements: &'static str,
}

/// What is said of dust, in the JSON form.
#[derive(Debug, Serialize)]
pub(super) struct DustData {
    /// `none`, `released`, `undeclared`; nothing in logs of programs that did not ask.
    zone: Option<DustZone>,
    released_by: Option<String>,
}

pub(super) fn data(flight: &Flight) -> Vec<DeclarationData> {
    let of = |(at, said): &(Stamp<Mono>, Declaration)| DeclarationData {
        declared_utc: flight.civil(*at).map(|at| at.to_string()),
        declared_at_ns: at.nanos(),
        declared_by: said.by.clone(),
        before: if said.verb == OperatorVerb::FlyGaps { "fly_gaps" } else { "start" },
        statements: STATEMENTS,
    };
    flight.declarations.iter().map(of).collect()
}

pub(super) fn dust(flight: &Flight) -> DustData {
    // A log from before the question was asked is read as if it had been answered.
    let is_asked = flight.config_toml.lines().any(|line| line.starts_with("dust_zone"));
    let zone = is_asked.then_some(flight.config.hall.dust_zone);
    DustData { zone, released_by: flight.config.hall.dust_released_by.clone() }
}

/// The part of the report.
pub(super) fn parts(flight: &Flight) -> Vec<Part> {
    let mut rows: Vec<Vec<String>> =
        flight.declarations.iter().map(|said| row(flight, said)).collect();
    let has_said = !rows.is_empty();
    if !has_said {
        let none = match flight.reproduction {
            Reproduction::ResultsOnly => "in the logs that this one was merged from",
            Reproduction::Identical | Reproduction::Different => {
                "none in the log: the start did not come from the page, or its program did not keep them"
            }
        };
        rows.push(vec!["Declarations".to_owned(), "–".to_owned(), none.to_owned()]);
    }
    rows.push(vec!["Configuration".to_owned(), "–".to_owned(), dust_said(&dust(flight))]);
    let columns =
        vec![Column::words("When", 1.3), Column::words("Who", 1.2), Column::words("What", 3.2)];
    let mut parts = vec![
        Part::Heading("What was said before the motors turned".to_owned()),
        Part::Table(Table { columns, rows }),
    ];
    if has_said {
        let text = format!(
            "Each declaration says: {STATEMENTS}. Names are as typed; nobody has checked who typed them."
        );
        parts.push(Part::Text(text));
    }
    parts
}

fn row(flight: &Flight, (at, said): &(Stamp<Mono>, Declaration)) -> Vec<String> {
    let when = flight.civil(*at).map_or_else(
        || format!("{:.0}\u{a0}s into the log", at.seconds_since(flight.began_at)),
        |at| format!("{}, {} UTC", words::date(at), words::time(at)),
    );
    let before = match said.verb {
        OperatorVerb::FlyGaps => "before the flight into the gaps",
        _ => "before the START",
    };
    vec![when, said.by.clone(), format!("the four statements below, {before}")]
}

fn dust_said(dust: &DustData) -> String {
    match (dust.zone, &dust.released_by) {
        (None, _) => "dust: not asked by the program that flew".to_owned(),
        (Some(DustZone::Undeclared), _) => "dust: nothing is said of it".to_owned(),
        (Some(DustZone::None), _) => "the hall is no dust zone".to_owned(),
        (Some(DustZone::Released), by) => {
            format!("the dust zone is released by {}", by.as_deref().unwrap_or("nobody named"))
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::messages::{
        Declaration, HitCounts, OperatorCommand, OperatorRequest, OperatorVerb, VolumeAccount,
        VolumeBudget, VolumeEstimate, VolumeShares,
    };
    use crate::mission::Phase;
    use crate::pilot::{Action, Event, FlightSummary, PhaseChange};
    use crate::record::{LogHeader, Recorder};
    use crate::report::{Facts, Report, Wishes};
    use crate::survey::Flight;
    use crate::time::Stamp;
    use std::path::Path;

    /// The report of a flight that `by` started from the page, or somebody elsewhere.
    fn report_of(dust: &str, by: Option<&str>) -> Report {
        let example = include_str!("../../deploy/config.example.toml");
        let config_toml = example.replace("dust_zone = \"undeclared\"\n", dust);
        assert_ne!(config_toml, example, "the example speaks of it");
        let notes = [("started_utc".to_owned(), "2026-03-04T05:06:07Z".to_owned())].into();
        let header = LogHeader { config_toml, notes, ..LogHeader::default() };
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("flight.mcap");
        let mut recorder = Recorder::create(&log, &header).unwrap().waiting();
        let at = Stamp::from_nanos(10_000_000_000);
        if let Some(by) = by {
            let said = Declaration { verb: OperatorVerb::Start, by: by.to_owned() };
            recorder.declared(at, &said);
        }
        let from = OperatorRequest { system: 1, component: 191 };
        let wish = OperatorCommand { at, verb: OperatorVerb::Start, from };
        recorder.event(at, &Event::Operator(wish));
        for to in [Phase::Preflight, Phase::TakeOff] {
            let change = PhaseChange { at, from: Phase::Idle, to, reason: String::new() };
            recorder.result(at, &Action::PhaseChanged(change));
        }
        let volume = VolumeEstimate { at, volume_m3: 10.0, sigma_m3: 1.0, coverage_ratio: 1.0 };
        let account = VolumeAccount {
            name: "hall".to_owned(),
            estimate: volume,
            mass: None,
            budget: VolumeBudget::default(),
            shares: VolumeShares::default(),
        };
        recorder.result(at, &Action::VolumesAccounted(vec![account.clone()]));
        let summary = FlightSummary {
            at,
            volume,
            accounts: vec![account],
            hits: HitCounts::default(),
            steps_done: 0,
            path_length_m: 0.0,
            is_complete: true,
            is_final: true,
        };
        recorder.result(at, &Action::Ended(Box::new(summary)));
        assert_eq!(recorder.close().lost_on_disk, 0);
        let flight = Flight::read(Path::new(&log)).unwrap();
        Report::new(&Facts::new(flight, Wishes::default()).unwrap(), "0").unwrap()
    }

    #[test]
    fn a_report_says_who_declared_what_and_when() {
        let dust = "dust_zone = \"released\"\ndust_released_by = \"A. Person, 2026-03-04\"\n";
        let report = report_of(dust, Some("Zoë <b>"));
        // Ten seconds after the log's beginning.
        for said in [
            "4 March 2026, 05:06:17 UTC",
            "Zoë &lt;b&gt;",
            "before the START",
            "nobody is in the hall and nobody can walk in",
            "the dust zone is released by A. Person, 2026-03-04",
        ] {
            assert!(report.html.contains(said), "{said:?} is not in the report");
        }
        let json: serde_json::Value = serde_json::from_str(&report.json).unwrap();
        let declared = &json["survey"]["declarations"][0];
        assert_eq!(declared["declared_utc"], "2026-03-04T05:06:17Z");
        assert_eq!(
            (&declared["declared_by"], &declared["before"]),
            (&"Zoë <b>".into(), &"start".into())
        );
        assert_eq!(json["survey"]["dust"]["zone"], "released");
    }

    #[test]
    fn a_report_does_not_say_what_nobody_has_said() {
        let report = report_of("", None);
        assert!(report.html.contains("none in the log"));
        assert!(report.html.contains("dust: not asked by the program that flew"));
        assert!(!report.html.contains("nobody is in the hall"));
        let json: serde_json::Value = serde_json::from_str(&report.json).unwrap();
        assert_eq!(json["survey"]["declarations"], serde_json::json!([]));
        assert_eq!(json["survey"]["dust"]["zone"], serde_json::Value::Null);
    }
}
