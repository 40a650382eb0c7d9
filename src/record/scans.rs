//! The scans of a log with the poses that the flight had for them, computed again from its events.

use super::reader::{LogItem, LogReader};
use super::refly::Refly;
use super::replay::ReplayError;
use crate::messages::Scan;
use crate::pilot::{Event, Pilot};
use std::collections::VecDeque;
use std::error::Error;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Scans that wait for their pose at most; the ring of poses is shorter.
const MOST_WAITING: usize = 64;

/// Shows every scan of a log whose pose is known for good, with the brain that knows it: the one that
/// `make_pilot` builds from the recorded configuration (TOML).
///
/// # Errors
/// The log cannot be opened or holds no configuration, or no brain can be built from it.
pub fn read_scans<E>(
    log: &Path,
    make_pilot: impl FnOnce(&str) -> Result<Pilot, E>,
    mut visit: impl FnMut(&Scan, &Pilot),
) -> Result<(), ReplayError>
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    let mut reader = LogReader::<BufReader<File>>::open(log)?;
    let Some(LogItem::Config { config_toml, .. }) = reader.next() else {
        return Err(ReplayError::NoConfig { damage: reader.damage().map(str::to_owned) });
    };
    let pilot = make_pilot(&config_toml).map_err(|error| ReplayError::Config(error.into()))?;
    let mut brain = Refly::new(pilot);
    let mut waiting: VecDeque<Scan> = VecDeque::new();
    for item in reader.by_ref() {
        let event = match item {
            LogItem::Event { event, .. } => event,
            // What the brain was told there is unknown, and so is every pose after it.
            LogItem::Lost { .. } => break,
            LogItem::Config { .. } | LogItem::Result { .. } => continue,
        };
        let Some(event) = brain.event(event) else { continue };
        if let Event::Scanned(scan) = &event {
            let known = &brain.pilot().settings().scan_correction;
            waiting.push_back(scan.clone().corrected(known));
        }
        brain.step(event);
        while let Some(scan) = waiting.front() {
            let is_settled = brain.pilot().has_settled(scan.end());
            if is_settled {
                visit(scan, brain.pilot());
            } else if waiting.len() <= MOST_WAITING {
                break;
            }
            waiting.pop_front();
        }
    }
    Ok(())
}
