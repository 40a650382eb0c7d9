//! Byte streams: TCP and serial ports, opened again when they break.

use super::{Counters, Ends, Pace, REOPEN_AFTER, Received, Timer, count, hand_on, numbered_frame};
use crate::link::Guard;
use mavlink::AsyncMavlinkReader;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::error::MessageReadError;
use std::future::Future;
use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio_serial::{SerialPortBuilderExt as _, SerialStream};
use tokio_util::sync::CancellationToken;

/// Something that can be opened again and again.
pub(super) trait Opener: Send + 'static {
    type Stream: AsyncRead + AsyncWrite + Unpin + Send;
    fn open(&self) -> impl Future<Output = io::Result<Self::Stream>> + Send;
    fn name(&self) -> &str;
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
        let stream = TcpStream::connect(&self.host).await?;
        stream.set_nodelay(true)?;
        Ok(stream)
    }

    fn name(&self) -> &str {
        &self.host
    }
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
        result = write_all(writer, opener.pace(), ends) => result,
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
        sink.write_all(&frame).await?;
        count(&ends.counters.sent);
        if let Some(pace) = &mut pace {
            pace.hand_over(ends.timer.now(), frame.len());
            ends.timer.sleep_until(pace.open_from()).await;
        }
    }
    Ok(())
}
