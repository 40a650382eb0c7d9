//! The transports for byte streams.

use crate::support::{at_ms, patiently, px4_heartbeat, until};
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavMessage, SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA,
};
use mavlink::{MavHeader, MavlinkReader};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs::File;
use std::io::{Cursor, Read as _, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
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

fn out(message: MavMessage) -> Outgoing {
    Outgoing { header: MavHeader { system_id: 1, component_id: 191, sequence: 0 }, message }
}

fn heartbeat_out() -> Outgoing {
    out(MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()))
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
    transport.outgoing.send(heartbeat_out()).unwrap();
    driver.advance_to(at_ms(1_000));
    let (mut peer, _) = patiently(listener.accept()).await.unwrap();
    until(|| transport.stats().send_failed == 1).await;
    peer.write_all(&px4_heartbeat()).await.unwrap();
    assert!(patiently(transport.received.recv()).await.is_some());
    transport.outgoing.send(heartbeat_out()).unwrap();
    let mut stx = [0];
    patiently(peer.read_exact(&mut stx)).await.unwrap();
    assert_eq!(stx, [0xfd]);
    assert_eq!((transport.stats().opened, transport.stats().sent), (2, 1));
    stop.cancel();
    patiently(transport.join()).await;
}

/// A peer that holds the connection and does nothing with it: neither reads nor speaks.
#[tokio::test]
async fn a_peer_that_takes_nothing_gets_nothing_old() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (transport, driver, stop) =
        open(&format!("tcpout:{}", listener.local_addr().unwrap())).await;
    let (peer, _) = patiently(listener.accept()).await.unwrap();
    until(|| transport.stats().opened == 1).await;
    let text = STATUSTEXT_DATA { text: "x".repeat(50).as_str().into(), ..Default::default() };
    // Until the buffers of both ends are full.
    let mut sent_before = u64::MAX;
    while transport.stats().sent != sent_before {
        sent_before = transport.stats().sent;
        for _ in 0..200 {
            // Once the outbox is full the rest is lost, as it should be.
            transport.outgoing.send(out(MavMessage::STATUSTEXT(text.clone()))).ok();
        }
        for _ in 0..2_000 {
            tokio::task::yield_now().await;
        }
    }
    assert_eq!(transport.stats().io_errors, 0);
    driver.advance_to(at_ms(1_001));
    until(|| transport.stats().io_errors == 1).await;
    transport.outgoing.send(heartbeat_out()).unwrap();
    driver.advance_to(at_ms(2_002));
    let (_peer, _) = patiently(listener.accept()).await.unwrap();
    until(|| transport.stats().opened == 2).await;
    // All that had waited is thrown away, and so is what the heartbeat would have led.
    until(|| transport.stats().send_failed > 0).await;
    assert_eq!(transport.stats().sent, sent_before);
    drop(peer);
    stop.cancel();
    patiently(transport.join()).await;
}

#[tokio::test]
async fn a_silent_connection_is_opened_again() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (mut transport, driver, stop) =
        open(&format!("tcpout:{}", listener.local_addr().unwrap())).await;
    let (mut peer, _) = patiently(listener.accept()).await.unwrap();
    until(|| transport.stats().opened == 1).await;
    // A heartbeat in each span keeps it open.
    for second in [4, 8] {
        peer.write_all(&px4_heartbeat()).await.unwrap();
        assert!(patiently(transport.received.recv()).await.is_some());
        driver.advance_to(at_ms(second * 1_000 + 1_500));
        for _ in 0..200 {
            tokio::task::yield_now().await;
        }
        assert_eq!(transport.stats().io_errors, 0);
    }
    // Its last heartbeat fell into the span that ends at 10.5 s; the next one is silent.
    for ms in [11_000, 17_000] {
        driver.advance_to(at_ms(ms));
        for _ in 0..200 {
            tokio::task::yield_now().await;
        }
    }
    until(|| transport.stats().io_errors == 1).await;
    driver.advance_to(at_ms(18_001));
    let _again = patiently(listener.accept()).await.unwrap();
    stop.cancel();
    patiently(transport.join()).await;
}

fn pseudo_terminal() -> (File, String) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    (File::from(master), path)
}

#[tokio::test]
async fn a_serial_port_moves_frames_and_says_when_it_is_unplugged() {
    let (mut master, path) = pseudo_terminal();
    let (mut transport, _driver, stop) = open(&format!("serial:{path}:57600")).await;
    until(|| transport.stats().opened == 1).await;
    master.write_all(&px4_heartbeat()).unwrap();
    assert!(patiently(transport.received.recv()).await.is_some());
    transport.outgoing.send(heartbeat_out()).unwrap();
    until(|| transport.stats().sent == 1).await;
    let mut stx = [0];
    master.read_exact(&mut stx).unwrap();
    assert_eq!(stx, [0xfd]);
    drop(master);
    until(|| transport.stats().io_errors == 1).await;
    stop.cancel();
    patiently(transport.join()).await;
}

/// 57600 baud are 5760 bytes in a second; 20 ms of it and the frame that crosses this mark may be
/// ahead. What waits is overtaken by what is newer or more urgent.
#[tokio::test]
async fn a_slow_serial_line_gets_what_it_carries_and_fresh_setpoints() {
    let (master, path) = pseudo_terminal();
    let (transport, driver, stop) = open(&format!("serial:{path}:57600")).await;
    until(|| transport.stats().opened == 1).await;
    let n_bytes = Arc::new(AtomicUsize::new(0));
    let peer = std::thread::spawn({
        let n_bytes = Arc::clone(&n_bytes);
        move || setpoints_heard(master, &n_bytes)
    });
    let text = STATUSTEXT_DATA { text: "x".repeat(50).as_str().into(), ..Default::default() };
    for _ in 0..64 {
        transport.outgoing.send(out(MavMessage::STATUSTEXT(text.clone()))).unwrap();
    }
    // Twice as many setpoints as the line could carry, and their only content is their number.
    for ms in 1..=1_000 {
        let data = SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: u32::try_from(ms).unwrap(),
            yaw_rate: 1.0,
            ..Default::default()
        };
        if ms % 5 == 0 {
            transport.outgoing.send(out(MavMessage::SET_POSITION_TARGET_LOCAL_NED(data))).unwrap();
        }
        driver.advance_to(at_ms(ms));
        for _ in 0..20 {
            tokio::task::yield_now().await;
        }
    }
    let sent = transport.stats().sent;
    stop.cancel();
    patiently(transport.join()).await;
    let heard = peer.join().unwrap();
    let n_bytes = n_bytes.load(Ordering::Relaxed);
    assert!(n_bytes <= 5_760 + 116 + 65, "{n_bytes} bytes in a second");
    assert!(n_bytes > 5_500, "{n_bytes} bytes in a second");
    // 65 bytes each take 11.3 ms: between two that leave, two are put in.
    assert!(heard.len() > 60 && heard.len() as u64 <= sent, "{} of {sent}", heard.len());
    assert!(heard.windows(2).all(|pair| pair[1] > pair[0]));
    assert!(*heard.last().unwrap() > 970, "the newest left: {heard:?}");
}

/// The numbers of the setpoints that arrive until the line is closed.
fn setpoints_heard(master: File, n_bytes: &AtomicUsize) -> Vec<u32> {
    let mut bytes = Vec::new();
    let mut chunk = [0; 512];
    let mut master = master;
    while let Ok(n) = master.read(&mut chunk) {
        bytes.extend_from_slice(&chunk[..n]);
        n_bytes.store(bytes.len(), Ordering::Relaxed);
    }
    let mut reader = MavlinkReader::new(Cursor::new(bytes));
    std::iter::from_fn(|| reader.read_any_message::<MavMessage>().ok())
        .filter_map(|(_, message)| match message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(data) => Some(data.time_boot_ms),
            _ => None,
        })
        .collect()
}
