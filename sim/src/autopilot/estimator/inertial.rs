//! Strapdown navigation in NED, and how errors of its parts hang together.
//!
//! Each horizontal axis is a chain position – velocity – acceleration error – its rate, where the
//! acceleration error is the tilt times g and its rate the gyroscope's bias times g:
//!
//! ```text
//! δv̇ = δθ × (R f),  R f ≈ (0, 0, −g)   ⇒   δv̇_N = −g δθ_E,  δv̇_E = g δθ_N
//! δθ̇ = −R δb
//! ```
//! The vertical chain ends in the accelerometer's bias, the heading chain in the gyroscope's.

use super::COMPASS_VAR_RAD2;
use super::chain::ChainFilter;
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;
use stockpilot::time::{Boot, Stamp};
use stockpilot::units::{GRAVITY_MPS2, wrapped_rad};

/// Entries kept for late measurements: 0.5 s at 200 Hz.
const N_KEPT: usize = 100;

/// Position, velocity and heading at an instant of the past.
#[derive(Debug, Clone, Copy)]
pub(super) struct Past {
    pub(super) at: Stamp<Boot>,
    pub(super) position_m: Vector3<f64>,
    pub(super) velocity_mps: Vector3<f64>,
    pub(super) yaw_rad: f64,
}

/// Attitude, velocity, position and biases, with the errors' covariances.
#[derive(Debug, Clone)]
pub(super) struct Inertial {
    /// Takes FRD to NED.
    pub(super) attitude: UnitQuaternion<f64>,
    pub(super) velocity_mps: Vector3<f64>,
    pub(super) position_m: Vector3<f64>,
    /// Angular velocity in FRD without bias, rad/s.
    pub(super) rate_radps: Vector3<f64>,
    /// Acceleration in NED, m/s².
    pub(super) accel_mps2: Vector3<f64>,
    gyro_bias_radps: Vector3<f64>,
    accel_bias_down_mps2: f64,
    pub(super) north: ChainFilter<4>,
    pub(super) east: ChainFilter<4>,
    pub(super) down: ChainFilter<3>,
    pub(super) yaw: ChainFilter<2>,
    past: VecDeque<Past>,
}

impl Inertial {
    /// Levelled by a first specific force in FRD, m/s², heading north.
    pub(super) fn levelled(specific_force_mps2: &Vector3<f64>) -> Self {
        let f = specific_force_mps2;
        let roll = (-f.y).atan2(-f.z);
        let pitch = f.x.atan2((f.y * f.y + f.z * f.z).sqrt());
        let horizontal = || ChainFilter::new([1.0, 0.5, 0.15, 0.06], [0.001, 0.07, 0.004, 0.0003]);
        let zero = Vector3::zeros();
        Self {
            attitude: UnitQuaternion::from_euler_angles(roll, pitch, 0.0),
            velocity_mps: zero,
            position_m: zero,
            rate_radps: zero,
            accel_mps2: zero,
            gyro_bias_radps: zero,
            accel_bias_down_mps2: 0.0,
            north: horizontal(),
            east: horizontal(),
            down: ChainFilter::new([1.0, 0.5, 0.1], [0.001, 0.07, 0.002]),
            yaw: ChainFilter::new([1.0, 0.007], [0.003, 0.000_03]),
            past: VecDeque::with_capacity(N_KEPT + 1),
        }
    }

    /// Moves on by one inertial sample in FRD.
    pub(super) fn propagate(
        &mut self,
        at: Stamp<Boot>,
        accel_mps2: &Vector3<f64>,
        gyro_radps: &Vector3<f64>,
        dt_s: f64,
    ) {
        self.rate_radps = gyro_radps - self.gyro_bias_radps;
        let half_turn = UnitQuaternion::from_scaled_axis(self.rate_radps * (0.5 * dt_s));
        let halfway = self.attitude * half_turn;
        self.attitude = halfway * half_turn;
        self.attitude.renormalize_fast();
        self.accel_mps2 =
            halfway * accel_mps2 + Vector3::new(0.0, 0.0, GRAVITY_MPS2 + self.accel_bias_down_mps2);
        self.position_m += (self.velocity_mps + self.accel_mps2 * (0.5 * dt_s)) * dt_s;
        self.velocity_mps += self.accel_mps2 * dt_s;
        self.north.predict(dt_s);
        self.east.predict(dt_s);
        self.down.predict(dt_s);
        self.yaw.predict(dt_s);
        if self.past.len() == N_KEPT {
            self.past.pop_front();
        }
        self.past.push_back(Past {
            at,
            position_m: self.position_m,
            velocity_mps: self.velocity_mps,
            yaw_rad: self.yaw_rad(),
        });
    }

    /// Heading, rad.
    pub(super) fn yaw_rad(&self) -> f64 {
        self.attitude.euler_angles().2
    }

    /// The entry nearest to `at`; `None` if `at` is older than all.
    pub(super) fn past_at(&self, at: Stamp<Boot>) -> Option<Past> {
        let next = self.past.partition_point(|past| past.at < at);
        let after = self.past.get(next).or_else(|| self.past.back())?;
        let Some(before) = next.checked_sub(1).and_then(|index| self.past.get(index)) else {
            return (after.at == at).then_some(*after);
        };
        let is_before_nearer = at.nanos_since(before.at) < after.at.nanos_since(at).abs();
        Some(if is_before_nearer { *before } else { *after })
    }

    /// Fuses a horizontal measurement: `axis` 0 north or 1 east, `index` of the chain.
    pub(super) fn fuse_horizontal(&mut self, axis: usize, index: usize, innov: f64, var: f64) {
        let chain = if axis == 0 { &mut self.north } else { &mut self.east };
        let step = chain.fuse(index, innov, var);
        self.shift(axis, step[0], step[1]);
        let (tilt, bias) = (step[2] / GRAVITY_MPS2, step[3] / GRAVITY_MPS2);
        if axis == 0 {
            self.turn(&Vector3::new(0.0, -tilt, 0.0), &Vector3::new(0.0, bias, 0.0));
        } else {
            self.turn(&Vector3::new(tilt, 0.0, 0.0), &Vector3::new(-bias, 0.0, 0.0));
        }
    }

    /// Fuses a measurement of the vertical chain.
    pub(super) fn fuse_down(&mut self, index: usize, innov: f64, var: f64) {
        let step = self.down.fuse(index, innov, var);
        self.shift(2, step[0], step[1]);
        self.accel_bias_down_mps2 += step[2];
    }

    /// Fuses a measurement of the heading chain.
    pub(super) fn fuse_yaw(&mut self, index: usize, innov: f64, var: f64) {
        let step = self.yaw.fuse(index, innov, var);
        self.turn(&Vector3::new(0.0, 0.0, step[0]), &Vector3::new(0.0, 0.0, -step[1]));
        for past in &mut self.past {
            past.yaw_rad += step[0];
        }
    }

    /// Takes the heading from the compass: at once the first time.
    pub(super) fn follow_compass(&mut self, compass_rad: f64, is_aligned: bool) {
        let off_rad = wrapped_rad(compass_rad - self.yaw_rad());
        if is_aligned {
            self.fuse_yaw(0, off_rad, COMPASS_VAR_RAD2);
        } else {
            self.reset_yaw(off_rad, COMPASS_VAR_RAD2);
        }
    }

    /// At rest, every rate that is measured is bias and every velocity is zero.
    pub(super) fn fuse_rest(&mut self) {
        const RATE_VAR: f64 = 0.01 * 0.01;
        const VELOCITY_VAR: f64 = 0.05 * 0.05;
        let rate = self.attitude * self.rate_radps;
        let g = GRAVITY_MPS2;
        self.fuse_horizontal(0, 3, g * rate.y, g * g * RATE_VAR);
        self.fuse_horizontal(1, 3, -g * rate.x, g * g * RATE_VAR);
        self.fuse_yaw(1, -rate.z, RATE_VAR);
        for axis in 0..2 {
            self.fuse_horizontal(axis, 1, -self.velocity_mps[axis], VELOCITY_VAR);
        }
        self.fuse_down(1, -self.velocity_mps.z, VELOCITY_VAR);
    }

    /// Moves position and velocity of one axis, and the memory with them.
    fn shift(&mut self, axis: usize, position_m: f64, velocity_mps: f64) {
        self.position_m[axis] += position_m;
        self.velocity_mps[axis] += velocity_mps;
        for past in &mut self.past {
            past.position_m[axis] += position_m;
            past.velocity_mps[axis] += velocity_mps;
        }
    }

    /// Turns the attitude by δθ and moves the gyroscope's bias by δb, both given in NED.
    fn turn(&mut self, delta_rad: &Vector3<f64>, bias_radps: &Vector3<f64>) {
        self.gyro_bias_radps += self.attitude.inverse() * bias_radps;
        self.attitude = UnitQuaternion::from_scaled_axis(*delta_rad) * self.attitude;
    }

    /// Puts the position of one axis where `delta_m` says, with a new variance.
    pub(super) fn reset_position(&mut self, axis: usize, delta_m: f64, var: f64) {
        self.shift(axis, delta_m, 0.0);
        match axis {
            0 => self.north.reset(0, var),
            1 => self.east.reset(0, var),
            _ => self.down.reset(0, var),
        }
    }

    /// Turns the heading by `delta_rad`, with a new variance.
    pub(super) fn reset_yaw(&mut self, delta_rad: f64, var: f64) {
        self.turn(&Vector3::new(0.0, 0.0, delta_rad), &Vector3::zeros());
        for past in &mut self.past {
            past.yaw_rad += delta_rad;
        }
        self.yaw.reset(0, var);
    }
}
