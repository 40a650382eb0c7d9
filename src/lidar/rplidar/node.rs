//! One sample in the vendor's own units.

use crate::lidar::Sample;

/// A full turn in units of 2⁻¹⁶ °.
pub(super) const TURN_Q16: i32 = 360 << 16;
/// Strength that stands for "there is a return" in the formats that tell none, as in the SDK.
pub(super) const UNTOLD_QUALITY: u8 = 0x2F << 2;

/// One sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Node {
    /// Clockwise angle, 2⁻¹⁶ °, in [0, 360°).
    pub angle_q16: i32,
    /// Distance, ¼ mm; 0 where nothing came back.
    pub dist_q2: u32,
    /// Strength of the return in the sensor's scale; 188 or 0 in the formats that tell none.
    pub quality: u8,
    /// The head passed its front mark with this sample.
    pub starts_turn: bool,
}

impl Node {
    /// A node of a format that tells no strength, with any angle.
    #[inline]
    pub(super) const fn untold(angle_q16: i32, dist_q2: u32, starts_turn: bool) -> Self {
        let quality = if dist_q2 == 0 { 0 } else { UNTOLD_QUALITY };
        Self { angle_q16: wrapped(angle_q16), dist_q2, quality, starts_turn }
    }

    /// The angle as the SDK gives it: units of 90°/2¹⁴, by way of 1/64°.
    #[must_use]
    pub const fn angle_z_q14(&self) -> u32 {
        ((self.angle_q16 >> 10).unsigned_abs() << 8) / 90
    }

    /// The sample in degrees and metres.
    #[inline]
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "2⁻¹⁶ ° and ¼ mm fit single precision")]
    pub fn sample(&self) -> Sample {
        Sample {
            clockwise_deg: self.angle_q16 as f32 * (1.0 / 65_536.0),
            range_m: self.dist_q2 as f32 * 0.000_25,
            intensity: self.quality,
        }
    }
}

/// The angle once wrapped into [0, 360°); it is never more than a turn outside.
#[inline]
const fn wrapped(angle_q16: i32) -> i32 {
    if angle_q16 < 0 {
        angle_q16 + TURN_Q16
    } else if angle_q16 >= TURN_Q16 {
        angle_q16 - TURN_Q16
    } else {
        angle_q16
    }
}
