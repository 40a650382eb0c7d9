//! The filter in the file.

use super::convert::{invalid, seconds, within};
use super::error::ConfigError;
use super::file::Config;
use crate::geometry::Point;
use crate::localization::filter::ImuNoise;
use crate::localization::{self, vision_fix};
use serde::{Deserialize, Serialize};

/// How a frame meets the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpdateName {
    /// As one pose.
    Loose,
    /// Corner by corner.
    Tight,
}

/// Where the vehicle stands before a flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PadSection {
    /// Origin of the body in the hall, m.
    pub position_m: [f64; 3],
    /// Yaw of the body in the hall, degrees.
    pub yaw_deg: f64,
    /// Standard deviation of each coordinate, m.
    pub position_sigma_m: f64,
    /// Standard deviation of the yaw, degrees.
    pub yaw_sigma_deg: f64,
}

/// The filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilterSection {
    /// How a frame meets the filter.
    pub update: UpdateName,
    /// Standard deviation of a detected corner, px.
    pub corner_sigma_px: f64,
    /// Standard deviation of a frame's capture time, s.
    pub capture_sigma_s: f64,
    /// A single fix less certain than this is not observable, m.
    pub max_fix_sigma_m: f64,
    /// Accelerometer noise with vibration, m/s²/√Hz.
    pub accel_density_mps2_rthz: f64,
    /// Gyroscope noise with vibration, rad/s/√Hz.
    pub gyro_density_radps_rthz: f64,
    /// Accelerometer bias walk, m/s²/√s.
    pub accel_walk_mps2_rts: f64,
    /// Gyroscope bias walk, rad/s/√s.
    pub gyro_walk_radps_rts: f64,
    /// Late frames are taken in this far back, s.
    pub ring_span_s: f64,
    /// Without a fix for this long the position counts as lost, s.
    pub lost_after_s: f64,
    /// A position less certain than this counts as lost, m.
    pub lost_sigma_m: f64,
    /// Where the vehicle stands before a flight, if it should know without a tag in view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pad: Option<PadSection>,
}

impl Default for FilterSection {
    fn default() -> Self {
        Self {
            update: UpdateName::Tight,
            corner_sigma_px: 0.4,
            capture_sigma_s: 0.002,
            max_fix_sigma_m: 0.5,
            accel_density_mps2_rthz: 0.01,
            gyro_density_radps_rthz: 5e-4,
            accel_walk_mps2_rts: 5e-4,
            gyro_walk_radps_rts: 2e-5,
            ring_span_s: 1.0,
            lost_after_s: 1.5,
            lost_sigma_m: 0.25,
            pad: None,
        }
    }
}

impl Config {
    pub(super) fn localization_settings(&self) -> Result<localization::Settings, ConfigError> {
        let f = &self.filter;
        if self.cameras.is_empty() {
            return Err(invalid("cameras", "there must be at least one camera"));
        }
        let cameras = self.cameras.iter().enumerate().map(|(k, c)| c.model(k));
        let density = |key, value| within(key, value, (1e-8, 10.0), "1/√Hz");
        Ok(localization::Settings {
            cameras: cameras.collect::<Result<_, _>>()?,
            marker_map: self.marker_map()?,
            vision: vision_fix::Settings {
                corner_sigma_px: within(
                    "filter.corner_sigma_px",
                    f.corner_sigma_px,
                    (0.01, 20.0),
                    "px",
                )?,
                max_position_sigma_m: within(
                    "filter.max_fix_sigma_m",
                    f.max_fix_sigma_m,
                    (0.01, 10.0),
                    "m",
                )?,
            },
            update: match f.update {
                UpdateName::Loose => localization::Update::Loose,
                UpdateName::Tight => localization::Update::Tight,
            },
            pad: f.pad.as_ref().map(pad_pose).transpose()?,
            capture_sigma_s: within("filter.capture_sigma_s", f.capture_sigma_s, (0.0, 0.1), "s")?,
            imu_noise: ImuNoise {
                accel_density_mps2_rthz: density(
                    "filter.accel_density_mps2_rthz",
                    f.accel_density_mps2_rthz,
                )?,
                gyro_density_radps_rthz: density(
                    "filter.gyro_density_radps_rthz",
                    f.gyro_density_radps_rthz,
                )?,
                accel_walk_mps2_rts: density("filter.accel_walk_mps2_rts", f.accel_walk_mps2_rts)?,
                gyro_walk_radps_rts: density("filter.gyro_walk_radps_rts", f.gyro_walk_radps_rts)?,
            },
            ring_span: seconds("filter.ring_span_s", f.ring_span_s, (0.3, 5.0))?,
            lost_after: seconds("filter.lost_after_s", f.lost_after_s, (0.2, 10.0))?,
            lost_sigma_m: within("filter.lost_sigma_m", f.lost_sigma_m, (0.02, 5.0), "m")?,
        })
    }
}

fn pad_pose(pad: &PadSection) -> Result<localization::PadPose, ConfigError> {
    let coordinate =
        |k: usize| within("filter.pad.position_m", pad.position_m[k], (-10_000.0, 10_000.0), "m");
    let sigma_deg = within("filter.pad.yaw_sigma_deg", pad.yaw_sigma_deg, (0.1, 30.0), "°")?;
    Ok(localization::PadPose {
        position: Point::new(coordinate(0)?, coordinate(1)?, coordinate(2)?),
        yaw_rad: within("filter.pad.yaw_deg", pad.yaw_deg, (-360.0, 360.0), "°")?.to_radians(),
        position_sigma_m: within(
            "filter.pad.position_sigma_m",
            pad.position_sigma_m,
            (0.005, 5.0),
            "m",
        )?,
        yaw_sigma_rad: sigma_deg.to_radians(),
    })
}
