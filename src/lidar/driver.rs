//! The thread that reads the serial port.

use super::port::{self, READ_TIMEOUT};
use super::watchdog::Watchdog;
use super::{
    AssemblerStats, Detector, Family, Found, Identity, LidarHealth, LidarStatus, Model, OpenError,
    Probe, ScanAssembler, Sensor, Settings, Stranger, sensor,
};
use crate::messages::Scan;
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use serialport::{SerialPort, TTYPort};
use std::io::{self, Read, Write};
use std::thread;
use std::time::Duration;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Pauses of [`READ_TIMEOUT`] between two attempts to open a lost port: one second.
const RETRY_PAUSES: u32 = 20;
/// The kernel's queue of a serial port holds no more.
const CHUNK_BYTES: usize = 4096;
/// A sensor that has said nothing sensible by then may talk at another line speed.
const BAUD_PATIENCE: Duration = Duration::from_millis(1500);
/// Where the search for an unknown sensor begins, bit/s.
const FIRST_BAUD: u32 = 115_200;

/// A running serial driver; reads until it is cancelled or the brain is gone.
///
/// Cancelling takes effect within 100 ms. Dropping the driver cancels it but does not wait.
#[derive(Debug)]
pub struct Driver {
    thread: Option<thread::JoinHandle<()>>,
    cancel: CancellationToken,
    status: watch::Receiver<LidarStatus>,
}

impl Driver {
    /// Opens the port and starts reading; every scan goes to `events` as [`Event::Scanned`].
    ///
    /// `now` is the service's clock. A full channel never blocks: the scan is dropped and counted.
    /// A port that is lost later is opened again every second.
    ///
    /// # Errors
    /// Why the port cannot be opened, with the cure.
    pub fn start(
        settings: Settings,
        now: impl Fn() -> Stamp<Mono> + Send + 'static,
        events: mpsc::Sender<Event>,
        cancel: &CancellationToken,
    ) -> Result<Self, OpenError> {
        let baud = settings.known_baud().unwrap_or(FIRST_BAUD);
        let port = port::open(&settings.port, baud)?;
        port::warn_of_latency(&settings.port);
        let (status_tx, status) = watch::channel(LidarStatus::default());
        let cancel = cancel.child_token();
        let port_name = settings.port.clone();
        let opened_at = now();
        let mut reader = Reader {
            target: settings.model.map(|model| Target::new(model, baud)),
            stranger: None,
            baud,
            watchdog: Watchdog::new(baud, opened_at, AssemblerStats::default()),
            status: LidarStatus::default(),
            opened_at,
            settings,
            now,
            events,
            cancel: cancel.clone(),
            status_tx,
        };
        let thread =
            thread::Builder::new().name("lidar".into()).spawn(move || reader.run(port)).map_err(
                |error| OpenError::Unusable { port: port_name, baud, cause: error.to_string() },
            )?;
        Ok(Self { thread: Some(thread), cancel, status })
    }

    /// Follows health and counts.
    #[must_use]
    pub fn status(&self) -> watch::Receiver<LidarStatus> {
        self.status.clone()
    }

    /// Cancels the driver and waits for its thread.
    pub fn stop(mut self) {
        self.cancel.cancel();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the lidar thread panicked");
        }
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}

/// A sensor and what puts its packets together.
struct Target {
    model: Model,
    sensor: Box<dyn Sensor>,
    assembler: ScanAssembler,
}

impl Target {
    fn new(model: Model, baud: u32) -> Self {
        // USB has no bits that take time.
        let line_baud = if model.family() == Family::Hokuyo { 0 } else { baud };
        Self { model, sensor: sensor(model), assembler: ScanAssembler::new(line_baud) }
    }
}

/// What the thread owns.
struct Reader<N> {
    settings: Settings,
    /// The sensor; `None` while it is being found out.
    target: Option<Target>,
    /// Who has answered in vain while it is being found out.
    stranger: Option<Stranger>,
    baud: u32,
    watchdog: Watchdog,
    status: LidarStatus,
    opened_at: Stamp<Mono>,
    now: N,
    events: mpsc::Sender<Event>,
    cancel: CancellationToken,
    status_tx: watch::Sender<LidarStatus>,
}

/// Why reading ended.
enum Ended {
    /// The port is gone.
    Lost(io::Error),
    /// Nothing came that makes sense; another line speed may do.
    NoSense,
    /// The driver is to end.
    Done,
}

impl<N: Fn() -> Stamp<Mono>> Reader<N> {
    fn run(&mut self, first_port: TTYPort) {
        let mut next_port = Some(first_port);
        while let Some(mut port) = next_port {
            let ended = self.use_port(&mut port);
            self.forget_conversation();
            next_port = match ended {
                Ended::Done => {
                    self.take_leave(&mut port);
                    None
                }
                Ended::NoSense => self.at_next_baud(port),
                Ended::Lost(reason) => {
                    drop(port);
                    self.tell(LidarHealth::Disconnected { reason: reason.to_string() });
                    self.reopen()
                }
            };
        }
        self.tell(LidarHealth::Stopped);
    }

    /// Finds out what is connected, if that is to be done, and reads.
    fn use_port(&mut self, port: &mut TTYPort) -> Ended {
        self.opened_at = (self.now)();
        if self.target.is_none() {
            match self.find_out(port) {
                Ok(Some(found)) => {
                    self.baud = found.baud;
                    self.target = Some(Target::new(found.model, found.baud));
                }
                Ok(None) if self.is_done() => return Ended::Done,
                Ok(None) => return Ended::NoSense,
                Err(error) => return Ended::Lost(error),
            }
        }
        let now = (self.now)();
        let Some(target) = &mut self.target else { return Ended::NoSense };
        target.sensor.restart(now);
        self.watchdog = Watchdog::new(self.baud, now, target.assembler.stats());
        self.read_until_ended(port)
    }

    fn find_out(&mut self, port: &mut TTYPort) -> io::Result<Option<Found>> {
        let mut detector = Detector::new(self.settings.baud);
        let mut chunk = [0; CHUNK_BYTES];
        while !detector.is_exhausted() && !self.is_done() {
            while let Some(probe) = detector.poll((self.now)()) {
                match probe {
                    Probe::SetBaud(baud) => port.set_baud_rate(baud)?,
                    Probe::Send(bytes) => port.write_all(&bytes)?,
                }
            }
            match port.read(&mut chunk) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(n_bytes) => {
                    if let Some(found) = detector.feed(&chunk[..n_bytes]) {
                        return Ok(Some(found));
                    }
                }
                Err(error) if is_only_slow(&error) => {}
                Err(error) => return Err(error),
            }
            self.tell(self.search_health(LidarHealth::Starting));
        }
        self.stranger = detector.stranger().cloned();
        Ok(None)
    }

    /// The health of a search: who has answered in vain, else this.
    fn search_health(&self, otherwise: LidarHealth) -> LidarHealth {
        self.stranger.as_ref().map_or(otherwise, |Stranger { name, baud }| LidarHealth::Unknown {
            name: name.clone(),
            baud: *baud,
        })
    }

    /// Reads until the port fails, nothing makes sense, or the driver is to end.
    fn read_until_ended(&mut self, port: &mut TTYPort) -> Ended {
        let mut chunk = [0; CHUNK_BYTES];
        loop {
            if let Err(error) = self.speak(port) {
                return Ended::Lost(error);
            }
            match port.read(&mut chunk) {
                Ok(0) => return Ended::Lost(io::ErrorKind::UnexpectedEof.into()),
                Ok(n_bytes) => self.take_in(&chunk[..n_bytes]),
                Err(error) if is_only_slow(&error) => {}
                Err(error) => return Ended::Lost(error),
            }
            self.take_stock();
            if self.is_done() {
                return Ended::Done;
            }
            if self.may_try_another_baud() {
                return Ended::NoSense;
            }
        }
    }

    /// Sends what the sensor is to be told.
    fn speak(&mut self, port: &mut TTYPort) -> io::Result<()> {
        let now = (self.now)();
        let Some(target) = &mut self.target else { return Ok(()) };
        while let Some(request) = target.sensor.poll(now) {
            match port::fulfil(port, &request) {
                Err(error) if is_only_slow(&error) => {}
                done => done?,
            }
        }
        Ok(())
    }

    fn take_in(&mut self, bytes: &[u8]) {
        let now = (self.now)();
        self.watchdog.note_bytes(now);
        let Some(target) = &mut self.target else { return };
        let Target { sensor, assembler, .. } = target;
        let (watchdog, status) = (&mut self.watchdog, &mut self.status);
        let mut scans = Vec::new();
        sensor.feed(bytes, now, &mut |packet| {
            watchdog.note_frame(now);
            status.last_frame_at = Some(now);
            assembler.push(packet, |scan| scans.push(scan));
        });
        scans.into_iter().for_each(|scan| self.hand_on(scan));
    }

    /// What has to be looked at even if nothing came.
    fn take_stock(&mut self) {
        let now = (self.now)();
        let Some(target) = &mut self.target else { return };
        let mut old = None;
        target.assembler.flush_if_old(now, |scan| old = Some(scan));
        self.status.rates = self.watchdog.note_counts(now, target.assembler.stats());
        let trouble = target.sensor.trouble().map(|trouble| trouble.text.clone());
        if let Some(scan) = old {
            self.hand_on(scan);
        }
        let health = match (self.watchdog.health(now), trouble) {
            (LidarHealth::Streaming, _) | (_, None) => self.watchdog.health(now),
            (_, Some(reason)) => LidarHealth::Faulty { reason },
        };
        self.tell(health);
    }

    fn hand_on(&mut self, scan: Scan) {
        let n_beams = scan.beams.len() as u64;
        match self.events.try_send(Event::Scanned(scan)) {
            Ok(()) => {
                self.status.stats.scans += 1;
                self.status.stats.beams += n_beams;
            }
            Err(TrySendError::Full(_) | TrySendError::Closed(_)) => {
                self.status.stats.lost_beams += n_beams;
            }
        }
    }

    /// Hands on the open scan; what comes next has nothing to do with it.
    fn forget_conversation(&mut self) {
        let mut rest = None;
        if let Some(target) = &mut self.target {
            target.assembler.reset(|scan| rest = Some(scan));
        }
        if let Some(scan) = rest {
            self.hand_on(scan);
        }
    }

    /// Leaves the sensor quiet and its motor off.
    fn take_leave(&self, port: &mut TTYPort) {
        for request in self.target.iter().flat_map(|target| target.sensor.farewell()) {
            if let Err(error) = port::fulfil(port, &request) {
                tracing::debug!(%error, "the lidar could not be told to stop");
            }
        }
    }

    /// True if the line speed is a guess that has had its chance.
    fn may_try_another_baud(&self) -> bool {
        let waited = (self.now)().since(self.opened_at);
        let is_unknown = self.target.as_ref().is_some_and(|t| t.sensor.identity().is_none());
        let is_guess = self.settings.baud.is_none() && self.other_bauds().len() > 1;
        is_guess && is_unknown && !self.watchdog.has_frame() && waited > BAUD_PATIENCE
    }

    /// Line speeds of the sensor's family; a model that has one speed only is alone.
    fn other_bauds(&self) -> &'static [u32] {
        match self.settings.model.map(Model::family) {
            Some(Family::Rplidar) => &[115_200, 256_000, 460_800, 1_000_000],
            Some(Family::Ydlidar) => &[115_200, 128_000, 230_400, 512_000],
            Some(Family::Hokuyo) => &[19_200, 57_600, 115_200],
            Some(Family::Ldrobot) | None => &[],
        }
    }

    /// The same port at the next line speed; a sensor to be found out is looked for again.
    fn at_next_baud(&mut self, mut port: TTYPort) -> Option<TTYPort> {
        let bauds = self.other_bauds();
        if let Some(model) = self.settings.model {
            let at = bauds.iter().position(|baud| *baud == self.baud).map_or(0, |at| at + 1);
            self.baud = bauds.get(at % bauds.len().max(1)).copied().unwrap_or(self.baud);
            self.target = Some(Target::new(model, self.baud));
        } else {
            self.tell(self.search_health(LidarHealth::NoFrames { baud: self.baud }));
        }
        match port.set_baud_rate(self.baud) {
            Ok(()) => Some(port),
            Err(error) => {
                drop(port);
                self.tell(LidarHealth::Disconnected { reason: error.to_string() });
                self.reopen()
            }
        }
    }

    /// Tries once a second; `None` when the driver is to end.
    fn reopen(&mut self) -> Option<TTYPort> {
        loop {
            for _ in 0..RETRY_PAUSES {
                thread::park_timeout(READ_TIMEOUT);
                if self.is_done() {
                    return None;
                }
            }
            match port::open(&self.settings.port, self.baud) {
                Ok(port) => {
                    self.status.stats.reconnects += 1;
                    return Some(port);
                }
                Err(error) => self.tell(LidarHealth::Disconnected { reason: error.to_string() }),
            }
        }
    }

    fn is_done(&self) -> bool {
        self.cancel.is_cancelled() || self.events.is_closed()
    }

    /// Publishes counts and health; a change of health is logged once.
    fn tell(&mut self, health: LidarHealth) {
        self.status.baud = self.baud;
        if let Some(target) = &self.target {
            let (counts, assembled) = (target.sensor.counts(), target.assembler.stats());
            let stats = &mut self.status.stats;
            stats.bytes = counts.bytes;
            stats.frames = counts.frames;
            stats.checksum_errors = counts.checksum_errors;
            stats.skipped_bytes = counts.skipped_bytes;
            stats.restarts = counts.restarts;
            stats.missing_samples = assembled.missing_samples;
            stats.clock_restarts = assembled.clock_restarts;
            if self.status.identity.as_ref() != target.sensor.identity() {
                let before = self.status.identity.take();
                self.status.identity = target.sensor.identity().cloned();
                let is_news = before.and_then(|before| before.model)
                    != self.status.identity.as_ref().and_then(|identity| identity.model);
                log_identity(&self.settings, target.model, self.status.identity.as_ref(), is_news);
            }
        }
        if health != self.status.health {
            log_change(&self.settings, self.target.as_ref().map(|t| t.model), &health);
            self.status.health = health;
        }
        self.status_tx.send_replace(self.status.clone());
    }
}

/// True for a read that merely ran out of time.
fn is_only_slow(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), TimedOut | WouldBlock | Interrupted)
}

/// Says who is there, and warns once if it is not who was expected.
fn log_identity(settings: &Settings, expected: Model, identity: Option<&Identity>, is_news: bool) {
    let Some(identity) = identity else { return };
    let (port, name) = (settings.port.as_str(), identity.name.as_str());
    let (firmware, mode) = (identity.firmware.as_deref(), identity.mode.as_deref());
    tracing::info!(port, name, firmware, mode, "lidar identified");
    if is_news && identity.model.is_some_and(|model| model != expected) {
        let expected = expected.full_name();
        tracing::warn!(port, name, expected, "another lidar than configured; check its ranges");
    }
}

fn log_change(settings: &Settings, model: Option<Model>, health: &LidarHealth) {
    let (port, model) = (settings.port.as_str(), model.map_or("unknown", Model::name));
    match health {
        LidarHealth::Starting | LidarHealth::Stopped => {
            tracing::debug!(port, model, "lidar {health:?}");
        }
        LidarHealth::Streaming => tracing::info!(port, model, "lidar streams"),
        LidarHealth::Silent => tracing::warn!(
            port,
            model,
            "lidar is silent; check its power, its cable, and, if it is one that must be asked, its \
             baud"
        ),
        LidarHealth::NoFrames { baud } => tracing::warn!(
            port,
            model,
            baud,
            "bytes arrive but form no frame: wrong baud, another lidar model, or a bad cable"
        ),
        LidarHealth::Unknown { name, baud } => tracing::warn!(
            port,
            name,
            baud,
            "a lidar answers whose name is not known: set lidar.model to its nearest relative, and \
             lidar.baud"
        ),
        LidarHealth::Stalled => tracing::warn!(
            port,
            model,
            "the lidar's head stands still: check that it turns freely and that its supply can \
             give an ampere at the start"
        ),
        LidarHealth::Faulty { reason } => {
            tracing::warn!(port, model, reason, "lidar is faulty");
        }
        LidarHealth::Disconnected { reason } => {
            tracing::warn!(port, model, reason, "lidar is disconnected, trying again every second");
        }
    }
}
