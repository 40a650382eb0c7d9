//! A transport behind its guard, with a peer that signs by the `mavlink` crate's own code.

use crate::support::{Peer, at_ms, patiently, px4_heartbeat, until};
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, SigningConfig, SigningData};
use std::collections::BTreeSet;
use std::os::unix::fs::PermissionsExt as _;
use std::time::Duration;
use stockpilot::link::signing::{SigningSettings, WallClock};
use stockpilot::link::transport::{Outgoing, Transport};
use stockpilot::link::{Address, Guard, SecuritySettings};
use stockpilot::service::clock::{Clock, ClockDriver};
use tempfile::TempDir;
use tokio_util::sync::CancellationToken;

const KEY: [u8; 32] = [0x5a; 32];

async fn transport(settings: &SecuritySettings) -> (Transport, ClockDriver) {
    let (clock, driver) = Clock::driven();
    // The peer signs by the computer's clock, so this side judges by it.
    let real = Clock::real();
    let guard = Guard::open(settings, WallClock::new(move || real.since_1970())).unwrap();
    let address: Address = "udpin:127.0.0.1:0".parse().unwrap();
    let stop = CancellationToken::new();
    let transport = Transport::start_guarded(&address, guard, clock, stop).await.unwrap();
    (transport, driver)
}

fn signing(folder: &TempDir) -> SecuritySettings {
    let key_file = folder.path().join("key");
    std::fs::write(&key_file, "5a".repeat(32)).unwrap();
    std::fs::set_permissions(&key_file, std::fs::Permissions::from_mode(0o600)).unwrap();
    let signing = SigningSettings {
        key_file,
        stamp_file: folder.path().join("stamp"),
        link_id: 0,
        max_ahead: Duration::from_secs(60),
        accept_unsigned: BTreeSet::from([0]),
    };
    SecuritySettings { peers: Vec::new(), signing: Some(signing) }
}

fn signed(data: &SigningData, message: &MavMessage) -> Vec<u8> {
    let mut raw = MAVLinkV2MessageRaw::new();
    let header = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
    raw.serialize_message_for_signing(header, message);
    data.sign_message(&mut raw);
    raw.raw_bytes().to_vec()
}

fn heartbeat() -> MavMessage {
    let bytes = px4_heartbeat();
    let mut reader = mavlink::MavlinkReader::new(bytes.as_slice());
    reader.read_any_message::<MavMessage>().unwrap().1
}

fn battery() -> MavMessage {
    MavMessage::BATTERY_STATUS(m::BATTERY_STATUS_DATA::default())
}

#[tokio::test]
async fn signed_frames_pass_both_ways_and_replays_and_forgeries_do_not() {
    let folder = TempDir::new().unwrap();
    let (mut transport, _driver) = transport(&signing(&folder)).await;
    let peer = Peer::new(transport.local_addr().unwrap()).await;
    let theirs = SigningData::from_config(SigningConfig::new(KEY, 0, true, false));
    let forger = SigningData::from_config(SigningConfig::new([1; 32], 0, true, false));
    // An unsigned heartbeat may make the acquaintance.
    peer.says(&px4_heartbeat()).await;
    patiently(transport.received.recv()).await.unwrap();
    peer.says(&signed(&forger, &battery())).await;
    let good = signed(&theirs, &battery());
    peer.says(&good).await;
    peer.says(&good).await;
    peer.says(&px4_heartbeat()).await;
    peer.says(&signed(&theirs, &battery())).await;
    for _ in 0..2 {
        let received = patiently(transport.received.recv()).await.unwrap();
        assert!(matches!(received.message, MavMessage::BATTERY_STATUS(_)));
    }
    let stats = transport.stats();
    let guard = stats.guard;
    assert_eq!(
        (stats.received, guard.wrong_signatures, guard.replayed, guard.unsigned),
        (3, 1, 1, 1)
    );
    let header = MavHeader { system_id: 1, component_id: 191, sequence: 0 };
    transport.outgoing.send(Outgoing { header, message: battery() }).unwrap();
    let frame = peer.hears_raw().await;
    assert!(theirs.verify_signature(&frame), "the other implementation believes it");
    assert!(!theirs.verify_signature(&frame), "once");
}

#[tokio::test]
async fn nobody_takes_a_silent_autopilots_place_without_its_key() {
    let folder = TempDir::new().unwrap();
    let (mut transport, driver) = transport(&signing(&folder)).await;
    let local = transport.local_addr().unwrap();
    let (peer, thief) = (Peer::new(local).await, Peer::new(local).await);
    let theirs = SigningData::from_config(SigningConfig::new(KEY, 0, true, false));
    peer.says(&px4_heartbeat()).await;
    peer.says(&signed(&theirs, &battery())).await;
    for _ in 0..2 {
        patiently(transport.received.recv()).await.unwrap();
    }
    driver.advance_to(at_ms(60_000));
    thief.says(&px4_heartbeat()).await;
    until(|| transport.stats().strangers == 1).await;
    // One that gives itself another number: its heartbeat may come unsigned, the place may not.
    thief.says(&crate::support::heartbeat_frame((2, 1), [2, 12, 81, 4])).await;
    until(|| transport.stats().strangers == 2).await;
    // The same autopilot from another port, with the key: it may.
    let moved = Peer::new(local).await;
    moved.says(&signed(&theirs, &heartbeat())).await;
    patiently(transport.received.recv()).await.unwrap();
    assert_eq!((transport.stats().received, transport.stats().guard.unsigned), (3, 1));
}

#[tokio::test]
async fn whoever_signs_takes_the_place_of_one_who_does_not() {
    let folder = TempDir::new().unwrap();
    let (mut transport, _driver) = transport(&signing(&folder)).await;
    let local = transport.local_addr().unwrap();
    let (thief, autopilot) = (Peer::new(local).await, Peer::new(local).await);
    let theirs = SigningData::from_config(SigningConfig::new(KEY, 0, true, false));
    thief.says(&crate::support::heartbeat_frame((2, 1), [2, 12, 81, 4])).await;
    patiently(transport.received.recv()).await.unwrap();
    autopilot.says(&signed(&theirs, &heartbeat())).await;
    patiently(transport.received.recv()).await.unwrap();
    thief.says(&crate::support::heartbeat_frame((2, 1), [2, 12, 81, 4])).await;
    until(|| transport.stats().strangers == 1).await;
}

#[tokio::test]
async fn an_autopilot_without_a_clock_takes_the_place_of_one_who_does_not_sign() {
    let folder = TempDir::new().unwrap();
    let (mut transport, driver) = transport(&signing(&folder)).await;
    let local = transport.local_addr().unwrap();
    let (stranger, autopilot) = (Peer::new(local).await, Peer::new(local).await);
    let mut frame = MAVLinkV2MessageRaw::new();
    frame.serialize_message_for_signing(
        MavHeader { system_id: 1, component_id: 1, sequence: 0 },
        &heartbeat(),
    );
    // Signed at the beginning of 2015.
    frame.signature_timestamp_bytes_mut().copy_from_slice(&[9, 0, 0, 0, 0, 0]);
    let mut signature = [0; 6];
    frame.calculate_signature(&KEY, &mut signature);
    frame.signature_value_mut().copy_from_slice(&signature);
    stranger.says(&crate::support::heartbeat_frame((2, 1), [2, 12, 81, 4])).await;
    patiently(transport.received.recv()).await.unwrap();
    autopilot.says(frame.raw_bytes()).await;
    patiently(transport.received.recv()).await.unwrap();
    stranger.says(&crate::support::heartbeat_frame((2, 1), [2, 12, 81, 4])).await;
    until(|| transport.stats().strangers == 1).await;
    // One who shows as much may follow it after a long silence.
    driver.advance_to(at_ms(60_000));
    let moved = Peer::new(local).await;
    moved.says(frame.raw_bytes()).await;
    patiently(transport.received.recv()).await.unwrap();
}

#[tokio::test]
async fn strangers_by_address_are_not_even_parsed() {
    let settings = SecuritySettings { peers: vec!["127.0.0.2".parse().unwrap()], signing: None };
    let (transport, _driver) = transport(&settings).await;
    let peer = Peer::new(transport.local_addr().unwrap()).await;
    peer.says(&px4_heartbeat()).await;
    until(|| transport.stats().guard.refused_addresses == 1).await;
    assert_eq!(transport.stats().received, 0);
}

#[tokio::test]
async fn a_flood_of_ten_thousand_leaves_the_heartbeat_its_place() {
    let (mut transport, driver) = transport(&SecuritySettings::default()).await;
    let peer = Peer::new(transport.local_addr().unwrap()).await;
    peer.says(&px4_heartbeat()).await;
    patiently(transport.received.recv()).await.unwrap();
    driver.advance_to(at_ms(1));
    // Whoever else speaks through the autopilot: 200 of each burst count, whatever its size.
    let flood = crate::support::heartbeat_frame((66, 66), [6, 8, 0, 4]);
    let burst: Vec<u8> = flood.repeat(100);
    for _ in 0..100 {
        peer.says(&burst).await;
        // One datagram after the other, so that no socket drops them.
        let before = transport.stats();
        until(|| transport.stats().guard.flooded + transport.stats().received > before.received)
            .await;
    }
    peer.says(&px4_heartbeat()).await;
    let mut n_flood = 0;
    loop {
        let received = patiently(transport.received.recv()).await.unwrap();
        if received.header.component_id == 1 {
            break;
        }
        n_flood += 1;
    }
    assert_eq!(n_flood, 200);
    assert_eq!(transport.stats().received_lost, 0);
}
