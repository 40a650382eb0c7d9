//! What a LiDAR is like.

use super::{Fading, Firmware};
use stockpilot::geometry::{Body, Lidar, Point, Rotation, Transform};

/// The numbers of one sensor and where it is mounted.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarModel {
    /// What the maker calls it.
    pub name: &'static str,
    /// What runs in it.
    pub firmware: Firmware,
    /// Range samples per second.
    pub samples_per_s: u32,
    /// Turns of the head per second.
    pub turns_per_s: f64,
    /// Standard deviation of the head's speed, as a ratio.
    pub speed_jitter_ratio: f64,
    /// Nearest range that is measured, m.
    pub range_min_m: f64,
    /// Farthest range that is measured, m.
    pub range_max_m: f64,
    /// Standard deviation of a range, m.
    pub range_sigma_m: f64,
    /// Standard deviation of a beam's direction in the scan plane about the one that is reported, rad.
    pub angle_sigma_rad: f64,
    /// Every range is reported longer by this, m.
    pub range_bias_m: f64,
    /// Every range is reported longer by this times itself.
    pub range_scale: f64,
    /// Samples are stamped later than they were measured by this, s.
    pub stamp_offset_s: f64,
    /// Share of samples without a return even near and square on.
    pub dropout_ratio: f64,
    /// How echoes get lost beside that.
    pub fading: Fading,
    /// Share of beams that dust in the air sends back before they reach a surface.
    pub dust_ratio: f64,
    /// Half the angle of the beam's cone in the scan plane, rad; where the cone meets two surfaces,
    /// the range lies between them. 0 for a beam without width.
    pub half_width_rad: f64,
    /// Speed of the serial line, bit/s.
    pub baud: u32,
    /// True mounting of the sensor on the body.
    pub body_from_lidar: Transform<Body, Lidar>,
}

/// Below the body, with the scan plane across the flight and x pointing down.
pub(crate) fn hanging_mount() -> Transform<Body, Lidar> {
    let pitched_down = Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0);
    Transform::new(pitched_down, Point::new(0.0, 0.0, -0.08))
}
