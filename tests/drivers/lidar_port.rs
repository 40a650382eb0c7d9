//! The serial thread over pseudo-terminals.

use crate::support::{frame, stream};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;
use stockpilot::lidar::{Driver, LidarHealth, LidarStatus, Model, OpenError, Settings};
use stockpilot::messages::Scan;
use stockpilot::pilot::Event;
use stockpilot::time::{Mono, Stamp};
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Long enough for any machine; no test waits for it to pass.
const LIMIT: Duration = Duration::from_secs(20);

/// The sensor's end of a serial line.
struct Line {
    sensor: OwnedFd,
    port: String,
}

impl Line {
    fn new() -> Self {
        let sensor = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&sensor).unwrap();
        unlockpt(&sensor).unwrap();
        let port = ptsname(&sensor, Vec::new()).unwrap().into_string().unwrap();
        Self { sensor, port }
    }

    fn send(&self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let n = rustix::io::write(&self.sensor, rest).unwrap();
            rest = &rest[n..];
        }
    }

    fn settings(&self) -> Settings {
        Settings { port: self.port.clone(), model: Some(Model::Ld19), baud: None }
    }
}

/// A clock that stands still until it is set.
#[derive(Clone, Default)]
struct HandClock(Arc<AtomicI64>);

impl HandClock {
    fn set(&self, to: Duration) {
        self.0.store(i64::try_from(to.as_nanos()).unwrap(), Ordering::SeqCst);
    }

    fn reader(&self) -> impl Fn() -> Stamp<Mono> + Send + 'static {
        let nanos = Arc::clone(&self.0);
        move || Stamp::from_nanos(nanos.load(Ordering::SeqCst))
    }
}

struct Rig {
    line: Line,
    clock: HandClock,
    driver: Driver,
    events: mpsc::Receiver<Event>,
    status: watch::Receiver<LidarStatus>,
}

fn rig(channel_size: usize) -> Rig {
    let (line, clock) = (Line::new(), HandClock::default());
    let (events_tx, events) = mpsc::channel(channel_size);
    let cancel = CancellationToken::new();
    let driver = Driver::start(line.settings(), clock.reader(), events_tx, &cancel).unwrap();
    let status = driver.status();
    Rig { line, clock, driver, events, status }
}

async fn next_scan(events: &mut mpsc::Receiver<Event>) -> Scan {
    match tokio::time::timeout(LIMIT, events.recv()).await.unwrap().unwrap() {
        Event::Scanned(scan) => scan,
        other => unreachable!("the driver sends scans only, not {other:?}"),
    }
}

async fn wait_until(
    status: &mut watch::Receiver<LidarStatus>,
    is_met: impl FnMut(&LidarStatus) -> bool,
) -> LidarStatus {
    tokio::time::timeout(LIMIT, status.wait_for(is_met)).await.unwrap().unwrap().clone()
}

#[tokio::test]
async fn two_turns_come_through_a_serial_line() {
    let mut rig = rig(16);
    rig.line.send(&stream(80));
    let scan = next_scan(&mut rig.events).await;
    assert_eq!(scan.beams.len(), 450);
    assert!(scan.beams.iter().all(|beam| (beam.range_m - 2.0).abs() < 1e-6));
    let status = wait_until(&mut rig.status, |status| status.stats.frames == 80).await;
    assert_eq!(status.health, LidarHealth::Streaming);
    assert_eq!((status.stats.missing_samples, status.stats.skipped_bytes), (0, 0));
    rig.driver.stop();
}

#[tokio::test]
async fn a_hundred_turns_come_without_loss() {
    // 176 kB, ten times what a pseudo-terminal holds: writing waits for the reader.
    let mut rig = rig(256);
    let bytes = stream(3750);
    let line = rig.line;
    let sending = std::thread::spawn(move || {
        line.send(&bytes);
        line
    });
    let status = wait_until(&mut rig.status, |status| status.stats.frames == 3750).await;
    let line = sending.join().unwrap();
    assert_eq!((status.stats.missing_samples, status.stats.skipped_bytes), (0, 0));
    drop(line);
    // Unplugged, the driver hands over the last, unfinished turn too.
    let is_all = |status: &LidarStatus| status.stats.beams == 3750 * 12;
    let status = wait_until(&mut rig.status, is_all).await;
    assert_eq!(status.stats.lost_beams, 0);
}

#[tokio::test]
async fn stopping_hands_over_nothing_more_and_ends_the_thread() {
    let mut rig = rig(16);
    rig.driver.stop();
    assert!(rig.events.recv().await.is_none());
    let status = wait_until(&mut rig.status, |_| true).await;
    assert_eq!(status.health, LidarHealth::Stopped);
}

#[tokio::test]
async fn silence_is_told_and_forgotten() {
    let mut rig = rig(16);
    rig.line.send(&stream(1));
    wait_until(&mut rig.status, |status| status.health == LidarHealth::Streaming).await;
    rig.clock.set(Duration::from_millis(1500));
    wait_until(&mut rig.status, |status| status.health == LidarHealth::Silent).await;
    rig.line.send(&frame(1).to_bytes());
    wait_until(&mut rig.status, |status| status.health == LidarHealth::Streaming).await;
}

#[tokio::test]
async fn bytes_without_frames_name_the_baud() {
    let mut rig = rig(16);
    rig.line.send(&[0xA5; 100]);
    wait_until(&mut rig.status, |status| status.stats.bytes == 100).await;
    rig.clock.set(Duration::from_millis(1100));
    rig.line.send(&[0xA5; 100]);
    let told = LidarHealth::NoFrames { baud: 230_400 };
    wait_until(&mut rig.status, |status| status.health == told).await;
}

#[tokio::test]
async fn a_full_channel_loses_and_counts_but_never_blocks() {
    let mut rig = rig(1);
    // Four whole turns end in 151 frames; the channel holds one of them.
    rig.line.send(&stream(151));
    let status = wait_until(&mut rig.status, |status| status.stats.frames == 151).await;
    assert_eq!(status.stats.scans, 1);
    assert_eq!(status.stats.beams, 450);
    assert_eq!(status.stats.lost_beams, 3 * 450);
}

#[tokio::test]
async fn an_unplugged_sensor_is_found_again_under_the_same_name() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("lidar");
    let line = Line::new();
    std::os::unix::fs::symlink(&line.port, &link).unwrap();
    let settings = Settings { port: link.to_str().unwrap().into(), ..line.settings() };
    let (events_tx, mut events) = mpsc::channel(16);
    let cancel = CancellationToken::new();
    let clock = HandClock::default();
    let driver = Driver::start(settings, clock.reader(), events_tx, &cancel).unwrap();
    let mut status = driver.status();

    drop(line);
    wait_until(&mut status, |s| matches!(s.health, LidarHealth::Disconnected { .. })).await;
    let again = Line::new();
    std::fs::remove_file(&link).unwrap();
    std::os::unix::fs::symlink(&again.port, &link).unwrap();
    wait_until(&mut status, |status| status.stats.reconnects == 1).await;
    again.send(&stream(80));
    assert_eq!(next_scan(&mut events).await.beams.len(), 450);
}

#[test]
fn open_errors_name_the_cure() {
    let start = |settings| {
        let (events, _) = mpsc::channel(1);
        let now = HandClock::default().reader();
        Driver::start(settings, now, events, &CancellationToken::new()).err().unwrap()
    };
    let line = Line::new();
    let (events, _events_rx) = mpsc::channel(1);
    let first = Driver::start(
        line.settings(),
        HandClock::default().reader(),
        events,
        &CancellationToken::new(),
    );
    assert!(first.is_ok());
    assert_eq!(start(line.settings()), OpenError::Busy { port: line.port.clone() });

    let missing = Settings { port: "/dev/no-such-lidar".into(), ..line.settings() };
    let error = start(missing);
    assert!(matches!(error, OpenError::Missing { .. }));
    assert!(error.to_string().contains("plugged in"));

    let no_serial = Settings { port: "/dev/null".into(), ..line.settings() };
    assert!(matches!(start(no_serial), OpenError::Unusable { .. }));
}
