//! The gate as a whole.

use super::*;
use mavlink::MavlinkReader;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, HEARTBEAT_DATA, SETUP_SIGNING_DATA};

const STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };

fn frame(message: &MavMessage) -> MAVLinkMessageRaw {
    let bytes = super::super::wire::encode(STATION, message);
    MavlinkReader::new(bytes.as_slice()).read_any_raw_message::<MavMessage>().unwrap()
}

#[test]
fn a_key_set_up_ends_at_the_gate() {
    let guard = Guard::unsigned();
    let setup = SETUP_SIGNING_DATA { secret_key: [0xA5; 32], ..SETUP_SIGNING_DATA::default() };
    assert!(!guard.admits(&frame(&MavMessage::SETUP_SIGNING(setup)), Stamp::ZERO));
    assert_eq!(guard.stats(), GuardStats { key_setups: 1, ..GuardStats::default() });
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    assert!(guard.admits(&frame(&heartbeat), Stamp::ZERO));
}

#[test]
fn only_listed_addresses_are_heard_and_all_without_a_list() {
    assert!(Guard::unsigned().admits_address("203.0.113.5".parse().unwrap()));
    let peers = vec!["10.0.0.0/8".parse().unwrap(), "127.0.0.1".parse().unwrap()];
    let guard = Guard::new(peers, None);
    assert!(guard.admits_address("10.9.8.7".parse().unwrap()));
    assert!(guard.admits_address("127.0.0.1".parse().unwrap()));
    assert!(!guard.admits_address("127.0.0.2".parse().unwrap()));
    assert_eq!(guard.stats().refused_addresses, 1);
}

#[test]
fn a_flood_is_counted() {
    let guard = Guard::unsigned();
    let command = frame(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA::default()));
    let n_taken = (0..1_000).filter(|_| guard.admits(&command, Stamp::ZERO)).count();
    assert_eq!((n_taken, guard.stats().flooded), (200, 800));
}
