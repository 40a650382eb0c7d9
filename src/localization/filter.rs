//! The error-state Kalman filter: one state, its propagation and its update.
//!
//! ```text
//! ṗ = v,   v̇ = R (a − b_a) + g,   Ṙ = R (ω − b_g)^,   ḃ_g, ḃ_a = random walks
//!
//! δp⁺ = δp + δv dt
//! δθ⁺ = exp(−(ω − b_g) dt) δθ − J_r dt δb_g
//! δv⁺ = δv − R (a − b_a)^ dt δθ − R dt δb_a
//! ```
//! - `p`, `v`: position (m) and velocity (m/s) in the hall, 3
//! - `R`: `hall_from_body`, perturbed on the right by δθ in body axes (rad)
//! - `b_g`, `b_a`: biases in body axes (rad/s, m/s²)
//!
//! Order and size of the error state: [`crate::messages::state`].
//! Source: Solà 2017, "Quaternion kinematics for the error-state Kalman filter", section 7 (there
//! in the order p, v, θ, `b_a`, `b_g`).
//! Checked: `transition_matches_central_difference`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use crate::geometry::{Body, Direction, Hall, Point, Transform, exp_so3, right_jacobian_so3, skew};
use crate::messages::state::{ACCEL_BIAS, ATT, GYRO_BIAS, POS, SIZE, VEL};
use crate::messages::{FixOutcome, ImuSample, NavEstimate};
use crate::stats::chi2_gate_99;
use crate::time::{Mono, Stamp};
use crate::units::GRAVITY_MPS2;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3, Vector6};

/// Covariance of the error state.
pub type Covariance = SMatrix<f64, SIZE, SIZE>;

/// Noise of the inertial sensors, vibration included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuNoise {
    /// Accelerometer white noise, m/s²/√Hz.
    pub accel_density_mps2_rthz: f64,
    /// Gyroscope white noise, rad/s/√Hz.
    pub gyro_density_radps_rthz: f64,
    /// Accelerometer bias random walk, m/s²/√s.
    pub accel_walk_mps2_rts: f64,
    /// Gyroscope bias random walk, rad/s/√s.
    pub gyro_walk_radps_rts: f64,
}

impl Default for ImuNoise {
    fn default() -> Self {
        Self {
            accel_density_mps2_rthz: 0.01,
            gyro_density_radps_rthz: 5e-4,
            accel_walk_mps2_rts: 5e-4,
            gyro_walk_radps_rts: 2e-5,
        }
    }
}

/// What the filter believes at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterState {
    /// When.
    pub at: Stamp<Mono>,
    /// Pose of the body in the hall.
    pub hall_from_body: Transform<Hall, Body>,
    /// Velocity in hall axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Gyroscope bias in body axes, rad/s.
    pub gyro_bias_radps: Vector3<f64>,
    /// Accelerometer bias in body axes, m/s².
    pub accel_bias_mps2: Vector3<f64>,
    /// Covariance of the error state, 15×15.
    pub P: Covariance,
}

/// How a pose met the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Measured minus predicted: position in hall axes (m), attitude in body axes (rad).
    pub pose: Vector6<f64>,
    /// Normalised innovation squared.
    pub nis: f64,
    /// The bound it had to keep.
    pub nis_gate: f64,
}

impl Innovation {
    /// True if the measurement is compatible with the state.
    #[must_use]
    pub fn is_within_gate(&self) -> bool {
        self.nis <= self.nis_gate
    }
}

impl FilterState {
    /// The state at `until`, with `imu` holding all the way.
    #[must_use]
    pub fn propagated(&self, imu: &ImuSample, until: Stamp<Mono>, noise: &ImuNoise) -> Self {
        let dt = until.seconds_since(self.at);
        if dt <= 0.0 {
            return self.clone();
        }
        let rotation = self.hall_from_body.rotation;
        let R = rotation.matrix();
        let turn = (imu.gyro_radps - self.gyro_bias_radps) * dt;
        let force = imu.accel_mps2 - self.accel_bias_mps2;
        // Specific force over the step, in the middle attitude: second order in the turn.
        let accel =
            rotation.perturbed(&(turn * 0.5)).quaternion() * force - Vector3::z() * GRAVITY_MPS2;
        let position =
            self.hall_from_body.origin.coords + self.velocity_mps * dt + accel * (0.5 * dt * dt);
        Self {
            at: until,
            hall_from_body: Transform::new(rotation.perturbed(&turn), Point::from_coords(position)),
            velocity_mps: self.velocity_mps + accel * dt,
            gyro_bias_radps: self.gyro_bias_radps,
            accel_bias_mps2: self.accel_bias_mps2,
            P: propagated_cov(&self.P, &transition(&R, &force, &turn, dt), dt, noise),
        }
    }

    /// Measures a pose against this state without changing it.
    #[must_use]
    pub fn innovation(&self, fix: &FixOutcome) -> Innovation {
        let dp = (fix.hall_from_body.origin - self.hall_from_body.origin).coords;
        let dr = fix.hall_from_body.rotation.minus(&self.hall_from_body.rotation);
        let pose = Vector6::new(dp.x, dp.y, dp.z, dr.x, dr.y, dr.z);
        let S = self.P.fixed_view::<6, 6>(0, 0) + fix.pose_cov;
        // Without a factor nothing can be said of the fix: outside of every gate, yet a number.
        let nis = S.cholesky().map_or(f64::MAX, |c| pose.dot(&c.solve(&pose)));
        Innovation { pose, nis, nis_gate: chi2_gate_99(6) }
    }

    /// Fuses a pose, gate or not, in Joseph form.
    ///
    /// ```text
    /// K = P Hᵀ S⁻¹,   P⁺ = (I − K H) P (I − K H)ᵀ + K R Kᵀ,   H = [I₆ 0]
    /// ```
    pub fn fuse(&mut self, fix: &FixOutcome, innovation: &Innovation) {
        let S = self.P.fixed_view::<6, 6>(0, 0) + fix.pose_cov;
        let Some(S_inverse) = S.cholesky().map(|c| c.inverse()) else { return };
        let K = self.P.fixed_columns::<6>(0) * S_inverse;
        let mut A = Covariance::identity();
        let mut left = A.fixed_columns_mut::<6>(0);
        left -= K;
        let P = A * self.P * A.transpose() + K * fix.pose_cov * K.transpose();
        self.P = (P + P.transpose()) * 0.5;
        self.correct(&(K * innovation.pose));
    }

    /// Moves the nominal state by an error.
    fn correct(&mut self, error: &SVector<f64, SIZE>) {
        let part = |range: std::ops::Range<usize>| error.fixed_rows::<3>(range.start).into_owned();
        self.hall_from_body = self.hall_from_body.perturbed(&part(POS), &part(ATT));
        self.velocity_mps += part(VEL);
        self.gyro_bias_radps += part(GYRO_BIAS);
        self.accel_bias_mps2 += part(ACCEL_BIAS);
    }

    /// The belief as the rest of the brain reads it.
    #[must_use]
    pub fn estimate(&self, gyro_radps: &Vector3<f64>, reset_counter: u8) -> NavEstimate {
        NavEstimate {
            at: self.at,
            hall_from_body: self.hall_from_body,
            velocity_mps: Direction::from_coords(self.velocity_mps),
            gyro_radps: gyro_radps - self.gyro_bias_radps,
            gyro_bias_radps: self.gyro_bias_radps,
            accel_bias_mps2: self.accel_bias_mps2,
            error_cov: self.P,
            reset_counter,
        }
    }
}

/// Φ of the error state over one step.
fn transition(R: &Matrix3<f64>, force: &Vector3<f64>, turn: &Vector3<f64>, dt: f64) -> Covariance {
    let mut F = Covariance::identity();
    let mut set =
        |rows: std::ops::Range<usize>, cols: std::ops::Range<usize>, block: Matrix3<f64>| {
            F.fixed_view_mut::<3, 3>(rows.start, cols.start).copy_from(&block);
        };
    let dv_dtheta = -R * skew(force) * dt;
    set(POS, VEL, Matrix3::identity() * dt);
    set(POS, ATT, dv_dtheta * (0.5 * dt));
    set(POS, ACCEL_BIAS, -R * (0.5 * dt * dt));
    set(ATT, ATT, exp_so3(&-turn).to_rotation_matrix().into_inner());
    set(ATT, GYRO_BIAS, -right_jacobian_so3(turn) * dt);
    set(VEL, ATT, dv_dtheta);
    set(VEL, ACCEL_BIAS, -R * dt);
    F
}

/// Φ P Φᵀ + Q with white noise integrated over the step.
fn propagated_cov(P: &Covariance, F: &Covariance, dt: f64, noise: &ImuNoise) -> Covariance {
    let mut next = F * P * F.transpose();
    let mut add = |range: std::ops::Range<usize>, variance: f64| {
        for k in range {
            next[(k, k)] += variance;
        }
    };
    add(POS, noise.accel_density_mps2_rthz.powi(2) * dt.powi(3) / 3.0);
    add(ATT, noise.gyro_density_radps_rthz.powi(2) * dt);
    add(VEL, noise.accel_density_mps2_rthz.powi(2) * dt);
    add(GYRO_BIAS, noise.gyro_walk_radps_rts.powi(2) * dt);
    add(ACCEL_BIAS, noise.accel_walk_mps2_rts.powi(2) * dt);
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;
    use nalgebra::Matrix6;

    fn awkward_state() -> FilterState {
        FilterState {
            at: Stamp::ZERO,
            hall_from_body: Transform::new(
                Rotation::from_euler_rad(0.2, -0.3, 1.9),
                Point::new(3.0, -2.0, 6.5),
            ),
            velocity_mps: Vector3::new(1.2, -0.4, 0.3),
            gyro_bias_radps: Vector3::new(0.01, -0.02, 0.005),
            accel_bias_mps2: Vector3::new(0.1, 0.05, -0.08),
            P: Covariance::identity() * 0.01,
        }
    }

    fn awkward_imu() -> ImuSample {
        ImuSample {
            at: Stamp::from_nanos(5_000_000),
            accel_mps2: Vector3::new(1.4, -0.7, 9.1),
            gyro_radps: Vector3::new(0.4, -0.9, 0.6),
        }
    }

    fn minus(a: &FilterState, b: &FilterState) -> SVector<f64, SIZE> {
        let mut error = SVector::<f64, SIZE>::zeros();
        let mut set = |range: std::ops::Range<usize>, v: Vector3<f64>| {
            error.fixed_rows_mut::<3>(range.start).copy_from(&v);
        };
        set(POS, (a.hall_from_body.origin - b.hall_from_body.origin).coords);
        set(ATT, a.hall_from_body.rotation.minus(&b.hall_from_body.rotation));
        set(VEL, a.velocity_mps - b.velocity_mps);
        set(GYRO_BIAS, a.gyro_bias_radps - b.gyro_bias_radps);
        set(ACCEL_BIAS, a.accel_bias_mps2 - b.accel_bias_mps2);
        error
    }

    #[test]
    fn transition_matches_central_difference() {
        let (state, imu) = (awkward_state(), awkward_imu());
        let until = imu.at;
        let dt = until.seconds_since(state.at);
        let F = transition(
            &state.hall_from_body.rotation.matrix(),
            &(imu.accel_mps2 - state.accel_bias_mps2),
            &((imu.gyro_radps - state.gyro_bias_radps) * dt),
            dt,
        );
        for k in 0..SIZE {
            let shifted = |step: f64| {
                let mut s = state.clone();
                s.correct(&SVector::ith(k, step));
                s.propagated(&imu, until, &ImuNoise::default())
            };
            let numeric = minus(&shifted(1e-5), &shifted(-1e-5)) / 2e-5;
            let analytic: SVector<f64, SIZE> = F.column(k).into();
            // The force is taken in the middle attitude, Φ at the start: they differ by
            // |ω dt| |a| dt ≈ 3e-4 in the velocity rows.
            assert!((numeric - analytic).norm() < 5e-4, "column {k}: {}", numeric - analytic);
        }
    }

    #[test]
    fn free_fall_follows_the_parabola() {
        // No force felt for one second: 9.80665/2 m down.
        let mut state = awkward_state();
        state.accel_bias_mps2 = Vector3::zeros();
        let start = state.hall_from_body.origin.coords;
        let start_velocity = state.velocity_mps;
        for k in 1..=200 {
            let at = Stamp::from_nanos(k * 5_000_000);
            let imu = ImuSample { at, accel_mps2: Vector3::zeros(), gyro_radps: Vector3::zeros() };
            state = state.propagated(&imu, at, &ImuNoise::default());
        }
        let expected = start + start_velocity - Vector3::z() * (GRAVITY_MPS2 / 2.0);
        assert!((state.hall_from_body.origin.coords - expected).norm() < 1e-9);
    }

    #[test]
    fn one_update_matches_the_closed_form() {
        // Information adds: 1/0.01 + 1/0.04 = 125, so each pose variance becomes 0.008.
        let mut state = awkward_state();
        let truth =
            state.hall_from_body.perturbed(&Vector3::new(0.05, 0.0, 0.0), &Vector3::zeros());
        let fix = FixOutcome {
            hall_from_body: truth,
            pose_cov: Matrix6::identity() * 0.04,
            residual_rms_px: 0.0,
            q_pos: 1.0,
            q_position: 1.0,
        };
        let innovation = state.innovation(&fix);
        // 0.05² over (0.01 + 0.04).
        assert!((innovation.nis - 0.05).abs() < 1e-12);
        let before = state.hall_from_body.origin.coords.x;
        state.fuse(&fix, &innovation);
        assert!((state.P[(0, 0)] - 0.008).abs() < 1e-12);
        // The gain is 0.01/0.05.
        assert!((state.hall_from_body.origin.coords.x - before - 0.01).abs() < 1e-12);
    }
}
