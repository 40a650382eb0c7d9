//! Ultra capsules: 132 bytes, 32 cabins of three samples.
//!
//! ```text
//! cabin u32: major bits 11..0, p1 bits 21..12 signed, p2 bits 31..22 signed
//! samples: major;  (p1 << scale) + major;  (p2 << next scale) + next cabin's major
//! ```
//! A major value grows coarser with the distance (1 mm below 0.5 m to 16 mm beyond 16 m). The
//! sensor triangulates, so the direction of a beam depends on its distance; the SDK's correction
//! is a cubic in 1/distance.

use super::capsule::{RawAngle, advance_q8};
use super::node::Node;
#[cfg(test)]
use super::node::TURN_Q16;

/// Bytes of a capsule.
pub(super) const BYTES: usize = 132;
/// Samples of a capsule.
pub(super) const SAMPLES: usize = 96;
/// Predictions that stand for "no return".
const NO_RETURN: [i32; 2] = [-512, 511];

/// Quotient by which the correction is tabulated: 98361/d, for d ≥ 200 ¼ mm.
const QUOTIENT: i32 = 98_361;
const NEAREST_Q2: i32 = 50 * 4;
const OFFSETS: usize = 492;
/// Correction, 2⁻¹⁶ °, by the quotient.
const OFFSET_Q16: [i32; OFFSETS] = offset_table();
/// Correction where nothing came back or the distance is below 50 mm, 2⁻¹⁶ °.
const NEAR_OFFSET_Q16: i32 = degrees_q16(rad_q16(7.5));
/// π as the SDK writes it, so that every truncation falls alike.
#[expect(clippy::approx_constant, reason = "the vendor's digits decide the last bit")]
const SDK_PI: f64 = 3.141_592_653_5;
#[expect(clippy::approx_constant, reason = "the vendor's digits decide the last bit")]
const SDK_PI_SHORT: f64 = 3.141_592_65;

#[expect(clippy::cast_possible_truncation, reason = "the SDK truncates here, and so must this")]
const fn degrees_q16(rad_q16: i32) -> i32 {
    ((rad_q16 * 180) as f64 / SDK_PI_SHORT) as i32
}

#[expect(clippy::cast_possible_truncation, reason = "the SDK truncates here, and so must this")]
const fn rad_q16(deg: f64) -> i32 {
    (deg * SDK_PI * 65_536.0 / 180.0) as i32
}

const fn offset_table() -> [i32; OFFSETS] {
    let mut table = [0; OFFSETS];
    let (mut at, mut k) = (0, 0_i32);
    while at < OFFSETS {
        table[at] = degrees_q16(rad_q16(8.0) - (k << 6) - (k * k * k) / 98_304);
        (at, k) = (at + 1, k + 1);
    }
    table
}

/// The samples of a capsule, appended to `nodes`; the angles and the last sample need the next one.
pub(super) fn decode(
    capsule: &[u8],
    start_q6: u16,
    next: &[u8],
    next_q6: u16,
    nodes: &mut Vec<Node>,
) {
    let mut raw = RawAngle::new(start_q6, (advance_q8(start_q6, next_q6) << 3) / 3);
    let may_pass_mark = raw.ends_beyond_turn(SAMPLES);
    let (cabins, _) = capsule[4..BYTES].as_chunks::<4>();
    let first_of_next = [next[4], next[5], next[6], next[7]];
    let mut samples = [Node::default(); SAMPLES];
    let mut cabin = u32::from_le_bytes(cabins[0]);
    let mut major = Major::of(cabin);
    let following = cabins[1..].iter().chain([&first_of_next]);
    for (three, following) in samples.as_chunks_mut::<3>().0.iter_mut().zip(following) {
        let next_cabin = u32::from_le_bytes(*following);
        let next_major = Major::of(next_cabin);
        for (sample, dist_mm) in three.iter_mut().zip(distances_mm(cabin, major, next_major)) {
            *sample = node(dist_mm, raw.at_q16, may_pass_mark && raw.passes_mark(1));
            raw.advance();
        }
        (cabin, major) = (next_cabin, next_major);
    }
    nodes.extend_from_slice(&samples);
}

#[inline]
fn node(dist_mm: i32, raw_q16: i32, starts_turn: bool) -> Node {
    let dist_q2 = dist_mm.max(0) << 2;
    let is_near = dist_q2 < NEAREST_Q2;
    let offset_q16 = OFFSET_Q16[quotient(dist_q2.max(NEAREST_Q2))];
    let offset_q16 = if is_near { NEAR_OFFSET_Q16 } else { offset_q16 };
    Node::untold(raw_q16 - offset_q16, dist_q2.unsigned_abs(), starts_turn)
}

/// Whole quotient 98361/d. Floats divide faster; they are exact here, because no quotient lies
/// nearer to a whole number from below than 1/d, and 98361 is less than 2²⁴.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "0 to 491")]
#[expect(clippy::cast_sign_loss, reason = "0 to 491")]
#[expect(clippy::cast_precision_loss, reason = "below 2²⁴")]
fn quotient(dist_q2: i32) -> usize {
    ((QUOTIENT as f32 / dist_q2 as f32) as i32 as usize).min(OFFSETS - 1)
}

/// The three distances of a cabin, mm; negative ones are nonsense and become "no return".
#[inline]
#[expect(clippy::cast_possible_wrap, reason = "the fields are signed from here on")]
const fn distances_mm(cabin: u32, major: Major, next: Major) -> [i32; 3] {
    let base = if major.mm == 0 && next.mm != 0 { next } else { major };
    // Arithmetic shifts keep the sign.
    let (p1, p2) = (((cabin << 10) as i32) >> 22, (cabin as i32) >> 22);
    [major.mm, base.predicted(p1), next.predicted(p2)]
}

/// A cabin's own distance, and the shift of the predictions that refer to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Major {
    mm: i32,
    scale: usize,
}

impl Major {
    /// From the low twelve bits of a cabin, without a branch: values come in no order that a
    /// processor could guess.
    #[inline]
    #[expect(clippy::cast_possible_wrap, reason = "twelve bits")]
    const fn of(cabin: u32) -> Self {
        /// First value of each coarser scale.
        const FIRST: [u32; 4] = [512, 1280, 1792, 3328];
        /// Distance of value 0 if its scale went on downwards, mm.
        const ZERO_MM: [i32; 5] = [0, -512, -3072, -10_240, -36_864];
        let value = cabin & 0xFFF;
        let scale = (value >= FIRST[0]) as usize
            + (value >= FIRST[1]) as usize
            + (value >= FIRST[2]) as usize
            + (value >= FIRST[3]) as usize;
        Self { mm: ((value as i32) << scale) + ZERO_MM[scale], scale }
    }

    /// The distance of a prediction, mm; 0 for "no return".
    #[inline]
    const fn predicted(self, p: i32) -> i32 {
        if p == NO_RETURN[0] || p == NO_RETURN[1] { 0 } else { (p << self.scale) + self.mm }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_quotients_are_the_whole_ones() {
        for dist_q2 in NEAREST_Q2..200_000 {
            let expected = (QUOTIENT / dist_q2).unsigned_abs() as usize;
            assert_eq!(quotient(dist_q2), expected, "{dist_q2}");
        }
    }

    /// The protocol's five branches, as the vendor writes them.
    #[test]
    fn every_value_is_decoded_as_by_the_protocol() {
        for value in 0..4096_i32 {
            let (mm, scale) = match value {
                3328.. => (16_384 + ((value - 3328) << 4), 4),
                1792.. => (4096 + ((value - 1792) << 3), 3),
                1280.. => (2048 + ((value - 1280) << 2), 2),
                512.. => (512 + ((value - 512) << 1), 1),
                _ => (value, 0),
            };
            let with_predictions = 0xABCD_E000 | value.unsigned_abs();
            assert_eq!(Major::of(with_predictions), Major { mm, scale }, "{value}");
        }
    }

    #[test]
    fn no_cabin_makes_it_panic_and_no_return_is_zero() {
        let invalid = (0x200 << 12) | (0x1FF << 22) | 700;
        let distances =
            |cabin, following| distances_mm(cabin, Major::of(cabin), Major::of(following));
        assert_eq!(distances(invalid, 0), [512 + 188 * 2, 0, 0]);
        for cabin in [0, u32::MAX, 0x8000_0000, 0xFFF] {
            for dist_mm in distances(cabin, u32::MAX) {
                for raw_q16 in [0, TURN_Q16 - 1, TURN_Q16 + (1 << 20)] {
                    assert!((0..TURN_Q16).contains(&node(dist_mm, raw_q16, false).angle_q16));
                }
            }
        }
    }
}
