//! Hands every event and action to a recorder, away from the brain's task.

use crate::pilot::{Action, Event, JobId};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

/// Records that may wait: three seconds of a flight at some 1300 a second.
const CAPACITY: usize = 4096;

/// One line of the flight's history.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// What the brain was told.
    Event {
        /// Numbers the events of a run from 0.
        seq: u64,
        /// The event.
        event: Event,
    },
    /// What the brain wanted.
    Action {
        /// The event that it follows from.
        seq: u64,
        /// The action; never [`Action::Start`].
        action: Action,
    },
    /// The brain began a job, whose inputs follow from the events before.
    JobStarted {
        /// The event that it follows from.
        seq: u64,
        /// The job's number.
        id: JobId,
    },
}

/// Keeps records. Runs on a thread where it may block.
pub trait Recorder: Send + 'static {
    /// Keeps one record; records come in order, and lost ones leave a gap in `seq`.
    ///
    /// # Errors
    /// If it could not be kept. The service counts it and goes on.
    fn record(&mut self, record: &Record) -> io::Result<()>;

    /// Writes out everything; called once, last.
    ///
    /// # Errors
    /// If something could not be written.
    fn finish(&mut self) -> io::Result<()>;
}

/// A recorder at work.
#[derive(Debug)]
pub(super) struct Recording {
    records: mpsc::Sender<Record>,
    failed: Arc<AtomicU64>,
    task: JoinHandle<()>,
}

impl Recording {
    pub(super) fn start(recorder: Box<dyn Recorder>) -> Self {
        let (records, queue) = mpsc::channel(CAPACITY);
        let failed = Arc::new(AtomicU64::new(0));
        let counter = Arc::clone(&failed);
        let task = tokio::task::spawn_blocking(move || keep_all(recorder, queue, &counter));
        Self { records, failed, task }
    }

    /// Hands `record` on; false if there was no room.
    pub(super) fn keep(&self, record: Record) -> bool {
        self.records.try_send(record).is_ok()
    }

    /// Records that the recorder could not keep.
    pub(super) fn failed(&self) -> u64 {
        self.failed.load(Ordering::Relaxed)
    }

    /// Lets the recorder finish what waits, and waits for it; gives [`Self::failed`] after that.
    pub(super) async fn finish(self) -> u64 {
        drop(self.records);
        if let Err(error) = self.task.await {
            tracing::error!(%error, "the recorder died");
        }
        self.failed.load(Ordering::Relaxed)
    }
}

fn keep_all(
    mut recorder: Box<dyn Recorder>,
    mut queue: mpsc::Receiver<Record>,
    failed: &AtomicU64,
) {
    while let Some(record) = queue.blocking_recv() {
        if let Err(error) = recorder.record(&record)
            && failed.fetch_add(1, Ordering::Relaxed) == 0
        {
            tracing::error!(%error, "the flight is not recorded completely");
        }
    }
    if let Err(error) = recorder.finish() {
        failed.fetch_add(1, Ordering::Relaxed);
        tracing::error!(%error, "the end of the flight is not recorded");
    }
}
