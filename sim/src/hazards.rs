//! What can be between the LiDAR and the material: dust, wide beams, lost echoes, a machine, gaps in
//! the hall.
//!
//! All of it is off unless asked for, and drawn from streams of its own, so that a run with a hazard
//! has the same world, flight and noise as the run without.

use crate::lidar::{Fading, LidarModel};
use clap::Args;

/// Half the angle over which a low-priced sensor's beam spreads: 2 × 4 mrad, 6 cm at 7 m.
const HALF_WIDTH_RAD: f64 = 0.004;

/// The hazards of a run.
#[expect(clippy::struct_excessive_bools, reason = "switches of the command line, each by itself")]
#[derive(Debug, Clone, Copy, PartialEq, Default, Args)]
pub struct Hazards {
    /// Share of beams that dust sends back from anywhere before the surface, such as 0.01.
    #[arg(long = "dust", value_name = "SHARE", default_value_t = 0.0)]
    pub dust_ratio: f64,
    /// Beams are 8 mrad wide: where they straddle an edge, the range lies between both surfaces.
    #[arg(long = "mixed-pixels")]
    pub mixes_pixels: bool,
    /// Echoes get lost little by little, with the distance and where beams graze: half of them at the
    /// farthest range, square on.
    #[arg(long = "fading")]
    pub fades: bool,
    /// The same, and a quarter of the ground is dark: it is seen from half the distance.
    #[arg(long = "dark-patches")]
    pub has_dark_patches: bool,
    /// A wheel loader drives to and fro through the region during the flight; it is no material.
    #[arg(long = "machine")]
    pub has_machine: bool,
    /// The hall has a gate in a wall and a skylight; beams through them see the ground outside,
    /// 1.5 m below the floor, or nothing.
    #[arg(long = "gap")]
    pub has_gaps: bool,
}

impl Hazards {
    /// The sensor with these hazards in its beams.
    #[must_use]
    pub fn applied_to(&self, lidar: &LidarModel) -> LidarModel {
        let half_width_rad = if self.mixes_pixels { HALF_WIDTH_RAD } else { lidar.half_width_rad };
        let fading = match (self.has_dark_patches, self.fades) {
            (true, _) => Fading::DarkPatches,
            (false, true) => Fading::White,
            (false, false) => lidar.fading,
        };
        LidarModel { dust_ratio: self.dust_ratio, half_width_rad, fading, ..lidar.clone() }
    }
}
