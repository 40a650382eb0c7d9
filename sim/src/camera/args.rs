//! Options of the camera.

use super::CameraModel;
use clap::Args;
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
