//! The cascade: position → velocity → acceleration → attitude and thrust → rates → rotors.

use super::estimator::Belief;
use super::limits::Limits;
use super::mixer::Airframe;
use super::setpoint::Target;
use crate::vehicle::MotorCommands;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use stockpilot::units::{GRAVITY_MPS2, wrapped_rad};

/// Gains of the airframe; x, y, z or roll, pitch, yaw.
const POSITION_P_PER_S: Vector3<f64> = Vector3::new(1.8, 1.8, 1.4);
const VELOCITY_P_PER_S: Vector3<f64> = Vector3::new(4.5, 4.5, 4.0);
const VELOCITY_I_PER_S2: Vector3<f64> = Vector3::new(1.5, 1.5, 2.0);
const ATTITUDE_P_PER_S: Vector3<f64> = Vector3::new(9.0, 9.0, 3.0);
const RATE_P_PER_S: Vector3<f64> = Vector3::new(24.0, 24.0, 6.0);
const RATE_I_PER_S2: Vector3<f64> = Vector3::new(20.0, 20.0, 3.0);
const MAX_RATE_RADPS: Vector3<f64> = Vector3::new(3.8, 3.8, 1.5);
/// Bound of the velocity loop's integral, m/s².
const MAX_INTEGRAL_MPS2: f64 = 4.0;
/// Bound of the rate loop's integral, rad/s².
const MAX_RATE_INTEGRAL: f64 = 8.0;
/// Time constant of the learned hover thrust, s.
const HOVER_TIME_S: f64 = 3.0;
/// Rotor command of an armed vehicle that waits on the ground.
const IDLE: f64 = 0.08;

/// State of the cascade.
#[derive(Debug, Clone)]
pub(super) struct Controller {
    airframe: Airframe,
    velocity_integral_mps2: Vector3<f64>,
    rate_integral: Vector3<f64>,
    hover_thrust_n: f64,
    thrust_n: f64,
    velocity_sp_mps: Vector3<f64>,
    yaw_sp_rad: f64,
}

impl Controller {
    pub(super) fn new(hover_ratio: f64) -> Self {
        let airframe = Airframe::NOMINAL;
        Self {
            airframe,
            velocity_integral_mps2: Vector3::zeros(),
            rate_integral: Vector3::zeros(),
            hover_thrust_n: hover_ratio * airframe.max_total_n(),
            thrust_n: 0.0,
            velocity_sp_mps: Vector3::zeros(),
            yaw_sp_rad: 0.0,
        }
    }

    /// Rotors turn without lifting; the integrals start anew.
    pub(super) fn idle(&mut self, belief: &Belief) -> MotorCommands {
        self.velocity_integral_mps2 = Vector3::zeros();
        self.rate_integral = Vector3::zeros();
        self.thrust_n = 0.0;
        self.velocity_sp_mps = Vector3::zeros();
        self.yaw_sp_rad = belief.yaw_rad;
        [IDLE; 4]
    }

    /// Collective thrust over that of hovering.
    pub(super) fn thrust_ratio(&self) -> f64 {
        self.thrust_n / self.hover_thrust_n
    }

    /// Wanted velocity downwards, m/s.
    pub(super) fn sink_wanted_mps(&self) -> f64 {
        self.velocity_sp_mps.z
    }

    /// One step of the whole cascade. `climb_limit_mps` bounds the wanted velocity upwards.
    pub(super) fn step(
        &mut self,
        belief: &Belief,
        target: &Target,
        limits: &Limits,
        climb_limit_mps: f64,
        dt_s: f64,
    ) -> MotorCommands {
        self.velocity_sp_mps = wanted_velocity(belief, target, limits, climb_limit_mps);
        let accel_sp = self.wanted_accel(belief, target, dt_s);
        let up = thrust_direction(&accel_sp, limits.tilt_rad);
        let hover = self.hover_thrust_n;
        let lift = (hover * (1.0 - accel_sp.z / GRAVITY_MPS2)).max(0.1 * hover);
        self.thrust_n = (lift / (-up.z)).clamp(0.05 * hover, 0.9 * self.airframe.max_total_n());
        self.learn_hover(belief, dt_s);
        if let Some(yaw_rad) = target.yaw_rad {
            self.yaw_sp_rad = yaw_rad;
        } else {
            let rate = target.yaw_rate_radps.unwrap_or(0.0);
            self.yaw_sp_rad = wrapped_rad(self.yaw_sp_rad + rate * dt_s);
        }
        let attitude_sp = attitude_with(&up, self.yaw_sp_rad);
        let torque = self.torque(belief, &attitude_sp, target.yaw_rate_radps.unwrap_or(0.0), dt_s);
        self.airframe.mixed(self.thrust_n, &torque)
    }

    fn wanted_accel(&mut self, belief: &Belief, target: &Target, dt_s: f64) -> Vector3<f64> {
        let error = self.velocity_sp_mps - belief.velocity_mps;
        let mut accel = Vector3::from(target.accel_mps2.map(|a| a.unwrap_or(0.0)));
        for axis in 0..3 {
            if target.position_m[axis].is_none() && target.velocity_mps[axis].is_none() {
                continue;
            }
            let integral = &mut self.velocity_integral_mps2[axis];
            *integral += VELOCITY_I_PER_S2[axis] * error[axis] * dt_s;
            *integral = integral.clamp(-MAX_INTEGRAL_MPS2, MAX_INTEGRAL_MPS2);
            accel[axis] += VELOCITY_P_PER_S[axis] * error[axis] + *integral;
        }
        accel
    }

    /// Learns the thrust of hovering from the lift that was felt.
    fn learn_hover(&mut self, belief: &Belief, dt_s: f64) {
        let felt = GRAVITY_MPS2 - belief.accel_mps2.z;
        let is_flying = self.thrust_ratio() > 0.6 && felt > 0.7 * GRAVITY_MPS2;
        if is_flying && felt < 1.3 * GRAVITY_MPS2 {
            let lift = self.thrust_n * (belief.attitude * Vector3::z()).z;
            let hover = lift * GRAVITY_MPS2 / felt;
            let before = self.hover_thrust_n;
            self.hover_thrust_n += (hover - before) * (dt_s / HOVER_TIME_S);
            // The integral carried what the hover thrust lacked; keep the sum unchanged.
            let z = &mut self.velocity_integral_mps2.z;
            *z += (1.0 - before / self.hover_thrust_n) * (GRAVITY_MPS2 - *z);
        }
    }

    fn torque(
        &mut self,
        belief: &Belief,
        attitude_sp: &UnitQuaternion<f64>,
        yaw_rate_radps: f64,
        dt_s: f64,
    ) -> Vector3<f64> {
        let error = (belief.attitude.inverse() * attitude_sp).scaled_axis();
        let feed_forward = belief.attitude.inverse() * Vector3::new(0.0, 0.0, yaw_rate_radps);
        let mut rate_sp = ATTITUDE_P_PER_S.component_mul(&error) + feed_forward;
        for axis in 0..3 {
            rate_sp[axis] = rate_sp[axis].clamp(-MAX_RATE_RADPS[axis], MAX_RATE_RADPS[axis]);
        }
        let rate_error = rate_sp - belief.rate_radps;
        self.rate_integral += RATE_I_PER_S2.component_mul(&rate_error) * dt_s;
        self.rate_integral =
            self.rate_integral.map(|i| i.clamp(-MAX_RATE_INTEGRAL, MAX_RATE_INTEGRAL));
        let angular_accel = RATE_P_PER_S.component_mul(&rate_error) + self.rate_integral;
        self.airframe.inertia_kgm2.component_mul(&angular_accel)
    }
}

/// Velocity from the position error plus the feed-forward, bounded.
fn wanted_velocity(
    belief: &Belief,
    target: &Target,
    limits: &Limits,
    climb_limit_mps: f64,
) -> Vector3<f64> {
    let mut wanted = Vector3::from(target.velocity_mps.map(|v| v.unwrap_or(0.0)));
    for axis in 0..3 {
        if let Some(position_m) = target.position_m[axis] {
            wanted[axis] += POSITION_P_PER_S[axis] * (position_m - belief.position_m[axis]);
        }
    }
    let horizontal = wanted.xy().norm();
    let limit = limits.level_mps;
    if horizontal > limit {
        wanted.x *= limit / horizontal;
        wanted.y *= limit / horizontal;
    }
    let up_mps = limits.up_mps.min(climb_limit_mps);
    wanted.z = wanted.z.min(limits.down_mps).max(-up_mps);
    wanted
}

/// Unit vector of the thrust in NED for an acceleration in NED, inside the tilt limit.
fn thrust_direction(accel_mps2: &Vector3<f64>, tilt_limit_rad: f64) -> Vector3<f64> {
    let down = (accel_mps2.z - GRAVITY_MPS2).min(-0.1 * GRAVITY_MPS2);
    let mut thrust = Vector3::new(accel_mps2.x, accel_mps2.y, down);
    let horizontal = thrust.xy().norm();
    let allowed = -down * tilt_limit_rad.tan();
    if horizontal > allowed {
        thrust.x *= allowed / horizontal;
        thrust.y *= allowed / horizontal;
    }
    thrust.normalize()
}

/// FRD attitude in NED whose thrust points along `up` and whose nose has the heading.
fn attitude_with(up: &Vector3<f64>, yaw_rad: f64) -> UnitQuaternion<f64> {
    let z = -up;
    let side = Vector3::new(-yaw_rad.sin(), yaw_rad.cos(), 0.0);
    let x = side.cross(&z).normalize();
    let y = z.cross(&x);
    let axes = Matrix3::from_columns(&[x, y, z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thrust_leans_into_the_acceleration() {
        // 9.80665 m/s² to the north tilts the thrust by 45° and the nose down.
        let up = thrust_direction(&Vector3::new(GRAVITY_MPS2, 0.0, 0.0), 1.0);
        assert!((up - Vector3::new(1.0, 0.0, -1.0).normalize()).norm() < 1e-12);
        let (roll, pitch, yaw) = attitude_with(&up, 0.0).euler_angles();
        assert!(roll.abs() < 1e-9 && yaw.abs() < 1e-9);
        assert!((pitch + 45_f64.to_radians()).abs() < 1e-9);
    }

    #[test]
    fn heading_survives_a_tilt() {
        let up = thrust_direction(&Vector3::new(1.0, -2.0, 0.5), 1.0);
        let attitude = attitude_with(&up, 2.5);
        assert!((attitude * Vector3::new(0.0, 0.0, -1.0) - up).norm() < 1e-9);
        let nose = attitude * Vector3::x();
        assert!((nose.y.atan2(nose.x) - 2.5).abs() < 1e-9);
    }
}
