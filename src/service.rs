//! Runs the brain: tasks, channels, clock, supervision.
//!
//! ```text
//!  lidar thread ──Event──┐                                    ┌──▶ link transport
//!  camera task ──Event───┤                                    │
//!  link transport ───────┼──▶ brain task: pilot + session ────┼──▶ recorder thread
//!  jobs (other threads) ─┤        ▲                           │
//!  page: wishes ─────────┤        ├── status (watch), feed ───┴──▶ displays, page
//!  Clock, 60 Hz ─────────┘
//! ```
//!
//! Only the brain task speaks to the autopilot. It awaits nothing but its inputs: every output
//! channel is bounded and never waited for; what does not fit is dropped, counted in
//! [`ServiceStats`] and warned of once a second. So heartbeat and setpoints stop exactly when the
//! brain stops.

mod brain;
pub mod clock;
pub mod external_planner;
pub mod onboard;
pub mod plan;
mod recorder;
mod status;
mod storage;
pub mod watchdog;

pub use recorder::Recorder;
pub use status::{ServiceStats, ServiceStatus};

use crate::link::signing::{SigningError, WallClock};
use crate::link::transport::Transport;
use crate::link::{self, Guard, Session};
use crate::pilot::{Event, Pilot};
use crate::time::{Mono, Stamp};
use crate::web::{BrainEnd, Feed, Wish};
use brain::Brain;
use clock::Clock;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// What a service is made of.
#[expect(missing_debug_implementations, reason = "a recorder need not be printable")]
pub struct ServiceSetup {
    /// The brain.
    pub pilot: Pilot,
    /// How to reach the autopilot.
    pub link: link::Settings,
    /// The clock that stamps everything.
    pub clock: Clock,
    /// Cancelled to end the service.
    pub stop: CancellationToken,
    /// [`Event::Scanned`] from the LiDAR; the sender counts what does not fit.
    pub scans: mpsc::Receiver<Event>,
    /// [`Event::TagsSeen`] from the cameras; the sender counts what does not fit.
    pub tags: mpsc::Receiver<Event>,
    /// [`Event::StorageLooked`] from who looks after the disk.
    pub storage: mpsc::Receiver<Event>,
    /// Where every event and action goes, if anywhere.
    pub recorder: Option<Box<dyn Recorder>>,
    /// Who shows the flight and passes on what people ask for there, if anybody.
    pub page: Option<BrainEnd>,
}

/// Why a service did not start or did not end well.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The link's socket could not be had.
    #[error("cannot open the link {address}")]
    Link {
        /// What was to be opened.
        address: link::Address,
        /// Why not.
        #[source]
        source: std::io::Error,
    },
    /// The key or the timestamps of signing cannot be had.
    #[error(transparent)]
    Signing(#[from] SigningError),
    /// The brain's task died.
    #[error("the brain stopped in the middle of its work")]
    Brain(#[source] tokio::task::JoinError),
}

/// The service.
#[derive(Debug)]
pub struct Service;

impl Service {
    /// Opens the link and starts all tasks on the current tokio runtime.
    ///
    /// # Errors
    /// [`ServiceError::Link`] if the link's socket cannot be had, [`ServiceError::Signing`] if the
    /// link is to be signed and cannot.
    pub async fn start(setup: ServiceSetup) -> Result<RunningService, ServiceError> {
        let ServiceSetup { pilot, link, clock, stop, scans, tags, storage, recorder, page } = setup;
        let wall = clock.clone();
        let guard = Guard::open(&link.security, WallClock::new(move || wall.since_1970()))?;
        let link_stop = CancellationToken::new();
        let start =
            Transport::start_guarded(&link.address, guard, clock.clone(), link_stop.clone());
        let transport = start
            .await
            .map_err(|source| ServiceError::Link { address: link.address.clone(), source })?;
        let link_addr = transport.local_addr();
        let (status_tx, status) = watch::channel(ServiceStatus::default());
        let session = Session::new(link);
        let (feed, wishes) = page.map_or_else(without_page, |end| (Some(end.feed), end.wishes));
        let witnesses = brain::Witnesses { recorder, status_tx, feed };
        let brain = Brain::new(pilot, session, clock, (transport, link_stop), witnesses);
        let last_tick = brain.last_tick();
        let inputs = brain::Inputs { scans, tags, storage, wishes };
        let task = tokio::spawn(brain.run(inputs, stop.clone()));
        Ok(RunningService { status, last_tick, stop, link_addr, task })
    }
}

/// Nobody looks and nobody asks: a channel whose other end is gone.
fn without_page() -> (Option<Feed>, mpsc::Receiver<Wish>) {
    (None, mpsc::channel(1).1)
}

/// A service at work.
#[derive(Debug)]
pub struct RunningService {
    status: watch::Receiver<ServiceStatus>,
    last_tick: Arc<AtomicI64>,
    stop: CancellationToken,
    link_addr: Option<SocketAddr>,
    task: JoinHandle<ServiceStats>,
}

impl RunningService {
    /// What the service last said of itself; some ten times a second.
    #[must_use]
    pub fn status(&self) -> watch::Receiver<ServiceStatus> {
        self.status.clone()
    }

    /// When the brain ticked last: how far it has come, for whoever drives its clock.
    #[must_use]
    pub fn last_tick(&self) -> Stamp<Mono> {
        Stamp::from_nanos(self.last_tick.load(Ordering::Relaxed))
    }

    /// The own address of a link by datagrams.
    #[must_use]
    pub const fn link_addr(&self) -> Option<SocketAddr> {
        self.link_addr
    }

    /// Somebody has asked for the end.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        self.stop.is_cancelled()
    }

    /// Asks the service to end; a vehicle that it steers is told to land first.
    pub fn stop(&self) {
        self.stop.cancel();
    }

    /// Waits until every task has ended and the recorder is flushed.
    ///
    /// # Errors
    /// [`ServiceError::Brain`] if the brain's task panicked.
    pub async fn join(self) -> Result<ServiceStats, ServiceError> {
        self.task.await.map_err(ServiceError::Brain)
    }
}
