//! The same flight again from its log.
//!
//! Every recorded event goes to a fresh brain in the recorded order; what the brain gives out is
//! put into its recorded form and compared with the file byte by byte. Jobs are run again when
//! their end was recorded; what a program outside answered comes from the log.

use super::entry::{Encoded, RecordedEvent, encode_action};
use super::reader::{LogItem, LogReader};
use super::topic::Topic;
use crate::pilot::{Action, Event, Job, JobId, Pilot};
use crate::time::{Mono, Stamp};
use std::collections::{BTreeMap, VecDeque};
use std::error::Error;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// Why a log could not be replayed at all.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The file cannot be opened.
    #[error("cannot open the log: {0}")]
    Open(#[from] io::Error),
    /// The file holds no configuration: it is no log, or was cut in its first bytes.
    #[error("the log holds no configuration{}", damage.as_ref().map(|d| format!(": {d}")).unwrap_or_default())]
    NoConfig {
        /// What is wrong with the file, if something is.
        damage: Option<String>,
    },
    /// No brain can be built from the recorded configuration.
    #[error("the recorded configuration does not work with this build: {0}")]
    Config(#[source] Box<dyn Error + Send + Sync>),
    /// The log has no survey of this number.
    #[error("there is no survey {wanted} in the log: it holds {n_in_log}")]
    NoSuchSurvey {
        /// What was asked for.
        wanted: usize,
        /// How many there are.
        n_in_log: usize,
    },
    /// The decisions beside the log cannot be read.
    #[error("{}: {cause}", path.display())]
    Review {
        /// Which file.
        path: PathBuf,
        /// Why.
        cause: String,
    },
    /// A result cannot be put into its recorded form.
    #[error("a result cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
}

/// The first place where brain and log part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The event after which it happened, counted from 0.
    pub event_idx: u64,
    /// When that event was taken in.
    pub at: Stamp<Mono>,
    /// What the log holds, as channel and message; `None` if the brain said more.
    pub logged: Option<(Topic, String)>,
    /// What the brain gave out; `None` if the log holds more.
    pub replayed: Option<(Topic, String)>,
}

/// What a replay found.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ReplayReport {
    /// Every compared result is equal to the last byte.
    pub identical: bool,
    /// Events fed.
    pub events: u64,
    /// Results compared.
    pub results_compared: u64,
    /// Where they part first; the replay ends there.
    pub first_difference: Option<Difference>,
    /// The log has its proper end and no gap. At a gap the replay ends, for the brain cannot know
    /// what it was told there.
    pub is_complete: bool,
}

/// Replays a log with the brain that `make_pilot` builds from the recorded configuration (TOML).
///
/// # Errors
/// The log cannot be opened or holds no configuration, or no brain can be built from it.
pub fn replay<E>(
    log: &Path,
    make_pilot: impl FnOnce(&str) -> Result<Pilot, E>,
) -> Result<ReplayReport, ReplayError>
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    let reader = LogReader::<BufReader<File>>::open(log)?;
    replay_by(reader, |config_toml| {
        let mut pilot = make_pilot(config_toml)?;
        Ok::<_, E>(move |event, actions: &mut Vec<Action>| pilot.step(event, actions))
    })
}

/// Replays a log with any step function: an event in, actions appended.
///
/// # Errors
/// As [`replay`].
pub fn replay_by<R, S, E>(
    mut reader: LogReader<R>,
    make_step: impl FnOnce(&str) -> Result<S, E>,
) -> Result<ReplayReport, ReplayError>
where
    R: Read,
    S: FnMut(Event, &mut Vec<Action>),
    E: Into<Box<dyn Error + Send + Sync>>,
{
    let Some(LogItem::Config { config_toml, .. }) = reader.next() else {
        return Err(ReplayError::NoConfig { damage: reader.damage().map(str::to_owned) });
    };
    let step = make_step(&config_toml).map_err(|error| ReplayError::Config(error.into()))?;
    let mut run = Run::new(step);
    for item in reader.by_ref() {
        if !run.take(item)? {
            break;
        }
    }
    run.report.identical = run.report.first_difference.is_none();
    run.report.is_complete = reader.is_complete();
    Ok(run.report)
}

/// A replay under way.
struct Run<S> {
    step: S,
    jobs: BTreeMap<JobId, Box<Job>>,
    expected: VecDeque<Encoded>,
    last_at: Stamp<Mono>,
    report: ReplayReport,
}

impl<S: FnMut(Event, &mut Vec<Action>)> Run<S> {
    fn new(step: S) -> Self {
        Self {
            step,
            jobs: BTreeMap::new(),
            expected: VecDeque::new(),
            last_at: Stamp::ZERO,
            report: ReplayReport::default(),
        }
    }

    /// Takes in one item of the log; false when the replay is to end.
    fn take(&mut self, item: LogItem) -> Result<bool, ReplayError> {
        match item {
            LogItem::Event { at, event } => self.take_event(at, event),
            LogItem::Result { topic, json, .. } if topic.is_result() => {
                Ok(self.compare(topic, json))
            }
            // What the recorder was told beside the brain.
            LogItem::Result { .. } | LogItem::Config { .. } => Ok(true),
            LogItem::Lost { .. } => Ok(false),
        }
    }

    fn take_event(&mut self, at: Stamp<Mono>, event: RecordedEvent) -> Result<bool, ReplayError> {
        if let Some(unlogged) = self.expected.pop_front() {
            self.note(None, Some(&unlogged));
            return Ok(false);
        }
        self.last_at = at;
        let Some(event) = event.for_brain(|id| self.jobs.remove(&id)) else {
            self.note(Some((Topic::Finished, "a job that never began".to_owned())), None);
            return Ok(false);
        };
        let mut actions = Vec::new();
        (self.step)(event, &mut actions);
        self.report.events += 1;
        for action in actions {
            self.expected.push_back(encode_action(&action)?);
            if let Action::Start { id, job } = action {
                self.jobs.insert(id, job);
            }
        }
        Ok(true)
    }

    fn compare(&mut self, topic: Topic, json: Vec<u8>) -> bool {
        let logged = Encoded { topic, json };
        let replayed = self.expected.pop_front();
        let is_equal = replayed.as_ref() == Some(&logged);
        if is_equal {
            self.report.results_compared += 1;
        } else {
            self.note(Some(shown(&logged)), replayed.as_ref());
        }
        is_equal
    }

    fn note(&mut self, logged: Option<(Topic, String)>, replayed: Option<&Encoded>) {
        self.report.first_difference = Some(Difference {
            event_idx: self.report.events.saturating_sub(1),
            at: self.last_at,
            logged,
            replayed: replayed.map(shown),
        });
    }
}

fn shown(message: &Encoded) -> (Topic, String) {
    (message.topic, String::from_utf8_lossy(&message.json).into_owned())
}
