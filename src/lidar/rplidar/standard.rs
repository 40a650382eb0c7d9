//! Standard nodes: five bytes without a checksum.
//!
//! ```text
//! b0: bit 0 new turn, bit 1 its inverse, bits 7..2 quality
//! b1: bit 0 always 1, bits 7..1 angle bits 6..0      b2: angle bits 14..7, 1/64°
//! b3, b4: distance, ¼ mm
//! ```
//! A wrong bit in the distance cannot be seen. What can be seen is checked: the three check bits,
//! the range of the angle, and that the head goes on by little from node to node. Random bytes
//! pass the bits alone one time in six, so only a chain of nodes counts as found.

use super::capsule::TURN_Q6;
use super::node::Node;

/// Bytes of a node.
pub(super) const BYTES: usize = 5;
/// So many nodes in a row must fit before the first of them is believed.
pub(super) const CHAIN: usize = 8;
/// The head never goes further than this from one node to the next, 1/64°.
const LARGEST_STEP_Q6: i32 = 20 << 6;

/// The node, if its check bits and its angle are possible.
pub(super) fn decode(bytes: &[u8; BYTES]) -> Option<Node> {
    let [head, angle_low, angle_high, dist_low, dist_high] = *bytes;
    let angle_q6 = u16::from_le_bytes([angle_low, angle_high]) >> 1;
    let is_possible = (head ^ (head >> 1)) & 1 == 1 && angle_low & 1 == 1 && angle_q6 < TURN_Q6;
    is_possible.then(|| Node {
        angle_q16: i32::from(angle_q6) << 10,
        dist_q2: u32::from(u16::from_le_bytes([dist_low, dist_high])),
        quality: head & 0xFC,
        starts_turn: head & 1 == 1,
    })
}

/// True if the head can have gone from one node to the other.
pub(super) const fn can_follow(previous: &Node, next: &Node) -> bool {
    let step_q6 = (next.angle_q16 - previous.angle_q16) >> 10;
    let turn = TURN_Q6 as i32;
    let forward = step_q6.rem_euclid(turn);
    forward <= LARGEST_STEP_Q6 || turn - forward <= LARGEST_STEP_Q6
}

/// True if a chain of nodes begins here; the bytes hold at least a chain.
pub(super) fn is_chain(bytes: &[u8]) -> bool {
    let (nodes, _) = bytes.as_chunks::<BYTES>();
    let mut previous: Option<Node> = None;
    nodes.iter().take(CHAIN).all(|bytes| {
        let Some(node) = decode(bytes) else { return false };
        let follows = previous.is_none_or(|previous| can_follow(&previous, &node));
        previous = Some(node);
        follows
    })
}
