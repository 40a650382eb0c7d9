//! The thread that writes the log.

use super::entry::{Entry, Written};
use super::live::LiveView;
use super::writer::{LogHeader, LogWriter, WriteError};
use crate::geometry::{Body, Lidar, Transform};
use crate::messages::Declaration;
use crate::pilot::{Action, Event};
use crate::time::{Mono, Stamp};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Entries that may wait for the disk: about ten seconds of flight.
const QUEUE_ENTRIES: usize = 8192;
/// Wall time between two flushes; a killed program loses no more than this and one write.
const FLUSH_PERIOD: Duration = Duration::from_millis(800);

/// Why a log could not be begun or ended.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be created; it must not exist yet.
    #[error("cannot create log {}: {cause}", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// The first records cannot be written.
    #[error("cannot begin log {}: {cause}", path.display())]
    Begin {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        cause: String,
    },
}

/// Counts since the log began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RecorderStats {
    /// Entries flushed to the file; those of the last second follow.
    pub written: u64,
    /// Entries lost because the disk fell behind; the file tells where.
    pub lost_in_queue: u64,
    /// Entries lost because the disk failed, those of the unfinished chunk included.
    pub lost_on_disk: u64,
    /// The disk failed: nothing is written any more.
    pub has_failed: bool,
}

/// Hands events and results to the thread that writes them. Never blocks, unless told to wait.
///
/// Dropping or closing it waits for the rest to be written and ends the file properly.
#[derive(Debug)]
pub struct Recorder {
    queue: Option<SyncSender<Job>>,
    metronome_stop: Option<mpsc::Sender<()>>,
    threads: Vec<JoinHandle<()>>,
    counts: Arc<Counts>,
    notes: LogNotes,
    lost_here: u64,
    last_lost_at: Stamp<Mono>,
    waits: bool,
}

#[derive(Debug, Default)]
struct Counts {
    written: AtomicU64,
    lost_in_queue: AtomicU64,
    lost_on_disk: AtomicU64,
    has_failed: AtomicBool,
}

impl Counts {
    fn stats(&self) -> RecorderStats {
        RecorderStats {
            written: self.written.load(Ordering::Relaxed),
            lost_in_queue: self.lost_in_queue.load(Ordering::Relaxed),
            lost_on_disk: self.lost_on_disk.load(Ordering::Relaxed),
            has_failed: self.has_failed.load(Ordering::Relaxed),
        }
    }
}

/// Looks at a recorder's counts from outside.
#[derive(Debug, Clone)]
pub struct RecorderHealth(Arc<Counts>);

impl RecorderHealth {
    /// Counts so far.
    #[must_use]
    pub fn stats(&self) -> RecorderStats {
        self.0.stats()
    }
}

/// What becomes known only while the log is written, such as which sensor answers; goes to the file with the next
/// flush. Another note of the same name takes the place of the earlier one for readers.
#[derive(Debug, Clone, Default)]
pub struct LogNotes(Arc<Mutex<BTreeMap<String, String>>>);

impl LogNotes {
    /// Adds a note.
    pub fn add(&self, name: &str, note: &str) {
        self.pending().insert(name.to_owned(), note.to_owned());
    }

    fn pending(&self) -> MutexGuard<'_, BTreeMap<String, String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[derive(Debug)]
enum Job {
    Write {
        lost_before: u64,
        at: Stamp<Mono>,
        entry: Box<Entry>,
    },
    /// Entries were lost and none came after them.
    EndGap {
        n_entries: u64,
        at: Stamp<Mono>,
    },
    Flush,
}

impl Recorder {
    /// Creates the file, which must not exist yet, and writes its head.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub fn create(path: &Path, header: &LogHeader) -> Result<Self, RecordError> {
        Self::create_shown(path, header, None)
    }

    /// The same; what is written is shown live too, if somebody is to see it.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub fn create_shown(
        path: &Path,
        header: &LogHeader,
        live: Option<LiveView>,
    ) -> Result<Self, RecordError> {
        let create = |cause| RecordError::Create { path: path.into(), cause };
        let begin = |cause: String| RecordError::Begin { path: path.into(), cause };
        let file = File::create_new(path).map_err(create)?;
        let to_sync = file.try_clone().map_err(create)?;
        let log = LogWriter::begin(BufWriter::new(file), header)
            .map_err(|cause| begin(cause.to_string()))?;
        if let Some(live) = &live {
            let encoded = header.config().map_err(|cause| begin(cause.to_string()))?;
            live.show(header.started_at, &Written { encoded, views: Vec::new() });
        }
        sync_folder_of(path);
        let viewed = Viewed { live, body_from_lidar: header.body_from_lidar };
        Self::spawn(log, viewed, move || to_sync.sync_data())
            .map_err(|cause| begin(cause.to_string()))
    }

    /// Starts the threads over a begun log; `sync` brings flushed bytes to the disk.
    fn spawn<W>(
        log: LogWriter<W>,
        viewed: Viewed,
        sync: impl FnMut() -> io::Result<()> + Send + 'static,
    ) -> io::Result<Self>
    where
        W: Write + Seek + Send + 'static,
    {
        let (queue, jobs) = sync_channel(QUEUE_ENTRIES);
        let (metronome_stop, stopped) = channel();
        let (counts, notes) = (Arc::new(Counts::default()), LogNotes::default());
        let scribe = Scribe {
            log: Some(log),
            viewed,
            sync,
            n_unflushed: 0,
            counts: Arc::clone(&counts),
            notes: notes.clone(),
        };
        let beats = queue.clone();
        let threads = vec![
            thread::Builder::new().name("log".into()).spawn(move || scribe.run(&jobs))?,
            thread::Builder::new()
                .name("log-flush".into())
                .spawn(move || beat(&stopped, &beats))?,
        ];
        let metronome_stop = Some(metronome_stop);
        let queue = Some(queue);
        Ok(Self {
            queue,
            metronome_stop,
            threads,
            counts,
            notes,
            lost_here: 0,
            last_lost_at: Stamp::ZERO,
            waits: false,
        })
    }

    /// The same recorder, but it waits for the disk instead of losing entries: for flights faster
    /// than real time, where nobody falls from the sky meanwhile.
    #[must_use]
    pub const fn waiting(mut self) -> Self {
        self.waits = true;
        self
    }

    /// Records what the brain is told at `at`; call it before the results that follow from it.
    pub fn event(&mut self, at: Stamp<Mono>, event: &Event) {
        self.put(at, Entry::from(event));
    }

    /// Records what the brain gave out at `at`.
    pub fn result(&mut self, at: Stamp<Mono>, action: &Action) {
        self.put(at, Entry::from(action));
    }

    /// Records what a person said at `at`, before the motors turned. The brain is not told, so a replay passes over it.
    pub fn declared(&mut self, at: Stamp<Mono>, said: &Declaration) {
        self.put(at, Entry::Declared { at, said: said.clone() });
    }

    /// Counts so far.
    #[must_use]
    pub fn stats(&self) -> RecorderStats {
        self.counts.stats()
    }

    /// The counts for somebody else to look at, also after the end.
    #[must_use]
    pub fn health(&self) -> RecorderHealth {
        RecorderHealth(Arc::clone(&self.counts))
    }

    /// Where somebody else leaves notes, also after the end, when nobody reads them any more.
    #[must_use]
    pub fn notes(&self) -> LogNotes {
        self.notes.clone()
    }

    /// Writes what waits, ends the file, and tells the final counts.
    #[must_use]
    pub fn close(mut self) -> RecorderStats {
        self.end();
        self.stats()
    }

    fn put(&mut self, at: Stamp<Mono>, entry: Entry) {
        let Some(queue) = &self.queue else { return };
        let job = Job::Write { lost_before: self.lost_here, at, entry: Box::new(entry) };
        let is_taken =
            if self.waits { queue.send(job).is_ok() } else { queue.try_send(job).is_ok() };
        if is_taken {
            self.lost_here = 0;
        } else {
            self.lost_here += 1;
            self.last_lost_at = at;
            let lost = self.counts.lost_in_queue.fetch_add(1, Ordering::Relaxed);
            if lost == 0 {
                tracing::error!("the log falls behind: entries are lost, the file tells where");
            }
        }
    }

    fn end(&mut self) {
        self.metronome_stop = None;
        let n_entries = std::mem::take(&mut self.lost_here);
        if let Some(queue) = self.queue.take()
            && n_entries > 0
            && queue.send(Job::EndGap { n_entries, at: self.last_lost_at }).is_err()
        {
            tracing::error!(n_entries, "the log ended before it could tell what it lost");
        }
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a thread of the log panicked");
            }
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.end();
    }
}

/// Asks for a flush in equal steps of wall time until told to stop.
fn beat(stopped: &Receiver<()>, queue: &SyncSender<Job>) {
    while stopped.recv_timeout(FLUSH_PERIOD) == Err(RecvTimeoutError::Timeout) {
        if queue.send(Job::Flush).is_err() {
            return;
        }
    }
}

/// Brings the name of a new file to the disk: without it a power cut takes the whole file.
fn sync_folder_of(path: &Path) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let synced = File::open(folder.unwrap_or(Path::new("."))).and_then(|folder| folder.sync_all());
    if let Err(error) = synced {
        tracing::warn!(%error, "the log's name cannot be brought to the disk");
    }
}

/// What is made for viewers.
#[derive(Debug, Default)]
struct Viewed {
    live: Option<LiveView>,
    body_from_lidar: Option<Transform<Body, Lidar>>,
}

/// What the writing thread owns; the log is gone once the disk has failed.
struct Scribe<W: Write + Seek, S> {
    log: Option<LogWriter<W>>,
    viewed: Viewed,
    sync: S,
    n_unflushed: u64,
    counts: Arc<Counts>,
    notes: LogNotes,
}

impl<W: Write + Seek, S: FnMut() -> io::Result<()>> Scribe<W, S> {
    fn run(mut self, jobs: &Receiver<Job>) {
        for job in jobs {
            match job {
                Job::Write { lost_before, at, entry } => self.write(lost_before, at, &entry),
                Job::EndGap { n_entries, at } => self.note_end_gap(at, n_entries),
                Job::Flush => self.flush(),
            }
        }
        self.write_notes();
        if let Some(log) = self.log.take() {
            let ended = log.finish();
            self.settle(ended);
            self.bring_to_disk();
        }
    }

    fn write(&mut self, lost_before: u64, at: Stamp<Mono>, entry: &Entry) {
        self.n_unflushed += 1;
        // A disk that has failed ends the file, not the view.
        if self.log.is_none() && self.viewed.live.is_none() {
            self.count_lost();
            return;
        }
        let written = match Written::new(at, entry, self.viewed.body_from_lidar.as_ref()) {
            Ok(written) => written,
            Err(error) => return self.settle(Err(error.into())),
        };
        if let Some(live) = &self.viewed.live {
            live.show(at, &written);
        }
        let Some(log) = &mut self.log else {
            self.count_lost();
            return;
        };
        let gap = if lost_before > 0 { log.write_lost(at, lost_before) } else { Ok(()) };
        if let Err(error) = gap.and_then(|()| log.write(at, &written)) {
            self.settle(Err(error));
        }
    }

    fn note_end_gap(&mut self, at: Stamp<Mono>, n_entries: u64) {
        let Some(log) = &mut self.log else { return };
        if let Err(error) = log.write_lost(at, n_entries) {
            self.settle(Err(error));
        }
    }

    fn write_notes(&mut self) {
        let notes = std::mem::take(&mut *self.notes.pending());
        let Some(log) = self.log.as_mut().filter(|_| !notes.is_empty()) else { return };
        if let Err(error) = log.write_notes(notes) {
            self.settle(Err(error));
        }
    }

    fn flush(&mut self) {
        self.write_notes();
        let Some(log) = &mut self.log else { return };
        let flushed = log.flush();
        self.settle(flushed);
        self.bring_to_disk();
    }

    fn bring_to_disk(&mut self) {
        if let Err(error) = (self.sync)() {
            tracing::warn!(%error, "the log cannot be brought to the disk");
        }
    }

    /// Books the unflushed entries by how their flush went; gives up the file if it failed, for its
    /// writer cannot go on.
    fn settle(&mut self, outcome: Result<(), WriteError>) {
        match outcome {
            Ok(()) => {
                self.counts.written.fetch_add(self.n_unflushed, Ordering::Relaxed);
                self.n_unflushed = 0;
            }
            Err(error) => {
                self.log = None;
                self.count_lost();
                self.counts.has_failed.store(true, Ordering::Relaxed);
                tracing::error!(%error, "the log failed, nothing is recorded from here on");
            }
        }
    }

    fn count_lost(&mut self) {
        self.counts.lost_on_disk.fetch_add(self.n_unflushed, Ordering::Relaxed);
        self.n_unflushed = 0;
    }
}

#[cfg(test)]
mod tests;
