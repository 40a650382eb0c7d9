//! Samples packed into nodes, capsules and packets.

use super::super::whole;

/// A format of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Nodes of five bytes.
    Standard,
    /// Legacy express capsules.
    Legacy,
    /// HQ packets.
    Hq,
    /// Ultra capsules.
    Ultra,
    /// Dense capsules.
    Dense,
    /// Ultra-dense capsules.
    UltraDense,
}

/// One sample before it is packed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Shot {
    /// Angle at which it was measured, clockwise, °.
    pub(super) angle_deg: f64,
    /// mm; 0 without a return.
    pub(super) dist_mm: f64,
    pub(super) intensity: u8,
    pub(super) starts_turn: bool,
}

impl Format {
    /// The type byte of the reply.
    pub(super) const fn kind(self) -> u8 {
        match self {
            Self::Standard => 0x81,
            Self::Legacy => 0x82,
            Self::Hq => 0x83,
            Self::Ultra => 0x84,
            Self::Dense => 0x85,
            Self::UltraDense => 0x86,
        }
    }

    /// Bytes of one frame.
    pub(super) const fn bytes(self) -> u32 {
        match self {
            Self::Standard => 5,
            Self::Legacy | Self::Dense => 84,
            Self::Hq => 781,
            Self::Ultra => 132,
            Self::UltraDense => 170,
        }
    }

    /// Samples of one frame.
    pub(super) const fn samples(self) -> u32 {
        match self {
            Self::Standard => 1,
            Self::Legacy => 32,
            Self::Hq | Self::Ultra => 96,
            Self::Dense => 40,
            Self::UltraDense => 64,
        }
    }

    /// What the receiver takes off the head's angle for a distance, °.
    ///
    /// Legacy capsules state it, in steps of 1/8°; for ultra capsules it is agreed between sensor
    /// and SDK: 7.5° without a return, else 8° − k − k³/6 rad with k = 64 · 98361/(d · 65536).
    pub(super) fn compensation_deg(self, dist_mm: f64) -> f64 {
        let near = dist_mm < 50.0;
        match self {
            Self::Ultra | Self::Legacy if near => 7.5,
            Self::Ultra => {
                let k = (98_361.0 / (4.0 * dist_mm)).floor();
                let k_rad = (64.0 * k + (k * k * k / 98_304.0).trunc()) / 65_536.0;
                8.0 - k_rad.to_degrees()
            }
            // As the optics of the ultra capsules, but never below 0: the field has no sign.
            Self::Legacy => {
                let offset_deg = 8.0 - (1.5 / dist_mm * 16.0).to_degrees();
                (offset_deg.clamp(0.0, 7.875) * 8.0).round() / 8.0
            }
            _ => 0.0,
        }
    }

    /// The bytes of one frame. `next` is the first sample of the next one.
    pub(super) fn pack(self, start_q6: u32, is_first: bool, shots: &[Shot], next: Shot) -> Vec<u8> {
        let start = u16::try_from(start_q6 % 23_040).unwrap_or(0) | u16::from(is_first) << 15;
        match self {
            Self::Standard => standard(shots[0]),
            Self::Hq => hq(shots),
            Self::Legacy => capsule(&[&start.to_le_bytes()[..], &legacy(shots)].concat()),
            Self::Ultra => capsule(&[&start.to_le_bytes()[..], &ultra(shots, next)].concat()),
            Self::Dense => {
                let words = shots.iter().flat_map(|shot| mm16(shot.dist_mm).to_le_bytes());
                capsule(&start.to_le_bytes().into_iter().chain(words).collect::<Vec<u8>>())
            }
            Self::UltraDense => {
                let head = [0_u8; 6];
                capsule(&[&head[..], &start.to_le_bytes(), &ultra_dense(shots)].concat())
            }
        }
    }
}

/// Sync nibbles and checksum before the content.
fn capsule(content: &[u8]) -> Vec<u8> {
    let sum = content.iter().fold(0, |xor, byte| xor ^ byte);
    let mut bytes = vec![0xA0 | (sum & 0x0F), 0x50 | (sum >> 4)];
    bytes.extend_from_slice(content);
    bytes
}

fn mm16(dist_mm: f64) -> u16 {
    u16::try_from(whole(dist_mm)).unwrap_or(u16::MAX)
}

fn standard(shot: Shot) -> Vec<u8> {
    let quality = shot.intensity & 0xFC;
    let head = if shot.starts_turn { quality | 1 } else { quality | 2 };
    let angle = u16::try_from(whole(shot.angle_deg * 64.0) % 23_040).unwrap_or(0) << 1 | 1;
    let quarters = mm16(shot.dist_mm * 4.0);
    [&[head][..], &angle.to_le_bytes(), &quarters.to_le_bytes()].concat()
}

fn legacy(shots: &[Shot]) -> Vec<u8> {
    let pack = |pair: &[Shot]| {
        let offset = |shot: &Shot| whole(8.0 * Format::Legacy.compensation_deg(shot.dist_mm));
        // Whole millimetres above the two upper bits of the offset.
        let word = |shot: &Shot| {
            let word = whole(shot.dist_mm) << 2 | offset(shot) >> 4;
            u16::try_from(word).unwrap_or(0).to_le_bytes()
        };
        let low = |shot: &Shot| u8::try_from(offset(shot) & 0xF).unwrap_or(0);
        let ([a, b], [c, d]) = (word(&pair[0]), word(&pair[1]));
        [a, b, c, d, low(&pair[0]) | low(&pair[1]) << 4]
    };
    shots.chunks_exact(2).flat_map(pack).collect()
}

/// Ranges of the major value: first value, first millimetre, shift.
const MAJORS: [(u32, u32, u32); 5] =
    [(3328, 16_384, 4), (1792, 4096, 3), (1280, 2048, 2), (512, 512, 1), (0, 0, 0)];

/// The major value nearest to a distance, the millimetres that it stands for, and its shift.
///
/// The nearest and not the next lower one: the SDK adds nothing to what it reads, so a sensor that
/// rounded down would measure short by half a step, 4 mm at 8 m, and its maker would have seen that.
fn major(dist_mm: f64) -> (u32, u32, u32) {
    let ranges = MAJORS.into_iter();
    let of_distance = |(_, first_mm, _): &(u32, u32, u32)| dist_mm >= f64::from(*first_mm);
    let (first, first_mm, shift) = ranges.clone().find(of_distance).unwrap_or((0, 0, 0));
    let steps = whole((dist_mm - f64::from(first_mm)) / f64::from(1 << shift));
    let value = (first + steps).min(4095);
    // The last value of a range plus a step is the first of the next, with the shift of that.
    let of_value = |(first, _, _): &(u32, u32, u32)| value >= *first;
    let (first, first_mm, shift) = ranges.clone().find(of_value).unwrap_or((0, 0, 0));
    (value, first_mm + ((value - first) << shift), shift)
}

fn ultra(shots: &[Shot], next: Shot) -> Vec<u8> {
    let pack = |cabin_idx: usize| {
        let cabin = &shots[3 * cabin_idx..3 * cabin_idx + 3];
        let following = shots.get(3 * cabin_idx + 3).copied().unwrap_or(next);
        let (own, own_mm, own_shift) = major(cabin[0].dist_mm);
        let (_, next_mm, next_shift) = major(following.dist_mm);
        let (base_mm, base_shift) =
            if own == 0 && next_mm != 0 { (next_mm, next_shift) } else { (own_mm, own_shift) };
        let p1 = prediction(cabin[1].dist_mm, base_mm, base_shift);
        let p2 = prediction(cabin[2].dist_mm, next_mm, next_shift);
        (own | (p1 & 0x3FF) << 12 | (p2 & 0x3FF) << 22).to_le_bytes()
    };
    (0..32).flat_map(pack).collect()
}

/// The difference to a base in ten bits; −512 stands for "no return".
#[expect(clippy::cast_possible_truncation, reason = "compared with the field's range before")]
#[expect(clippy::cast_sign_loss, reason = "two's complement is what the field holds")]
fn prediction(dist_mm: f64, base_mm: u32, shift: u32) -> u32 {
    let steps = ((dist_mm - f64::from(base_mm)) / f64::from(1 << shift)).round();
    let fits = dist_mm > 0.0 && (-511.0..=510.0).contains(&steps);
    (if fits { steps as i32 } else { -512 }) as u32
}

fn ultra_dense(shots: &[Shot]) -> Vec<u8> {
    let word = |shot: &Shot| {
        let (mm, quality) = (shot.dist_mm, u32::from(shot.intensity));
        // The nearest step; where it would be the first of the next range, that range says it.
        let steps = |first_mm: f64, step_mm: f64| whole((mm - first_mm) / step_mm);
        match mm {
            ..2045.0 => steps(0.0, 2.0) << 2 | quality << 12,
            ..8185.5 => steps(2046.0, 3.0) << 2 | 1 | (quality >> 1) << 13,
            ..24_565.0 => steps(8187.0, 4.0) << 2 | 2 | (quality >> 2) << 14,
            _ => steps(24_567.0, 5.0).min(0x1FFF) << 2 | 3 | (quality >> 3) << 15,
        }
    };
    let pack = |pair: &[Shot]| {
        let ([a, b, a_high, _], [c, d, c_high, _]) =
            (word(&pair[0]).to_le_bytes(), word(&pair[1]).to_le_bytes());
        [a, b, c, d, (a_high & 0xF) | c_high << 4]
    };
    shots.chunks_exact(2).flat_map(pack).collect()
}

fn hq(shots: &[Shot]) -> Vec<u8> {
    let mut bytes = vec![0xA5];
    bytes.extend([0; 8]);
    for shot in shots {
        let angle = u16::try_from(whole(shot.angle_deg / 90.0 * 16_384.0) % 65_536).unwrap_or(0);
        bytes.extend(angle.to_le_bytes());
        bytes.extend(whole(shot.dist_mm * 4.0).to_le_bytes());
        bytes.extend([shot.intensity, u8::from(shot.starts_turn)]);
    }
    let padded = [&bytes[..], &[0; 3]].concat();
    bytes.extend(crc32(&padded).to_le_bytes());
    bytes
}

/// CRC-32, bit by bit: slow, and plainly the definition.
fn crc32(bytes: &[u8]) -> u32 {
    let rest = bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            if crc & 1 == 0 { crc >> 1 } else { (crc >> 1) ^ 0xEDB8_8320 }
        })
    });
    !rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_of_the_crc() {
        // The catalogue of CRCs: CRC-32 of "123456789".
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn majors_stand_for_their_distances() {
        let mut sum_mm = 0.0;
        for quarter_mm in 0..4 * 28_000 {
            let mm = 0.25 * f64::from(quarter_mm);
            let (value, told_mm, shift) = major(mm);
            assert!(value <= 4095);
            let off_mm = f64::from(told_mm) - mm;
            assert!(off_mm.abs() <= 0.5 * f64::from(1 << shift), "{mm}");
            sum_mm += off_mm;
        }
        // Rounded to the nearest of steps up to 16 mm, nothing is left on average.
        assert!((sum_mm / f64::from(4 * 28_000)).abs() < 0.2, "{sum_mm}");
    }
}
