//! Dense capsules (84 bytes, 40 samples of 16 bit in mm) and ultra-dense ones (170 bytes, 64
//! samples of 20 bit with a strength).
//!
//! ```text
//! dense:        sync, start u16, 40 × u16 mm
//! ultra-dense:  sync, time u32 µs, status u16, start u16, 32 × (u16, u16, u8: high nibbles)
//! ```
//! The SDK smooths near ultra-dense ranges over neighbours; here they stay as they were measured,
//! because their noise is wanted.

use super::capsule::{RawAngle, advance_q8};
use super::node::Node;

/// Bytes of a dense capsule.
pub(super) const BYTES: usize = 84;
/// Samples of a dense capsule.
pub(super) const SAMPLES: usize = 40;
/// Bytes of an ultra-dense capsule.
pub(super) const ULTRA_BYTES: usize = 170;
/// Samples of an ultra-dense capsule.
pub(super) const ULTRA_SAMPLES: usize = 64;
/// Steps of the angle in each.
const STEPS: i32 = 40;
const ULTRA_STEPS: i32 = 64;
/// Where the samples of an ultra-dense capsule begin.
const ULTRA_DATA: usize = 10;

/// The new-turn flag looks two steps ahead and is told once.
#[derive(Debug, Default)]
struct RisingEdge(bool);

impl RisingEdge {
    fn rises(&mut self, is_high: bool) -> bool {
        let rises = is_high && !self.0;
        self.0 = is_high;
        rises
    }
}

/// The samples of a dense capsule, appended to `nodes`.
pub(super) fn decode(capsule: &[u8], start_q6: u16, next_q6: u16, nodes: &mut Vec<Node>) {
    let step_q16 = (advance_q8(start_q6, next_q6) << 8) / STEPS;
    let mut raw = RawAngle::new(start_q6, step_q16);
    let mut edge = RisingEdge::default();
    for sample in capsule[4..BYTES].as_chunks::<2>().0 {
        let dist_q2 = u32::from(u16::from_le_bytes(*sample)) << 2;
        nodes.push(Node::untold(raw.at_q16, dist_q2, edge.rises(raw.passes_mark(2))));
        raw.advance();
    }
}

/// The samples of an ultra-dense capsule, appended to `nodes`.
pub(super) fn decode_ultra(capsule: &[u8], start_q6: u16, next_q6: u16, nodes: &mut Vec<Node>) {
    let step_q16 = (advance_q8(start_q6, next_q6) << 8) / ULTRA_STEPS;
    let mut raw = RawAngle::new(start_q6, step_q16);
    let mut edge = RisingEdge::default();
    for cabin in capsule[ULTRA_DATA..ULTRA_BYTES].as_chunks::<5>().0 {
        let word = |low: u8, high: u8, nibble: u8| {
            u32::from(u16::from_le_bytes([low, high])) | u32::from(nibble) << 16
        };
        let words =
            [word(cabin[0], cabin[1], cabin[4] & 0xF), word(cabin[2], cabin[3], cabin[4] >> 4)];
        for word in words {
            let (dist_mm, quality) = unpacked(word);
            let starts_turn = edge.rises(raw.passes_mark(2));
            let node = Node::untold(raw.at_q16, dist_mm << 2, starts_turn);
            nodes.push(Node { quality, ..node });
            raw.advance();
        }
    }
}

/// Distance, mm, and strength of a word of 20 bits: the farther, the coarser.
#[expect(clippy::cast_possible_truncation, reason = "the strength has eight bits at most")]
const fn unpacked(word: u32) -> (u32, u8) {
    /// First millimetre of each scale; the step is two and the scale, mm, and the range has ten
    /// bits and the scale.
    const FIRST_MM: [u32; 4] = [0, 2046, 8187, 24_567];
    let scale = word & 3;
    let steps = (word >> 2) & ((1 << (10 + scale)) - 1);
    let dist_mm = steps * (2 + scale) + FIRST_MM[scale as usize];
    (dist_mm, ((word >> (12 + scale)) << scale) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_of_ultra_dense_words_meet_at_their_borders() {
        // Largest value of each scale plus its step against the smallest of the next.
        assert_eq!(unpacked(0xFFC).0, 1023 * 2);
        assert_eq!(unpacked(1).0, 2046);
        assert_eq!(unpacked(0x1FFC | 1).0, 2047 * 3 + 2046);
        assert_eq!(unpacked(2).0, 8187);
        assert_eq!(unpacked(0x3FFC | 2).0 + 4, 24_571);
        assert_eq!(unpacked(3).0, 24_567);
        assert_eq!(unpacked(0xF_FFFF).1, 31 << 3);
    }
}
