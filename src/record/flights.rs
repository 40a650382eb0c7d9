//! The turns of the scanner out of a log, computed again from its events.
//!
//! The recorded events go to a fresh brain, as in a [`replay`](super::replay), so scans meet the same
//! poses as in flight. Nothing is compared: the log of an older build gives what this build makes
//! of it. A log without an end gives its flights up to the last event before the cut or the gap.

use super::entry::RecordedEvent;
use super::reader::{LogItem, LogReader};
use super::refly::Refly;
use super::replay::ReplayError;
use crate::mapping::footprint::Footprint;
use crate::messages::HitCounts;
use crate::pilot::{Event, Pilot};
use crate::time::{Mono, Stamp};
use std::error::Error;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

/// What a log holds.
#[derive(Debug, Clone, Default)]
pub struct LoggedFlights {
    /// The effective configuration, TOML.
    pub config_toml: String,
    /// The turns of each flight that saw something, in their order.
    pub flights: Vec<Vec<Arc<Footprint>>>,
    /// Where the beams of all flights went.
    pub hits: HitCounts,
    /// When the last event was taken in.
    pub last_at: Stamp<Mono>,
    /// The log has its proper end and no gap.
    pub is_complete: bool,
}

/// Reads the flights of a log with the brain that `make_pilot` builds from the recorded
/// configuration (TOML).
///
/// # Errors
/// The log cannot be opened or holds no configuration, or no brain can be built from it.
pub fn read_flights<E>(
    log: &Path,
    make_pilot: impl FnOnce(&str) -> Result<Pilot, E>,
) -> Result<LoggedFlights, ReplayError>
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    let mut reader = LogReader::<BufReader<File>>::open(log)?;
    let Some(LogItem::Config { config_toml, .. }) = reader.next() else {
        return Err(ReplayError::NoConfig { damage: reader.damage().map(str::to_owned) });
    };
    let pilot = make_pilot(&config_toml).map_err(|error| ReplayError::Config(error.into()))?;
    let read = LoggedFlights { config_toml, ..LoggedFlights::default() };
    let mut flown = Flown { brain: Refly::new(pilot), read };
    for item in reader.by_ref() {
        match item {
            LogItem::Event { at, event } => flown.take(at, event),
            // What the brain was told there is unknown, and so is every pose after it.
            LogItem::Lost { .. } => break,
            LogItem::Config { .. } | LogItem::Result { .. } => {}
        }
    }
    Ok(LoggedFlights { is_complete: reader.is_complete(), ..flown.end() })
}

/// What is taken from a log that is flown again.
struct Flown {
    brain: Refly,
    read: LoggedFlights,
}

impl Flown {
    fn take(&mut self, at: Stamp<Mono>, event: RecordedEvent) {
        self.read.last_at = at;
        let Some(event) = self.brain.event(event) else { return };
        // Only a person starts a flight, and the map begins anew with it.
        let before = matches!(event, Event::Operator(_)).then(|| self.turns());
        self.brain.step(event);
        if let Some(before) = before
            && self.brain.pilot().mapper().turns().len() < before.len()
        {
            self.read.flights.push(before);
        }
    }

    fn turns(&self) -> Vec<Arc<Footprint>> {
        self.brain.pilot().mapper().turns().to_vec()
    }

    fn end(mut self) -> LoggedFlights {
        let last = self.turns();
        if !last.is_empty() {
            self.read.flights.push(last);
        }
        self.read.hits = self.brain.pilot().mapper().counts();
        self.read
    }
}
