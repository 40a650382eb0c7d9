//! How the filter starts: at rest, from gravity, from a declared pad, from a first fix.

use super::filter::{Covariance, FilterState};
use crate::geometry::{Body, Hall, Point, Rotation, Transform};
use crate::messages::ImuSample;
use crate::messages::state::{ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL};
use crate::time::{Mono, Stamp};
use crate::units::GRAVITY_MPS2;
use nalgebra::{Matrix3, Vector3};
use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

/// Where the vehicle stands before a flight, as a person declares it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PadPose {
    /// Origin of the body in the hall.
    pub position: Point<Hall>,
    /// Yaw of the body in the hall, rad.
    pub yaw_rad: f64,
    /// Standard deviation of each coordinate, m.
    pub position_sigma_m: f64,
    /// Standard deviation of the yaw, rad.
    pub yaw_sigma_rad: f64,
}

/// Rest is judged over this long.
const REST_SPAN: Duration = Duration::from_secs(1);
/// Fewer samples say nothing.
const MIN_REST_SAMPLES: usize = 20;
/// The window counts as full from here, s: the first sample is rarely on its edge.
const FULL_REST_S: f64 = 0.9;
/// At rest the gyroscope wanders less than this, rad/s.
const REST_GYRO_SIGMA_RADPS: f64 = 0.02;
/// At rest the accelerometer wanders less than this, m/s²: above idle motors, below any hand.
const REST_ACCEL_SIGMA_MPS2: f64 = 0.3;
/// At rest the force is gravity within this: the bias, m/s².
const REST_FORCE_TOLERANCE_MPS2: f64 = 0.6;
/// Gyroscope biases are smaller than this: a faster mean is a turn, rad/s.
const MAX_REST_RATE_RADPS: f64 = 0.1;

/// Where nobody said where: σ of a position, m, and of a uniform angle, rad.
const UNKNOWN_POSITION_SIGMA_M: f64 = 100.0;
const UNKNOWN_YAW_SIGMA_RAD: f64 = 1.81;
/// σ of roll and pitch from gravity, rad: an accelerometer bias of 0.15 m/s² tilts by 0.015, twice.
const TILT_SIGMA_RAD: f64 = 0.03;
/// A fix may contradict gravity by this plus three of its own σ, rad. The two poses that one tag
/// leaves open differ by more.
const TILT_TOLERANCE_RAD: f64 = 0.1;

/// σ of what is known at rest: velocity, gyroscope bias after averaging, accelerometer bias.
pub(super) const AT_REST: [(Range<usize>, f64); 3] =
    [(VEL, 0.05), (GYRO_BIAS, 0.003), (ACCEL_BIAS, 0.15)];
/// The same in flight, where only the biases were known.
pub(super) const IN_FLIGHT: [(Range<usize>, f64); 3] =
    [(VEL, 0.5), (GYRO_BIAS, 0.005), (ACCEL_BIAS, 0.2)];

/// The inertial samples of the last second.
#[derive(Debug, Clone, Default)]
pub(super) struct RestWindow {
    samples: VecDeque<ImuSample>,
}

/// Means over a window at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rest {
    /// Mean angular velocity, body axes: the gyroscope's bias, rad/s.
    pub(super) gyro_radps: Vector3<f64>,
    /// Mean specific force, body axes, m/s².
    pub(super) accel_mps2: Vector3<f64>,
}

impl RestWindow {
    /// Takes in the next sample.
    pub(super) fn push(&mut self, imu: ImuSample) {
        self.samples.push_back(imu);
        let horizon = imu.at.minus(REST_SPAN);
        while self.samples.front().is_some_and(|oldest| oldest.at < horizon) {
            self.samples.pop_front();
        }
    }

    /// Forgets everything, as after a gap.
    pub(super) fn clear(&mut self) {
        self.samples.clear();
    }

    /// The samples after an instant.
    pub(super) fn after(&self, at: Stamp<Mono>) -> impl Iterator<Item = &ImuSample> {
        self.samples.iter().filter(move |imu| imu.at > at)
    }

    /// The means, if the gyroscope stood still.
    pub(super) fn gyro_rest(&self) -> Option<Rest> {
        if self.samples.len() < MIN_REST_SAMPLES {
            return None;
        }
        let (gyro_radps, sigma) = mean_and_sigma(&self.samples, |imu| imu.gyro_radps);
        let (accel_mps2, _) = mean_and_sigma(&self.samples, |imu| imu.accel_mps2);
        (sigma < REST_GYRO_SIGMA_RADPS).then_some(Rest { gyro_radps, accel_mps2 })
    }

    /// The means, if nothing moved for the whole window. Slow, even motion looks the same: only
    /// somebody who knows that the vehicle is on the ground may ask.
    pub(super) fn standstill(&self) -> Option<Rest> {
        let (first, last) = (self.samples.front()?, self.samples.back()?);
        let rest = self.gyro_rest()?;
        let (_, sigma) = mean_and_sigma(&self.samples, |imu| imu.accel_mps2);
        let is_still = last.at.seconds_since(first.at) >= FULL_REST_S
            && sigma < REST_ACCEL_SIGMA_MPS2
            && rest.gyro_radps.norm() < MAX_REST_RATE_RADPS
            && (rest.accel_mps2.norm() - GRAVITY_MPS2).abs() < REST_FORCE_TOLERANCE_MPS2;
        is_still.then_some(rest)
    }
}

/// Mean, and the largest σ of the three axes.
fn mean_and_sigma(
    samples: &VecDeque<ImuSample>,
    of: impl Fn(&ImuSample) -> Vector3<f64>,
) -> (Vector3<f64>, f64) {
    #[expect(clippy::cast_precision_loss, reason = "a second holds few samples")]
    let n = samples.len() as f64;
    let mean = samples.iter().map(&of).sum::<Vector3<f64>>() / n;
    let squares = |imu: &ImuSample| (of(imu) - mean).map(|d| d * d);
    let variance = samples.iter().map(squares).sum::<Vector3<f64>>() / n;
    (mean, variance.max().sqrt())
}

/// The state of a vehicle at rest: roll and pitch from gravity, the rest as declared or unknown.
///
/// ```text
/// Rᵀ e_z = (−sin θ, sin φ cos θ, cos φ cos θ)   is the direction of the specific force
/// ```
pub(super) fn aligned(at: Stamp<Mono>, rest: &Rest, pad: Option<&PadPose>) -> FilterState {
    let f = rest.accel_mps2;
    let (roll_rad, pitch_rad) = (f.y.atan2(f.z), (-f.x).atan2(f.y.hypot(f.z)));
    let yaw_rad = pad.map_or(0.0, |pad| pad.yaw_rad);
    let rotation = Rotation::<Hall, Body>::from_euler_rad(roll_rad, pitch_rad, yaw_rad);
    let position = pad.map_or_else(Point::origin, |pad| pad.position);
    let mut state = FilterState {
        at,
        hall_from_body: Transform::new(rotation, position),
        velocity_mps: Vector3::zeros(),
        gyro_bias_radps: rest.gyro_radps,
        accel_bias_mps2: Vector3::zeros(),
        P: Covariance::zeros(),
        places: None,
    };
    let position_sigma_m = pad.map_or(UNKNOWN_POSITION_SIGMA_M, |pad| pad.position_sigma_m);
    let yaw_sigma_rad = pad.map_or(UNKNOWN_YAW_SIGMA_RAD, |pad| pad.yaw_sigma_rad);
    let up = f.normalize();
    let about_up = up * up.transpose();
    let tilt = (Matrix3::identity() - about_up) * TILT_SIGMA_RAD.powi(2);
    let att_cov = tilt + about_up * yaw_sigma_rad.powi(2);
    state.P.fixed_view_mut::<3, 3>(ATT.start, ATT.start).copy_from(&att_cov);
    set_sigma(&mut state.P, &[(POS, position_sigma_m)]);
    set_sigma(&mut state.P, &AT_REST);
    state
}

/// Sets independent variances of some states.
pub(super) fn set_sigma(cov: &mut Covariance, sigmas: &[(Range<usize>, f64)]) {
    for (range, sigma) in sigmas {
        for k in range.clone() {
            cov[(k, k)] = sigma.powi(2);
        }
    }
}

/// True if a pose has the tilt that the specific force at rest shows.
pub(super) fn agrees_with_gravity(
    rotation: &Rotation<Hall, Body>,
    rest: &Rest,
    attitude_sigma_rad: f64,
) -> bool {
    let up = rotation.inverse().quaternion() * Vector3::z();
    up.angle(&rest.accel_mps2) <= TILT_TOLERANCE_RAD + 3.0 * attitude_sigma_rad
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rest(rotation: &Rotation<Hall, Body>) -> Rest {
        let up = rotation.inverse().quaternion() * Vector3::z();
        Rest { gyro_radps: Vector3::new(0.01, -0.02, 0.005), accel_mps2: up * GRAVITY_MPS2 }
    }

    #[test]
    fn gravity_gives_roll_and_pitch_and_the_pad_the_rest() {
        let truth = Rotation::<Hall, Body>::from_euler_rad(0.07, -0.11, 2.3);
        let pad = PadPose {
            position: Point::new(1.0, 2.0, 0.2),
            yaw_rad: 2.3,
            position_sigma_m: 0.1,
            yaw_sigma_rad: 0.05,
        };
        let state = aligned(Stamp::ZERO, &rest(&truth), Some(&pad));
        assert!(state.hall_from_body.rotation.minus(&truth).norm() < 1e-12);
        assert!((state.hall_from_body.origin - pad.position).coords.norm() < 1e-12);
        // The yaw's variance lies about the vertical, seen from the body.
        let up = truth.inverse().quaternion() * Vector3::z();
        let att_cov = state.P.fixed_view::<3, 3>(3, 3);
        assert!((up.dot(&(att_cov * up)) - 0.05_f64.powi(2)).abs() < 1e-12);
        assert!((att_cov.trace() - 0.05_f64.powi(2) - 2.0 * 0.03_f64.powi(2)).abs() < 1e-12);
    }

    #[test]
    fn a_flipped_pose_contradicts_gravity() {
        let truth = Rotation::<Hall, Body>::from_euler_rad(0.02, 0.03, 1.0);
        let flipped = Rotation::<Hall, Body>::from_euler_rad(0.02, 0.35, 1.1);
        assert!(agrees_with_gravity(&truth, &rest(&truth), 0.01));
        assert!(!agrees_with_gravity(&flipped, &rest(&truth), 0.01));
    }

    #[test]
    fn a_hand_is_not_rest() {
        let sample = |k: i64, shake: f64| ImuSample {
            at: Stamp::from_nanos(k * 5_000_000),
            accel_mps2: Vector3::new(if k % 2 == 0 { shake } else { -shake }, 0.0, 9.8),
            gyro_radps: Vector3::new(0.0, 0.01, 0.0),
        };
        let mut window = RestWindow::default();
        (0..100).for_each(|k| window.push(sample(k, 0.05)));
        assert_eq!(window.standstill(), None, "half a second is too short");
        (100..250).for_each(|k| window.push(sample(k, 0.05)));
        assert!(window.standstill().is_some());
        (250..300).for_each(|k| window.push(sample(k, 1.0)));
        assert_eq!(window.standstill(), None);
    }
}
