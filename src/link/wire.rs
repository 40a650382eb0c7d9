//! Bytes of the wire to messages and back.

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, HEARTBEAT_DATA, MavMessage};
use mavlink::error::ParserError;
use mavlink::{MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, Message as _, MessageData as _};

/// Enumerations in a heartbeat.
const MAX_PATCHES: usize = 3;

/// The message in a frame whose checksum was found right.
///
/// A value that its enumeration does not know voids the whole message in the parser. Two messages
/// are too important for that: in `HEARTBEAT` an unknown type, autopilot or state, and in
/// `COMMAND_ACK` an unknown result, are replaced by "generic", "not initialised" and "failed".
///
/// # Errors
/// As [`MavMessage::parse`]: unknown message, unknown enumeration value, wrong length.
pub fn decode(raw: &MAVLinkMessageRaw) -> Result<(MavHeader, MavMessage), ParserError> {
    let header = MavHeader {
        system_id: raw.system_id(),
        component_id: raw.component_id(),
        sequence: raw.sequence(),
    };
    let message = match MavMessage::parse(raw.version(), raw.message_id(), raw.payload()) {
        Err(ParserError::InvalidEnum { .. }) => decode_patched(raw)?,
        other => other?,
    };
    Ok((header, message))
}

/// Replaces one unknown value after the other; each round mends the field that the parser names.
fn decode_patched(raw: &MAVLinkMessageRaw) -> Result<MavMessage, ParserError> {
    let mut payload = raw.payload().to_vec();
    let parse = |payload: &[u8]| MavMessage::parse(raw.version(), raw.message_id(), payload);
    for _ in 0..MAX_PATCHES {
        let Err(ParserError::InvalidEnum { enum_type, .. }) = parse(&payload) else { break };
        let Some((index, replacement)) = patch(raw.message_id(), enum_type) else { break };
        let Some(byte) = payload.get_mut(index) else { break };
        *byte = replacement;
    }
    parse(&payload)
}

/// Where the field of this type stands in the payload, and a value that promises nothing.
fn patch(message_id: u32, enum_type: &str) -> Option<(usize, u8)> {
    match (message_id, enum_type) {
        (HEARTBEAT_DATA::ID, "MavType") => Some((4, 0)),
        (HEARTBEAT_DATA::ID, "MavAutopilot") => Some((5, 0)),
        (HEARTBEAT_DATA::ID, "MavState") => Some((7, 0)),
        (COMMAND_ACK_DATA::ID, "MavResult") => Some((2, 4)),
        _ => None,
    }
}

/// The MAVLink 2 frame of a message, unsigned.
#[must_use]
pub fn encode(header: MavHeader, message: &MavMessage) -> Vec<u8> {
    let mut frame = MAVLinkV2MessageRaw::new();
    frame.serialize_message(header, message);
    frame.raw_bytes().to_vec()
}
