//! The whole service against a scripted autopilot, in virtual time.

use crate::support::{Peer, at_ms, patiently, px4_heartbeat, timesync_frame, until};
use mavlink::dialects::ardupilotmega::{MavMessage, MavType};
use std::sync::{Arc, Mutex};
use stockpilot::config::Config;
use stockpilot::link;
use stockpilot::messages::{Declaration, FlightMode, Scan};
use stockpilot::pilot::{Action, Event, Pilot};
use stockpilot::service::clock::{Clock, ClockDriver};
use stockpilot::service::{Recorder, RunningService, Service, ServiceSetup};
use stockpilot::time::{Mono, Stamp};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

#[derive(Debug, Default)]
struct Kept {
    events: Vec<Event>,
    is_finished: bool,
}

struct RecordingSink(Arc<Mutex<Kept>>);

impl Recorder for RecordingSink {
    fn event(&mut self, _at: Stamp<Mono>, event: &Event) {
        let mut kept = self.0.lock().unwrap();
        assert!(!kept.is_finished);
        kept.events.push(event.clone());
    }

    fn action(&mut self, _at: Stamp<Mono>, _action: &Action) {}

    fn declared(&mut self, _at: Stamp<Mono>, _said: &Declaration) {}

    fn lost(&self) -> u64 {
        0
    }

    fn close(self: Box<Self>) -> u64 {
        self.0.lock().unwrap().is_finished = true;
        0
    }
}

/// A full disk.
#[derive(Default)]
struct FailingRecorder {
    lost: u64,
}

impl Recorder for FailingRecorder {
    fn event(&mut self, _at: Stamp<Mono>, _event: &Event) {
        self.lost += 1;
    }

    fn action(&mut self, _at: Stamp<Mono>, _action: &Action) {}

    fn declared(&mut self, _at: Stamp<Mono>, _said: &Declaration) {}

    fn lost(&self) -> u64 {
        self.lost
    }

    fn close(self: Box<Self>) -> u64 {
        self.lost
    }
}

/// A brain for the example's hall.
pub(crate) fn pilot() -> Pilot {
    let example = include_str!("../../deploy/config.example.toml");
    let config = Config::from_toml(example, "config.example.toml".as_ref()).unwrap();
    Pilot::new(config.pilot_settings().unwrap())
}

fn setup(clock: Clock, recorder: impl Recorder) -> (ServiceSetup, mpsc::Sender<Event>) {
    let (scans, scans_rx) = mpsc::channel(16);
    let (_tags, tags_rx) = mpsc::channel(16);
    let setup = ServiceSetup {
        pilot: pilot(),
        link: link::Settings::new("udpin:127.0.0.1:0".parse().unwrap()),
        clock,
        stop: CancellationToken::new(),
        scans: scans_rx,
        tags: tags_rx,
        storage: mpsc::channel(1).1,
        recorder: Some(Box::new(recorder)),
        page: None,
    };
    (setup, scans)
}

struct Scene {
    service: RunningService,
    driver: ClockDriver,
    kept: Arc<Mutex<Kept>>,
    scans: mpsc::Sender<Event>,
    autopilot: Peer,
}

impl Scene {
    async fn new() -> Self {
        let (clock, driver) = Clock::driven();
        let kept = Arc::new(Mutex::new(Kept::default()));
        let (setup, scans) = setup(clock, RecordingSink(Arc::clone(&kept)));
        let service = Service::start(setup).await.unwrap();
        let autopilot = Peer::new(service.link_addr().unwrap()).await;
        Self { service, driver, kept, scans, autopilot }
    }

    /// Moves the clock tick by tick, and waits at each for the brain.
    async fn fly_until(&self, ms: i64) {
        while self.driver.now() < at_ms(ms) {
            let ticks_before = self.ticks();
            let next = (ticks_before + 1) * 1_000_000_000 / 60;
            self.driver.advance_to(Stamp::from_nanos(next));
            until(|| self.ticks() > ticks_before).await;
        }
    }

    fn ticks(&self) -> i64 {
        let kept = self.kept.lock().unwrap();
        let is_tick = |event: &&Event| matches!(event, Event::Ticked(_));
        i64::try_from(kept.events.iter().filter(is_tick).count()).unwrap()
    }

    async fn hears<T>(&self, wanted: impl Fn(MavMessage) -> Option<T>) -> T {
        patiently(async {
            loop {
                let (header, message) = self.autopilot.hears().await;
                assert_eq!((header.system_id, header.component_id), (1, 191));
                if let Some(found) = wanted(message) {
                    return found;
                }
            }
        })
        .await
    }
}

#[tokio::test]
async fn the_service_takes_its_place_answers_records_and_ends() {
    let scene = Scene::new().await;
    scene.fly_until(100).await;
    assert_eq!(scene.autopilot.heard(), 0);
    scene.autopilot.says(&px4_heartbeat()).await;
    let mut status = scene.service.status();
    scene.fly_until(300).await;
    patiently(status.wait_for(|status| status.vehicle.is_some())).await.unwrap();
    assert_eq!(status.borrow().vehicle.unwrap().mode, FlightMode::Companion);
    let mavtype = scene
        .hears(|message| match message {
            MavMessage::HEARTBEAT(data) => Some(data.mavtype),
            _ => None,
        })
        .await;
    assert_eq!(mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
    // A clock request is answered with the arrival in virtual time, between ticks.
    scene.autopilot.says(&timesync_frame(0, 4_711)).await;
    let tc1 = scene
        .hears(|message| match message {
            MavMessage::TIMESYNC(data) if data.tc1 != 0 => {
                assert_eq!(data.ts1, 4_711);
                Some(data.tc1)
            }
            _ => None,
        })
        .await;
    assert_eq!(tc1, scene.driver.now().nanos());
    let scan = Event::Scanned(Scan { start: at_ms(290), beams: Vec::new() });
    scene.scans.send(scan.clone()).await.unwrap();
    scene.fly_until(400).await;
    scene.service.stop();
    let stats = patiently(scene.service.join()).await.unwrap();
    assert_eq!((stats.records_lost, stats.outgoing_lost, stats.ticks_skipped), (0, 0, 0));
    let kept = scene.kept.lock().unwrap();
    assert!(kept.is_finished);
    let events = &kept.events;
    assert!(events.contains(&scan));
    assert_eq!(stats.events, u64::try_from(events.len()).unwrap());
    // Tick k strikes at exactly k/60 s.
    let ticks: Vec<i64> = events
        .iter()
        .filter_map(|event| match event {
            Event::Ticked(at) => Some(at.nanos()),
            _ => None,
        })
        .collect();
    let expected: Vec<i64> = (1..=24).map(|k| k * 1_000_000_000 / 60).collect();
    assert_eq!(ticks, expected);
}

#[tokio::test]
async fn a_silent_autopilot_is_told_and_nothing_speaks_after_the_end() {
    let scene = Scene::new().await;
    scene.autopilot.says(&px4_heartbeat()).await;
    let mut status = scene.service.status();
    scene.fly_until(120).await;
    patiently(status.wait_for(|status| status.vehicle.is_some())).await.unwrap();
    scene.fly_until(3_300).await;
    let is_lost = |event: &&Event| matches!(event, Event::AutopilotLost(_));
    assert_eq!(scene.kept.lock().unwrap().events.iter().filter(is_lost).count(), 1);
    scene.service.stop();
    let stats = patiently(scene.service.join()).await.unwrap();
    assert_eq!(stats.link.autopilot_losses, 1);
    scene.autopilot.heard();
    scene.driver.advance_to(at_ms(20_000));
    for _ in 0..100 {
        tokio::task::yield_now().await;
    }
    assert_eq!(scene.autopilot.heard(), 0);
}

#[tokio::test]
async fn a_full_disk_is_counted_and_does_not_stop_the_brain() {
    let (clock, driver) = Clock::driven();
    let (setup, _scans) = setup(clock, FailingRecorder::default());
    let service = Service::start(setup).await.unwrap();
    let mut status = service.status();
    for ms in 1..=200 {
        driver.advance_to(at_ms(ms));
        tokio::task::yield_now().await;
    }
    patiently(status.wait_for(|status| status.stats.ticks >= 6)).await.unwrap();
    service.stop();
    let stats = patiently(service.join()).await.unwrap();
    assert_eq!(stats.records_lost, stats.events);
}
