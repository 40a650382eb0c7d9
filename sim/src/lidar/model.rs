//! What a LiDAR is like.

use stockpilot::geometry::{Body, Lidar, Point, Rotation, Transform};

/// The numbers of one sensor and where it is mounted.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarModel {
    /// What the maker calls it.
    pub name: &'static str,
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
    /// Every range is reported longer by this, m.
    pub range_bias_m: f64,
    /// Every range is reported longer by this times itself.
    pub range_scale: f64,
    /// Samples are stamped later than they were measured by this, s.
    pub stamp_offset_s: f64,
    /// Share of samples without a return even near and square on.
    pub dropout_ratio: f64,
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

impl LidarModel {
    /// LDROBOT LD19: 4 500 samples/s to 12 m.
    ///
    /// Source: data sheet (range, standard deviation of 10 mm, 230 400 bit/s).
    #[must_use]
    pub fn ld19() -> Self {
        Self {
            name: "LD19",
            samples_per_s: 4_500,
            turns_per_s: 10.0,
            speed_jitter_ratio: 0.002,
            range_min_m: 0.02,
            range_max_m: 12.0,
            range_sigma_m: 0.010,
            range_bias_m: 0.0,
            range_scale: 0.0,
            stamp_offset_s: 0.0,
            dropout_ratio: 0.005,
            dust_ratio: 0.0,
            half_width_rad: 0.0,
            baud: 230_400,
            body_from_lidar: hanging_mount(),
        }
    }

    /// LDROBOT STL-27L: 21 600 samples/s to 25 m.
    ///
    /// Source: the maker's driver (rate, 921 600 bit/s) and data sheet (range).
    #[must_use]
    pub fn stl27l() -> Self {
        Self {
            name: "STL-27L",
            samples_per_s: 21_600,
            range_min_m: 0.03,
            range_max_m: 25.0,
            baud: 921_600,
            ..Self::ld19()
        }
    }
}

/// Below the body, with the scan plane across the flight and x pointing down.
fn hanging_mount() -> Transform<Body, Lidar> {
    let pitched_down = Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0);
    Transform::new(pitched_down, Point::new(0.0, 0.0, -0.08))
}
