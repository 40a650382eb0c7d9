//! Compares what the service claims, and where it flies, with the truth.

mod free_space;

pub use free_space::{FreeSpaceJudge, FreeSpaceRule, fix_quality};

use mavlink::dialects::ardupilotmega::{MavMessage, ODOMETRY_DATA};
use nalgebra::Vector3;
use stockpilot::geometry::{Body, Hall, Transform};
use stockpilot::time::{Mono, Stamp};

/// Collects the errors of the published odometry against the true poses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PoseJudge {
    n_samples: u32,
    n_within_3_sigma: u32,
    squared_error_m2: f64,
    squared_error_var: f64,
}

impl PoseJudge {
    /// Judges a message if it is ODOMETRY; `true_pose` gives the truth at its stamp.
    pub fn hear(
        &mut self,
        message: &MavMessage,
        true_pose: impl FnOnce(Stamp<Mono>) -> Option<Transform<Hall, Body>>,
    ) {
        let MavMessage::ODOMETRY(odometry) = message else { return };
        let stamp = Stamp::from_nanos(i64::try_from(odometry.time_usec * 1000).unwrap_or(i64::MAX));
        if let Some(truth) = true_pose(stamp) {
            self.compare(odometry, &truth.origin.coords);
        }
    }

    fn compare(&mut self, odometry: &ODOMETRY_DATA, truth: &Vector3<f64>) {
        // North-east-down of the autopilot is (x, −y, −z) of the hall.
        let claimed =
            Vector3::new(f64::from(odometry.x), -f64::from(odometry.y), -f64::from(odometry.z));
        // Row-major upper triangle of the 6×6 covariance: x at 0, y at 6, z at 11.
        let var_m2 = [0, 6, 11].map(|k| f64::from(odometry.pose_covariance[k]));
        self.judge(&claimed, var_m2, truth);
    }

    /// Judges a claimed position and its variance, in hall axes.
    pub fn judge(&mut self, claimed: &Vector3<f64>, var: [f64; 3], truth: &Vector3<f64>) {
        let error = claimed - truth;
        let is_within = std::iter::zip(error.iter(), var).all(|(e, var_m2)| e * e <= 9.0 * var_m2);
        self.n_samples += 1;
        self.n_within_3_sigma += u32::from(is_within);
        self.squared_error_m2 += error.norm_squared();
        let axes = std::iter::zip(error.iter(), var);
        self.squared_error_var += axes.map(|(e, var_m2)| e * e / var_m2).sum::<f64>();
    }

    /// Share of the samples with all three axes inside their own 3σ.
    #[must_use]
    pub fn within_3_sigma(&self) -> f64 {
        f64::from(self.n_within_3_sigma) / f64::from(self.n_samples.max(1))
    }

    /// Mean over samples and axes of the squared error over its variance: 1 where the claim is right.
    #[must_use]
    pub fn error_over_claim(&self) -> f64 {
        self.squared_error_var / (3.0 * f64::from(self.n_samples.max(1)))
    }

    /// Root mean square of the position error, m.
    #[must_use]
    pub fn position_rms_m(&self) -> f64 {
        (self.squared_error_m2 / f64::from(self.n_samples.max(1))).sqrt()
    }
}
