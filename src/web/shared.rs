//! What the page's tasks share. All of them run on its one thread.

use super::access::Access;
use super::collector::{Beside, Collector};
use super::feed::Feed;
use super::review::ReviewFile;
use super::server::Sensors;
use super::state::{State, Viewers};
use super::wish::Wish;
use axum::extract::ws::Utf8Bytes;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// More viewers at a time are turned away.
pub(super) const MOST_VIEWERS: usize = 64;

/// Counters of the page; they only grow.
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) requests: AtomicU64,
    pub(super) refused: AtomicU64,
    pub(super) wishes: AtomicU64,
    pub(super) states_sent: AtomicU64,
    pub(super) viewers_dropped: AtomicU64,
    pub(super) viewers_turned_away: AtomicU64,
}

/// What the page's tasks share.
#[derive(Debug)]
pub(super) struct Shared {
    collector: Mutex<Collector>,
    pub(super) access: Access,
    pub(super) wishes: mpsc::Sender<Wish>,
    /// The newest state, encoded.
    pub(super) states: watch::Sender<Utf8Bytes>,
    viewers: AtomicUsize,
    pub(super) counters: Counters,
    pub(super) sensors: Sensors,
    pub(super) feed: Feed,
    pub(super) log_directory: PathBuf,
    pub(super) review: ReviewFile,
    free_bytes: AtomicU64,
    pub(super) stop: CancellationToken,
}

/// What [`Shared`] is made of.
#[derive(Debug)]
pub(super) struct Parts {
    pub(super) collector: Collector,
    pub(super) access: Access,
    pub(super) wishes: mpsc::Sender<Wish>,
    pub(super) sensors: Sensors,
    pub(super) feed: Feed,
    pub(super) log: PathBuf,
    pub(super) stop: CancellationToken,
}

impl Shared {
    pub(super) fn new(parts: Parts) -> Self {
        let Parts { collector, access, wishes, sensors, feed, log, stop } = parts;
        Self {
            collector: Mutex::new(collector),
            access,
            wishes,
            states: watch::channel(Utf8Bytes::default()).0,
            viewers: AtomicUsize::new(0),
            counters: Counters::default(),
            sensors,
            feed,
            log_directory: log.parent().map_or_else(PathBuf::new, PathBuf::from),
            review: ReviewFile::beside(&log),
            free_bytes: AtomicU64::new(u64::MAX),
            stop,
        }
    }

    pub(super) fn collector(&self) -> MutexGuard<'_, Collector> {
        // News are taken in whole: a panic between leaves nothing half done.
        self.collector.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The picture of this moment.
    pub(super) fn picture(&self) -> State {
        let beside = self.beside();
        self.collector().picture(&beside)
    }

    fn beside(&self) -> Beside {
        let free_bytes = self.free_bytes.load(Ordering::Relaxed);
        Beside {
            lidar: self.sensors.lidar.borrow().clone(),
            camera: self.sensors.camera.borrow().clone(),
            viewers: self.viewers(),
            has_token: self.access.token.is_some(),
            free_bytes: (free_bytes != u64::MAX).then_some(free_bytes),
            news_lost: self.feed.lost(),
            now: Instant::now(),
        }
    }

    pub(super) fn viewers(&self) -> Viewers {
        Viewers {
            now: self.viewers.load(Ordering::Relaxed),
            dropped: self.counters.viewers_dropped.load(Ordering::Relaxed),
        }
    }

    /// Looks at the disk; to be called now and then.
    pub(super) fn look_at_disk(&self) {
        let free = rustix::fs::statvfs(&self.log_directory)
            .map_or(u64::MAX, |stat| stat.f_bavail.saturating_mul(stat.f_frsize));
        self.free_bytes.store(free, Ordering::Relaxed);
    }

    /// A place among the viewers, given back when it is dropped; `None` if there are too many.
    pub(super) fn enter(&self) -> Option<Seat<'_>> {
        if self.viewers.fetch_add(1, Ordering::Relaxed) >= MOST_VIEWERS {
            self.viewers.fetch_sub(1, Ordering::Relaxed);
            count(&self.counters.viewers_turned_away);
            return None;
        }
        Some(Seat { viewers: &self.viewers })
    }
}

/// A place among the viewers.
#[derive(Debug)]
pub(super) struct Seat<'a> {
    viewers: &'a AtomicUsize,
}

impl Drop for Seat<'_> {
    fn drop(&mut self) {
        self.viewers.fetch_sub(1, Ordering::Relaxed);
    }
}

pub(super) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}
