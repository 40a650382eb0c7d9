//! What the four kinds of capsules share: sync nibbles, checksum, start angle, interpolation.
//!
//! ```text
//! byte 0  A0 | low nibble of the checksum      byte 1  50 | high nibble
//! start u16: bits 14..0 angle in 1/64°, bit 15: first capsule after a start
//! ```

use super::node::TURN_Q16;

/// A full turn in the start angle's unit, 1/64°.
pub(super) const TURN_Q6: u16 = 360 << 6;

/// True if the bytes can begin a capsule; one byte is judged alone.
pub(super) fn has_sync(bytes: &[u8]) -> bool {
    let at = |i: usize, high_nibble: u8| bytes.get(i).is_none_or(|b| b & 0xF0 == high_nibble);
    at(0, 0xA0) && at(1, 0x50)
}

/// True if the XOR of all bytes after the second is the one in the sync bytes.
pub(super) fn has_good_checksum(capsule: &[u8]) -> bool {
    let told = (capsule[0] & 0x0F) | (capsule[1] << 4);
    xor(&capsule[2..]) == told
}

/// XOR of all bytes, eight at a time.
fn xor(bytes: &[u8]) -> u8 {
    let (eights, rest) = bytes.as_chunks::<8>();
    let folded = eights.iter().fold(0_u64, |sum, eight| sum ^ u64::from_ne_bytes(*eight));
    let folded = folded.to_ne_bytes().iter().fold(0, |sum, byte| sum ^ byte);
    rest.iter().fold(folded, |sum, byte| sum ^ byte)
}

/// Angle from one start to the next, 2⁻⁸ °, forward.
pub(super) fn advance_q8(start_q6: u16, next_q6: u16) -> i32 {
    let forward = (i32::from(next_q6) << 2) - (i32::from(start_q6) << 2);
    if start_q6 > next_q6 { forward + (360 << 8) } else { forward }
}

/// Raw angles of the samples of one capsule, before any compensation.
#[derive(Debug, Clone, Copy)]
pub(super) struct RawAngle {
    /// Of the next sample, 2⁻¹⁶ °; may pass a full turn.
    pub(super) at_q16: i32,
    /// Step, 2⁻¹⁶ °.
    pub(super) step_q16: i32,
}

impl RawAngle {
    #[inline]
    pub(super) fn new(start_q6: u16, step_q16: i32) -> Self {
        Self { at_q16: i32::from(start_q6) << 10, step_q16 }
    }

    /// True if the head passes its front mark within `n_steps` steps from here.
    #[inline]
    pub(super) const fn passes_mark(&self, n_steps: i32) -> bool {
        let ahead_q16 = n_steps * self.step_q16;
        // Within a capsule the head goes on by less than a turn from a start within the turn.
        let beyond_q16 = self.at_q16 + ahead_q16 - TURN_Q16;
        (0 <= beyond_q16 && beyond_q16 < ahead_q16) || beyond_q16 >= TURN_Q16
    }

    /// True if the head reaches the end of the turn within `n_samples` steps: no other can pass the mark.
    #[expect(
        clippy::cast_possible_wrap,
        clippy::cast_possible_truncation,
        reason = "a capsule has 96"
    )]
    pub(super) const fn ends_beyond_turn(&self, n_samples: usize) -> bool {
        self.at_q16 + n_samples as i32 * self.step_q16 >= TURN_Q16
    }

    #[inline]
    pub(super) const fn advance(&mut self) {
        self.at_q16 += self.step_q16;
    }
}
