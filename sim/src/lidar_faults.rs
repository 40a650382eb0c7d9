//! What a LiDAR gets wrong while its line is sound.

use stockpilot::messages::Scan;

/// What a LiDAR may do wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LidarFault {
    /// No scan arrives.
    Silent,
    /// Nothing comes back: dust, or something before the window.
    Covered,
    /// The head stands: the same direction over and over.
    Stands,
}

impl LidarFault {
    /// What becomes of a scan.
    pub(crate) fn spoilt(self, mut scan: Scan) -> Option<Scan> {
        let first = *scan.beams.first()?;
        for beam in &mut scan.beams {
            match self {
                Self::Silent => return None,
                Self::Covered => beam.range_m = 0.0,
                Self::Stands => {
                    (beam.angle_rad, beam.range_m) = (first.angle_rad, first.range_m);
                }
            }
        }
        Some(scan)
    }
}
