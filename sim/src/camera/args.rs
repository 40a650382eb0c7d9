//! Options of the camera.

use super::{CameraModel, DetectorModel, PictureModel};
use clap::{Args, ValueEnum};
use std::time::Duration;

/// The camera's options that `fly` and `campaign` share.
#[derive(Debug, Clone, Default, Args)]
pub struct CameraArgs {
    /// From exposure to arrival of each camera frame, ms; 30 to 150, drawn, without it.
    #[arg(long, value_parser = clap::value_parser!(u64).range(0..1000))]
    pub camera_latency_ms: Option<u64>,
}

impl CameraArgs {
    /// Changes the camera as the options say.
    pub fn apply(&self, camera: &mut CameraModel) {
        if let Some(latency_ms) = self.camera_latency_ms {
            let latency = Duration::from_millis(latency_ms);
            camera.detector.latency = (latency, latency);
        }
    }
}

/// What the camera hands over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CameraOutput {
    /// Tags, as exact as a good detector finds them.
    Tags,
    /// Rendered pictures.
    Rendered,
}

/// How exact the service's own detector is told to find corners in rendered pictures, px.
///
/// Corners of tags from 20 px are off by 0.04 px, root mean square of a coordinate
/// (`corners_are_found_where_the_world_projects_them`). 0.02 px of that is new in every picture; 0.035 px comes again as
/// long as the view stands still, because it hangs on how edges lie between the pixels and on the cells beside them, and
/// a filter takes every picture for new. In whole flights at 2 m/s the squared error of the position was 3.3, 1.8 and
/// 1.3 times what the filter claimed when it was told 0.10, 0.18 and 0.25 px, and 1.7 times with 0.30 px over other ground.
const FOUND_SIGMA_PX: f64 = 0.30;

impl CameraOutput {
    /// Changes the camera as the option says; noisier or quieter markers scale what the filter is told.
    pub fn apply(self, camera: &mut CameraModel) {
        if matches!(self, Self::Rendered) {
            camera.pictures = Some(PictureModel::usual());
            let usual_px = DetectorModel::usual().pixel_sigma_px;
            camera.detector.pixel_sigma_px *= FOUND_SIGMA_PX / usual_px;
        }
    }
}
