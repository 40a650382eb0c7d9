//! The driver's thread over pseudo-terminals: unplugged, at a wrong speed, with a held head.
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
use stockpilot_sim::lidar::{LidarModel, LineFaults, Mishap, Room, SerialLidar};
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

const STEP: Duration = Duration::from_millis(25);
/// Long enough for any machine; no test waits for it to pass.
const LIMIT: Duration = Duration::from_secs(30);

struct Rig {
    _folder: tempfile::TempDir,
    link: PathBuf,
    model: LidarModel,
    lidar: Option<SerialLidar>,
    room: Room,
    nanos: Arc<AtomicI64>,
    driver: Driver,
    status: watch::Receiver<LidarStatus>,
    events: mpsc::Receiver<Event>,
}

impl Rig {
    fn new(model: Model, settings: impl FnOnce(Settings) -> Settings) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("lidar");
        let model = exact(model);
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

    fn now(&self) -> Stamp<Mono> {
        Stamp::from_nanos(self.nanos.load(Ordering::SeqCst))
    }

    /// One step of virtual time; the driver has looked at the line after it.
    async fn step(&mut self) {
        let now = self.now().plus(STEP);
        self.nanos.store(now.nanos_since(Stamp::ZERO), Ordering::SeqCst);
        if let Some(lidar) = &mut self.lidar {
            lidar.advance(now, &mut self.room).unwrap();
        }
        tokio::time::timeout(LIMIT, self.status.changed()).await.unwrap().unwrap();
        self.status.mark_unchanged();
    }

    /// Virtual seconds until the status is as wanted.
    async fn until(&mut self, limit_s: f64, is_met: impl Fn(&LidarStatus) -> bool) -> f64 {
        let start = self.now();
        while !is_met(&self.status.borrow()) {
            let waited_s = self.now().seconds_since(start);
            assert!(waited_s < limit_s, "after {waited_s} s: {:?}", self.status.borrow());
            self.step().await;
        }
        self.now().seconds_since(start)
    }

    async fn until_streaming(&mut self) -> f64 {
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

const ONE_OF_EACH: [Model; 4] =
    [Model::Ld19, Model::RplidarA3, Model::YdlidarG4, Model::HokuyoUrg04lx];

#[tokio::test]
async fn a_held_head_is_told_within_two_seconds_and_forgotten_when_it_turns() {
    for model in ONE_OF_EACH {
        let mut rig = Rig::new(model, |s| Settings { model: Some(model), ..s });
        rig.until_streaming().await;
        for _ in 0..60 {
            rig.step().await;
        }
        let now = rig.now();
        rig.lidar.as_mut().unwrap().suffer(Mishap::HeadHeld(true), now);
        let told_s = rig.until(2.0, |s| s.health != LidarHealth::Streaming).await;
        println!("{:18} told after {told_s:.2} s", model.name());
        let now = rig.now();
        rig.lidar.as_mut().unwrap().suffer(Mishap::HeadHeld(false), now);
        rig.until_streaming().await;
        rig.driver.stop();
    }
}

#[tokio::test]
async fn an_unplugged_sensor_is_told_at_once_and_streams_again_after_it_is_plugged_in() {
    for model in ONE_OF_EACH {
        let mut rig = Rig::new(model, |s| Settings { model: Some(model), ..s });
        rig.until_streaming().await;
        rig.lidar = None;
        let is_gone = |s: &LidarStatus| matches!(s.health, LidarHealth::Disconnected { .. });
        tokio::time::timeout(LIMIT, rig.status.wait_for(|s| is_gone(s))).await.unwrap().unwrap();
        rig.lidar = Some(plug(&rig.model, &rig.link, rig.now()));
        let n_events = rig.events.len();
        let is_back = |s: &LidarStatus| s.stats.reconnects == 1;
        tokio::time::timeout(LIMIT, rig.status.wait_for(|s| is_back(s))).await.unwrap().unwrap();
        rig.until_streaming().await;
        for _ in 0..12 {
            rig.step().await;
        }
        assert!(rig.events.len() > n_events);
        rig.driver.stop();
    }
}

#[tokio::test]
async fn a_wrong_speed_is_told_within_two_seconds() {
    for (model, baud) in [(Model::Ld19, 115_200), (Model::YdlidarX2, 230_400)] {
        let mut rig = Rig::new(model, |s| Settings { model: Some(model), baud: Some(baud), ..s });
        let told = LidarHealth::NoFrames { baud };
        rig.until(2.0, |status| status.health == told).await;
        rig.driver.stop();
    }
}

#[tokio::test]
async fn an_rplidar_with_another_speed_than_its_model_is_found() {
    // An A2 sold with the faster interface.
    let mut rig =
        Rig::new(Model::RplidarA2m12, |s| Settings { model: Some(Model::RplidarA2), ..s });
    rig.until_streaming().await;
    let status = rig.status.borrow().clone();
    assert_eq!(status.baud, 256_000);
    assert_eq!(status.identity.unwrap().model, Some(Model::RplidarA2m12));
    rig.driver.stop();
}

#[tokio::test]
async fn an_unknown_sensor_is_found_and_streams() {
    for model in [Model::RplidarS1, Model::YdlidarX4] {
        let mut rig = Rig::new(model, |s| s);
        rig.until_streaming().await;
        assert_eq!(rig.status.borrow().identity.as_ref().unwrap().model, Some(model));
        rig.driver.stop();
    }
}
