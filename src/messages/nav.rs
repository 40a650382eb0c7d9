//! What the localisation says of the vehicle.

use super::TagDetections;
use crate::geometry::{Body, Direction, Hall, Transform};
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, Matrix6x3, SMatrix, Vector3};

/// Order and size of the error state, in one place.
pub mod state {
    use std::ops::Range;

    /// Number of error states.
    pub const SIZE: usize = 15;
    /// Position error in hall axes, m.
    pub const POS: Range<usize> = 0..3;
    /// Attitude error, right-multiplicative, in body axes, rad.
    pub const ATT: Range<usize> = 3..6;
    /// Velocity error in hall axes, m/s.
    pub const VEL: Range<usize> = 6..9;
    /// Gyroscope bias error, rad/s.
    pub const GYRO_BIAS: Range<usize> = 9..12;
    /// Accelerometer bias error, m/s².
    pub const ACCEL_BIAS: Range<usize> = 12..15;
}

/// The filter's belief at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct NavEstimate {
    /// When it is valid.
    pub at: Stamp<Mono>,
    /// Pose of the body in the hall.
    pub hall_from_body: Transform<Hall, Body>,
    /// Velocity of the body in hall axes, m/s.
    pub velocity_mps: Direction<Hall>,
    /// Angular velocity in body axes with the bias removed, rad/s.
    pub gyro_radps: Vector3<f64>,
    /// Gyroscope bias in body axes, rad/s.
    pub gyro_bias_radps: Vector3<f64>,
    /// Accelerometer bias in body axes, m/s².
    pub accel_bias_mps2: Vector3<f64>,
    /// Covariance of the error state, 15×15 in the order of [`state`].
    pub error_cov: SMatrix<f64, 15, 15>,
    /// Counts the jumps of the pose that were declared, modulo 256.
    pub reset_counter: u8,
}

impl NavEstimate {
    /// True if no field is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let vectors = [&self.gyro_radps, &self.gyro_bias_radps, &self.accel_bias_mps2];
        self.hall_from_body.origin.is_finite()
            && self.hall_from_body.rotation.quaternion().coords.iter().all(|c| c.is_finite())
            && self.velocity_mps.is_finite()
            && vectors.into_iter().flatten().all(|c| c.is_finite())
            && self.error_cov.iter().all(|c| c.is_finite())
    }

    /// Covariance of the pose error: position in hall axes (m), attitude in body axes (rad), 6×6.
    #[must_use]
    pub fn pose_cov(&self) -> Matrix6<f64> {
        self.error_cov.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// Standard deviations of the position in hall axes, m.
    #[must_use]
    pub fn position_sigma_m(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.error_cov[(axis, axis)].max(0.0).sqrt())
    }
}

/// The error of the pose at one scan, and how the error at the scan before lives on in it.
///
/// ```text
/// e_k = A_k e_{k−1} + new noise,   P_k = cov(e_k)
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PoseError {
    /// When it is valid.
    pub at: Stamp<Mono>,
    /// `P_k`: covariance of the error state, 15×15 in the order of [`state`]; without what misplaced
    /// tags do, where `tags` says that.
    pub cov: SMatrix<f64, 15, 15>,
    /// `A_k`: transition of the error state from the scan before; zero where nothing of it lives
    /// on (the first scan, a reset, a gap longer than the filter remembers).
    pub from_previous: SMatrix<f64, 15, 15>,
    /// Velocity of the body in hall axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity in body axes with the bias removed, rad/s.
    pub rate_radps: Vector3<f64>,
    /// What an error in the place of each tag does to the pose. In single precision, which is far
    /// finer than the places are known: thousands of turns keep these lists, and they are most of
    /// what a turn keeps.
    pub tags: Vec<TagSensitivity<f32>>,
}

impl PoseError {
    /// True if every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let mut of_tags = self.tags.iter().flat_map(|tag| tag.pose_by_place.iter());
        let motion = self.velocity_mps.iter().chain(&self.rate_radps);
        let mut numbers = self.cov.iter().chain(&self.from_previous).chain(motion);
        numbers.all(|c| c.is_finite()) && of_tags.all(|c| c.is_finite())
    }
}

/// What an error in the mapped place of one tag does to the pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TagSensitivity<T = f64> {
    /// Number of the tag in the order of the marker map; points that belong to no tag follow.
    pub tag_idx: usize,
    /// Derivative of the pose (position in hall axes, attitude in body axes) by the tag's place
    /// in the hall, 6×3.
    pub pose_by_place: Matrix6x3<T>,
}

impl TagSensitivity {
    /// The same in single precision.
    #[must_use]
    pub fn to_single(&self) -> TagSensitivity<f32> {
        TagSensitivity { tag_idx: self.tag_idx, pose_by_place: self.pose_by_place.cast() }
    }
}

/// What became of one attempt to fuse a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Used.
    Fused,
    /// Used to start the filter.
    Initialized,
    /// Its innovation lies outside the gate.
    Gated,
    /// Older than the delay ring.
    TooOld,
    /// Stamped in the future.
    FromTheFuture,
    /// The points do not determine a pose.
    NotObservable,
    /// No mapped tag in the frame.
    NoKnownTag,
    /// The filter is not initialised and this measurement cannot do it.
    NotInitialized,
    /// The solution does not explain the pixels.
    BadResidual,
    /// The picture repeats an older one although the vehicle moved.
    Frozen,
    /// The pose has not the tilt that gravity shows at rest.
    AgainstGravity,
}

/// What was to be fused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FixSource {
    /// The pose of a frame, six numbers at once.
    Loose,
    /// The points of a frame, one by one.
    Tight,
    /// That the vehicle stands still, over about a second of attempts.
    Standstill,
}

/// A pose measured from one frame of tags.
#[derive(Debug, Clone, PartialEq)]
pub struct FixOutcome {
    /// Pose of the body in the hall.
    pub hall_from_body: Transform<Hall, Body>,
    /// Covariance of the pose error, 6×6, in the order and axes of [`NavEstimate::pose_cov`].
    pub pose_cov: Matrix6<f64>,
    /// Root mean square of the reprojection residuals, px.
    pub residual_rms_px: f64,
    /// Points that the fix rests on; those that did not fit are left out.
    pub n_points: usize,
    /// Quality of the fix by its pixels alone: 1/√tr(Σ^χ), m² and rad² added as the paper does; an
    /// uncertain capture time widens `pose_cov` but not this.
    pub q_pos: f64,
    /// The same of the position alone, 1/m: 1/√tr of the upper left 3×3 of Σ^χ.
    pub q_position: f64,
}

/// The record of one attempt to fuse a frame of tags, or of some attempts to fuse a standstill.
#[derive(Debug, Clone, PartialEq)]
pub struct FixRecord {
    /// When the frame was exposed; the last attempt of a standstill.
    pub at: Stamp<Mono>,
    /// How late it arrived at the filter, s.
    pub age_s: f64,
    /// What was to be fused in the end.
    pub source: FixSource,
    /// Tags in the frame.
    pub n_tags: usize,
    /// Tags that are in the marker map and were used.
    pub n_tags_used: usize,
    /// Points that were tried; attempts of a standstill.
    pub n_points: usize,
    /// Points that passed their gates; of a loose fix all that went into it; of a standstill the
    /// attempts that were fused.
    pub n_points_used: usize,
    /// The fix, if one was found; a tight update needs none.
    pub fix: Option<FixOutcome>,
    /// Innovation, if it came that far: six pose components, m and rad, of a loose fix; where the
    /// points, weighed against the state, see the pose, of a tight one; velocity (m/s) and
    /// gyroscope bias (rad/s) of a standstill.
    pub innovation: Option<[f64; 6]>,
    /// Covariance that the innovation should have, 6×6 by rows.
    pub innovation_cov: Option<[[f64; 6]; 6]>,
    /// Normalised innovation squared.
    pub nis: Option<f64>,
    /// The bound that `nis` had to keep: 99 % of χ² with 6 degrees of freedom, or of a tight update
    /// with two for each point used.
    pub nis_gate: f64,
    /// What became of it.
    pub verdict: Verdict,
}

impl FixRecord {
    /// The record of a frame of which nothing is known yet but its verdict so far.
    #[must_use]
    pub fn of_frame(frame: &TagDetections, nis_gate: f64, verdict: Verdict) -> Self {
        Self {
            at: frame.captured_at,
            age_s: frame.received_at.seconds_since(frame.captured_at),
            source: FixSource::Loose,
            n_tags: frame.tags.len(),
            n_tags_used: 0,
            n_points: 0,
            n_points_used: 0,
            fix: None,
            innovation: None,
            innovation_cov: None,
            nis: None,
            nis_gate,
            verdict,
        }
    }
}
