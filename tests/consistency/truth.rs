//! A smooth true motion in closed form, and sensors that draw from the filter's noise model.
//!
//! Position and Euler angles are sums of sines, so velocity, acceleration and angular velocity
//! are derivatives on paper; nothing is integrated, nothing is shared with the filter.

use nalgebra::{Matrix6, Vector3};
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::localization::filter::ImuNoise;
use stockpilot::messages::{FixOutcome, ImuSample};
use stockpilot::stats::Noise;
use stockpilot::time::{Mono, Stamp};

const GRAVITY_MPS2: f64 = 9.80665;

/// a sin(2π f t + φ) with its first and second derivative.
#[derive(Clone, Copy)]
struct Sine {
    amplitude: f64,
    rate_radps: f64,
    phase_rad: f64,
}

impl Sine {
    fn value(&self, t: f64) -> f64 {
        self.amplitude * (self.rate_radps * t + self.phase_rad).sin()
    }
    fn first(&self, t: f64) -> f64 {
        self.amplitude * self.rate_radps * (self.rate_radps * t + self.phase_rad).cos()
    }
    fn second(&self, t: f64) -> f64 {
        -self.rate_radps.powi(2) * self.value(t)
    }
}

/// One drawn motion.
pub(crate) struct Motion {
    position: [Sine; 3],
    /// Roll, pitch, yaw.
    angles: [Sine; 3],
    /// Before this the vehicle stands, s; then it takes [`RAMP_S`] to come up to speed.
    stands_until: f64,
}

const RAMP_S: f64 = 2.0;

impl Motion {
    pub(crate) fn drawn(noise: &mut Noise) -> Self {
        let mut sine = |amplitude: f64, low: f64, high: f64| Sine {
            amplitude: amplitude * noise.between(0.5, 1.0),
            rate_radps: noise.between(low, high),
            phase_rad: noise.between(-3.0, 3.0),
        };
        Self {
            position: [sine(4.0, 0.2, 0.5), sine(4.0, 0.2, 0.5), sine(1.0, 0.2, 0.6)],
            angles: [sine(0.15, 0.5, 1.5), sine(0.15, 0.5, 1.5), sine(1.2, 0.2, 0.5)],
            stands_until: f64::NEG_INFINITY,
        }
    }

    /// The same, but it stands for a while first.
    pub(crate) fn standing_until(self, stands_until: f64) -> Self {
        Self { stands_until, ..self }
    }

    /// The sines' own time u(t) with its first and second derivative: it stands, speeds up evenly,
    /// then runs as t does.
    fn own_time(&self, t: f64) -> (f64, f64, f64) {
        let since = t - self.stands_until;
        if !self.stands_until.is_finite() {
            (t, 1.0, 0.0)
        } else if since <= 0.0 {
            (0.0, 0.0, 0.0)
        } else if since < RAMP_S {
            (since * since / (2.0 * RAMP_S), since / RAMP_S, 1.0 / RAMP_S)
        } else {
            (since - 0.5 * RAMP_S, 1.0, 0.0)
        }
    }

    pub(crate) fn velocity_mps(&self, t: f64) -> Vector3<f64> {
        let (u, du, _) = self.own_time(t);
        Vector3::from(self.position.map(|sine| sine.first(u) * du))
    }

    pub(crate) fn pose(&self, t: f64) -> Transform<Hall, Body> {
        let (u, ..) = self.own_time(t);
        let [roll, pitch, yaw] = self.angles.map(|sine| sine.value(u));
        let [x, y, z] = self.position.map(|sine| sine.value(u));
        Transform::new(Rotation::from_euler_rad(roll, pitch, yaw), Point::new(x, y, z))
    }

    /// Specific force in body axes: `Rᵀ (a + g e_z)`.
    fn force_mps2(&self, t: f64) -> Vector3<f64> {
        let (u, du, ddu) = self.own_time(t);
        let accel =
            Vector3::from(self.position.map(|sine| sine.second(u) * du * du + sine.first(u) * ddu));
        let felt = accel + Vector3::z() * GRAVITY_MPS2;
        self.pose(t).rotation.matrix().transpose() * felt
    }

    /// Angular velocity in body axes from the rates of the Euler angles (yaw, pitch, roll).
    ///
    /// ```text
    /// ω = (φ′ − ψ′ sin θ, θ′ cos φ + ψ′ sin φ cos θ, −θ′ sin φ + ψ′ cos φ cos θ)
    /// ```
    /// Source: Diebel 2006, eq. (73).
    pub(crate) fn rate_radps(&self, t: f64) -> Vector3<f64> {
        let (u, du, _) = self.own_time(t);
        let [roll, pitch, _] = self.angles.map(|sine| sine.value(u));
        let [d_roll, d_pitch, d_yaw] = self.angles.map(|sine| sine.first(u) * du);
        let ((sr, cr), (sp, cp)) = (roll.sin_cos(), pitch.sin_cos());
        Vector3::new(
            d_roll - d_yaw * sp,
            d_pitch * cr + d_yaw * sr * cp,
            -d_pitch * sr + d_yaw * cr * cp,
        )
    }
}

/// Inertial sensors whose biases walk.
pub(crate) struct Sensors {
    pub(crate) gyro_bias_radps: Vector3<f64>,
    pub(crate) accel_bias_mps2: Vector3<f64>,
    model: ImuNoise,
}

impl Sensors {
    pub(crate) const fn new(
        gyro_bias_radps: Vector3<f64>,
        accel_bias_mps2: Vector3<f64>,
        model: ImuNoise,
    ) -> Self {
        Self { gyro_bias_radps, accel_bias_mps2, model }
    }

    /// The sample for the step of `dt` that ends at `t`: the middle of the step, white noise with
    /// the density over √dt.
    pub(crate) fn sample(
        &mut self,
        motion: &Motion,
        t: f64,
        dt: f64,
        noise: &mut Noise,
    ) -> ImuSample {
        let white = 1.0 / dt.sqrt();
        let middle = t - 0.5 * dt;
        let sample = ImuSample {
            at: stamp(t),
            accel_mps2: motion.force_mps2(middle)
                + self.accel_bias_mps2
                + noise.normal3() * (self.model.accel_density_mps2_rthz * white),
            gyro_radps: motion.rate_radps(middle)
                + self.gyro_bias_radps
                + noise.normal3() * (self.model.gyro_density_radps_rthz * white),
        };
        self.accel_bias_mps2 += noise.normal3() * (self.model.accel_walk_mps2_rts * dt.sqrt());
        self.gyro_bias_radps += noise.normal3() * (self.model.gyro_walk_radps_rts * dt.sqrt());
        sample
    }
}

/// A fix at `t` whose error is drawn from its covariance.
pub(crate) fn fix(
    motion: &Motion,
    t: f64,
    pose_cov: &Matrix6<f64>,
    noise: &mut Noise,
) -> FixOutcome {
    let half = pose_cov.cholesky().expect("a positive definite covariance").l();
    let (a, b) = (noise.normal3(), noise.normal3());
    let error = half * nalgebra::Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z);
    let dp = error.fixed_rows::<3>(0).into_owned();
    let dr = error.fixed_rows::<3>(3).into_owned();
    FixOutcome {
        hall_from_body: motion.pose(t).perturbed(&dp, &dr),
        pose_cov: *pose_cov,
        residual_rms_px: 0.5,
        n_points: 8,
        q_pos: 1.0 / pose_cov.trace().sqrt(),
        q_position: 1.0 / pose_cov.fixed_view::<3, 3>(0, 0).trace().sqrt(),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a few seconds in nanoseconds")]
pub(crate) fn stamp(t: f64) -> Stamp<Mono> {
    Stamp::from_nanos((t * 1e9).round() as i64)
}

#[test]
fn angular_velocity_is_the_derivative_of_the_attitude() {
    for stands_until in [f64::NEG_INFINITY, 2.5] {
        let mut noise = stockpilot::stats::SeedBook::new(3).stream("motion");
        let motion = Motion::drawn(&mut noise).standing_until(stands_until);
        for k in 0..20 {
            let (t, h) = (f64::from(k) + 0.2, 1e-5);
            let (a, b) = (motion.pose(t - h), motion.pose(t + h));
            let turn = b.rotation.minus(&a.rotation) / (2.0 * h);
            assert!((turn - motion.rate_radps(t)).norm() < 1e-7);
            let velocity = (b.origin - a.origin).coords / (2.0 * h);
            assert!((velocity - motion.velocity_mps(t)).norm() < 1e-7);
            let accel = (motion.velocity_mps(t + h) - motion.velocity_mps(t - h)) / (2.0 * h);
            let felt = a.rotation.matrix() * motion.force_mps2(t) - Vector3::z() * GRAVITY_MPS2;
            assert!((accel - felt).norm() < 1e-3, "{}", (accel - felt).norm());
        }
    }
}
