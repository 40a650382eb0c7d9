//! The transports for byte streams.

use crate::support::{at_ms, patiently, px4_heartbeat, until};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavMessage};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs::File;
use std::io::{Read as _, Write as _};
use stockpilot::link::Address;
use stockpilot::link::transport::{Outgoing, Transport};
use stockpilot::service::clock::{Clock, ClockDriver};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

async fn open(address: &str) -> (Transport, ClockDriver, CancellationToken) {
    let (clock, driver) = Clock::driven();
    let stop = CancellationToken::new();
    let address: Address = address.parse().unwrap();
    let transport = Transport::start(&address, clock, stop.clone()).await.unwrap();
    (transport, driver, stop)
}

fn heartbeat_out() -> Outgoing {
    let header = MavHeader { system_id: 1, component_id: 191, sequence: 0 };
    Outgoing { header, message: MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()) }
}

#[tokio::test]
async fn frames_in_pieces_and_in_rubbish_arrive() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (mut transport, _driver, stop) =
        open(&format!("tcpout:{}", listener.local_addr().unwrap())).await;
    let (mut peer, _) = patiently(listener.accept()).await.unwrap();
    peer.set_nodelay(true).unwrap();
    for byte in px4_heartbeat() {
        peer.write_all(&[byte]).await.unwrap();
        tokio::task::yield_now().await;
    }
    assert!(patiently(transport.received.recv()).await.is_some());
    peer.write_all(&[0xfe, 3, 0xfd, 0, 1, 0x55]).await.unwrap();
    peer.write_all(&px4_heartbeat()).await.unwrap();
    peer.write_all(&px4_heartbeat()).await.unwrap();
    for _ in 0..2 {
        assert!(patiently(transport.received.recv()).await.is_some());
    }
    stop.cancel();
    patiently(transport.join()).await;
}

#[tokio::test]
async fn a_broken_stream_is_opened_again_after_a_second_without_stale_messages() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (mut transport, driver, stop) =
        open(&format!("tcpout:{}", listener.local_addr().unwrap())).await;
    let (peer, _) = patiently(listener.accept()).await.unwrap();
    drop(peer);
    until(|| transport.stats().io_errors == 1).await;
    transport.outgoing.send(heartbeat_out()).await.unwrap();
    driver.advance_to(at_ms(1_000));
    let (mut peer, _) = patiently(listener.accept()).await.unwrap();
    until(|| transport.stats().send_failed == 1).await;
    peer.write_all(&px4_heartbeat()).await.unwrap();
    assert!(patiently(transport.received.recv()).await.is_some());
    transport.outgoing.send(heartbeat_out()).await.unwrap();
    let mut stx = [0];
    patiently(peer.read_exact(&mut stx)).await.unwrap();
    assert_eq!(stx, [0xfd]);
    assert_eq!((transport.stats().opened, transport.stats().sent), (2, 1));
    stop.cancel();
    patiently(transport.join()).await;
}

#[tokio::test]
async fn a_serial_port_moves_frames_and_says_when_it_is_unplugged() {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let (mut transport, _driver, stop) = open(&format!("serial:{path}:57600")).await;
    until(|| transport.stats().opened == 1).await;
    let mut master = File::from(master);
    master.write_all(&px4_heartbeat()).unwrap();
    assert!(patiently(transport.received.recv()).await.is_some());
    transport.outgoing.send(heartbeat_out()).await.unwrap();
    until(|| transport.stats().sent == 1).await;
    let mut stx = [0];
    master.read_exact(&mut stx).unwrap();
    assert_eq!(stx, [0xfd]);
    drop(master);
    until(|| transport.stats().io_errors == 1).await;
    stop.cancel();
    patiently(transport.join()).await;
}
