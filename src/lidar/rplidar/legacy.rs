//! Legacy express capsules: 84 bytes, 16 cabins of two samples.
//!
//! ```text
//! cabin: w1 u16, w2 u16, off u8      distance q2 = w & FFFC
//! q1 = (off & F) | (w1 & 3) << 4     q2 = (off >> 4) | (w2 & 3) << 4      1/8°, unsigned
//! angle = start + k · advance/32 − q/8
//! ```

use super::capsule::{RawAngle, advance_q8};
use super::node::Node;

/// Bytes of a capsule.
pub(super) const BYTES: usize = 84;
/// Samples of a capsule.
pub(super) const SAMPLES: usize = 32;

/// The samples of a capsule, appended to `nodes`; the angles need the start of the next one.
pub(super) fn decode(capsule: &[u8], start_q6: u16, next_q6: u16, nodes: &mut Vec<Node>) {
    let mut raw = RawAngle::new(start_q6, advance_q8(start_q6, next_q6) << 3);
    for cabin in capsule[4..BYTES].as_chunks::<5>().0 {
        let [w1, w2] = [[cabin[0], cabin[1]], [cabin[2], cabin[3]]].map(u16::from_le_bytes);
        let offsets = [cabin[4] & 0xF, cabin[4] >> 4];
        for (word, low) in [w1, w2].into_iter().zip(offsets) {
            let offset_q3 = i32::from(low) | i32::from(word & 3) << 4;
            let angle_q16 = raw.at_q16 - (offset_q3 << 13);
            nodes.push(Node::untold(angle_q16, u32::from(word & 0xFFFC), raw.passes_mark(1)));
            raw.advance();
        }
    }
}
