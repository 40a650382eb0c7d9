//! Frames built byte by byte, independent of the crate under test, and scripted peers.

use mavlink::dialects::ardupilotmega::MavMessage;
use std::future::Future;
use std::io::Cursor;
use std::net::SocketAddr;
use std::time::Duration;
use stockpilot::time::{Mono, Stamp};
use tokio::net::UdpSocket;

/// Bounds a test that would otherwise wait for ever; nothing is timed by it.
pub(crate) const PATIENCE: Duration = Duration::from_secs(10);

pub(crate) async fn patiently<T>(work: impl Future<Output = T>) -> T {
    match tokio::time::timeout(PATIENCE, work).await {
        Ok(value) => value,
        Err(_) => panic!("nothing happened"),
    }
}

/// Waits until `is_so`, letting everything else run meanwhile.
pub(crate) async fn until(is_so: impl Fn() -> bool) {
    patiently(async {
        while !is_so() {
            tokio::task::yield_now().await;
        }
    })
    .await;
}

pub(crate) fn at_ms(ms: i64) -> Stamp<Mono> {
    Stamp::from_nanos(ms * 1_000_000)
}

/// CRC-16/MCRF4XX, as the MAVLink guide prints it.
fn crc(bytes: impl Iterator<Item = u8>) -> u16 {
    bytes.fold(0xffff, |crc, byte| {
        let mut x = byte ^ crc.to_le_bytes()[0];
        x ^= x << 4;
        let wide = u16::from(x);
        (crc >> 8) ^ (wide << 8) ^ (wide << 3) ^ (wide >> 4)
    })
}

/// A MAVLink 2 frame; `crc_extra` is the message's seed.
pub(crate) fn frame(from: (u8, u8), id: u32, crc_extra: u8, payload: &[u8]) -> Vec<u8> {
    let used = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
    let [id0, id1, id2, _] = id.to_le_bytes();
    let mut bytes =
        vec![0xfd, u8::try_from(used).unwrap(), 0, 0, 42, from.0, from.1, id0, id1, id2];
    bytes.extend_from_slice(&payload[..used]);
    let crc = crc(bytes[1..].iter().copied().chain([crc_extra]));
    bytes.extend_from_slice(&crc.to_le_bytes());
    bytes
}

/// `HEARTBEAT`: id 0, seed 50; type, autopilot, base mode, state as bytes.
pub(crate) fn heartbeat_frame(from: (u8, u8), fields: [u8; 4]) -> Vec<u8> {
    let [mavtype, autopilot, base_mode, state] = fields;
    frame(from, 0, 50, &[0, 0, 6, 0, mavtype, autopilot, base_mode, state, 3])
}

/// The heartbeat of a PX4 quadrotor with system id 1 in OFFBOARD, armed.
pub(crate) fn px4_heartbeat() -> Vec<u8> {
    heartbeat_frame((1, 1), [2, 12, 0x91, 4])
}

/// `TIMESYNC`: id 111, seed 34.
pub(crate) fn timesync_frame(tc1: i64, ts1: i64) -> Vec<u8> {
    let payload: Vec<u8> = tc1.to_le_bytes().into_iter().chain(ts1.to_le_bytes()).collect();
    frame((1, 1), 111, 34, &payload)
}

/// A peer on the loopback that speaks to `target`.
pub(crate) struct Peer {
    socket: UdpSocket,
    target: SocketAddr,
}

impl Peer {
    pub(crate) async fn new(target: SocketAddr) -> Self {
        Self { socket: UdpSocket::bind("127.0.0.1:0").await.unwrap(), target }
    }

    pub(crate) async fn says(&self, datagram: &[u8]) {
        self.socket.send_to(datagram, self.target).await.unwrap();
    }

    /// The next message that reaches this peer.
    pub(crate) async fn hears(&self) -> (mavlink::MavHeader, MavMessage) {
        let mut buffer = [0; 512];
        let (length, from) = patiently(self.socket.recv_from(&mut buffer)).await.unwrap();
        assert_eq!(from, self.target);
        let cursor = Cursor::new(buffer[..length].to_vec());
        let mut reader = mavlink::MavlinkReader::new(cursor);
        reader.read_any_message().unwrap()
    }

    /// The next frame of MAVLink 2 that reaches this peer, as it is.
    pub(crate) async fn hears_raw(&self) -> mavlink::MAVLinkV2MessageRaw {
        let mut buffer = [0; 512];
        let (length, _) = patiently(self.socket.recv_from(&mut buffer)).await.unwrap();
        let mut reader = mavlink::MavlinkReader::new(&buffer[..length]);
        match reader.read_any_raw_message::<MavMessage>().unwrap() {
            mavlink::MAVLinkMessageRaw::V2(raw) => raw,
            mavlink::MAVLinkMessageRaw::V1(_) => panic!("version 1"),
        }
    }

    /// The messages that have reached this peer so far.
    pub(crate) fn heard(&self) -> usize {
        let mut buffer = [0; 512];
        std::iter::from_fn(|| self.socket.try_recv(&mut buffer).ok()).count()
    }
}
