//! Datagrams, from and to the autopilot's address only.

use super::{Ends, Outgoing, Timer, count, hand_on, numbered_frame};
use crate::link::session::is_known_autopilot;
use crate::link::signing::Proof;
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
    /// The best that it has shown of having the key.
    proof: Proof,
    heard_at: Stamp<Mono>,
}

impl Socket {
    pub(super) async fn open(bind: &str, peer: Option<&str>) -> io::Result<Self> {
        let socket = UdpSocket::bind(bind).await?;
        let Some(peer) = peer else { return Ok(Self { socket, peer: None }) };
        let unknown = || io::Error::new(io::ErrorKind::NotFound, format!("`{peer}` is not known"));
        let addr = tokio::net::lookup_host(peer).await?.next().ok_or_else(unknown)?;
        let peer =
            Peer { addr, is_configured: true, proof: Proof::NotNeeded, heard_at: Stamp::ZERO };
        Ok(Self { socket, peer: Some(peer) })
    }

    pub(super) fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// True if another address is the peer and speaks: what `from` says is not even parsed. Where frames
    /// are signed, a peer that has not signed is none that keeps others out.
    fn is_taken_by_another(&self, from: SocketAddr, signs: bool, now: Stamp<Mono>) -> bool {
        self.peer.is_some_and(|peer| {
            let keeps_place = peer.proof == Proof::Signed || !signs;
            peer.addr != from && (peer.is_configured || (keeps_place && !peer.is_silent(now)))
        })
    }

    /// True if frames from `from` may be handed on. The first autopilot's heartbeat fixes the peer;
    /// another address takes its place only after a long silence, and only the same way. Where frames
    /// are signed, it must show as much of the key as the peer has, and who shows more has the place at
    /// once.
    fn admits(
        &mut self,
        from: SocketAddr,
        frames: &[Admitted],
        signs: bool,
        now: Stamp<Mono>,
    ) -> bool {
        if let Some(peer) = self.peer.as_mut().filter(|peer| peer.addr == from) {
            peer.heard_at = now;
            peer.proof = frames.iter().map(|admitted| admitted.proof).fold(peer.proof, Proof::max);
            return true;
        }
        let heartbeats = frames.iter().filter(|admitted| is_autopilot_heartbeat(&admitted.frame));
        let Some(proof) = heartbeats.map(|admitted| admitted.proof).max() else { return false };
        let takes_place = self.peer.is_none_or(|peer| {
            !signs || proof > peer.proof || (proof == peer.proof && peer.is_silent(now))
        });
        if takes_place {
            self.peer = Some(Peer { addr: from, is_configured: false, proof, heard_at: now });
            tracing::info!(%from, "the autopilot's datagrams come from here");
        }
        takes_place
    }
}

impl Peer {
    fn is_silent(&self, now: Stamp<Mono>) -> bool {
        now.since(self.heard_at) >= PEER_SILENT_FOR
    }
}

/// A frame that the guard lets pass: nobody takes the place with a forged one.
struct Admitted {
    frame: MAVLinkMessageRaw,
    proof: Proof,
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
    let signs = ends.guard.signs();
    if socket.is_taken_by_another(from, signs, arrived) {
        count(&ends.counters.strangers);
        return;
    }
    let frames = frames(datagram);
    let is_garbage = frames.is_empty();
    let admitted = |frame| ends.guard.proof(&frame, arrived).map(|proof| Admitted { frame, proof });
    let frames: Vec<Admitted> = frames.into_iter().filter_map(admitted).collect();
    if !socket.admits(from, &frames, signs, arrived) {
        count(&ends.counters.strangers);
        return;
    }
    if is_garbage {
        count(&ends.counters.garbage_datagrams);
    }
    for Admitted { frame, .. } in &frames {
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
