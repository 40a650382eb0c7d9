//! A log flown again while somebody watches: what reports and exports are made of.
//!
//! The recorded events go to a fresh brain, as in a [`replay`](super::replay); the watcher sees each
//! event and each action. Unlike a replay this does not end where another build's log parts from this
//! build: it tells whether the newest volumes and surface come out as they were recorded, to the last
//! bit.

use super::accounts::read_surface;
use super::entry::{RecordedEvent, encode_action};
use super::reader::{LogItem, LogReader};
use super::replay::ReplayError;
use super::surveys::{SurveyPlace, read_surveys};
use super::topic::Topic;
use super::twin::AccountsTwin;
use crate::messages::{Declaration, HeightMap, HitCounts, VolumeAccount};
use crate::pilot::{Action, Event, Job, JobId, Pilot};
use crate::time::{Mono, Stamp};
use std::collections::BTreeMap;
use std::error::Error;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Sees what the brain is told and what it gives out.
pub trait Watcher {
    /// The survey that is asked for begins with the next event: what came before belongs to others.
    fn begin(&mut self);
    /// The brain is about to be told this.
    fn event(&mut self, event: &Event);
    /// The brain has given this out at the time of its newest event.
    fn action(&mut self, at: Stamp<Mono>, action: &Action);
}

/// Volumes and their surface.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoggedVolumes {
    /// The whole region first, then its bays; empty if nothing was measured.
    pub accounts: Vec<VolumeAccount>,
    /// The surface that belongs to them.
    pub surface: Option<HeightMap>,
    /// They are the result after a landing, not of a flight under way.
    pub is_final: bool,
}

/// What a log is, and what came out when it was flown again.
#[derive(Debug)]
pub struct FlownAgain {
    /// Version of the program that wrote it.
    pub version: String,
    /// Build of that program.
    pub build: String,
    /// The effective configuration, TOML.
    pub config_toml: String,
    /// What was noted at its head, such as civil time at its start.
    pub notes: BTreeMap<String, String>,
    /// When it began.
    pub began_at: Stamp<Mono>,
    /// When the last event was taken in.
    pub last_at: Stamp<Mono>,
    /// Which survey of the log it is.
    pub place: SurveyPlace,
    /// What it is known by, however the log goes on.
    pub identity: String,
    /// What people said before its motors turned.
    pub declarations: Vec<(Stamp<Mono>, Declaration)>,
    /// Civil time at the survey's beginning, RFC 3339 in UTC, if the log's was noted.
    pub started_utc: Option<String>,
    /// Where the beams of earlier surveys went.
    pub earlier_hits: HitCounts,
    /// Events fed; none in what `stockpilot merge` has written.
    pub n_events: u64,
    /// The survey's newest volumes as they were recorded.
    pub recorded: LoggedVolumes,
    /// The newest volumes and surface came out as they were recorded, to the last bit.
    pub is_reproduced: bool,
    /// The log has its proper end and no gap.
    pub is_complete: bool,
    /// The brain after the survey's last event.
    pub pilot: Pilot,
}

/// The newest results, as bytes of the log.
#[derive(Debug, Default, PartialEq)]
struct Newest {
    accounts: Option<Vec<u8>>,
    surface: Option<Vec<u8>>,
}

impl Newest {
    fn take(&mut self, topic: Topic, json: Vec<u8>) {
        match topic {
            Topic::Accounts => self.accounts = Some(json),
            Topic::Surface => self.surface = Some(json),
            _ => {}
        }
    }
}

/// Flies a log again, up to the end of the survey with this number or of the last one, with the brain
/// that `make_pilot` builds from the recorded configuration (TOML).
///
/// # Errors
/// The log cannot be opened or holds no configuration, has no survey of this number, no brain can be built
/// from it, or it holds volumes that this build cannot read.
pub fn fly_again<E>(
    log: &Path,
    number: Option<usize>,
    make_pilot: impl FnOnce(&str) -> Result<Pilot, E>,
    watcher: &mut impl Watcher,
) -> Result<FlownAgain, ReplayError>
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    let contents = read_surveys(log)?;
    let survey = contents.survey(number)?.cloned().unwrap_or_default();
    let is_last = survey.place.number == contents.surveys.len();
    let pilot =
        make_pilot(&contents.config_toml).map_err(|error| ReplayError::Config(error.into()))?;
    let mut flight = Flight::new(pilot, watcher);
    let mut reader = LogReader::<BufReader<File>>::open(log)?;
    let until = if survey.place.number == 0 { u64::MAX } else { survey.events.end };
    for (item_event, item) in numbered(reader.by_ref()) {
        match item {
            LogItem::Event { .. } if item_event == until => break,
            LogItem::Event { at, event } => {
                if item_event == survey.events.start {
                    flight.begin();
                }
                flight.take_recorded(at, event)?;
            }
            // What the brain was told there is unknown, and so is all that would follow.
            LogItem::Lost { .. } => break,
            LogItem::Config { .. } | LogItem::Result { .. } => {}
        }
    }
    let is_complete = if is_last { contents.is_complete } else { !reader.has_gaps() };
    let recorded = Newest { accounts: survey.accounts, surface: survey.surface };
    let Flight { pilot, computed, last_at, n_events, earlier_hits, .. } = flight;
    Ok(FlownAgain {
        started_utc: contents.started_utc(&survey.place),
        place: survey.place,
        identity: survey.identity,
        declarations: survey.declarations,
        version: contents.version,
        build: contents.build,
        config_toml: contents.config_toml,
        notes: contents.notes,
        began_at: contents.began_at,
        last_at,
        n_events,
        earlier_hits,
        is_reproduced: n_events > 0 && computed == recorded,
        recorded: read(&recorded, survey.is_final)?,
        is_complete,
        pilot,
    })
}

/// The items with the number of events before them.
fn numbered(items: impl Iterator<Item = LogItem>) -> impl Iterator<Item = (u64, LogItem)> {
    items.scan(0, |n_events, item| {
        let before = *n_events;
        *n_events += u64::from(matches!(item, LogItem::Event { .. }));
        Some((before, item))
    })
}

fn read(newest: &Newest, is_final: bool) -> Result<LoggedVolumes, serde_json::Error> {
    let accounts = newest.accounts.as_ref().map_or(Ok(Vec::new()), |json| {
        serde_json::from_slice::<AccountsTwin>(json).map(AccountsTwin::into_accounts)
    })?;
    let surface = newest.surface.as_ref().map(|json| read_surface(json)).transpose()?;
    Ok(LoggedVolumes { accounts, surface, is_final })
}

/// A brain that flies a log again.
struct Flight<'a, W> {
    pilot: Pilot,
    watcher: &'a mut W,
    jobs: BTreeMap<JobId, Box<Job>>,
    computed: Newest,
    last_at: Stamp<Mono>,
    n_events: u64,
    earlier_hits: HitCounts,
}

impl<'a, W: Watcher> Flight<'a, W> {
    fn new(pilot: Pilot, watcher: &'a mut W) -> Self {
        Self {
            pilot,
            watcher,
            jobs: BTreeMap::new(),
            computed: Newest::default(),
            last_at: Stamp::ZERO,
            n_events: 0,
            earlier_hits: HitCounts::default(),
        }
    }

    /// The survey that is asked for begins.
    fn begin(&mut self) {
        self.watcher.begin();
        self.computed = Newest::default();
        self.earlier_hits = self.pilot.mapper().counts();
    }

    fn take_recorded(
        &mut self,
        at: Stamp<Mono>,
        event: RecordedEvent,
    ) -> Result<(), serde_json::Error> {
        let event = event.for_brain(|id| self.jobs.remove(&id));
        event.map_or(Ok(()), |event| self.take(at, event))
    }

    fn take(&mut self, at: Stamp<Mono>, event: Event) -> Result<(), serde_json::Error> {
        self.last_at = at;
        self.n_events += 1;
        self.watcher.event(&event);
        let mut actions = Vec::new();
        self.pilot.step(event, &mut actions);
        for action in actions {
            self.watcher.action(at, &action);
            if matches!(action, Action::VolumesAccounted(_) | Action::SurfaceSolved(_)) {
                let encoded = encode_action(&action)?;
                self.computed.take(encoded.topic, encoded.json);
            }
            if let Action::Start { id, job } = action {
                self.jobs.insert(id, job);
            }
        }
        Ok(())
    }
}
