//! Motion of the airframe under thrust, torque, gravity, drag and the ground.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::units::GRAVITY_MPS2;

/// Mass, inertia and drag of the airframe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBodySettings {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Principal moments of inertia about the axes of `Body`, kg·m².
    pub inertia_kgm2: Vector3<f64>,
    /// Drag force over air speed, N/(m/s).
    pub drag_n_per_mps: f64,
    /// Drag torque over angular velocity, N·m/(rad/s).
    pub angular_drag_nm_per_radps: f64,
    /// Height of the body origin over the ground when the vehicle stands, m.
    pub gear_height_m: f64,
}

impl Default for RigidBodySettings {
    fn default() -> Self {
        Self {
            mass_kg: 1.5,
            inertia_kgm2: Vector3::new(0.018, 0.018, 0.032),
            drag_n_per_mps: 0.35,
            angular_drag_nm_per_radps: 0.003,
            gear_height_m: 0.15,
        }
    }
}

/// Where the body is and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionState {
    /// Body origin in the hall, m.
    pub position_m: Vector3<f64>,
    /// Takes `Body` axes to `Hall` axes.
    pub attitude: UnitQuaternion<f64>,
    /// Velocity in `Hall` axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity in `Body` axes, rad/s.
    pub rate_radps: Vector3<f64>,
}

impl MotionState {
    /// At rest at a pose.
    #[must_use]
    pub fn at_rest(pose: &Transform<Hall, Body>) -> Self {
        Self {
            position_m: pose.origin.coords,
            attitude: *pose.rotation.quaternion(),
            velocity_mps: Vector3::zeros(),
            rate_radps: Vector3::zeros(),
        }
    }

    /// Pose of the body in the hall.
    #[must_use]
    pub fn hall_from_body(&self) -> Transform<Hall, Body> {
        Transform::new(
            Rotation::from_quaternion(self.attitude),
            Point::from_coords(self.position_m),
        )
    }
}

/// How fast a standing vehicle loses its tilt, 1/s.
const LEVELLING_PER_S: f64 = 20.0;

/// Forces and torques of one step, besides gravity, drag and the ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    /// Thrust along +z of `Body`, N.
    pub(super) thrust_n: f64,
    /// Torque in `Body` axes, N·m.
    pub(super) torque_nm: Vector3<f64>,
    /// Velocity of the air in `Hall` axes, m/s.
    pub(super) wind_mps: Vector3<f64>,
    /// Height of the ground under the body, m.
    pub(super) ground_height_m: f64,
}

/// What a step did.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Specific force in `Body` axes, m/s².
    pub(super) specific_force_mps2: Vector3<f64>,
    /// Downward speed with which the ground was met in this step, m/s.
    pub(super) impact_mps: Option<f64>,
    /// The ground carries the vehicle.
    pub(super) is_on_ground: bool,
}

/// Moves `state` by `step_s` (semi-implicit in attitude, exact for constant acceleration).
pub(super) fn advance(
    settings: &RigidBodySettings,
    state: &mut MotionState,
    load: &Load,
    step_s: f64,
) -> Step {
    let gravity = Vector3::new(0.0, 0.0, -GRAVITY_MPS2);
    let lift = state.attitude * Vector3::new(0.0, 0.0, load.thrust_n);
    let drag = (load.wind_mps - state.velocity_mps) * settings.drag_n_per_mps;
    let accel = (lift + drag) / settings.mass_kg + gravity;

    let floor_m = load.ground_height_m + settings.gear_height_m;
    let next_z = state.position_m.z + (state.velocity_mps.z + 0.5 * accel.z * step_s) * step_s;
    if next_z <= floor_m && (accel.z <= 0.0 || state.velocity_mps.z < 0.0) {
        return stand(state, floor_m, &gravity, step_s);
    }
    state.position_m += (state.velocity_mps + accel * (0.5 * step_s)) * step_s;
    state.velocity_mps += accel * step_s;
    let before = state.attitude;
    turn(settings, state, &load.torque_nm, step_s);
    // The force is constant in the hall over the step, and felt in the attitudes on the way.
    let middle = before.nlerp(&state.attitude, 0.5);
    Step {
        specific_force_mps2: middle.inverse() * (accel - gravity),
        impact_mps: None,
        is_on_ground: false,
    }
}

/// J ω̇ = τ − ω × J ω − d ω, then q ← q ⊗ exp(ω dt).
fn turn(
    settings: &RigidBodySettings,
    state: &mut MotionState,
    torque_nm: &Vector3<f64>,
    step_s: f64,
) {
    let rate = state.rate_radps;
    let momentum = settings.inertia_kgm2.component_mul(&rate);
    let torque = torque_nm - rate.cross(&momentum) - rate * settings.angular_drag_nm_per_radps;
    state.rate_radps += torque.component_div(&settings.inertia_kgm2) * step_s;
    state.attitude = turned(&state.attitude, &(state.rate_radps * step_s));
}

/// q ⊗ exp(δ) for a rotation of one step; its error of δ³/24 is far below a microradian.
fn turned(attitude: &UnitQuaternion<f64>, delta_rad: &Vector3<f64>) -> UnitQuaternion<f64> {
    let half = delta_rad * 0.5;
    let step = Quaternion::new(1.0 - 0.5 * half.norm_squared(), half.x, half.y, half.z);
    UnitQuaternion::new_normalize(attitude.quaternion() * step)
}

/// Keeps the vehicle on its gear: no bounce, no sliding, the tilt goes away.
fn stand(state: &mut MotionState, floor_m: f64, gravity: &Vector3<f64>, step_s: f64) -> Step {
    let arrival_mps = state.velocity_mps;
    state.position_m.z = floor_m;
    state.velocity_mps = Vector3::zeros();
    let up = state.attitude.inverse() * Vector3::z();
    state.rate_radps = Vector3::z().cross(&up) * LEVELLING_PER_S;
    state.attitude = turned(&state.attitude, &(state.rate_radps * step_s));
    let accel = -arrival_mps / step_s;
    Step {
        specific_force_mps2: state.attitude.inverse() * (accel - gravity),
        impact_mps: (arrival_mps.z < 0.0).then_some(-arrival_mps.z),
        is_on_ground: true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAR_BELOW_M: f64 = -1e9;

    fn load(thrust_n: f64) -> Load {
        Load {
            thrust_n,
            torque_nm: Vector3::zeros(),
            wind_mps: Vector3::zeros(),
            ground_height_m: FAR_BELOW_M,
        }
    }

    fn level_at(z_m: f64) -> MotionState {
        MotionState::at_rest(&Transform::new(Rotation::identity(), Point::new(1.0, 2.0, z_m)))
    }

    #[test]
    fn falls_freely_without_drag() {
        let settings = RigidBodySettings { drag_n_per_mps: 0.0, ..RigidBodySettings::default() };
        let mut state = level_at(100.0);
        let mut felt = Vector3::x();
        for _ in 0..2000 {
            felt = advance(&settings, &mut state, &load(0.0), 1e-3).specific_force_mps2;
        }
        // ½ g t² with t = 2 s; a falling accelerometer feels nothing.
        assert!((state.position_m.z - (100.0 - 19.6133)).abs() < 1e-9);
        assert!((state.velocity_mps.z + 19.6133).abs() < 1e-9);
        assert!(felt.norm() < 1e-12);
    }

    #[test]
    fn drag_ends_at_the_terminal_velocity() {
        let settings = RigidBodySettings::default();
        let mut state = level_at(0.0);
        for _ in 0..60_000 {
            advance(&settings, &mut state, &load(0.0), 1e-3);
        }
        // m g / d = 1.5 · 9.80665 / 0.35 = 42.0285 m/s.
        assert!((state.velocity_mps.z + 42.0285).abs() < 1e-3);
    }

    #[test]
    fn constant_torque_turns_by_the_closed_form() {
        let settings =
            RigidBodySettings { angular_drag_nm_per_radps: 0.0, ..RigidBodySettings::default() };
        let mut state = level_at(0.0);
        let turning = Load { torque_nm: Vector3::new(0.0, 0.0, 0.032), ..load(0.0) };
        for _ in 0..1000 {
            advance(&settings, &mut state, &turning, 1e-3);
        }
        // 0.032 N·m on 0.032 kg·m² is 1 rad/s²: 1 rad/s and half a radian after 1 s,
        // and half a step more because the rate is advanced before the angle.
        assert!((state.rate_radps.z - 1.0).abs() < 1e-9);
        assert!((state.attitude.euler_angles().2 - 0.5005).abs() < 1e-6);
    }

    #[test]
    fn standing_reads_gravity_and_levels_out() {
        let settings = RigidBodySettings::default();
        let mut state = level_at(0.2);
        state.attitude = UnitQuaternion::from_euler_angles(0.1, -0.2, 1.0);
        let ground = Load { ground_height_m: 0.0, ..load(3.0) };
        let mut last = advance(&settings, &mut state, &ground, 1e-3);
        for _ in 0..1000 {
            last = advance(&settings, &mut state, &ground, 1e-3);
        }
        assert!(last.is_on_ground);
        assert!((state.position_m.z - 0.15).abs() < 1e-12);
        assert!((last.specific_force_mps2 - Vector3::new(0.0, 0.0, 9.806_65)).norm() < 1e-6);
        let (roll, pitch, yaw) = state.attitude.euler_angles();
        assert!(roll.abs() < 1e-6 && pitch.abs() < 1e-6);
        assert!((yaw - 1.0).abs() < 0.03);
    }
}
