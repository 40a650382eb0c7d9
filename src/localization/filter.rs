//! The error-state Kalman filter: one state, its propagation and its update.
//!
//! ```text
//! ṗ = v,   v̇ = R (a − b_a) + g,   Ṙ = R (ω − b_g)^,   ḃ_g, ḃ_a = random walks
//!
//! ```
//! - `p`, `v`: position (m) and velocity (m/s) in the hall, 3
//! - `R`: `hall_from_body`, perturbed on the right by δθ in body axes (rad)
//! - `b_g`, `b_a`: biases in body axes (rad/s, m/s²)
//!
//! Order and size of the error state: [`crate::messages::state`].
//! Source: Solà 2017, "Quaternion kinematics for the error-state Kalman filter", section 7 (there
//! in the order p, v, θ, `b_a`, `b_g`).
//! The error's step is in `propagation`. Checked: `transition_matches_central_difference`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::place_errors::PlaceErrors;
use super::propagation::{Error, Transition};
use crate::geometry::{Body, Direction, Hall, Point, Transform};
use crate::messages::state::{ACCEL_BIAS, ATT, GYRO_BIAS, POS, SIZE, VEL};
use crate::messages::{FixOutcome, ImuSample, NavEstimate, TagSensitivity};
use crate::stats::chi2_gate_99;
use crate::time::{Mono, Stamp};
use crate::units::GRAVITY_MPS2;
use nalgebra::{Matrix6, SMatrix, Vector3, Vector6};

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
    /// Covariance of the error state, 15×15, but for what misplaced tags do to it.
    pub P: Covariance,
    /// What misplaced tags do to it; `None` where the marker map counts as exact.
    pub places: Option<Box<PlaceErrors>>,
}

/// A pose to fuse, with what it owes to the places of the tags that it was found from.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedFix {
    /// The pose and the covariance that its pixels give it.
    pub outcome: FixOutcome,
    /// Its derivatives by the mapped places; empty where the map counts as exact.
    pub by_place: Vec<TagSensitivity>,
}

impl From<FixOutcome> for PlacedFix {
    fn from(outcome: FixOutcome) -> Self {
        Self { outcome, by_place: Vec::new() }
    }
}

/// How a pose met the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Measured minus predicted: position in hall axes (m), attitude in body axes (rad).
    pub pose: Vector6<f64>,
    /// S: covariance that it should have, 6×6.
    pub cov: Matrix6<f64>,
    /// Normalised innovation squared.
    pub nis: f64,
    /// The bound it had to keep.
    pub nis_gate: f64,
}

/// σ of the velocity of a vehicle that stands, m/s: it may rock on its feet.
const STANDSTILL_SIGMA_MPS: f64 = 0.02;
/// σ of the gyroscope's mean at rest, rad/s. The window is a second and comes ten times a second:
/// ten overlapping means count as one with this √10 wider than one.
const STANDSTILL_GYRO_SIGMA_RADPS: f64 = 2e-3;

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
        let step = Step::new(self, imu, dt);
        let position = self.hall_from_body.origin.coords
            + self.velocity_mps * dt
            + step.accel * (0.5 * dt * dt);
        let rotation = self.hall_from_body.rotation.perturbed(&step.turn);
        Self {
            at: until,
            hall_from_body: Transform::new(rotation, Point::from_coords(position)),
            velocity_mps: self.velocity_mps + step.accel * dt,
            gyro_bias_radps: self.gyro_bias_radps,
            accel_bias_mps2: self.accel_bias_mps2,
            P: step.transition.propagated_cov(&self.P, noise),
            places: self.places.as_ref().map(|places| Box::new(places.stepped(&step.transition))),
        }
    }

    /// Covariance of the error state with all that is known of it, 15×15: P and misplaced tags.
    #[must_use]
    pub fn total_cov(&self) -> Covariance {
        self.places.as_ref().map_or(self.P, |places| self.P + places.cov())
    }

    /// The pose's part of [`Self::total_cov`], 6×6: position in hall axes (m), attitude in body axes
    /// (rad).
    #[must_use]
    pub fn pose_cov(&self) -> Matrix6<f64> {
        let P = self.P.fixed_view::<6, 6>(0, 0).into_owned();
        self.places.as_ref().map_or(P, |places| P + places.pose_cov())
    }

    /// True if no part of the belief is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let vectors = [&self.velocity_mps, &self.gyro_bias_radps, &self.accel_bias_mps2];
        self.hall_from_body.origin.is_finite()
            && self.hall_from_body.rotation.quaternion().coords.iter().all(|c| c.is_finite())
            && vectors.into_iter().flatten().all(|c| c.is_finite())
            && self.P.iter().all(|c| c.is_finite())
            && self.places.as_ref().is_none_or(|places| places.is_finite())
    }

    /// Φ of the error from this state to `until`; nothing moves backwards.
    pub(super) fn transition(&self, imu: &ImuSample, until: Stamp<Mono>) -> Transition {
        Step::new(self, imu, until.seconds_since(self.at).max(0.0)).transition
    }

    /// Measures a pose against this state without changing it.
    #[must_use]
    pub fn innovation(&self, fix: &FixOutcome) -> Innovation {
        self.innovation_of(fix, &[])
    }

    /// The same for a pose that answers the places of tags with `by_place`.
    pub(super) fn innovation_of(
        &self,
        fix: &FixOutcome,
        by_place: &[TagSensitivity],
    ) -> Innovation {
        let dp = (fix.hall_from_body.origin - self.hall_from_body.origin).coords;
        let dr = fix.hall_from_body.rotation.minus(&self.hall_from_body.rotation);
        let pose = Vector6::new(dp.x, dp.y, dp.z, dr.x, dr.y, dr.z);
        let S = self.against(by_place).1 + fix.pose_cov;
        // Without a factor nothing can be said of the fix: outside of every gate, yet a number.
        let nis = S.cholesky().map_or(f64::MAX, |c| pose.dot(&c.solve(&pose)));
        Innovation { pose, cov: S, nis, nis_gate: chi2_gate_99(6) }
    }

    /// Fuses a pose, gate or not, in Joseph form.
    ///
    /// ```text
    /// K = P Hᵀ S⁻¹,   P⁺ = (I − K H) P (I − K H)ᵀ + K R Kᵀ,   H = [I₆ 0]
    /// ```
    /// `None` and no change where S has no Cholesky factor.
    pub fn fuse(&mut self, fix: &FixOutcome, innovation: &Innovation) -> Option<Gain> {
        self.fuse_placed(fix, &[], innovation)
    }

    /// The same for a pose that answers the places of tags with `by_place`: it measures
    /// `H e − Σ F_t τ_t`, so `V_t = K F_t`.
    pub(super) fn fuse_placed(
        &mut self,
        fix: &FixOutcome,
        by_place: &[TagSensitivity],
        innovation: &Innovation,
    ) -> Option<Gain> {
        let (cross, own) = self.against(by_place);
        let S = own + fix.pose_cov;
        let K = cross * S.cholesky()?.inverse();
        let gain = Gain { first: 0, U: K };
        self.absorb(&gain, &K, &fix.pose_cov, &innovation.pose);
        if let Some(places) = &mut self.places {
            let share = |tag: &TagSensitivity| (tag.tag_idx, K * tag.pose_by_place);
            places.add(&by_place.iter().map(share).collect::<Vec<_>>());
        }
        Some(gain)
    }

    /// Covariances of the error, and of `H e − Σ F_t τ_t`, with `H e − Σ F_t τ_t`: 15×6 and 6×6.
    ///
    /// ```text
    /// P_tot Hᵀ − Σ σ² E_t F_tᵀ,   H P_tot Hᵀ + Σ σ² (F_t F_tᵀ − H E_t F_tᵀ − F_t E_tᵀ Hᵀ)
    /// ```
    fn against(&self, by_place: &[TagSensitivity]) -> (SMatrix<f64, SIZE, 6>, Matrix6<f64>) {
        let mut cross = self.P.fixed_columns::<6>(0).into_owned();
        let mut own = self.pose_cov();
        if let Some(places) = &self.places {
            cross += places.cov_with_pose();
            let var_m2 = places.sigma_m().powi(2);
            for tag in by_place {
                let F = tag.pose_by_place * var_m2;
                let EF = places.share(tag.tag_idx) * F.transpose();
                cross -= EF;
                let pose_part = EF.fixed_rows::<6>(0);
                own += F * tag.pose_by_place.transpose() - pose_part - pose_part.transpose();
            }
        }
        (cross, own)
    }

    /// Fuses that the vehicle stands: no velocity, and a gyroscope that shows its bias; only within
    /// the gate.
    ///
    /// ```text
    /// z = (−v, ω̄ − b_g),   H = [0 I₆ 0] on (v, b_g)
    /// ```
    /// - `ω̄`: mean of the gyroscope at rest, rad/s
    pub(super) fn stand(&mut self, gyro_radps: &Vector3<f64>) -> (Innovation, Option<Gain>) {
        let (v, b) = (-self.velocity_mps, gyro_radps - self.gyro_bias_radps);
        let z = Vector6::new(v.x, v.y, v.z, b.x, b.y, b.z);
        let (r_v, r_b) = (STANDSTILL_SIGMA_MPS.powi(2), STANDSTILL_GYRO_SIGMA_RADPS.powi(2));
        let R = Matrix6::from_diagonal(&Vector6::new(r_v, r_v, r_v, r_b, r_b, r_b));
        let P = self.total_cov();
        let S = P.fixed_view::<6, 6>(VEL.start, VEL.start) + R;
        let factor = S.cholesky();
        let nis = factor.as_ref().map_or(f64::MAX, |S| z.dot(&S.solve(&z)));
        let innovation = Innovation { pose: z, cov: S, nis, nis_gate: chi2_gate_99(6) };
        let gain = factor.filter(|_| innovation.is_within_gate()).map(|S| {
            let K = P.fixed_columns::<6>(VEL.start) * S.inverse();
            let gain = Gain { first: VEL.start, U: K };
            self.absorb(&gain, &K, &R, &z);
            gain
        });
        (innovation, gain)
    }

    /// `P⁺ = (I − U H) P (I − U H)ᵀ + W N Wᵀ` and the nominal state moved by `W z`.
    pub(super) fn absorb(
        &mut self,
        gain: &Gain,
        W: &SMatrix<f64, SIZE, 6>,
        N: &Matrix6<f64>,
        z: &Vector6<f64>,
    ) {
        self.absorb_parts(gain, &((W * N) * W.transpose()), &(W * z));
    }

    /// `P⁺ = (I − U H) P (I − U H)ᵀ + noise` and the nominal state moved by `error`.
    pub(super) fn absorb_parts(&mut self, gain: &Gain, noise: &Covariance, error: &Error) {
        let mut AP = self.P;
        gain.apply(&mut AP);
        let right = AP.fixed_columns::<6>(gain.first) * gain.U.transpose();
        let P = AP - right + noise;
        self.P = (P + P.transpose()) * 0.5;
        if let Some(places) = &mut self.places {
            places.apply(gain);
        }
        self.correct(error);
    }

    /// Moves the nominal state by an error.
    pub(super) fn correct(&mut self, error: &Error) {
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
            error_cov: self.total_cov(),
            reset_counter,
        }
    }
}

/// What an update does to the error: e⁺ = (I − U H) e, H picks six states from `first` on.
#[derive(Debug, Clone, PartialEq)]
pub struct Gain {
    /// First of the six states that were measured.
    pub(super) first: usize,
    /// Gain from the error of these states to all, 15×6.
    pub(super) U: SMatrix<f64, SIZE, 6>,
}

impl Gain {
    /// `X ← (I − U H) X`.
    pub(super) fn apply(&self, X: &mut Covariance) {
        let measured: SMatrix<f64, 6, SIZE> = X.fixed_rows::<6>(self.first).into_owned();
        *X -= self.U * measured;
    }
}

/// One inertial step: what the nominal state and the error share.
struct Step {
    /// φ, rad, body axes.
    turn: Vector3<f64>,
    /// Acceleration in hall axes, m/s².
    accel: Vector3<f64>,
    transition: Transition,
}

impl Step {
    fn new(state: &FilterState, imu: &ImuSample, dt: f64) -> Self {
        let rotation = state.hall_from_body.rotation;
        let turn = (imu.gyro_radps - state.gyro_bias_radps) * dt;
        let force = imu.accel_mps2 - state.accel_bias_mps2;
        // The force is taken in the middle attitude: second order in the turn.
        let (R, R_mid) = (rotation.matrix(), rotation.perturbed(&(turn * 0.5)).matrix());
        let accel = R_mid * force - Vector3::z() * GRAVITY_MPS2;
        Self { turn, accel, transition: Transition::new(&R, &R_mid, &force, &turn, dt) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;

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
            places: None,
        }
    }

    fn awkward_imu() -> ImuSample {
        ImuSample {
            at: Stamp::from_nanos(5_000_000),
            accel_mps2: Vector3::new(1.4, -0.7, 9.1),
            gyro_radps: Vector3::new(0.4, -0.9, 0.6),
        }
    }

    fn minus(a: &FilterState, b: &FilterState) -> Error {
        let mut error = Error::zeros();
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
        let F = state.transition(&imu, until).dense();
        for k in 0..SIZE {
            let shifted = |step: f64| {
                let mut s = state.clone();
                s.correct(&Error::ith(k, step));
                s.propagated(&imu, until, &ImuNoise::default())
            };
            let numeric = minus(&shifted(1e-5), &shifted(-1e-5)) / 2e-5;
            let analytic: Error = F.column(k).into();
            // D takes J_r to first order: |φ|² |a| dt²/48 ≈ 2e-10 here; the rest is rounding.
            assert!((numeric - analytic).norm() < 1e-9, "column {k}: {}", numeric - analytic);
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
            n_points: 8,
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
