//! The whole onboard program from a configuration: brain, drivers, log and service.

use super::clock::Clock;
use super::recorder::NoLog;
use super::storage::StorageWatch;
use super::{RunningService, Service, ServiceError, ServiceSetup, ServiceStats, ServiceStatus};
use crate::camera::images::{self, ImageDriver, ImageStats, PictureError};
use crate::camera::{CameraStats, Listener};
use crate::config::{Config, ConfigError};
use crate::lidar::{Driver, Identity, LidarStatus, OpenError};
use crate::pilot::{Event, Pilot};
use crate::record::{self, LogHeader};
use crate::time::{Mono, Stamp};
use crate::web::{self, BrainEnd, Floor, RunningPage, Scene, Sensors};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio_util::sync::{CancellationToken, DropGuard};

/// Scans that may wait for the brain: three seconds of turns at 10 Hz.
const SCANS_WAITING: usize = 32;
/// Camera frames that may wait for the brain.
const FRAMES_WAITING: usize = 64;
/// Words on the disk that may wait for the brain; they are seldom.
const STORAGE_WAITING: usize = 4;

/// Why the program did not start.
#[derive(Debug, thiserror::Error)]
pub enum OnboardError {
    /// The configuration does not fit.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The LiDAR's port cannot be opened.
    #[error(transparent)]
    Lidar(#[from] OpenError),
    /// The socket for marker detections cannot be had.
    #[error("cannot listen for detections on {address}: {source}")]
    Detections {
        /// Where.
        address: String,
        /// Why.
        source: std::io::Error,
    },
    /// A camera cannot be had.
    #[error("camera {camera}: {source}")]
    Images {
        /// Its number.
        camera: u8,
        /// Why.
        source: PictureError,
    },
    /// The link or the brain's task failed.
    #[error(transparent)]
    Service(#[from] ServiceError),
}

/// How the program meets the world, beside its configuration.
#[derive(Debug, Clone)]
pub struct Surroundings {
    /// The clock that stamps everything.
    pub clock: Clock,
    /// Cancelled to end the program.
    pub stop: CancellationToken,
    /// The brain may wait for the disk: only where no vehicle can fall from the sky.
    pub waits_for_disk: bool,
}

/// The onboard program at work.
#[derive(Debug)]
pub struct Onboard {
    service: RunningService,
    lidar: Driver,
    detections: JoinHandle<std::io::Result<()>>,
    detections_addr: Option<SocketAddr>,
    camera_stats: watch::Receiver<CameraStats>,
    images: Vec<ImageDriver>,
    page: Option<RunningPage>,
    live: Option<record::RunningLive>,
    log: PathBuf,
    /// Ends the sensors and the page when it is dropped, after the brain: a vehicle that lands needs them.
    sensors_stop: DropGuard,
}

/// The counters at the end.
#[derive(Debug, Clone)]
pub struct OnboardStats {
    /// The service's.
    pub service: ServiceStats,
    /// The LiDAR driver's.
    pub lidar: LidarStatus,
    /// The detection listener's.
    pub camera: CameraStats,
    /// Those of the cameras whose tags are found here.
    pub images: Vec<ImageStats>,
}

impl Onboard {
    /// Checks the configuration, opens everything and starts all tasks on the current runtime.
    ///
    /// # Errors
    /// The first thing that cannot be had; nothing runs then.
    pub async fn start(config: &Config, around: Surroundings) -> Result<Self, OnboardError> {
        let settings = config.pilot_settings()?;
        let (page, scene) = (config.page_settings()?, Scene::new(&settings));
        let floor = Floor::new(&settings.mapping);
        let pilot = Pilot::new(settings);
        let (link, lidar) = (config.link_settings()?, config.lidar_settings()?);
        let listener = Listener::bind(config.camera_settings()?).await.map_err(|source| {
            OnboardError::Detections { address: config.detections.clone(), source }
        })?;
        let Surroundings { clock, stop, waits_for_disk } = around;
        let sensors = CancellationToken::new();
        let sensors_stop = sensors.clone().drop_guard();
        let (scans_tx, scans) = mpsc::channel(SCANS_WAITING);
        let lidar_clock = clock.clone();
        let lidar = Driver::start(lidar, move || lidar_clock.now(), scans_tx, &sensors)?;
        let shelf = config.storage_settings()?;
        let log = log_path(&shelf.folder);
        let (live, running_live) = start_live(config.foxglove_address()?).unzip();
        let begun = begin_log(&log, &header(config, clock.now())?, live);
        let health = begun.as_ref().map(record::Recorder::health);
        let notes = begun.as_ref().map(record::Recorder::notes).unwrap_or_default();
        tokio::spawn(note_lidar(lidar.status(), notes));
        let recorder: Box<dyn super::Recorder> = match begun {
            Some(recorder) if waits_for_disk => Box::new(recorder.waiting()),
            Some(recorder) => Box::new(recorder),
            None => Box::new(NoLog::default()),
        };
        let (frames_tx, tags) = mpsc::channel(FRAMES_WAITING);
        let images = start_cameras(config, &clock, &frames_tx, &sensors)?;
        let (detections_addr, camera_stats) = (listener.local_addr(), listener.stats());
        let camera_clock = clock.clone();
        let detections = tokio::spawn(listener.run(
            move || camera_clock.now(),
            frames_tx,
            sensors.child_token(),
        ));
        let (storage_tx, storage) = mpsc::channel(STORAGE_WAITING);
        let watch_clock = clock.clone();
        let watch_stop = sensors.child_token();
        let seen = Sensors { lidar: lidar.status(), camera: camera_stats.clone() };
        let around = web::Surroundings {
            scene,
            floor,
            space: pilot.free_space(),
            sensors: seen,
            log: log.clone(),
            stop: sensors.child_token(),
        };
        let (page, running) = page.and_then(|page| start_page(&page, around)).unzip();
        let recorder = Some(recorder);
        let setup = ServiceSetup { pilot, link, clock, stop, scans, tags, storage, recorder, page };
        let service = Service::start(setup).await?;
        let ends = (storage_tx, service.status());
        let storage = StorageWatch::new(shelf, log.clone(), health, watch_clock, ends);
        tokio::spawn(storage.run(watch_stop));
        Ok(Self {
            service,
            lidar,
            detections,
            detections_addr,
            camera_stats,
            images,
            page: running,
            live: running_live,
            log,
            sensors_stop,
        })
    }

    /// Where the live page is served, if it is.
    #[must_use]
    pub fn page_addr(&self) -> Option<SocketAddr> {
        self.page.as_ref().map(RunningPage::address)
    }

    /// Where the live log for Foxglove is served, if it is.
    #[must_use]
    pub fn foxglove_addr(&self) -> Option<SocketAddr> {
        self.live.as_ref().map(record::RunningLive::address)
    }

    /// What the service last said of itself.
    #[must_use]
    pub fn status(&self) -> watch::Receiver<ServiceStatus> {
        self.service.status()
    }

    /// The LiDAR driver's health and counters.
    #[must_use]
    pub fn lidar(&self) -> watch::Receiver<LidarStatus> {
        self.lidar.status()
    }

    /// The detection listener's counters.
    #[must_use]
    pub fn camera(&self) -> watch::Receiver<CameraStats> {
        self.camera_stats.clone()
    }

    /// The counters of the cameras whose tags are found here, in the order of the configuration.
    #[must_use]
    pub fn images(&self) -> Vec<watch::Receiver<ImageStats>> {
        self.images.iter().map(ImageDriver::stats).collect()
    }

    /// The own address of the autopilot's link by datagrams.
    #[must_use]
    pub const fn link_addr(&self) -> Option<SocketAddr> {
        self.service.link_addr()
    }

    /// The address where detections come in by datagrams.
    #[must_use]
    pub const fn detections_addr(&self) -> Option<SocketAddr> {
        self.detections_addr
    }

    /// When the brain ticked last.
    #[must_use]
    pub fn last_tick(&self) -> Stamp<Mono> {
        self.service.last_tick()
    }

    /// Where the log is written.
    #[must_use]
    pub fn log(&self) -> &Path {
        &self.log
    }

    /// Returns when the brain's task is over, asked for or not.
    pub async fn ended(&self) {
        let mut status = self.service.status();
        while status.changed().await.is_ok() {}
    }

    /// Everything has ended, or the brain by itself.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.service.status().has_changed().is_err()
    }

    /// Asks everything to end; a vehicle in the air lands first.
    pub fn stop(&self) {
        self.service.stop();
    }

    /// Waits until every task has ended and the log is closed.
    ///
    /// # Errors
    /// [`ServiceError::Brain`] if the brain's task panicked.
    pub async fn join(self) -> Result<OnboardStats, OnboardError> {
        let lidar = self.lidar.status();
        let images = self.images();
        let service = self.service.join().await?;
        drop(self.sensors_stop);
        if let Err(error) = self.detections.await {
            tracing::error!(%error, "the detection listener died");
        }
        if let Some(page) = self.page
            && let Err(error) = tokio::task::spawn_blocking(move || page.join()).await
        {
            tracing::error!(%error, "the page died");
        }
        if let Some(live) = self.live
            && let Err(error) = tokio::task::spawn_blocking(move || live.join()).await
        {
            tracing::error!(%error, "the live log died");
        }
        // Joining a thread blocks for one poll of its port.
        let stop_threads = move || {
            self.lidar.stop();
            self.images.into_iter().for_each(ImageDriver::stop);
        };
        if let Err(error) = tokio::task::spawn_blocking(stop_threads).await {
            tracing::error!(%error, "a sensor's driver died");
        }
        let camera = self.camera_stats.borrow().clone();
        let lidar = lidar.borrow().clone();
        let images = images.iter().map(|stats| stats.borrow().clone()).collect();
        Ok(OnboardStats { service, lidar, camera, images })
    }
}

/// Notes in the log which LiDAR answers, each time that another one does: reports name it.
async fn note_lidar(mut status: watch::Receiver<LidarStatus>, notes: record::LogNotes) {
    loop {
        let said = status.borrow_and_update().identity.as_ref().map(Identity::said);
        if let Some(said) = &said {
            notes.add("lidar", said);
        }
        let is_news = |now: &LidarStatus| now.identity.as_ref().map(Identity::said) != said;
        if status.wait_for(is_news).await.is_err() {
            return;
        }
    }
}

/// Starts the cameras whose tags are found here.
fn start_cameras(
    config: &Config,
    clock: &Clock,
    frames: &mpsc::Sender<Event>,
    stop: &CancellationToken,
) -> Result<Vec<ImageDriver>, OnboardError> {
    let start = |settings: images::Settings| {
        let camera = settings.camera.0;
        let clock = clock.clone();
        ImageDriver::start(settings, move || clock.now(), frames.clone(), stop)
            .map_err(|source| OnboardError::Images { camera, source })
    };
    config.image_settings()?.into_iter().map(start).collect()
}

/// A flight does not depend on its page: one that cannot be had is told.
fn start_page(
    settings: &web::Settings,
    around: web::Surroundings,
) -> Option<(BrainEnd, RunningPage)> {
    match web::start(settings, around) {
        Ok(page) => Some(page),
        Err(error) => {
            tracing::error!(%error, address = %settings.listen, "there is no live page");
            None
        }
    }
}

/// A flight does not depend on who looks at its log.
fn start_live(listen: Option<SocketAddr>) -> Option<(record::LiveView, record::RunningLive)> {
    let address = listen?;
    match record::LiveView::serve(address) {
        Ok(live) => Some(live),
        Err(error) => {
            tracing::error!(%error, %address, "there is no live log");
            None
        }
    }
}

/// A name that sorts by time of start and is not taken: two starts in one second differ by a count.
fn log_path(directory: &Path) -> PathBuf {
    let started = jiff::Timestamp::now().strftime("%Y%m%dT%H%M%SZ").to_string();
    let names = std::iter::once(format!("flight-{started}.mcap"))
        .chain((2_u32..).map(|n| format!("flight-{started}-{n}.mcap")));
    let mut free = names.map(|name| directory.join(name)).filter(|path| !path.exists());
    free.next().unwrap_or_else(|| directory.join("flight.mcap"))
}

/// Begins the log. Without one the program runs all the same: beside a vehicle that flies already people
/// may need it, and on the ground the preflight list says what is wrong.
fn begin_log(
    log: &Path,
    header: &LogHeader,
    live: Option<record::LiveView>,
) -> Option<record::Recorder> {
    let folder = log.parent().unwrap_or(Path::new("."));
    if let Err(error) = std::fs::create_dir_all(folder) {
        tracing::error!(%error, folder = %folder.display(), "the log's folder cannot be made");
    }
    match record::Recorder::create_shown(log, header, live) {
        Ok(recorder) => Some(recorder),
        Err(error) => {
            tracing::error!(%error, "nothing is recorded, and no survey is begun");
            None
        }
    }
}

fn header(config: &Config, now: Stamp<Mono>) -> Result<LogHeader, ConfigError> {
    let started_at = jiff::Timestamp::now().to_string();
    Ok(LogHeader {
        started_at: now,
        config_toml: config.to_toml()?,
        notes: BTreeMap::from([("started_utc".to_owned(), started_at)]),
        body_from_lidar: Some(config.pilot_settings()?.mapping.lidar.body_from_lidar),
    })
}
