//! Beams of the 2D LiDAR.

use crate::time::{Mono, Stamp};
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

impl Scan {
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
