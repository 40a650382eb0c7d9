//! Timestamps that only grow, over restarts too.
//!
//! A stamp that was used once must never be used again: its frame could be replayed, and peers
//! refuse it. So a file holds a stamp that no run has reached yet. A run begins there if the clock
//! is behind it (a board without a battery wakes up in the past), and moves the file ahead of
//! itself, in a thread of its own, so that no slow disk holds up the link.

use atomic_write_file::AtomicWriteFile;
use std::fmt;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// A stamp counts 10 µs.
pub(super) const UNITS_PER_SECOND: u64 = 100_000;
/// 2015-01-01T00:00:00Z in Unix time, s.
const EPOCH: Duration = Duration::from_secs(1_420_070_400);
/// Stamps have 48 bits, enough until 2104.
const LAST_STAMP: u64 = (1 << 48) - 1;
/// The file stands so far ahead of what is used. After a restart the first stamps may lie so far
/// in the future; it must be well below the minute that peers allow a new stream.
pub(super) const RESERVED: u64 = 20 * UNITS_PER_SECOND;
/// The file is moved on when so much of it is used up.
const RENEW_AFTER: u64 = 10 * UNITS_PER_SECOND;

/// The time of day, as long after 1970 as it says.
#[derive(Clone)]
pub struct WallClock(Arc<dyn Fn() -> Duration + Send + Sync>);

impl WallClock {
    /// A clock that asks `now` for the time since 1970 in UTC.
    pub fn new(now: impl Fn() -> Duration + Send + Sync + 'static) -> Self {
        Self(Arc::new(now))
    }

    fn stamp(&self) -> u64 {
        let units = (self.0)().saturating_sub(EPOCH).as_micros() / 10;
        u64::try_from(units).unwrap_or(LAST_STAMP).min(LAST_STAMP)
    }
}

impl fmt::Debug for WallClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("WallClock")
    }
}

/// What is wrong with the file of used-up stamps.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// It cannot be read or written.
    #[error("cannot keep signing timestamps in {path}: {source}", path = path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It holds something else.
    #[error("{path} is no file of signing timestamps; remove it only if this key was never used", path = path.display())]
    Malformed {
        /// Which file.
        path: PathBuf,
    },
}

/// The local time of signing.
#[derive(Debug)]
pub(super) struct Stamps {
    wall: WallClock,
    /// No run before this one has used or believed a later one; 0 without one.
    first: u64,
    /// The last stamp that was used or believed.
    latest: u64,
    /// What the file holds, or soon will.
    reserved: u64,
    writer: SyncSender<u64>,
}

impl Stamps {
    /// Begins behind everything that earlier runs may have used.
    pub(super) fn open(path: &Path, wall: WallClock) -> Result<Self, LedgerError> {
        let first = read(path)?;
        let reserved = (wall.stamp().max(first) + RESERVED).min(LAST_STAMP);
        write(path, reserved)
            .map_err(|source| LedgerError::Io { path: path.to_owned(), source })?;
        let writer = spawn_writer(path.to_owned())
            .map_err(|source| LedgerError::Io { path: path.to_owned(), source })?;
        Ok(Self { wall, first, latest: first, reserved, writer })
    }

    /// No run before this one has used or believed a later stamp; 0 if there was none.
    pub(super) const fn first(&self) -> u64 {
        self.first
    }

    /// The own time, whatever others say.
    pub(super) fn own(&self) -> u64 {
        self.wall.stamp().max(self.first)
    }

    /// The own time or the latest stamp that was believed.
    pub(super) fn latest(&self) -> u64 {
        self.own().max(self.latest)
    }

    /// Others are ahead: later stamps of this side must not lie behind theirs.
    pub(super) fn heard(&mut self, stamp: u64) {
        self.latest = self.latest.max(stamp);
        self.reserve();
    }

    /// A stamp that was never used.
    pub(super) fn next(&mut self) -> u64 {
        self.latest = self.own().max(self.latest + 1).min(LAST_STAMP);
        self.reserve();
        self.latest
    }

    /// Moves the file ahead of what is used up.
    fn reserve(&mut self) {
        if self.latest + (RESERVED - RENEW_AFTER) > self.reserved {
            let wanted = (self.latest + RESERVED).min(LAST_STAMP);
            // A writer that is still busy gets the next wish.
            match self.writer.try_send(wanted) {
                Ok(()) => self.reserved = wanted,
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
            }
        }
    }
}

fn read(path: &Path) -> Result<u64, LedgerError> {
    match std::fs::read_to_string(path) {
        Ok(text) => text
            .trim()
            .parse()
            .ok()
            .filter(|stamp| *stamp <= LAST_STAMP)
            .ok_or_else(|| LedgerError::Malformed { path: path.to_owned() }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
        Err(source) => Err(LedgerError::Io { path: path.to_owned(), source }),
    }
}

/// Replaces the file as a whole, so that a power cut leaves the old one or the new one.
fn write(path: &Path, stamp: u64) -> io::Result<()> {
    let mut file = AtomicWriteFile::open(path)?;
    writeln!(file, "{stamp}")?;
    file.commit()
}

/// Ends when the other side of the channel is dropped.
fn spawn_writer(path: PathBuf) -> io::Result<SyncSender<u64>> {
    let (sender, wishes) = sync_channel(1);
    std::thread::Builder::new().name("signing".to_owned()).spawn(move || {
        for stamp in wishes {
            if let Err(error) = write(&path, stamp) {
                tracing::error!(path = %path.display(), %error, "signing timestamps are not kept");
            }
        }
    })?;
    Ok(sender)
}
