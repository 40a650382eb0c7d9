//! The driver's thread and an emulated sensor on a pseudo-terminal.
//!
//! The driver tells its status after every read, and the emulator waits for that, so the two go in
//! step and virtual time needs no sleeping.

use crate::support::{exact, room};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;
use stockpilot::lidar::{Driver, LidarHealth, LidarStatus, Model, Settings};
use stockpilot::pilot::Event;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::lidar::{LidarModel, LineFaults, Room, SerialLidar};
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

const STEP: Duration = Duration::from_millis(25);
/// Long enough for any machine; no test waits for it to pass.
const LIMIT: Duration = Duration::from_secs(30);

/// A sensor, its driver, and the clock of both.
pub(crate) struct Rig {
    _folder: tempfile::TempDir,
    link: PathBuf,
    model: LidarModel,
    lidar: Option<SerialLidar>,
    room: Room,
    nanos: Arc<AtomicI64>,
    pub(crate) driver: Driver,
    pub(crate) status: watch::Receiver<LidarStatus>,
    pub(crate) events: mpsc::Receiver<Event>,
}

impl Rig {
    /// A sensor that has just got its power, behind a port with these settings.
    pub(crate) fn new(model: Model, settings: impl FnOnce(Settings) -> Settings) -> Self {
        Self::with(exact(model), settings)
    }

    /// The same for a sensor that is in no catalogue.
    pub(crate) fn with(model: LidarModel, settings: impl FnOnce(Settings) -> Settings) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("lidar");
        let lidar = plug(&model, &link, Stamp::ZERO);
        let nanos = Arc::new(AtomicI64::new(0));
        let clock = Arc::clone(&nanos);
        let now = move || Stamp::from_nanos(clock.load(Ordering::SeqCst));
        let (events_tx, events) = mpsc::channel(4096);
        let port = link.to_str().unwrap().to_owned();
        let settings = settings(Settings { port, model: None, baud: None });
        let driver = Driver::start(settings, now, events_tx, &CancellationToken::new()).unwrap();
        let status = driver.status();
        let room = room(&model);
        let lidar = Some(lidar);
        Self { _folder: folder, link, model, lidar, room, nanos, driver, status, events }
    }

    pub(crate) fn now(&self) -> Stamp<Mono> {
        Stamp::from_nanos(self.nanos.load(Ordering::SeqCst))
    }

    /// The sensor, which is plugged in.
    pub(crate) fn lidar(&mut self) -> &mut SerialLidar {
        self.lidar.as_mut().unwrap()
    }

    pub(crate) fn unplug(&mut self) {
        self.lidar = None;
    }

    /// Plugs the sensor in again, as a new device behind the same link.
    pub(crate) fn plug_in(&mut self) {
        self.lidar = Some(plug(&self.model, &self.link, self.now()));
    }

    /// Waits without virtual time: for what the driver does by itself.
    pub(crate) async fn wait_for(&mut self, is_met: impl Fn(&LidarStatus) -> bool) {
        tokio::time::timeout(LIMIT, self.status.wait_for(is_met)).await.unwrap().unwrap();
    }

    /// One step of virtual time; the driver has looked at the line after it.
    pub(crate) async fn step(&mut self) {
        let now = self.now().plus(STEP);
        self.nanos.store(now.nanos_since(Stamp::ZERO), Ordering::SeqCst);
        if let Some(lidar) = &mut self.lidar {
            lidar.advance(now, &mut self.room).unwrap();
        }
        tokio::time::timeout(LIMIT, self.status.changed()).await.unwrap().unwrap();
        self.status.mark_unchanged();
    }

    /// Virtual seconds until the status is as wanted.
    pub(crate) async fn until(
        &mut self,
        limit_s: f64,
        is_met: impl Fn(&LidarStatus) -> bool,
    ) -> f64 {
        let start = self.now();
        while !is_met(&self.status.borrow()) {
            let waited_s = self.now().seconds_since(start);
            assert!(waited_s < limit_s, "after {waited_s} s: {:?}", self.status.borrow());
            self.step().await;
        }
        self.now().seconds_since(start)
    }

    pub(crate) async fn until_streaming(&mut self) -> f64 {
        self.until(12.0, |status| status.health == LidarHealth::Streaming).await
    }
}

fn plug(model: &LidarModel, link: &std::path::Path, now: Stamp<Mono>) -> SerialLidar {
    let faults = LineFaults { checks_speed: true, ..LineFaults::default() };
    let lidar = SerialLidar::open(model, faults, SeedBook::new(3), now, false).unwrap();
    if link.is_symlink() {
        std::fs::remove_file(link).unwrap();
    }
    std::os::unix::fs::symlink(lidar.path(), link).unwrap();
    lidar
}
