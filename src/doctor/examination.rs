//! Listens to everything for some seconds.

use super::cameras::OwnCameras;
use super::ports::port;
use super::{Check, Report, Verdict, judge, serial_ports, video_checks};
use crate::camera::images::devices::video_devices;
use crate::camera::{CameraStats, Listener};
use crate::config::Config;
use crate::lidar::{Driver, LidarHealth, LidarStatus, Settings};
use crate::link::LinkBudget;
use crate::pilot::Pilot;
use crate::service::clock::Clock;
use crate::service::{Service, ServiceSetup, ServiceStatus};
use crate::time::{Mono, Stamp};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Scans and frames that may wait; nobody is late here.
const WAITING: usize = 64;
/// After the sensor streams, rates are counted this long.
const COUNTING: Duration = Duration::from_millis(2500);
/// Two looks of the link at the rate of the samples on a serial line, and the time until the first.
const RATE_SEEN_AFTER: Duration = Duration::from_secs(6);
/// How often it is looked whether everything is there.
const LOOKING_EVERY: Duration = Duration::from_millis(100);

/// How long is waited for what does not come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience(pub Duration);

impl Default for Patience {
    /// Twelve seconds: enough for a sensor to be found at any line speed and to spin up.
    fn default() -> Self {
        Self(Duration::from_secs(12))
    }
}

/// What is examined, and by which clock.
#[derive(Debug)]
pub struct Examination<'a> {
    /// Everything that is configured; without it only ports, video devices and sensors are looked at.
    pub config: Option<&'a Config>,
    /// Look at the LiDAR on this port only.
    pub port: Option<PathBuf>,
    /// The autopilot's parameters must be those of this file.
    pub params: Option<PathBuf>,
    /// How long to wait.
    pub patience: Patience,
    /// The clock that stamps everything.
    pub clock: Clock,
}

impl Examination<'_> {
    /// Looks at everything at once and judges it.
    pub async fn run(&self) -> Report {
        let mut checks = Vec::new();
        let ports = serial_ports();
        checks.extend(ports.iter().map(super::SerialPort::check));
        // What is configured is tried out below; the list is for who still has to write it.
        if self.config.is_none() {
            checks.extend(video_checks(&video_devices()));
        }
        match self.config {
            Some(config) => checks.extend(Box::pin(self.configured(config)).await),
            None => {
                let named = self.port.iter().cloned();
                let found = ports.into_iter().filter(|port| port.is_permitted).map(|p| p.path);
                let paths: Vec<PathBuf> =
                    if self.port.is_some() { named.collect() } else { found.collect() };
                if paths.is_empty() {
                    checks.push(no_port());
                }
                for path in paths {
                    let settings = settings(&path);
                    checks.extend(self.lidar_alone(settings).await);
                }
            }
        }
        checks.push(clock_check());
        Report { checks }
    }

    /// One LiDAR without the rest.
    async fn lidar_alone(&self, settings: Settings) -> Vec<Check> {
        let stop = CancellationToken::new();
        let (scans_tx, mut scans) = mpsc::channel(WAITING);
        let expected = settings.model;
        let clock = self.clock.clone();
        let driver = match Driver::start(settings, move || clock.now(), scans_tx, &stop) {
            Ok(driver) => driver,
            Err(error) => return vec![cannot_open(&error.to_string())],
        };
        let mut status = driver.status();
        let limit = self.clock.now().plus(self.patience.0);
        let mut streams_since = None;
        loop {
            while scans.try_recv().is_ok() {}
            let now = self.clock.now();
            note_streaming(&mut streams_since, &status.borrow_and_update(), now);
            if now >= limit || has_counted(streams_since, now) {
                break;
            }
            self.clock.sleep_until(now.plus(LOOKING_EVERY)).await;
        }
        let last = status.borrow().clone();
        stop_driver(driver).await;
        judge::lidar(&last, expected)
    }

    /// LiDAR, detector, autopilot and log, as in flight.
    async fn configured(&self, config: &Config) -> Vec<Check> {
        let parts = (config.pilot_settings(), config.link_settings(), config.lidar_settings());
        let (pilot, link, lidar) = match parts {
            (Ok(pilot), Ok(link), Ok(lidar)) => (pilot, link, lidar),
            (Err(error), ..) | (_, Err(error), _) | (.., Err(error)) => {
                let cure = "mend this key; `run --print-config` checks the file";
                let found = error.to_string();
                return vec![Check::with_cure("configuration", Verdict::Bad, found, cure)];
            }
        };
        let mut checks = vec![Check::good("configuration", "every key is in its range")];
        checks.extend(port(lidar.port.clone().into()).map(|port| port.check()));
        checks.push(log_check(&config.log.directory));
        let stop = CancellationToken::new();
        let (scans_tx, scans) = mpsc::channel(WAITING);
        let (frames_tx, tags) = mpsc::channel(WAITING);
        let expected = lidar.model;
        let clock = self.clock.clone();
        let driver = Driver::start(lidar, move || clock.now(), scans_tx, &stop);
        let cameras = OwnCameras::start(config, &self.clock, &frames_tx, &stop);
        let (camera_stats, listener_error) = self.listen(config, frames_tx, &stop).await;
        let address = link.address.to_string();
        let budget = LinkBudget::of(&link);
        let link_settings = link.clone();
        let setup = ServiceSetup {
            pilot: Pilot::new(pilot),
            link,
            clock: self.clock.clone(),
            stop: stop.clone(),
            scans,
            tags,
            storage: mpsc::channel(1).1,
            recorder: None,
            page: None,
        };
        let service = Service::start(setup).await;
        let lidar_status = driver.as_ref().ok().map(Driver::status);
        let service_status = service.as_ref().ok().map(crate::service::RunningService::status);
        let (began, listened) = self
            .wait(
                lidar_status.as_ref(),
                (&camera_stats, &cameras),
                (service_status.as_ref(), budget.is_some()),
            )
            .await;
        tracing::debug!(seconds = listened.as_secs_f64(), began = began.seconds(), "listened");
        match &driver {
            Ok(driver) => checks.extend(judge::lidar(&driver.status().borrow(), expected)),
            Err(error) => checks.push(cannot_open(&error.to_string())),
        }
        if cameras.is_empty() {
            checks.push(listener_error.unwrap_or_else(|| {
                judge::detector(&camera_stats.borrow(), &config.detections, listened)
            }));
        } else {
            checks.extend(listener_error);
            checks.extend(cameras.end(listened));
        }
        match (&service, &service_status) {
            (Ok(_), Some(status)) => checks.extend(link_lines(&status.borrow(), &address, budget)),
            (Err(error), _) => checks.push(no_link(&error.to_string(), &address)),
            (Ok(_), None) => {}
        }
        stop.cancel();
        if let Ok(driver) = driver {
            stop_driver(driver).await;
        }
        if let Ok(service) = service
            && let Err(error) = service.join().await
        {
            tracing::error!(%error, "the examination's brain died");
        }
        // Only now is the link free.
        if let Some(path) = &self.params {
            let clock = self.clock.clone();
            checks.extend(super::parameters::check(path, &link_settings, clock).await);
        }
        checks
    }

    async fn listen(
        &self,
        config: &Config,
        frames: mpsc::Sender<crate::pilot::Event>,
        stop: &CancellationToken,
    ) -> (watch::Receiver<CameraStats>, Option<Check>) {
        let none = || watch::Sender::new(CameraStats::default()).subscribe();
        let refused = |error: String| {
            let cure = "see that nothing else listens there: `ss -lunp`";
            Some(Check::with_cure("detector", Verdict::Bad, error, cure))
        };
        let settings = match config.camera_settings() {
            Ok(settings) => settings,
            Err(error) => return (none(), refused(error.to_string())),
        };
        match Listener::bind(settings).await {
            Ok(listener) => {
                let stats = listener.stats();
                let clock = self.clock.clone();
                tokio::spawn(listener.run(move || clock.now(), frames, stop.child_token()));
                (stats, None)
            }
            Err(error) => (none(), refused(format!("{}: {error}", config.detections))),
        }
    }

    /// Waits until everything is there and its rates are counted, or patience ends.
    async fn wait(
        &self,
        lidar: Option<&watch::Receiver<LidarStatus>>,
        (detector, cameras): (&watch::Receiver<CameraStats>, &OwnCameras),
        (service, is_serial): (Option<&watch::Receiver<ServiceStatus>>, bool),
    ) -> (Stamp<Mono>, Duration) {
        let began = self.clock.now();
        let limit = began.plus(self.patience.0);
        let mut streams_since = None;
        loop {
            let now = self.clock.now();
            if let Some(lidar) = lidar {
                note_streaming(&mut streams_since, &lidar.borrow(), now);
            }
            let is_counted = lidar.is_none() || has_counted(streams_since, now);
            let is_sent = !cameras.is_empty() || detector.borrow().frames > 0;
            let sees = is_sent && cameras.have_delivered();
            let hears = service.is_none_or(|service| {
                let status = service.borrow();
                // An old PX4 never tells its mode at once; then the patience ends this.
                status.vehicle.is_some_and(|v| v.is_mode_prompt) && status.is_clock_known
            });
            let has_rate = !is_serial || now.since(began) >= RATE_SEEN_AFTER;
            if now >= limit || (is_counted && sees && hears && has_rate) {
                return (began, now.since(began));
            }
            self.clock.sleep_until(now.plus(LOOKING_EVERY)).await;
        }
    }
}

fn no_link(error: &str, address: &str) -> Check {
    Check::with_cure(
        "autopilot",
        Verdict::Bad,
        format!("{error}: {address}"),
        "see that nothing else uses this address: `ss -lunp`, `fuser -v DEVICE`",
    )
}

/// The autopilot, and the serial line to it if there is one.
fn link_lines(status: &ServiceStatus, address: &str, budget: Option<LinkBudget>) -> Vec<Check> {
    let mut checks = judge::autopilot(status, address);
    checks.extend(budget.map(|budget| judge::serial_line(&budget, status)));
    checks
}

fn settings(path: &Path) -> Settings {
    Settings { port: path.to_string_lossy().into_owned(), model: None, baud: None }
}

fn note_streaming(since: &mut Option<Stamp<Mono>>, status: &LidarStatus, now: Stamp<Mono>) {
    if status.health == LidarHealth::Streaming {
        since.get_or_insert(now);
    } else {
        *since = None;
    }
}

fn has_counted(since: Option<Stamp<Mono>>, now: Stamp<Mono>) -> bool {
    since.is_some_and(|since| now.since(since) >= COUNTING)
}

/// Joining a thread blocks for one poll of the port.
async fn stop_driver(driver: Driver) {
    if let Err(error) = tokio::task::spawn_blocking(move || driver.stop()).await {
        tracing::error!(%error, "the LiDAR driver died");
    }
}

fn cannot_open(error: &str) -> Check {
    // The error of an open port says what to do after its semicolon.
    let (found, cure) = error.split_once("; ").unwrap_or((error, "see `dmesg | tail`"));
    Check::with_cure("lidar", Verdict::Bad, found, cure)
}

fn no_port() -> Check {
    Check::with_cure(
        "lidar",
        Verdict::Bad,
        "no serial port that may be opened",
        "plug the sensor's adapter in; `dmesg -w` shows whether the system sees it",
    )
}

fn log_check(directory: &Path) -> Check {
    let subject = "log";
    let probe = directory.join(".stockpilot-doctor");
    let written = std::fs::create_dir_all(directory)
        .and_then(|()| std::fs::write(&probe, b"doctor"))
        .and_then(|()| std::fs::remove_file(&probe));
    match written {
        Ok(()) => Check::good(subject, format!("{} can be written", directory.display())),
        Err(error) => Check::with_cure(
            subject,
            Verdict::Bad,
            format!("{}: {error}", directory.display()),
            "make the folder writable for this user, or name another as `log.directory`",
        ),
    }
}

fn clock_check() -> Check {
    let now_s = u64::try_from(jiff::Timestamp::now().as_second()).unwrap_or(0);
    // systemd-timesyncd leaves this file once it has set the clock.
    let service = Path::new("/run/systemd/timesync");
    let is_synchronised = service.exists().then(|| service.join("synchronized").exists());
    judge::wall_clock(now_s, is_synchronised)
}
