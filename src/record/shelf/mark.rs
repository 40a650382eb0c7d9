//! The mark beside a log: of which of its surveys something was made.

use super::is_cut;
use crate::record::surveys::read_surveys;
use atomic_write_file::AtomicWriteFile;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

const REPORTED: &str = "reported.json";

/// What a mark says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Mark {
    /// What was made last.
    what: String,
    at_utc: String,
    /// The log's length when it was looked at for that: a log that is longer now is looked into again.
    bytes: u64,
    /// By when they last took off or gave a result on the log's clock: the surveys of which something was
    /// made. Gaps flown since make another number of it.
    reported_ns: BTreeSet<i64>,
    /// Nothing else was in the log then.
    is_of_all: bool,
}

impl Mark {
    /// The mark of a log; none if there is none, or none that can be read.
    pub(super) fn beside(log: &Path) -> Option<Self> {
        serde_json::from_slice(&std::fs::read(log.with_extension(REPORTED)).ok()?).ok()
    }

    /// Everything in the log was reported, and nothing was written to it since.
    pub(super) const fn is_of_all(&self, n_bytes: u64) -> bool {
        self.is_of_all && self.bytes == n_bytes
    }

    /// Everything that was seen in the log was reported.
    pub(super) fn knows(&self, seen: &Seen) -> bool {
        seen.is_readable && seen.surveys_ns.iter().all(|at_ns| self.reported_ns.contains(at_ns))
    }
}

/// What a log held when somebody looked. A running service goes on writing it, so whoever makes something of a
/// log looks first and marks by that afterwards.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Seen {
    log: PathBuf,
    bytes: u64,
    surveys_ns: Vec<i64>,
    /// Nothing in it may hide another survey.
    is_readable: bool,
}

impl Seen {
    /// Looks into a log. Reads all of it: takes seconds.
    ///
    /// # Errors
    /// The log cannot be opened.
    pub fn look(log: &Path) -> io::Result<Self> {
        let bytes = std::fs::metadata(log)?.len();
        let (log, nothing) = (log.to_owned(), Vec::new());
        // What cannot be read at all may be released by people, and by nobody else.
        let Ok(contents) = read_surveys(&log) else {
            return Ok(Self { log, bytes, surveys_ns: nothing, is_readable: false });
        };
        let surveys_ns = contents.surveys.iter().map(|survey| survey.newest_at.nanos()).collect();
        let is_cut = is_cut(bytes, contents.readable_bytes);
        let is_readable = contents.is_complete || (is_cut && !contents.has_gaps);
        Ok(Self { log, bytes, surveys_ns, is_readable })
    }

    /// How many surveys it held.
    #[must_use]
    pub const fn n_surveys(&self) -> usize {
        self.surveys_ns.len()
    }

    /// Marks the survey with this number as reported, beside those that were before; true if that is all that
    /// was seen, so that the log may be deleted when the disk fills.
    ///
    /// # Errors
    /// What the disk says, above all that the log lies where nothing can be written.
    pub fn mark(&self, what: &str, number: usize) -> io::Result<bool> {
        let newest = number.checked_sub(1).and_then(|index| self.surveys_ns.get(index));
        let mut mark = self.begun(what);
        mark.reported_ns.extend(newest);
        mark.is_of_all = mark.knows(self);
        self.write(&mark)
    }

    /// Marks everything that was seen as lying elsewhere too.
    ///
    /// # Errors
    /// As [`Self::mark`].
    pub fn mark_all(&self, what: &str) -> io::Result<bool> {
        let mut mark = self.begun(what);
        mark.reported_ns.extend(&self.surveys_ns);
        mark.is_of_all = true;
        self.write(&mark)
    }

    fn begun(&self, what: &str) -> Mark {
        let reported_ns = Mark::beside(&self.log).map(|mark| mark.reported_ns).unwrap_or_default();
        let (what, at_utc) = (what.to_owned(), jiff::Timestamp::now().to_string());
        Mark { what, at_utc, bytes: self.bytes, reported_ns, is_of_all: false }
    }

    fn write(&self, mark: &Mark) -> io::Result<bool> {
        let mut file = AtomicWriteFile::open(self.log.with_extension(REPORTED))?;
        serde_json::to_writer(&mut file, mark)?;
        file.write_all(b"\n")?;
        file.commit()?;
        Ok(mark.is_of_all)
    }
}

/// Marks all that a log holds: it may be deleted when the disk fills, until somebody flies on with it.
///
/// # Errors
/// What the disk says, above all that the log lies where nothing can be written.
pub fn mark_reported(log: &Path, what: &str) -> io::Result<()> {
    Seen::look(log)?.mark_all(what).map(drop)
}
