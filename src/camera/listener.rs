//! The socket that detectors send to.

use super::{Address, LineSplitter, Refusal, Settings, read_line};
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use std::io;
use std::net::SocketAddr;
use std::path::Path;
use tokio::io::AsyncReadExt;
use tokio::net::{UdpSocket, UnixDatagram, UnixListener, UnixStream};
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

/// The largest datagram, and the chunk that streams are read in.
const CHUNK_BYTES: usize = 65_536;
/// Detectors that may be connected to a stream socket at the same time.
const MAX_CONNECTIONS: usize = 8;

/// Counts since the listener was bound.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CameraStats {
    /// Lines that arrived.
    pub lines: u64,
    /// Frames handed to the brain.
    pub frames: u64,
    /// Lines refused.
    pub refused: u64,
    /// Why the last of them was.
    pub last_refusal: Option<Refusal>,
    /// Frames lost because the brain's channel was full.
    pub lost: u64,
    /// When the last good frame arrived.
    pub last_frame_at: Option<Stamp<Mono>>,
}

/// A bound socket, ready to run.
#[derive(Debug)]
pub struct Listener {
    socket: Socket,
    image_sizes_px: Vec<[u32; 2]>,
    stats: watch::Sender<CameraStats>,
}

#[derive(Debug)]
enum Socket {
    Udp(UdpSocket),
    UnixDatagram(UnixDatagram),
    UnixStream(UnixListener),
}

impl Listener {
    /// Binds the socket; a stale Unix socket at the path is replaced.
    ///
    /// # Errors
    /// What the system says: the address is in use, not of this computer, or not permitted.
    pub async fn bind(settings: Settings) -> io::Result<Self> {
        let socket = match &settings.address {
            Address::Udp(address) => Socket::Udp(UdpSocket::bind(address).await?),
            Address::UnixDatagram(path) => {
                remove_stale_socket(path)?;
                Socket::UnixDatagram(UnixDatagram::bind(path)?)
            }
            Address::UnixStream(path) => {
                remove_stale_socket(path)?;
                Socket::UnixStream(UnixListener::bind(path)?)
            }
        };
        let stats = watch::Sender::new(CameraStats::default());
        Ok(Self { socket, image_sizes_px: settings.image_sizes_px, stats })
    }

    /// The address in use; `None` for Unix sockets.
    #[must_use]
    pub fn local_addr(&self) -> Option<SocketAddr> {
        match &self.socket {
            Socket::Udp(socket) => socket.local_addr().ok(),
            Socket::UnixDatagram(_) | Socket::UnixStream(_) => None,
        }
    }

    /// Follows the counts.
    #[must_use]
    pub fn stats(&self) -> watch::Receiver<CameraStats> {
        self.stats.subscribe()
    }

    /// Takes in lines until cancelled; each good one goes to `events` as [`Event::TagsSeen`].
    ///
    /// `now` is the service's clock. A full channel never blocks: the frame is dropped and counted.
    ///
    /// # Errors
    /// What the system says if the socket itself fails.
    pub async fn run(
        self,
        now: impl Fn() -> Stamp<Mono> + Clone + Send + 'static,
        events: mpsc::Sender<Event>,
        cancel: CancellationToken,
    ) -> io::Result<()> {
        let inlet =
            Inlet { now, events, image_sizes_px: self.image_sizes_px, stats: self.stats.clone() };
        let work = async {
            match self.socket {
                Socket::Udp(socket) => {
                    let mut chunk = vec![0; CHUNK_BYTES];
                    loop {
                        let n_bytes = socket.recv(&mut chunk).await?;
                        inlet.take_datagram(&chunk[..n_bytes]);
                    }
                }
                Socket::UnixDatagram(socket) => {
                    let mut chunk = vec![0; CHUNK_BYTES];
                    loop {
                        let n_bytes = socket.recv(&mut chunk).await?;
                        inlet.take_datagram(&chunk[..n_bytes]);
                    }
                }
                Socket::UnixStream(listener) => accept_all(&listener, &inlet).await,
            }
        };
        cancel.run_until_cancelled(work).await.unwrap_or(Ok(()))
    }
}

/// Serves several connections at once; each has its own half line.
async fn accept_all<N>(listener: &UnixListener, inlet: &Inlet<N>) -> io::Result<()>
where
    N: Fn() -> Stamp<Mono> + Clone + Send + 'static,
{
    let mut connections = JoinSet::new();
    loop {
        let (stream, _) = listener.accept().await?;
        while connections.try_join_next().is_some() {}
        if connections.len() < MAX_CONNECTIONS {
            connections.spawn(serve(stream, inlet.clone()));
        } else {
            tracing::warn!(MAX_CONNECTIONS, "too many detectors are connected, one was refused");
        }
    }
}

async fn serve<N: Fn() -> Stamp<Mono>>(mut stream: UnixStream, inlet: Inlet<N>) {
    let mut splitter = LineSplitter::new();
    let mut chunk = vec![0; CHUNK_BYTES];
    loop {
        match stream.read(&mut chunk).await {
            Ok(0) => break,
            Ok(n_bytes) => splitter.feed(&chunk[..n_bytes], |line| inlet.take_line(line)),
            Err(error) => {
                tracing::warn!(%error, "lost the connection to a detector");
                break;
            }
        }
    }
    splitter.finish(|line| inlet.take_line(line));
}

/// What every source of lines leads to.
#[derive(Debug, Clone)]
struct Inlet<N> {
    now: N,
    events: mpsc::Sender<Event>,
    image_sizes_px: Vec<[u32; 2]>,
    stats: watch::Sender<CameraStats>,
}

impl<N: Fn() -> Stamp<Mono>> Inlet<N> {
    fn take_datagram(&self, bytes: &[u8]) {
        let mut splitter = LineSplitter::new();
        splitter.feed(bytes, |line| self.take_line(line));
        splitter.finish(|line| self.take_line(line));
    }

    fn take_line(&self, line: &[u8]) {
        let received_at = (self.now)();
        let read = read_line(line, received_at, &self.image_sizes_px);
        self.stats.send_modify(|stats| {
            stats.lines += 1;
            match read {
                Ok(frame) => match self.events.try_send(Event::TagsSeen(frame)) {
                    Ok(()) => {
                        stats.frames += 1;
                        stats.last_frame_at = Some(received_at);
                    }
                    Err(TrySendError::Full(_) | TrySendError::Closed(_)) => stats.lost += 1,
                },
                Err(refusal) => note_refusal(stats, refusal),
            }
        });
    }
}

/// Logs a reason when it first comes up, so that a wrong detector does not flood the log.
fn note_refusal(stats: &mut CameraStats, refusal: Refusal) {
    let is_new = stats
        .last_refusal
        .as_ref()
        .is_none_or(|last| std::mem::discriminant(last) != std::mem::discriminant(&refusal));
    if is_new {
        tracing::warn!(%refusal, "refused a line of the marker detector");
    }
    stats.refused += 1;
    stats.last_refusal = Some(refusal);
}

/// Makes room for a Unix socket; only a socket is ever removed.
pub(super) fn remove_stale_socket(path: &Path) -> io::Result<()> {
    use std::os::unix::fs::FileTypeExt;
    match std::fs::symlink_metadata(path) {
        Ok(found) if found.file_type().is_socket() => std::fs::remove_file(path),
        Ok(_) => Err(io::Error::new(
            io::ErrorKind::AlreadyExists,
            format!("{} exists and is not a socket", path.display()),
        )),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}
