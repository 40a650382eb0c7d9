//! One packet, taken apart.

use super::geometry::{Distance, Geometry};
use crate::lidar::Sample;

/// Bytes before the samples.
pub(super) const HEAD_BYTES: usize = 10;
/// No packet has more samples.
pub(super) const MOST_SAMPLES: u8 = 80;
/// A full turn, 1/64°.
const TURN_Q6: u16 = 360 << 6;

/// What a sample is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleFormat {
    /// Distance u16.
    Distance,
    /// Intensity u8 and distance u16 with two flag bits.
    IntensityAndDistance,
}

impl SampleFormat {
    /// Bytes of one sample.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Distance => 2,
            Self::IntensityAndDistance => 3,
        }
    }

    /// The other one.
    pub(super) const fn other(self) -> Self {
        match self {
            Self::Distance => Self::IntensityAndDistance,
            Self::IntensityAndDistance => Self::Distance,
        }
    }
}

/// The head of a packet with possible numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    pub(super) n_samples: u8,
    first_q6: u16,
    last_q6: u16,
    /// XOR of all words but the samples', the told one included: with the samples' it must be 0.
    xor: u16,
}

impl Head {
    /// Reads the head; `None` if it cannot begin a packet.
    pub(super) fn from_bytes(bytes: &[u8; HEAD_BYTES]) -> Option<Self> {
        let [_, _, flags, n_samples, f0, f1, l0, l1, c0, c1] = *bytes;
        let (first, last) = (u16::from_le_bytes([f0, f1]), u16::from_le_bytes([l0, l1]));
        let (first_q6, last_q6) = (first >> 1, last >> 1);
        let has_check_bits = first & last & 1 == 1;
        let is_possible = bytes.starts_with(&[0xAA, 0x55])
            && (1..=MOST_SAMPLES).contains(&n_samples)
            && has_check_bits
            && first_q6 < TURN_Q6
            && last_q6 < TURN_Q6;
        let xor = 0x55AA
            ^ first
            ^ last
            ^ u16::from_le_bytes([flags, n_samples])
            ^ u16::from_le_bytes([c0, c1]);
        is_possible.then_some(Self { n_samples, first_q6, last_q6, xor })
    }

    /// Bytes of the packet with samples of this format.
    pub(super) const fn packet_bytes(&self, format: SampleFormat) -> usize {
        HEAD_BYTES + self.n_samples as usize * format.bytes()
    }

    /// True if the checksum is right for these samples.
    pub(super) fn has_good_checksum(&self, samples: &[u8], format: SampleFormat) -> bool {
        let xor = match format {
            SampleFormat::Distance => xor_of_words(samples),
            SampleFormat::IntensityAndDistance => samples
                .as_chunks::<3>()
                .0
                .iter()
                .fold(0, |xor, s| xor ^ u16::from(s[0]) ^ u16::from_le_bytes([s[1], s[2]])),
        };
        xor == self.xor
    }

    /// Angle of the head at the first sample, °.
    pub(super) fn start_deg(&self) -> f64 {
        f64::from(self.first_q6) / 64.0
    }

    /// The samples, appended to `samples`.
    pub(super) fn decode(
        &self,
        bytes: &[u8],
        format: SampleFormat,
        geometry: Geometry,
        samples: &mut Vec<Sample>,
    ) {
        let turn = i32::from(TURN_Q6);
        let span_q6 = (i32::from(self.last_q6) - i32::from(self.first_q6)).rem_euclid(turn);
        let n_steps = f64::from(self.n_samples.max(2) - 1);
        let step_deg = f64::from(span_q6) / 64.0 / n_steps;
        let mut head_deg = self.start_deg();
        let mut next = |distance, intensity| {
            let sample = geometry.sample(head_deg, distance, intensity);
            head_deg += step_deg;
            sample
        };
        match format {
            SampleFormat::Distance => samples.extend(
                bytes
                    .as_chunks::<2>()
                    .0
                    .iter()
                    .map(|s| next(Distance::Whole(u16::from_le_bytes(*s)), 0)),
            ),
            SampleFormat::IntensityAndDistance => {
                samples.extend(bytes.as_chunks::<3>().0.iter().map(|s| {
                    let word = u16::from_le_bytes([s[1], s[2]]) & 0xFFFC;
                    next(Distance::Flagged(word), s[0])
                }));
            }
        }
    }
}

/// XOR of little-endian words, four at a time.
fn xor_of_words(bytes: &[u8]) -> u16 {
    let (fours, rest) = bytes.as_chunks::<8>();
    let folded = fours.iter().fold(0, |xor, four| xor ^ u64::from_le_bytes(*four));
    let words = [folded, folded >> 16, folded >> 32, folded >> 48];
    let low = |word: u64| (word & 0xFFFF) as u16;
    let folded = words.into_iter().fold(0, |xor, word| xor ^ low(word));
    rest.as_chunks::<2>().0.iter().fold(folded, |xor, word| xor ^ u16::from_le_bytes(*word))
}
