//! Byte streams: TCP and serial ports, opened again when they break.

use super::{Counters, Ends, Pace, REOPEN_AFTER, Received, Timer, count, hand_on, numbered_frame};
use crate::link::Guard;
use mavlink::AsyncMavlinkReader;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::error::MessageReadError;
use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpSocket, TcpStream};
use tokio::sync::mpsc;
use tokio_serial::{SerialPortBuilderExt as _, SerialStream};
use tokio_util::sync::CancellationToken;

/// Half a second of setpoints and ODOMETRY; the system doubles it for its own needs.
const SEND_BUFFER_BYTES: u32 = 4_096;
/// A line that takes nothing for this long is opened again: what waits in it is stale.
const STALLED_AFTER: Duration = Duration::from_secs(1);
/// An autopilot sends a heartbeat every second.
const SILENT_AFTER: Duration = Duration::from_secs(5);

/// Something that can be opened again and again.
pub(super) trait Opener: Send + 'static {
    type Stream: AsyncRead + AsyncWrite + Unpin + Send;
    fn open(&self) -> impl Future<Output = io::Result<Self::Stream>> + Send;
    fn name(&self) -> &str;
    /// After a span of this length without a frame the stream is opened again; `None` for never.
    fn silent_after(&self) -> Option<Duration> {
        None
    }
    /// How fast the line takes bytes, where that is known.
    fn pace(&self) -> Option<Pace> {
        None
    }
}

#[derive(Debug)]
pub(super) struct Tcp {
    pub(super) host: String,
}

impl Opener for Tcp {
    type Stream = TcpStream;

    async fn open(&self) -> io::Result<TcpStream> {
        let mut last = io::Error::from(io::ErrorKind::AddrNotAvailable);
        for address in tokio::net::lookup_host(&self.host).await? {
            match connect(address).await {
                Ok(stream) => return Ok(stream),
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    /// Half of a connection can be gone for minutes before the system notices.
    fn silent_after(&self) -> Option<Duration> {
        Some(SILENT_AFTER)
    }

    fn name(&self) -> &str {
        &self.host
    }
}

/// With a send buffer so small that what a stalled peer does not take is noticed, and not delivered
/// late: the system's own holds minutes of setpoints.
async fn connect(address: SocketAddr) -> io::Result<TcpStream> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    let stream = socket.connect(address).await?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

#[derive(Debug)]
pub(super) struct Serial {
    pub(super) path: String,
    pub(super) baud: u32,
}

impl Opener for Serial {
    type Stream = SerialStream;

    // 8 data bits, no parity, one stop bit and no flow control are the builder's defaults.
    async fn open(&self) -> io::Result<SerialStream> {
        Ok(tokio_serial::new(&self.path, self.baud).open_native_async()?)
    }

    fn name(&self) -> &str {
        &self.path
    }

    fn pace(&self) -> Option<Pace> {
        Some(Pace::of_baud(self.baud))
    }
}

/// Works until `stop` is cancelled.
pub(super) async fn run<O: Opener, T: Timer>(
    opener: O,
    mut ends: Ends<T>,
    stop: CancellationToken,
) {
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            result = serve_once(&opener, &mut ends) => match result {
                Ok(()) => return,
                Err(error) => {
                    count(&ends.counters.io_errors);
                    tracing::warn!(%error, link = opener.name(), "the link is down");
                }
            },
        }
        let resume_at = ends.timer.now().plus(REOPEN_AFTER);
        tokio::select! {
            () = stop.cancelled() => return,
            () = ends.timer.sleep_until(resume_at) => {}
        }
    }
}

/// Opens the stream and moves frames until it breaks; `Ok` if nobody sends any more.
async fn serve_once<O: Opener, T: Timer>(opener: &O, ends: &mut Ends<T>) -> io::Result<()> {
    let stream = opener.open().await?;
    count(&ends.counters.opened);
    tracing::info!(link = opener.name(), "the link is open");
    // What waited while the link was down is stale: a setpoint of a second ago must not be flown.
    let n_stale = ends.outgoing.clear() as u64;
    ends.counters.send_failed.fetch_add(n_stale, Ordering::Relaxed);
    let (reader, writer) = tokio::io::split(stream);
    let (counters, guard) = (Arc::clone(&ends.counters), Arc::clone(&ends.guard));
    let (received, timer) = (ends.received.clone(), ends.timer.clone());
    tokio::select! {
        error = read_all(reader, &received, &counters, &guard, &timer) => Err(error),
        error = silence(opener.silent_after(), &counters, &timer) => Err(error),
        result = write_all(writer, opener.pace(), ends) => result,
    }
}

/// Comes back once no frame has come for so long.
async fn silence<T: Timer>(after: Option<Duration>, counters: &Counters, timer: &T) -> io::Error {
    let Some(after) = after else { return std::future::pending().await };
    let n_heard = || counters.received.load(Ordering::Relaxed);
    loop {
        let before = n_heard();
        timer.sleep_until(timer.now().plus(after)).await;
        if n_heard() == before {
            return io::Error::new(io::ErrorKind::TimedOut, "no frame has come for seconds");
        }
    }
}

async fn read_all<R: AsyncRead + Unpin, T: Timer>(
    source: R,
    received: &mpsc::Sender<Received>,
    counters: &Counters,
    guard: &Guard,
    timer: &T,
) -> io::Error {
    let mut reader = AsyncMavlinkReader::new(source);
    loop {
        match reader.read_any_raw_message::<MavMessage>().await {
            Ok(raw) => {
                let arrived = timer.now();
                if guard.admits(&raw, arrived) {
                    hand_on(&raw, arrived, received, counters);
                }
            }
            Err(MessageReadError::Io(error)) => return error,
            Err(_) => count(&counters.undecodable),
        }
    }
}

/// Chooses a message only once the line takes it: what came meanwhile may be more urgent.
async fn write_all<W: AsyncWrite + Unpin, T: Timer>(
    mut sink: W,
    mut pace: Option<Pace>,
    ends: &mut Ends<T>,
) -> io::Result<()> {
    while let Some(message) = ends.outgoing.recv().await {
        let frame = numbered_frame(&message, &mut ends.sequence, &ends.guard);
        let stalled_at = ends.timer.now().plus(STALLED_AFTER);
        tokio::select! {
            written = sink.write_all(&frame) => written?,
            () = ends.timer.sleep_until(stalled_at) => {
                return Err(io::Error::new(io::ErrorKind::TimedOut, "the line takes nothing"));
            }
        }
        count(&ends.counters.sent);
        if let Some(pace) = &mut pace {
            pace.hand_over(ends.timer.now(), frame.len());
            ends.timer.sleep_until(pace.open_from()).await;
        }
    }
    Ok(())
}
