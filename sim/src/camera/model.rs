//! What a camera and its marker detector are like.

use super::{Lens, PictureModel};
use nalgebra::Matrix3;
use std::time::Duration;
use stockpilot::geometry::{Body, Camera, Point, Rotation, Transform};
use stockpilot::messages::CameraId;

/// A camera on the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraModel {
    /// Its number in the configuration.
    pub id: CameraId,
    /// Intrinsics.
    pub lens: Lens,
    /// True mounting on the body.
    pub body_from_camera: Transform<Body, Camera>,
    /// How it takes pictures, if it hands over those instead of markers.
    pub pictures: Option<PictureModel>,
    /// What the detector makes of its pictures.
    pub detector: DetectorModel,
}

/// Rate, limits, noise and faults of a marker detector.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorModel {
    /// Frames per second.
    pub frames_per_s: f64,
    /// Markers whose mean edge is shorter are not found, px.
    pub edge_min_px: f64,
    /// All corners lie at least this far inside the picture, px.
    pub margin_px: f64,
    /// Markers turned farther from the line of sight are not found, rad.
    pub incidence_max_rad: f64,
    /// Standard deviation of each coordinate of each corner, px.
    pub pixel_sigma_px: f64,
    /// Share of visible markers that are missed.
    pub missed_ratio: f64,
    /// Share of markers with one corner far off.
    pub outlier_ratio: f64,
    /// Shortest and longest time from exposure to arrival.
    pub latency: (Duration, Duration),
}

impl CameraModel {
    /// Looks ahead and 10° down, 90° across.
    #[must_use]
    pub fn ahead() -> Self {
        Self {
            id: CameraId(0),
            lens: Lens::wide(),
            body_from_camera: mounted(0.0, 10_f64.to_radians(), 0.0, Point::new(0.10, 0.0, 0.03)),
            pictures: None,
            detector: DetectorModel::usual(),
        }
    }
}

impl DetectorModel {
    /// An AprilTag detector on a small computer: 20 Hz, 30 to 150 ms late.
    #[must_use]
    pub fn usual() -> Self {
        Self {
            frames_per_s: 20.0,
            edge_min_px: 14.0,
            margin_px: 3.0,
            incidence_max_rad: 75_f64.to_radians(),
            pixel_sigma_px: 0.3,
            missed_ratio: 0.02,
            outlier_ratio: 0.002,
            latency: (Duration::from_millis(30), Duration::from_millis(150)),
        }
    }
}

/// The mounting of a camera that looks along body forward, turned by these angles (rad).
///
/// Positive pitch looks down, positive yaw to the left, as [`Rotation::from_euler_rad`] has it.
#[must_use]
pub fn mounted(
    roll_rad: f64,
    pitch_rad: f64,
    yaw_rad: f64,
    origin: Point<Body>,
) -> Transform<Body, Camera> {
    // Columns: right is −y of the body, down is −z, the optical axis is +x.
    let looking_ahead = Rotation::<Body, Camera>::from_matrix(&Matrix3::new(
        0.0, 0.0, 1.0, //
        -1.0, 0.0, 0.0, //
        0.0, -1.0, 0.0,
    ));
    let turn = Rotation::<Body, Body>::from_euler_rad(roll_rad, pitch_rad, yaw_rad);
    Transform::new(turn * looking_ahead, origin)
}
