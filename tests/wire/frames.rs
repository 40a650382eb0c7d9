//! Single frames against bytes put together by hand.

use crate::support::{frame, heartbeat_frame, px4_heartbeat};
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavResult, MavState, MavType,
};
use mavlink::{MAVLinkMessageRaw, MavHeader, MavlinkReader};
use stockpilot::link::wire::{decode, encode};

fn raw(bytes: &[u8]) -> MAVLinkMessageRaw {
    MavlinkReader::new(bytes).read_any_raw_message::<MavMessage>().unwrap()
}

#[test]
fn a_heartbeat_has_these_bytes() {
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0x0006_0000,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode: MavModeFlag::from_bits_retain(0x91),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    });
    let header = MavHeader { system_id: 1, component_id: 1, sequence: 42 };
    assert_eq!(encode(header, &message), px4_heartbeat());
    let (decoded_header, decoded) = decode(&raw(&px4_heartbeat())).unwrap();
    assert_eq!((decoded_header, decoded), (header, message));
}

#[test]
fn a_heartbeat_with_unknown_values_is_still_a_heartbeat() {
    let (_, message) = decode(&raw(&heartbeat_frame((1, 1), [200, 12, 0x91, 4]))).unwrap();
    let MavMessage::HEARTBEAT(data) = message else { panic!("{message:?}") };
    assert_eq!(data.autopilot, MavAutopilot::MAV_AUTOPILOT_PX4);
    assert_eq!(data.custom_mode, 0x0006_0000);
    // All three at once; an unknown autopilot never becomes a known one.
    let (_, message) = decode(&raw(&heartbeat_frame((1, 1), [200, 201, 0x91, 202]))).unwrap();
    let MavMessage::HEARTBEAT(data) = message else { panic!("{message:?}") };
    assert_eq!(data.autopilot, MavAutopilot::MAV_AUTOPILOT_GENERIC);
    assert_eq!(data.system_status, MavState::MAV_STATE_UNINIT);
}

#[test]
fn an_unknown_result_is_a_failure() {
    // COMMAND_ACK: id 77, seed 143; command 400, result 99.
    let (_, message) = decode(&raw(&frame((1, 1), 77, 143, &[0x90, 0x01, 99]))).unwrap();
    let MavMessage::COMMAND_ACK(data) = message else { panic!("{message:?}") };
    assert_eq!(data.result, MavResult::MAV_RESULT_FAILED);
}

#[test]
fn other_unknown_values_are_errors() {
    // COMMAND_ACK of a command that does not exist, EXTENDED_SYS_STATE (245, seed 130) with a
    // landed state that does not.
    assert!(decode(&raw(&frame((1, 1), 77, 143, &[0xff, 0xfe, 0]))).is_err());
    assert!(decode(&raw(&frame((1, 1), 245, 130, &[0, 77]))).is_err());
}
