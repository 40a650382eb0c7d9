//! Which surveys a log holds: the service writes one log from its start to its end, and may fly several.
//!
//! A survey begins with a START that measures anew and takes in the flights into its gaps; the next such
//! START ends it. Numbers count from 1 and only surveys that took off. A log without any START, as `stockpilot
//! merge` writes it, is one survey if it holds volumes.
//!
//! A log may grow after somebody has read it: by flights into the gaps, by another survey, by the idle service.
//! [`LoggedSurvey::identity`] stays what it was.

use super::entry::RecordedEvent;
use super::reader::{LogItem, LogReader};
use super::replay::ReplayError;
use super::topic::Topic;
use super::twin::DeclaredTwin;
use crate::messages::{Declaration, OperatorVerb};
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use jiff::{SignedDuration, Timestamp};
use serde::Deserialize;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;

/// What a survey is known by, of what went before its first take-off. The list stays as it is: a channel that
/// a later program knows must not give an old log another identity.
const IDENTIFYING: [Topic; 3] = [Topic::Phase, Topic::Odometry, Topic::Fix];
/// The parts of recorded steps of the mission that tell where surveys begin and that one was flown.
const TO_PREFLIGHT: &[u8] = br#""to":"preflight""#;
pub(super) const TO_TAKE_OFF: &[u8] = br#""to":"take_off""#;

/// Which survey of how many, and when.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SurveyPlace {
    /// Its number in the log, from 1.
    pub number: usize,
    /// Surveys in the log.
    pub n_in_log: usize,
    /// When its START came; the log's beginning if it has none.
    pub began_at: Stamp<Mono>,
    /// When its flights ended: the survey itself, then those into its gaps.
    pub ended_at: Vec<Stamp<Mono>>,
}

/// A survey as it stands in the log.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LoggedSurvey {
    /// Where it stands.
    pub place: SurveyPlace,
    /// SHA-256, hexadecimal, of what the log had told when the survey first took off: the configuration, both clocks
    /// at the log's beginning, and every result since the START. Of all its results, if nothing took off. It is the
    /// same however the log goes on, and another one for any other survey.
    pub identity: String,
    /// When it last took off or gave a result: another number means that more was flown.
    pub newest_at: Stamp<Mono>,
    /// What people said before its motors turned: before the START, and before flights into its gaps.
    pub declarations: Vec<(Stamp<Mono>, Declaration)>,
    /// A flight has ended since the newest volumes, and they are those of its last solve.
    pub is_final: bool,
    pub(super) accounts: Option<Vec<u8>>,
    pub(super) surface: Option<Vec<u8>>,
    /// Its events, counted from the log's first.
    pub(super) events: Range<u64>,
    has_start: bool,
    has_flown: bool,
}

/// The head of a log and its surveys.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LogContents {
    /// Version of the program that wrote it.
    pub version: String,
    /// Build of that program.
    pub build: String,
    /// The effective configuration, TOML.
    pub config_toml: String,
    /// What was noted, such as civil time at the start.
    pub notes: BTreeMap<String, String>,
    /// When it began.
    pub began_at: Stamp<Mono>,
    /// Its surveys in their order.
    pub surveys: Vec<LoggedSurvey>,
    /// It has its proper end and no gap.
    pub is_complete: bool,
    /// Entries are missing in it.
    pub(super) has_gaps: bool,
    /// How far it could be read, bytes.
    pub(super) readable_bytes: u64,
}

/// Reads what a log holds.
///
/// # Errors
/// The log cannot be opened or holds no configuration.
pub fn read_surveys(log: &Path) -> Result<LogContents, ReplayError> {
    let mut reader = LogReader::<BufReader<File>>::open(log)?;
    let Some(LogItem::Config { version, build, config_toml }) = reader.next() else {
        return Err(ReplayError::NoConfig { damage: reader.damage().map(str::to_owned) });
    };
    let began_at = reader.began_at().unwrap_or_default();
    let started_utc = reader.notes().get("started_utc").map_or("", String::as_str);
    let beginning = [config_toml.as_str(), started_utc, &began_at.nanos().to_string()].join("\0");
    let mut parts = Parts::new(began_at, Sha256::new_with_prefix(beginning));
    reader.by_ref().for_each(|item| parts.take(item));
    Ok(LogContents {
        version,
        build,
        config_toml,
        began_at,
        surveys: parts.end(),
        notes: reader.notes().clone(),
        is_complete: reader.is_complete(),
        has_gaps: reader.has_gaps(),
        readable_bytes: reader.readable_bytes(),
    })
}

impl LogContents {
    /// The survey of this number; without one the last that has volumes; `None` in a log without.
    ///
    /// # Errors
    /// A number that the log does not have.
    pub fn survey(&self, number: Option<usize>) -> Result<Option<&LoggedSurvey>, ReplayError> {
        let Some(wanted) = number else {
            return Ok(self.surveys.iter().rfind(|survey| survey.accounts.is_some()));
        };
        let found = wanted.checked_sub(1).and_then(|index| self.surveys.get(index));
        let n_in_log = self.surveys.len();
        found.map(Some).ok_or(ReplayError::NoSuchSurvey { wanted, n_in_log })
    }

    /// Civil time at the beginning of a survey, RFC 3339 in UTC, if the log's was noted.
    #[must_use]
    pub fn started_utc(&self, of: &SurveyPlace) -> Option<String> {
        let noted = self.notes.get("started_utc")?;
        if of.began_at == self.began_at {
            return Some(noted.clone());
        }
        let after = SignedDuration::from_nanos(of.began_at.nanos_since(self.began_at));
        let started: Timestamp = noted.parse().ok()?;
        started.checked_add(after).ok().map(|at| at.to_string())
    }
}

impl LoggedSurvey {
    fn from_start(began_at: Stamp<Mono>, first_event: u64) -> Self {
        Self {
            place: SurveyPlace { began_at, ..SurveyPlace::default() },
            has_start: true,
            events: first_event..u64::MAX,
            ..Self::default()
        }
    }

    fn take(&mut self, at: Stamp<Mono>, topic: Topic, json: Vec<u8>) {
        match topic {
            Topic::Accounts => {
                self.accounts = Some(json);
                self.is_final = false;
            }
            Topic::Surface => self.surface = Some(json),
            Topic::Ended => {
                let ended: Ended = serde_json::from_slice(&json).unwrap_or_default();
                self.is_final = self.accounts.is_some() && ended.is_final;
                self.place.ended_at.push(ended.at_ns.map_or(at, Stamp::from_nanos));
            }
            Topic::Phase if holds(&json, TO_TAKE_OFF) => self.has_flown = true,
            _ => return,
        }
        self.newest_at = at;
    }

    /// What never left the ground is no survey; volumes without any START are one that was merged.
    const fn counts(&self) -> bool {
        self.has_flown || (!self.has_start && self.accounts.is_some())
    }
}

/// A log on its way into surveys.
struct Parts {
    done: Vec<LoggedSurvey>,
    current: LoggedSurvey,
    n_events: u64,
    /// The newest event, if it was the wish to fly into the gaps.
    flies_gaps: bool,
    last_event_at: Stamp<Mono>,
    /// What was said last, until the start comes that it was said for.
    declared: Option<(Stamp<Mono>, Declaration)>,
    /// What was said for the newest event, if that was a start.
    said: Option<(Stamp<Mono>, Declaration)>,
    /// Of the log's beginning, with which every survey's sum begins.
    beginning: Sha256,
    /// Of the current survey, up to its take-off.
    sum: Sha256,
}

impl Parts {
    fn new(began_at: Stamp<Mono>, beginning: Sha256) -> Self {
        let current = LoggedSurvey { has_start: false, ..LoggedSurvey::from_start(began_at, 0) };
        let (done, sum) = (Vec::new(), beginning.clone());
        Self {
            done,
            current,
            n_events: 0,
            flies_gaps: false,
            last_event_at: began_at,
            declared: None,
            said: None,
            beginning,
            sum,
        }
    }

    fn take(&mut self, item: LogItem) {
        match item {
            LogItem::Event { at, event } => {
                self.n_events += 1;
                self.last_event_at = at;
                let wish = match &event {
                    RecordedEvent::Plain(Event::Operator(wish)) => Some(wish),
                    _ => None,
                };
                self.flies_gaps = wish.is_some_and(|wish| wish.verb == OperatorVerb::FlyGaps);
                // The page's wish has the instant at which it was declared; a start from elsewhere says nothing.
                self.said = wish.and_then(|wish| {
                    self.declared.take_if(|(at, said)| *at == wish.at && said.verb == wish.verb)
                });
            }
            LogItem::Result { topic: Topic::Declared, json, .. } => {
                self.declared = serde_json::from_slice(&json).ok().map(DeclaredTwin::said);
            }
            LogItem::Result { at, topic, json } => self.result(at, topic, json),
            LogItem::Config { .. } | LogItem::Lost { .. } => {}
        }
    }

    fn result(&mut self, at: Stamp<Mono>, topic: Topic, json: Vec<u8>) {
        let is_start = topic == Topic::Phase && holds(&json, TO_PREFLIGHT);
        if is_start && !self.flies_gaps {
            let first_event = self.n_events.saturating_sub(1);
            self.current.events.end = first_event;
            self.finish(LoggedSurvey::from_start(self.last_event_at, first_event));
        }
        if is_start {
            self.current.declarations.extend(self.said.take());
        }
        if !self.current.has_flown && IDENTIFYING.contains(&topic) {
            self.sum.update(at.nanos().to_le_bytes());
            self.sum.update(topic.name());
            self.sum.update(&json);
        }
        self.current.take(at, topic, json);
    }

    /// The current survey ends, and the next one begins.
    fn finish(&mut self, next: LoggedSurvey) {
        let sum = std::mem::replace(&mut self.sum, self.beginning.clone());
        self.current.identity = sum.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        self.done.push(std::mem::replace(&mut self.current, next));
    }

    fn end(mut self) -> Vec<LoggedSurvey> {
        self.finish(LoggedSurvey::default());
        self.done.retain(LoggedSurvey::counts);
        let n_in_log = self.done.len();
        for (number, survey) in (1..).zip(&mut self.done) {
            (survey.place.number, survey.place.n_in_log) = (number, n_in_log);
        }
        self.done
    }
}

pub(super) fn holds(json: &[u8], part: &[u8]) -> bool {
    json.windows(part.len()).any(|window| window == part)
}

/// What the end of a flight says: its own instant, by which decisions on it are kept, and whether its last solve
/// has told these volumes. Logs from before that was noted say nothing, and count as if it had.
#[derive(Deserialize)]
#[serde(default)]
struct Ended {
    at_ns: Option<i64>,
    is_final: bool,
}

impl Default for Ended {
    fn default() -> Self {
        Self { at_ns: None, is_final: true }
    }
}

#[cfg(test)]
mod tests;
