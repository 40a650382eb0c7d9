//! Beams of the 2D LiDAR.

use crate::time::{Mono, Stamp};
use crate::units::wrapped_rad;
use std::time::Duration;

/// One range measurement.
///
/// Single precision holds 0.1 µrad and 1 µm at 16 m, far below the sensors' steps, and halves
/// the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// When it was measured, after [`Scan::start`], ns.
    pub offset_ns: u32,
    /// Direction in the scan plane, from x of `Lidar` towards y, rad.
    pub angle_rad: f32,
    /// Distance, m; 0 where nothing came back.
    pub range_m: f32,
    /// Strength of the return, in the sensor's own scale.
    pub intensity: u8,
}

/// Beams in the order of measurement: one turn of the head, or the part of it that was received.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// When the first beam was measured.
    pub start: Stamp<Mono>,
    /// The beams; `offset_ns` does not decrease.
    pub beams: Vec<Beam>,
}

/// What is wrong with every beam of a LiDAR, and known: calibrated, and taken off before anything else.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScanCorrection {
    /// Ranges come out longer by this, m …
    pub range_bias_m: f64,
    /// … and by this times the distance.
    pub range_scale: f64,
    /// Stamps come out later by this, s.
    pub clock_offset_s: f64,
}

impl Scan {
    /// The scan as it would have come from a LiDAR without these errors. A beam without a return stays one.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "as precise as before")]
    pub fn corrected(mut self, known: &ScanCorrection) -> Self {
        if *known == ScanCorrection::default() {
            return self;
        }
        let by_ns = (known.clock_offset_s * 1e9).round() as i64;
        self.start = Stamp::from_nanos(self.start.nanos().saturating_sub(by_ns));
        for beam in self.beams.iter_mut().filter(|beam| beam.range_m > 0.0) {
            let true_m = (f64::from(beam.range_m) - known.range_bias_m) / (1.0 + known.range_scale);
            beam.range_m = true_m.max(0.0) as f32;
        }
        self
    }

    /// True if the beams point in several directions: the head turns.
    #[must_use]
    pub fn is_turning(&self) -> bool {
        /// A head that stands trembles by less, rad.
        const LEAST_TURN_RAD: f64 = 0.02;
        let Some(first) = self.beams.first() else { return false };
        self.beams.iter().any(|beam| {
            let turned_rad = wrapped_rad(f64::from(beam.angle_rad) - f64::from(first.angle_rad));
            turned_rad.abs() > LEAST_TURN_RAD
        })
    }

    /// When a beam of this scan was measured.
    #[must_use]
    pub fn beam_at(&self, beam: &Beam) -> Stamp<Mono> {
        self.start.plus(Duration::from_nanos(u64::from(beam.offset_ns)))
    }

    /// When the last beam was measured; the start for an empty scan.
    #[must_use]
    pub fn end(&self) -> Stamp<Mono> {
        self.beams.last().map_or(self.start, |beam| self.beam_at(beam))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_errors_are_taken_off() {
        let beam = |range_m| Beam { offset_ns: 500, angle_rad: 0.1, range_m, intensity: 9 };
        // 4 m seen by a LiDAR that adds 20 mm and 1 %, 3 ms late.
        let seen = Scan { start: Stamp::from_nanos(8_000_000), beams: vec![beam(4.06), beam(0.0)] };
        let known = ScanCorrection { range_bias_m: 0.02, range_scale: 0.01, clock_offset_s: 0.003 };
        let put_right = seen.clone().corrected(&known);
        assert_eq!(put_right.start, Stamp::from_nanos(5_000_000));
        assert!((put_right.beams[0].range_m - 4.0).abs() < 1e-6);
        assert_eq!(put_right.beams[1], beam(0.0));
        assert_eq!(seen.clone().corrected(&ScanCorrection::default()), seen);
    }
}
