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

/// Bytes of a capsule.
pub(super) const BYTES: usize = 132;
/// Samples of a capsule.
pub(super) const SAMPLES: usize = 96;
const CABINS: usize = 32;
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
    let (cabins, _) = capsule[4..BYTES].as_chunks::<4>();
    let first_of_next = [next[4], next[5], next[6], next[7]];
    for cabin_idx in 0..CABINS {
        let cabin = u32::from_le_bytes(cabins[cabin_idx]);
        let following = cabins.get(cabin_idx + 1).unwrap_or(&first_of_next);
        let following = u32::from_le_bytes(*following);
        for dist_mm in distances_mm(cabin, following) {
            nodes.push(node(dist_mm, &raw));
            raw.advance();
        }
    }
}

fn node(dist_mm: i32, raw: &RawAngle) -> Node {
    let dist_q2 = dist_mm.max(0) << 2;
    let offset_q16 =
        if dist_q2 >= NEAREST_Q2 { OFFSET_Q16[quotient(dist_q2)] } else { NEAR_OFFSET_Q16 };
    Node::untold(raw.at_q16 - offset_q16, dist_q2.unsigned_abs(), raw.passes_mark(1))
}

/// Whole quotient 98361/d. Floats divide faster; they are exact here, because no quotient lies
/// nearer to a whole number from below than 1/d.
#[expect(clippy::cast_possible_truncation, reason = "0 to 491")]
#[expect(clippy::cast_sign_loss, reason = "0 to 491")]
fn quotient(dist_q2: i32) -> usize {
    ((f64::from(QUOTIENT) / f64::from(dist_q2)) as usize).min(OFFSETS - 1)
}

/// The three distances of a cabin, mm; negative ones are nonsense and become "no return".
#[expect(clippy::cast_possible_wrap, reason = "the fields are signed from here on")]
fn distances_mm(cabin: u32, following: u32) -> [i32; 3] {
    let (major_mm, major_scale) = decoded(cabin & 0xFFF);
    let (next_mm, next_scale) = decoded(following & 0xFFF);
    let (base_mm, scale) =
        if major_mm == 0 && next_mm != 0 { (next_mm, next_scale) } else { (major_mm, major_scale) };
    // Arithmetic shifts keep the sign.
    let (p1, p2) = (((cabin << 10) as i32) >> 22, (cabin as i32) >> 22);
    let predicted = |p: i32, base_mm: i32, scale: u32| {
        if NO_RETURN.contains(&p) { 0 } else { (p << scale) + base_mm }
    };
    [major_mm, predicted(p1, base_mm, scale), predicted(p2, next_mm, next_scale)]
}

/// A major value in mm, and the shift of the predictions that refer to it.
#[expect(clippy::cast_possible_wrap, reason = "twelve bits")]
const fn decoded(major: u32) -> (i32, u32) {
    let (mm, scale) = match major {
        3328.. => (16_384 + ((major - 3328) << 4), 4),
        1792.. => (4096 + ((major - 1792) << 3), 3),
        1280.. => (2048 + ((major - 1280) << 2), 2),
        512.. => (512 + ((major - 512) << 1), 1),
        _ => (major, 0),
    };
    (mm as i32, scale)
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

    #[test]
    fn scales_meet_at_their_borders() {
        // The last value of each range plus its step is the first of the next.
        for (border, step_mm) in [(512, 1), (1280, 2), (1792, 4), (3328, 8)] {
            assert_eq!(decoded(border).0, decoded(border - 1).0 + step_mm, "{border}");
        }
        assert_eq!(decoded(4095), (16_384 + 767 * 16, 4));
    }

    #[test]
    fn no_cabin_makes_it_panic_and_no_return_is_zero() {
        let invalid = (0x200 << 12) | (0x1FF << 22) | 700;
        assert_eq!(distances_mm(invalid, 0), [512 + 188 * 2, 0, 0]);
        for cabin in [0, u32::MAX, 0x8000_0000, 0xFFF] {
            for d in distances_mm(cabin, u32::MAX) {
                let raw = RawAngle::new(23_039, 1 << 20);
                assert!((0..360 << 16).contains(&node(d, &raw).angle_q16));
            }
        }
    }
}
