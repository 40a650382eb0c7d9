//! The transport for datagrams.

use crate::support::{Peer, at_ms, frame, heartbeat_frame, patiently, px4_heartbeat, until};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavMessage};
use stockpilot::link::Address;
use stockpilot::link::transport::{Outgoing, Received, Transport};
use stockpilot::service::clock::{Clock, ClockDriver};
use tokio_util::sync::CancellationToken;

struct Scene {
    transport: Transport,
    driver: ClockDriver,
    stop: CancellationToken,
    autopilot: Peer,
}

impl Scene {
    async fn new() -> Self {
        let (clock, driver) = Clock::driven();
        let stop = CancellationToken::new();
        let address: Address = "udpin:127.0.0.1:0".parse().unwrap();
        let transport = Transport::start(&address, clock, stop.clone()).await.unwrap();
        let autopilot = Peer::new(transport.local_addr().unwrap()).await;
        Self { transport, driver, stop, autopilot }
    }

    async fn next(&mut self) -> Received {
        patiently(self.transport.received.recv()).await.unwrap()
    }

    async fn end(self) -> stockpilot::link::transport::TransportStats {
        let stats = self.transport.stats();
        self.stop.cancel();
        patiently(self.transport.join()).await;
        stats
    }
}

fn heartbeat_out() -> Outgoing {
    let header = MavHeader { system_id: 1, component_id: 191, sequence: 99 };
    Outgoing { header, message: MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()) }
}

#[tokio::test]
async fn a_false_header_withholds_nothing() {
    let mut scene = Scene::new().await;
    scene.autopilot.says(&px4_heartbeat()).await;
    scene.next().await;
    // Ten bytes that promise a frame of 267: alone, and before a good one in the same datagram.
    let false_header = [0xfd, 255, 0, 0, 1, 1, 1, 0, 0, 0];
    scene.autopilot.says(&false_header).await;
    scene.autopilot.says(&[&false_header, px4_heartbeat().as_slice()].concat()).await;
    scene.autopilot.says(&px4_heartbeat()).await;
    for _ in 0..2 {
        let received = scene.next().await;
        assert!(matches!(received.message, MavMessage::HEARTBEAT(_)));
    }
    let stats = scene.end().await;
    assert_eq!((stats.received, stats.garbage_datagrams), (3, 1));
}

#[tokio::test]
async fn garbage_truncation_and_bad_checksums_pass_by() {
    let mut scene = Scene::new().await;
    scene.autopilot.says(&px4_heartbeat()).await;
    scene.next().await;
    let whole = px4_heartbeat();
    for length in 0..whole.len() {
        scene.autopilot.says(&whole[..length]).await;
    }
    for index in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[index] ^= 0x10;
        scene.autopilot.says(&flipped).await;
    }
    // A known message with a value that its enumeration lacks, then an unknown message.
    scene.autopilot.says(&frame((1, 1), 245, 130, &[0, 77])).await;
    scene.autopilot.says(&frame((1, 1), 0x00ab_cdef, 1, &[1, 2, 3])).await;
    scene.autopilot.says(&[&whole[..], &whole[..], &whole[..]].concat()).await;
    for _ in 0..3 {
        scene.next().await;
    }
    let stats = scene.end().await;
    assert_eq!((stats.received, stats.undecodable), (4, 1));
}

#[tokio::test]
async fn the_first_autopilot_is_the_only_one_heard_and_spoken_to() {
    let mut scene = Scene::new().await;
    let stranger = Peer::new(scene.transport.local_addr().unwrap()).await;
    // A ground station alone does not make a peer.
    stranger.says(&heartbeat_frame((255, 190), [6, 8, 0, 4])).await;
    until(|| scene.transport.stats().strangers == 1).await;
    scene.transport.outgoing.send(heartbeat_out()).unwrap();
    until(|| scene.transport.stats().send_failed == 1).await;
    scene.autopilot.says(&px4_heartbeat()).await;
    scene.next().await;
    stranger.says(&heartbeat_frame((9, 1), [2, 12, 0x91, 4])).await;
    until(|| scene.transport.stats().strangers == 2).await;
    for sequence in 0..3 {
        scene.transport.outgoing.send(heartbeat_out()).unwrap();
        let (header, _) = scene.autopilot.hears().await;
        assert_eq!((header.component_id, header.sequence), (191, sequence));
    }
    assert_eq!(stranger.heard(), 0);
    // After ten silent seconds another address may take the place.
    scene.driver.advance_to(at_ms(10_001));
    stranger.says(&px4_heartbeat()).await;
    scene.next().await;
    scene.transport.outgoing.send(heartbeat_out()).unwrap();
    stranger.hears().await;
    scene.end().await;
}

#[tokio::test]
async fn a_configured_peer_is_spoken_to_first() {
    let autopilot = tokio::net::UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let address: Address = format!("udpout:{}", autopilot.local_addr().unwrap()).parse().unwrap();
    let (clock, _driver) = Clock::driven();
    let stop = CancellationToken::new();
    let mut transport = Transport::start(&address, clock, stop.clone()).await.unwrap();
    transport.outgoing.send(heartbeat_out()).unwrap();
    let mut buffer = [0; 512];
    let (_, from) = patiently(autopilot.recv_from(&mut buffer)).await.unwrap();
    autopilot.send_to(&px4_heartbeat(), from).await.unwrap();
    assert!(patiently(transport.received.recv()).await.is_some());
    stop.cancel();
    patiently(transport.join()).await;
}
