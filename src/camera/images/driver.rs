//! The two threads of one camera.

use super::slot::Slot;
use super::source::{self, PictureSource};
use super::{ImageStats, PictureError, Settings};
use crate::camera::line::check_age;
use crate::camera::picture::{GreyPicture, StampedPicture};
use crate::camera::tag_finder::{FoundTags, TagFinder};
use crate::messages::TagDetections;
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use std::io;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::thread;
use std::time::Duration;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Pauses between two attempts to open a source that failed: one second.
const RETRY_PAUSES: u32 = 20;
/// The detector looks this often whether it is to end.
const PATIENCE: Duration = Duration::from_millis(50);

/// Takes in one camera's pictures and hands their tags to the brain until it is cancelled.
///
/// Cancelling takes effect after the picture under way. Dropping cancels but does not wait.
#[derive(Debug)]
pub struct ImageDriver {
    threads: Vec<thread::JoinHandle<()>>,
    cancel: CancellationToken,
    stats: watch::Receiver<ImageStats>,
}

impl ImageDriver {
    /// Starts both threads; each picture's tags, none included, go to `events` as
    /// [`Event::TagsSeen`].
    ///
    /// `now` is the service's clock. A full channel never blocks: the frame is dropped and counted.
    ///
    /// # Errors
    /// A source that cannot be opened, or what the detector refuses of its settings.
    pub fn start(
        settings: Settings,
        now: impl Fn() -> Stamp<Mono> + Clone + Send + 'static,
        events: mpsc::Sender<Event>,
        cancel: &CancellationToken,
    ) -> Result<Self, PictureError> {
        let cancel = cancel.child_token();
        // The detector's thread makes its own; here only its settings are judged.
        drop(TagFinder::new(&settings.detector)?);
        let (opened_tx, opened) = std::sync::mpsc::sync_channel(1);
        let (stats_tx, stats) = watch::channel(ImageStats::default());
        let stats_tx = Arc::new(stats_tx);
        let slot = Arc::new(Slot::default());
        let number = settings.camera.0;
        let grabber = Grabber {
            settings: settings.clone(),
            now: now.clone(),
            slot: Arc::clone(&slot),
            cancel: cancel.clone(),
            stats: Arc::clone(&stats_tx),
        };
        let searcher =
            Searcher { settings, now, slot, events, cancel: cancel.clone(), stats: stats_tx };
        let threads = vec![
            spawn(format!("images-{number}"), move || grabber.run(&opened_tx))?,
            spawn(format!("tags-{number}"), move || searcher.run())?,
        ];
        let driver = Self { threads, cancel, stats };
        let died = || io::Error::other("the thread of the camera has ended");
        opened.recv().map_err(|_| died())??;
        Ok(driver)
    }

    /// Follows the counts.
    #[must_use]
    pub fn stats(&self) -> watch::Receiver<ImageStats> {
        self.stats.clone()
    }

    /// Cancels the driver and waits for its threads.
    pub fn stop(mut self) {
        self.cancel.cancel();
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a thread of the camera panicked");
            }
        }
    }
}

impl Drop for ImageDriver {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}

fn spawn(name: String, work: impl FnOnce() + Send + 'static) -> io::Result<thread::JoinHandle<()>> {
    thread::Builder::new().name(name).spawn(work)
}

/// A picture on its way to the detector.
struct Waiting {
    picture: GreyPicture,
    captured_at: Stamp<Mono>,
    arrived_at: Stamp<Mono>,
}

/// The thread that reads the source.
struct Grabber<N> {
    settings: Settings,
    now: N,
    slot: Arc<Slot<Waiting>>,
    cancel: CancellationToken,
    stats: Arc<watch::Sender<ImageStats>>,
}

impl<N: Fn() -> Stamp<Mono>> Grabber<N> {
    /// Tells whether the first opening worked, then reads until the end.
    ///
    /// Sources are opened here because some cannot change their thread.
    fn run(self, opened: &SyncSender<Result<(), PictureError>>) {
        let (first, answer) = match source::open(&self.settings, &self.cancel) {
            Ok(source) => (Some(source), Ok(())),
            Err(error) => (None, Err(error)),
        };
        let is_heard = opened.send(answer).is_ok();
        let Some(mut source) = first.filter(|_| is_heard) else { return };
        while let Some(error) = self.read(source.as_mut()) {
            let Some(again) = self.reopened(error) else { return };
            source = again;
        }
    }

    /// Opens a source that has failed again every second, until it works; `None` at the end.
    fn reopened(&self, mut error: PictureError) -> Option<Box<dyn PictureSource>> {
        loop {
            tracing::warn!(%error, camera = self.settings.camera.0, "lost the camera");
            self.stats.send_modify(|stats| {
                stats.reopened += 1;
                stats.last_error = Some(error.to_string());
            });
            for _ in 0..RETRY_PAUSES {
                if self.cancel.is_cancelled() {
                    return None;
                }
                source::pause();
            }
            match source::open(&self.settings, &self.cancel) {
                Ok(source) => return Some(source),
                Err(again) => error = again,
            }
        }
    }

    /// Reads until the source fails with what is returned, or until the end.
    fn read(&self, source: &mut dyn PictureSource) -> Option<PictureError> {
        while !self.cancel.is_cancelled() {
            if source.can_wait() && !self.slot.is_free_within(PATIENCE) {
                continue;
            }
            match source.next() {
                Ok(None) => {}
                Ok(Some(picture)) => self.take(picture),
                Err(error @ PictureError::Io(_)) => return Some(error),
                Err(error) => {
                    self.stats.send_modify(|stats| stats.pictures += 1);
                    self.refuse(&error);
                }
            }
        }
        None
    }

    fn take(&self, stamped: StampedPicture) {
        let arrived_at = (self.now)();
        let delay = self.settings.stamp_delay.unwrap_or_default();
        let captured_at = stamped.captured_at.unwrap_or_else(|| arrived_at.minus(delay));
        self.stats.send_modify(|stats| stats.pictures += 1);
        let picture = stamped.picture;
        let (got, expected) = ([picture.width_px(), picture.height_px()], self.settings.size_px);
        if got != expected {
            self.refuse(&PictureError::OtherSize { got, expected });
        } else if let Err(refusal) = check_age(captured_at, arrived_at) {
            self.refuse(&refusal.into());
        } else if self.slot.replace(Waiting { picture, captured_at, arrived_at }).is_some() {
            self.stats.send_modify(|stats| stats.skipped += 1);
        }
    }

    /// Counts it, and logs the first of each kind.
    fn refuse(&self, error: &PictureError) {
        let text = error.to_string();
        self.stats.send_modify(|stats| {
            if stats.refused == 0 {
                tracing::warn!(%error, camera = self.settings.camera.0, "refused a picture");
            }
            stats.refused += 1;
            stats.last_error = Some(text);
        });
    }
}

/// The thread that finds the tags.
struct Searcher<N> {
    settings: Settings,
    now: N,
    slot: Arc<Slot<Waiting>>,
    events: mpsc::Sender<Event>,
    cancel: CancellationToken,
    stats: Arc<watch::Sender<ImageStats>>,
}

impl<N: Fn() -> Stamp<Mono>> Searcher<N> {
    fn run(self) {
        let mut finder = match TagFinder::new(&self.settings.detector) {
            Ok(finder) => finder,
            Err(error) => {
                tracing::error!(%error, "no tag detector");
                return;
            }
        };
        while !self.cancel.is_cancelled() {
            let Some(waiting) = self.slot.take_within(PATIENCE) else { continue };
            match finder.find(&waiting.picture) {
                Ok(found) => self.hand_over(&waiting, found),
                Err(error) => self.stats.send_modify(|stats| {
                    stats.refused += 1;
                    stats.last_error = Some(error.to_string());
                }),
            }
        }
    }

    fn hand_over(&self, waiting: &Waiting, found: FoundTags) {
        let received_at = (self.now)();
        let n_tags = found.tags.len() as u64;
        let frame = TagDetections {
            captured_at: waiting.captured_at,
            received_at,
            camera: self.settings.camera,
            tags: found.tags,
            points: Vec::new(),
        };
        let sent = self.events.try_send(Event::TagsSeen(frame));
        self.stats.send_modify(|stats| {
            stats.left_out += found.n_left_out;
            stats.last_delay = received_at.since(waiting.arrived_at);
            match sent {
                Ok(()) => {
                    stats.frames += 1;
                    stats.tags += n_tags;
                    stats.last_frame_at = Some(received_at);
                }
                Err(TrySendError::Full(_) | TrySendError::Closed(_)) => stats.lost += 1,
            }
        });
    }
}
