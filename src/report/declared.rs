//! What named people have said before the motors turned, and what the configuration says of dust.

use super::content::{Column, Part, Table};
use super::words;
use crate::config::DustZone;
use crate::messages::{Declaration, OperatorVerb};
use crate::survey::Flight;
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
        let none = "none in the log: the start did not come from the page, or its program did not keep them";
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
