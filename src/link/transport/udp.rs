//! Datagrams, from and to the autopilot's address only.

use super::{Ends, Outgoing, Timer, count, hand_on, numbered_frame};
use crate::link::session::is_known_autopilot;
use crate::link::wire;
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkMessageRaw, MavlinkReader};
use std::io::{self, Read as _};
use std::net::SocketAddr;
use std::time::Duration;
use tokio::net::UdpSocket;
use tokio_util::sync::CancellationToken;

/// A peer that is silent for so long may be replaced by another address.
const PEER_SILENT_FOR: Duration = Duration::from_secs(10);
/// Pause after an error of the socket, so that a lasting one does not spin.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(100);
/// Largest datagram.
const BUFFER_BYTES: usize = 65_536;
/// Longer than any frame.
const PADDING: [u8; 300] = [0; 300];

/// A bound socket, and the address it listens to.
#[derive(Debug)]
pub(super) struct Socket {
    socket: UdpSocket,
    /// Where the autopilot is, and whether that was configured.
    peer: Option<Peer>,
}

#[derive(Debug, Clone, Copy)]
struct Peer {
    addr: SocketAddr,
    is_configured: bool,
    heard_at: Stamp<Mono>,
}

impl Socket {
    pub(super) async fn open(bind: &str, peer: Option<&str>) -> io::Result<Self> {
        let socket = UdpSocket::bind(bind).await?;
        let Some(peer) = peer else { return Ok(Self { socket, peer: None }) };
        let unknown = || io::Error::new(io::ErrorKind::NotFound, format!("`{peer}` is not known"));
        let addr = tokio::net::lookup_host(peer).await?.next().ok_or_else(unknown)?;
        let peer = Peer { addr, is_configured: true, heard_at: Stamp::ZERO };
        Ok(Self { socket, peer: Some(peer) })
    }

    pub(super) fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// True if another address is the peer and speaks: what `from` says is not even parsed.
    fn is_taken_by_another(&self, from: SocketAddr, now: Stamp<Mono>) -> bool {
        self.peer.is_some_and(|peer| {
            peer.addr != from && (peer.is_configured || now.since(peer.heard_at) < PEER_SILENT_FOR)
        })
    }

    /// True if frames from `from` may be handed on. The first autopilot's heartbeat fixes the
    /// peer; another address takes its place only after a long silence, and only the same way.
    /// `frames` are those that the guard lets pass: nobody takes the place with a forged one.
    fn admits(&mut self, from: SocketAddr, frames: &[MAVLinkMessageRaw], now: Stamp<Mono>) -> bool {
        if let Some(peer) = self.peer.as_mut().filter(|peer| peer.addr == from) {
            peer.heard_at = now;
            return true;
        }
        let is_autopilot = frames.iter().any(is_autopilot_heartbeat);
        if is_autopilot {
            self.peer = Some(Peer { addr: from, is_configured: false, heard_at: now });
            tracing::info!(%from, "the autopilot's datagrams come from here");
        }
        is_autopilot
    }
}

/// Works until `stop` is cancelled.
pub(super) async fn run<T: Timer>(mut socket: Socket, mut ends: Ends<T>, stop: CancellationToken) {
    count(&ends.counters.opened);
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            outgoing = ends.outgoing.recv() => match outgoing {
                Some(outgoing) => send(&socket, &outgoing, &mut ends).await,
                None => return,
            },
            result = socket.socket.recv_from(&mut buffer) => match result {
                Ok((length, from)) => take_in(&mut socket, &buffer[..length], from, &ends),
                Err(_) => {
                    count(&ends.counters.io_errors);
                    let resume_at = ends.timer.now().plus(PAUSE_AFTER_ERROR);
                    ends.timer.sleep_until(resume_at).await;
                }
            },
        }
    }
}

fn take_in<T: Timer>(socket: &mut Socket, datagram: &[u8], from: SocketAddr, ends: &Ends<T>) {
    let arrived = ends.timer.now();
    if !ends.guard.admits_address(from.ip()) {
        return;
    }
    if socket.is_taken_by_another(from, arrived) {
        count(&ends.counters.strangers);
        return;
    }
    let mut frames = frames(datagram);
    let is_garbage = frames.is_empty();
    frames.retain(|frame| ends.guard.admits(frame, arrived));
    if !socket.admits(from, &frames, arrived) {
        count(&ends.counters.strangers);
        return;
    }
    if is_garbage {
        count(&ends.counters.garbage_datagrams);
    }
    for frame in &frames {
        hand_on(frame, arrived, &ends.received, &ends.counters);
    }
}

async fn send<T: Timer>(socket: &Socket, outgoing: &Outgoing, ends: &mut Ends<T>) {
    let Some(peer) = socket.peer else {
        count(&ends.counters.send_failed);
        return;
    };
    let frame = numbered_frame(outgoing, &mut ends.sequence, &ends.guard);
    match socket.socket.send_to(&frame, peer.addr).await {
        Ok(_) => count(&ends.counters.sent),
        Err(_) => count(&ends.counters.send_failed),
    }
}

/// All frames of one datagram whose checksums are right.
///
/// Each datagram has a reader of its own, so that the beginning of a frame in one cannot swallow
/// the next; zeros behind it complete, and so refute, a false beginning inside.
fn frames(datagram: &[u8]) -> Vec<MAVLinkMessageRaw> {
    let padded = datagram.chain(PADDING.as_slice());
    let mut reader = MavlinkReader::with_capacity(PADDING.len(), padded);
    let mut frames = Vec::new();
    while let Ok(frame) = reader.read_any_raw_message::<MavMessage>() {
        frames.push(frame);
    }
    frames
}

fn is_autopilot_heartbeat(frame: &MAVLinkMessageRaw) -> bool {
    match wire::decode(frame) {
        Ok((header, MavMessage::HEARTBEAT(data))) => is_known_autopilot(&header, &data),
        _ => false,
    }
}
