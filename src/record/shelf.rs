//! The folder with the logs: what each holds, what may go when the disk fills, and what never may.
//!
//! Names sort by the time of the start, so the first is the oldest. Beside `flight-T.mcap` there may be
//! `flight-T.reported.json`, which says what was made of which of its surveys, and `flight-T.empty`, which
//! says that nobody took off while it was written. A log without either holds a survey that nobody has
//! reported, and stays; so does one that was flown with since.

mod mark;

pub use mark::{Seen, mark_reported};

use super::reader::{LogItem, LogReader};
use super::surveys::{TO_TAKE_OFF, holds};
use super::topic::Topic;
use super::writer::CHUNK_BYTES;
use crate::messages::Room;
use mark::Mark;
use serde::Serialize;
use std::collections::BTreeSet;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

const EMPTY: &str = "empty";
/// What a power cut leaves unreadable at the end: one chunk, begun and not finished. A chunk shrinks when it
/// is compressed; the quarter more is for its index and for the message that filled it.
const LONGEST_CUT_BYTES: u64 = CHUNK_BYTES + CHUNK_BYTES / 4;

/// What is known of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// Nobody took off while it was written.
    Empty,
    /// Of each of its surveys a report was made, or all of it lies in an audit pack or was released. An
    /// entry in the books is not enough: books hold volumes, not what they rest on.
    Reported,
    /// It holds a survey that nobody has reported, or was not looked into yet.
    Kept,
}

/// A log in the folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ShelvedLog {
    /// The file.
    pub path: PathBuf,
    /// Its length, bytes.
    pub bytes: u64,
    /// What is known of it.
    pub standing: Standing,
}

/// The logs in a folder, the oldest first.
///
/// # Errors
/// What the system says of the folder.
pub fn shelved_logs(folder: &Path) -> io::Result<Vec<ShelvedLog>> {
    let mut logs = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let is_log = path.extension().is_some_and(|extension| extension == "mcap");
        // A log that somebody takes away meanwhile is gone.
        let Ok(about) = std::fs::metadata(&path) else { continue };
        if is_log && about.is_file() {
            let (bytes, standing) = (about.len(), standing_of(&path, about.len()));
            logs.push(ShelvedLog { path, bytes, standing });
        }
    }
    logs.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(logs)
}

/// What the marks beside a log say of it, without looking into it.
fn standing_of(log: &Path, n_bytes: u64) -> Standing {
    if Mark::beside(log).is_some_and(|mark| mark.is_of_all(n_bytes)) {
        Standing::Reported
    } else if log.with_extension(EMPTY).exists() {
        Standing::Empty
    } else {
        Standing::Kept
    }
}

/// Looks into a log of which the marks say nothing: whether somebody flew, and whether each survey in it is
/// one of which something was made. Reads the whole log: takes seconds.
///
/// # Errors
/// The log cannot be opened.
pub fn standing_within(log: &Path) -> io::Result<Standing> {
    let Some(mark) = Mark::beside(log) else {
        return Ok(if has_flown(log)? { Standing::Kept } else { Standing::Empty });
    };
    let seen = Seen::look(log)?;
    Ok(if mark.knows(&seen) { Standing::Reported } else { Standing::Kept })
}

/// True if somebody took off while the log was written, or if that cannot be known: its head is unreadable, it
/// has gaps, or more of it is unreadable than a second or two.
///
/// A box that stands switched on loses its power sooner or later, and its logs then lack their proper end.
/// Such a file is readable but for one chunk that was begun; damage that hides a flight, or makes the file look
/// as if it ended early, leaves megabytes unread behind it.
///
/// # Errors
/// The log cannot be opened.
fn has_flown(log: &Path) -> io::Result<bool> {
    let n_bytes = std::fs::metadata(log)?.len();
    let mut reader = LogReader::<BufReader<std::fs::File>>::open(log)?;
    for item in reader.by_ref() {
        if let LogItem::Result { topic: Topic::Phase, json, .. } = item
            && holds(&json, TO_TAKE_OFF)
        {
            return Ok(true);
        }
    }
    if reader.is_complete() {
        return Ok(false);
    }
    let is_cut_off = reader.began_at().is_some() && is_cut(n_bytes, reader.readable_bytes());
    Ok(reader.has_gaps() || !is_cut_off)
}

/// True if what cannot be read of a file is no more than a cut leaves.
const fn is_cut(n_bytes: u64, readable_bytes: u64) -> bool {
    n_bytes.saturating_sub(readable_bytes) <= LONGEST_CUT_BYTES
}

/// How the folder is looked after.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShelfSettings {
    /// Where the logs are.
    pub folder: PathBuf,
    /// What one survey may need, bytes.
    pub survey_bytes: u64,
    /// Below this room is made, bytes.
    pub low_bytes: u64,
}

impl ShelfSettings {
    /// What so much free space is worth; a disk that does not say is believed to have enough.
    #[must_use]
    pub fn room(&self, free_bytes: Option<u64>) -> Room {
        match free_bytes {
            Some(free) if free < self.survey_bytes => Room::TooLittle,
            Some(free) if free < self.low_bytes => Room::Low,
            _ => Room::Enough,
        }
    }

    /// Bytes that this program may still write there; `None` if the disk does not say.
    #[must_use]
    pub fn free_bytes(&self) -> Option<u64> {
        let stat = rustix::fs::statvfs(&self.folder).ok()?;
        Some(stat.f_bavail.saturating_mul(stat.f_frsize))
    }

    /// So much is free once room has been made, bytes: a little more than where it is wanted.
    #[must_use]
    pub const fn enough_bytes(&self) -> u64 {
        self.low_bytes.saturating_add(self.low_bytes / 10)
    }
}

/// Makes room in a folder of logs.
#[derive(Debug)]
pub struct Shelf {
    folder: PathBuf,
    /// The log that is being written.
    current: PathBuf,
    /// Logs that were looked into and hold a survey to report.
    flown: BTreeSet<PathBuf>,
}

impl Shelf {
    /// The folder, with the log in it that is being written.
    #[must_use]
    pub const fn new(folder: PathBuf, current: PathBuf) -> Self {
        Self { folder, current, flown: BTreeSet::new() }
    }

    /// Deletes logs until `is_enough`, empty ones first, then reported surveys, each the oldest first;
    /// gives what was deleted. Neither the log that is being written nor a survey that nobody has
    /// reported is touched.
    ///
    /// # Errors
    /// What the system says of the folder, or of a file that cannot be deleted.
    pub fn make_room(
        &mut self,
        mut is_enough: impl FnMut() -> bool,
    ) -> io::Result<Vec<ShelvedLog>> {
        let mut logs = shelved_logs(&self.folder)?;
        logs.retain(|log| log.path != self.current);
        self.look_into(&mut logs);
        let mut deleted = Vec::new();
        for standing in [Standing::Empty, Standing::Reported] {
            for log in logs.iter().filter(|log| log.standing == standing) {
                if is_enough() {
                    return Ok(deleted);
                }
                std::fs::remove_file(&log.path)?;
                if log.path.with_extension(EMPTY).exists() {
                    std::fs::remove_file(log.path.with_extension(EMPTY))?;
                }
                deleted.push(log.clone());
            }
        }
        Ok(deleted)
    }

    /// Finds the logs that may go among those of which the marks say nothing.
    fn look_into(&mut self, logs: &mut [ShelvedLog]) {
        for log in logs.iter_mut().filter(|log| log.standing == Standing::Kept) {
            if self.flown.contains(&log.path) {
                continue;
            }
            // One that cannot be read is kept, and the others are looked into all the same.
            log.standing = standing_within(&log.path).unwrap_or(Standing::Kept);
            match log.standing {
                Standing::Kept => {
                    self.flown.insert(log.path.clone());
                }
                Standing::Reported => {}
                // The mark spares the next start the reading; a full disk may have no room for it.
                Standing::Empty => {
                    if let Err(error) = std::fs::write(log.path.with_extension(EMPTY), b"") {
                        tracing::debug!(%error, log = %log.path.display(), "not marked as empty");
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
