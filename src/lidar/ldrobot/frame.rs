//! One frame, taken apart and put together.

use super::{CLOCK_WRAP_MS, FRAME_BYTES, FRAME_HEAD, FRAME_SAMPLES, TURN_CDEG, crc8};

/// One sample as transmitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sample {
    /// Distance, mm; 0 where nothing came back.
    pub range_mm: u16,
    /// Strength of the return.
    pub intensity: u8,
}

/// One frame with its numbers as transmitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Speed of the head, °/s; 3600 is 10 turns/s.
    pub speed_deg_per_s: u16,
    /// Angle of the first sample, 0.01°, clockwise from the front mark.
    pub start_cdeg: u16,
    /// The samples in the order of measurement.
    pub samples: [Sample; FRAME_SAMPLES],
    /// Angle of the last sample, 0.01°.
    pub end_cdeg: u16,
    /// Device time, ms, below [`CLOCK_WRAP_MS`].
    pub timestamp_ms: u16,
}

impl Frame {
    /// Reads a frame; `None` if head or CRC are wrong.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; FRAME_BYTES]) -> Option<Self> {
        let is_whole = bytes.starts_with(&FRAME_HEAD) && crc8(&bytes[..46]) == bytes[46];
        is_whole.then(|| {
            let u16_at = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
            Self {
                speed_deg_per_s: u16_at(2),
                start_cdeg: u16_at(4),
                samples: std::array::from_fn(|i| Sample {
                    range_mm: u16_at(6 + 3 * i),
                    intensity: bytes[8 + 3 * i],
                }),
                end_cdeg: u16_at(42),
                timestamp_ms: u16_at(44),
            }
        })
    }

    /// The frame as the sensor sends it.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; FRAME_BYTES] {
        let mut bytes = [0; FRAME_BYTES];
        bytes[..2].copy_from_slice(&FRAME_HEAD);
        bytes[2..4].copy_from_slice(&self.speed_deg_per_s.to_le_bytes());
        bytes[4..6].copy_from_slice(&self.start_cdeg.to_le_bytes());
        for (slot, sample) in bytes[6..42].chunks_exact_mut(3).zip(&self.samples) {
            slot[..2].copy_from_slice(&sample.range_mm.to_le_bytes());
            slot[2] = sample.intensity;
        }
        bytes[42..44].copy_from_slice(&self.end_cdeg.to_le_bytes());
        bytes[44..46].copy_from_slice(&self.timestamp_ms.to_le_bytes());
        bytes[46] = crc8(&bytes[..46]);
        bytes
    }

    /// True if angles and time keep to their ranges.
    ///
    /// One false head in 256 passes the CRC by chance; this refuses most of those.
    #[must_use]
    pub const fn is_plausible(&self) -> bool {
        self.start_cdeg <= TURN_CDEG
            && self.end_cdeg <= TURN_CDEG
            && self.timestamp_ms <= CLOCK_WRAP_MS
    }

    /// Angle from the first to the last sample, 0.01°, in [0, 360°).
    #[must_use]
    pub const fn span_cdeg(&self) -> u16 {
        let (start, end) = (self.start_cdeg % TURN_CDEG, self.end_cdeg % TURN_CDEG);
        if end >= start { end - start } else { TURN_CDEG - (start - end) }
    }

    /// Angle of one sample, °, clockwise from the front mark, in [0, 360).
    ///
    /// ```text
    /// αᵢ = start + i · ((end − start) mod 360°) / 11
    /// ```
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "there are twelve samples")]
    pub fn angle_deg(&self, sample_idx: usize) -> f64 {
        let step_cdeg = f64::from(self.span_cdeg()) / (FRAME_SAMPLES - 1) as f64;
        ((f64::from(self.start_cdeg) + sample_idx as f64 * step_cdeg) / 100.0).rem_euclid(360.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the maker's manual.
    const MANUAL: [u8; FRAME_BYTES] = [
        0x54, 0x2C, 0x68, 0x08, 0xAB, 0x7E, 0xE0, 0x00, 0xE4, 0xDC, 0x00, 0xE2, 0xD9, 0x00, 0xE5,
        0xD5, 0x00, 0xE3, 0xD3, 0x00, 0xE4, 0xD0, 0x00, 0xE9, 0xCD, 0x00, 0xE4, 0xCA, 0x00, 0xE2,
        0xC7, 0x00, 0xE9, 0xC5, 0x00, 0xE5, 0xC2, 0x00, 0xE5, 0xC0, 0x00, 0xE5, 0xBE, 0x82, 0x3A,
        0x1A, 0x50,
    ];

    #[test]
    fn reads_the_example_of_the_manual() {
        let frame = Frame::from_bytes(&MANUAL).unwrap();
        assert_eq!(frame.speed_deg_per_s, 2152);
        assert_eq!((frame.start_cdeg, frame.end_cdeg), (32_427, 33_470));
        assert_eq!(frame.timestamp_ms, 6714);
        assert_eq!(frame.samples[0], Sample { range_mm: 224, intensity: 228 });
        assert_eq!(frame.samples[11], Sample { range_mm: 192, intensity: 229 });
        assert_eq!(frame.to_bytes(), MANUAL);
    }

    #[test]
    fn any_flipped_bit_is_noticed() {
        for bit in 0..FRAME_BYTES * 8 {
            let mut damaged = MANUAL;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Frame::from_bytes(&damaged), None, "bit {bit}");
        }
    }

    #[test]
    fn angles_run_through_north() {
        let mut frame = Frame::from_bytes(&MANUAL).unwrap();
        (frame.start_cdeg, frame.end_cdeg) = (35_500, 600);
        // 11° in 11 steps: 355, 356, … 359, 0, … 6.
        assert!((frame.angle_deg(4) - 359.0).abs() < 1e-9);
        assert!((frame.angle_deg(6) - 1.0).abs() < 1e-9);
        assert!((frame.angle_deg(11) - 6.0).abs() < 1e-9);
    }
}
