//! The thread that reads the serial port.

use super::ldrobot::Parser;
use super::port::{self, READ_TIMEOUT};
use super::watchdog::Watchdog;
use super::{LidarHealth, LidarStatus, OpenError, ScanAssembler, Settings};
use crate::messages::Scan;
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use serialport::TTYPort;
use std::io::{self, Read};
use std::thread;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Pauses of [`READ_TIMEOUT`] between two attempts to open a lost port: one second.
const RETRY_PAUSES: u32 = 20;
/// The kernel's queue of a serial port holds no more.
const CHUNK_BYTES: usize = 4096;

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
        let port = port::open(&settings)?;
        let (status_tx, status) = watch::channel(LidarStatus::default());
        let cancel = cancel.child_token();
        let port_name = settings.port.clone();
        let mut reader = Reader {
            parser: Parser::new(),
            assembler: ScanAssembler::new(settings.model, settings.effective_baud()),
            watchdog: Watchdog::new(settings.effective_baud(), now()),
            status: LidarStatus::default(),
            settings,
            now,
            events,
            cancel: cancel.clone(),
            status_tx,
        };
        let baud = reader.settings.effective_baud();
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

/// What the thread owns.
struct Reader<N> {
    settings: Settings,
    parser: Parser,
    assembler: ScanAssembler,
    watchdog: Watchdog,
    status: LidarStatus,
    now: N,
    events: mpsc::Sender<Event>,
    cancel: CancellationToken,
    status_tx: watch::Sender<LidarStatus>,
}

impl<N: Fn() -> Stamp<Mono>> Reader<N> {
    fn run(&mut self, first_port: TTYPort) {
        let mut next_port = Some(first_port);
        while let Some(port) = next_port {
            let reason = self.read_until_lost(port);
            if self.is_done() {
                break;
            }
            self.note_loss(reason.to_string());
            next_port = self.reopen();
        }
        self.tell(LidarHealth::Stopped);
    }

    /// Reads until the port fails or the driver is to end; says why it failed.
    fn read_until_lost(&mut self, mut port: TTYPort) -> io::Error {
        let mut chunk = [0; CHUNK_BYTES];
        loop {
            match port.read(&mut chunk) {
                Ok(0) => return io::ErrorKind::UnexpectedEof.into(),
                Ok(n_bytes) => self.take_in(&chunk[..n_bytes]),
                Err(error) if is_only_slow(&error) => {}
                Err(error) => return error,
            }
            self.take_stock();
            if self.is_done() {
                return io::ErrorKind::Interrupted.into();
            }
        }
    }

    fn take_in(&mut self, bytes: &[u8]) {
        let now = (self.now)();
        self.watchdog.note_bytes(now);
        let mut scans = Vec::new();
        self.parser.feed(bytes, |frame, n_bytes_after| {
            self.watchdog.note_frame(now);
            self.status.last_frame_at = Some(now);
            self.assembler.push(&frame, now, n_bytes_after, |scan| scans.push(scan));
        });
        scans.into_iter().for_each(|scan| self.hand_on(scan));
    }

    /// What has to be looked at even if nothing came.
    fn take_stock(&mut self) {
        let now = (self.now)();
        let mut old = None;
        self.assembler.flush_if_old(now, |scan| old = Some(scan));
        if let Some(scan) = old {
            self.hand_on(scan);
        }
        self.tell(self.watchdog.health(now));
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

    fn note_loss(&mut self, reason: String) {
        self.parser.reset();
        let mut rest = None;
        self.assembler.reset(|scan| rest = Some(scan));
        if let Some(scan) = rest {
            self.hand_on(scan);
        }
        self.tell(LidarHealth::Disconnected { reason });
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
            match port::open(&self.settings) {
                Ok(port) => {
                    self.status.stats.reconnects += 1;
                    self.watchdog = Watchdog::new(self.settings.effective_baud(), (self.now)());
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
        let (parsed, assembled) = (self.parser.stats(), self.assembler.stats());
        let stats = &mut self.status.stats;
        stats.bytes = parsed.bytes;
        stats.frames = parsed.frames;
        stats.crc_errors = parsed.crc_errors;
        stats.skipped_bytes = parsed.skipped_bytes;
        stats.missing_samples = assembled.missing_samples;
        if health != self.status.health {
            log_change(&self.settings, &health);
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

fn log_change(settings: &Settings, health: &LidarHealth) {
    let (port, model) = (settings.port.as_str(), settings.model.name());
    match health {
        LidarHealth::Starting | LidarHealth::Stopped => {
            tracing::debug!(port, model, "lidar {health:?}");
        }
        LidarHealth::Streaming => tracing::info!(port, model, "lidar streams"),
        LidarHealth::Silent => {
            tracing::warn!(port, model, "lidar is silent; check its power and cable");
        }
        LidarHealth::NoFrames { baud } => tracing::warn!(
            port,
            model,
            baud,
            "bytes arrive but form no frame: wrong baud or another lidar model"
        ),
        LidarHealth::Disconnected { reason } => {
            tracing::warn!(port, model, reason, "lidar is disconnected, trying again every second");
        }
    }
}
