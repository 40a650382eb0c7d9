//! Moves frames: datagrams, TCP and serial ports.
//!
//! A transport runs as one task between a bounded channel and an outbox. What does not fit is
//! dropped and counted; an unknown message, a bad checksum or a value that an enumeration does not
//! know never ends it. A stream that breaks is opened again after a second, for ever. A serial port
//! is given no more than its baud rate carries, so that what waits can still be overtaken.

mod queue;
mod stream;
mod udp;

pub use queue::{OutboxFull, OutgoingSender};

pub use super::outbox::Outgoing;
use super::outbox::Pace;
use super::settings::Address;
use super::{Guard, GuardStats, wire};
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkMessageRaw, MavHeader};
use std::future::Future;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Messages that wait to be taken: two seconds of a fast link.
const CHANNEL_CAPACITY: usize = 1024;
/// Pause before a broken stream is opened again.
const REOPEN_AFTER: Duration = Duration::from_secs(1);

/// What a transport must know of time.
pub trait Timer: Clone + Send + Sync + 'static {
    /// The present instant.
    fn now(&self) -> Stamp<Mono>;
    /// Returns once `deadline` has come.
    fn sleep_until(&self, deadline: Stamp<Mono>) -> impl Future<Output = ()> + Send;
}

/// A message that arrived.
#[derive(Debug, Clone)]
pub struct Received {
    /// Who sent it.
    pub header: MavHeader,
    /// What it says.
    pub message: MavMessage,
    /// When its last byte was read.
    pub arrived: Stamp<Mono>,
}

/// Counters of a transport since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TransportStats {
    /// Frames that were handed on.
    pub received: u64,
    /// Frames that were dropped because nobody took them in time.
    pub received_lost: u64,
    /// Frames with a right checksum whose content could not be read.
    pub undecodable: u64,
    /// Datagrams without any frame.
    pub garbage_datagrams: u64,
    /// Datagrams of others than the autopilot's address.
    pub strangers: u64,
    /// Frames that were sent.
    pub sent: u64,
    /// Messages that never left because a newer one of their kind came: the line is too slow.
    pub superseded: u64,
    /// Frames that could not be sent: no peer, or an error of the system.
    pub send_failed: u64,
    /// Errors and ends of the stream or socket.
    pub io_errors: u64,
    /// Times a stream was opened, the first included.
    pub opened: u64,
    /// Frames that the guard refused.
    pub guard: GuardStats,
}

/// The live counters behind [`TransportStats`].
#[derive(Debug, Default)]
struct Counters {
    received: AtomicU64,
    received_lost: AtomicU64,
    undecodable: AtomicU64,
    garbage_datagrams: AtomicU64,
    strangers: AtomicU64,
    sent: AtomicU64,
    superseded: AtomicU64,
    send_failed: AtomicU64,
    io_errors: AtomicU64,
    opened: AtomicU64,
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// A transport at work.
#[derive(Debug)]
pub struct Transport {
    /// What arrives.
    pub received: mpsc::Receiver<Received>,
    /// What is to be sent.
    pub outgoing: OutgoingSender,
    counters: Arc<Counters>,
    guard: Arc<Guard>,
    local_addr: Option<SocketAddr>,
    task: JoinHandle<()>,
}

impl Transport {
    /// Opens `address`, unsigned and for everybody, and works until `stop` is cancelled.
    ///
    /// # Errors
    /// As [`Self::start_guarded`].
    pub async fn start<T: Timer>(
        address: &Address,
        timer: T,
        stop: CancellationToken,
    ) -> std::io::Result<Self> {
        Self::start_guarded(address, Guard::unsigned(), timer, stop).await
    }

    /// Opens `address` behind `guard` and works until `stop` is cancelled.
    ///
    /// # Errors
    /// If a socket for datagrams cannot be had, or its peer's name is not known. Streams are tried
    /// again and again instead.
    pub async fn start_guarded<T: Timer>(
        address: &Address,
        guard: Guard,
        timer: T,
        stop: CancellationToken,
    ) -> std::io::Result<Self> {
        let (received_tx, received) = mpsc::channel(CHANNEL_CAPACITY);
        let counters = Arc::new(Counters::default());
        let (outgoing, outgoing_rx) = queue::queue(&counters);
        let guard = Arc::new(guard);
        let ends = Ends {
            received: received_tx,
            outgoing: outgoing_rx,
            counters: Arc::clone(&counters),
            guard: Arc::clone(&guard),
            timer,
            sequence: 0,
        };
        let mut local_addr = None;
        let task = match address.clone() {
            Address::Udp { bind, peer } => {
                let socket = udp::Socket::open(&bind, peer.as_deref()).await?;
                local_addr = Some(socket.local_addr()?);
                tokio::spawn(udp::run(socket, ends, stop))
            }
            Address::Tcp { host } => tokio::spawn(stream::run(stream::Tcp { host }, ends, stop)),
            Address::Serial { path, baud } => {
                tokio::spawn(stream::run(stream::Serial { path, baud }, ends, stop))
            }
        };
        Ok(Self { received, outgoing, counters, guard, local_addr, task })
    }

    /// The own address of a socket for datagrams.
    #[must_use]
    pub const fn local_addr(&self) -> Option<SocketAddr> {
        self.local_addr
    }

    /// The counters.
    #[must_use]
    pub fn stats(&self) -> TransportStats {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let c = &*self.counters;
        TransportStats {
            received: read(&c.received),
            received_lost: read(&c.received_lost),
            undecodable: read(&c.undecodable),
            garbage_datagrams: read(&c.garbage_datagrams),
            strangers: read(&c.strangers),
            sent: read(&c.sent),
            superseded: read(&c.superseded),
            send_failed: read(&c.send_failed),
            io_errors: read(&c.io_errors),
            opened: read(&c.opened),
            guard: self.guard.stats(),
        }
    }

    /// Waits until the task has ended after its cancellation.
    pub async fn join(self) {
        if let Err(error) = self.task.await {
            tracing::error!(%error, "the link's transport ended badly");
        }
    }
}

/// The transport's side of its channels.
#[derive(Debug)]
struct Ends<T> {
    received: mpsc::Sender<Received>,
    outgoing: queue::OutgoingReceiver,
    counters: Arc<Counters>,
    guard: Arc<Guard>,
    timer: T,
    sequence: u8,
}

/// Decodes and hands on one frame that the guard has let pass.
fn hand_on(
    raw: &MAVLinkMessageRaw,
    arrived: Stamp<Mono>,
    received: &mpsc::Sender<Received>,
    counters: &Counters,
) {
    match wire::decode(raw) {
        Ok((header, message)) => match received.try_send(Received { header, message, arrived }) {
            Ok(()) => count(&counters.received),
            Err(_) => count(&counters.received_lost),
        },
        Err(_) => count(&counters.undecodable),
    }
}

/// The frame of a message, numbered by the sender's counter.
fn numbered_frame(outgoing: &Outgoing, sequence: &mut u8, guard: &Guard) -> Vec<u8> {
    let header = MavHeader { sequence: *sequence, ..outgoing.header };
    *sequence = sequence.wrapping_add(1);
    guard.frame(header, &outgoing.message)
}
