//! Four rotors: speed with a lag, thrust and drag torque from speed.

use nalgebra::Vector3;

/// Speed of each rotor as a share of the highest, 0 to 1.
///
/// Order and places are those of PX4's quadrotor in X, seen from above:
///
/// ```text
///        front
///   2 (cw)    0 (ccw)
///         \  /
///         /  \
///   1 (ccw)   3 (cw)
/// ```
pub type MotorCommands = [f64; 4];

/// Geometry and strength of the rotors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorSettings {
    /// Thrust of one rotor at full speed, N.
    pub max_thrust_n: f64,
    /// Drag torque over thrust, m.
    pub torque_per_thrust_m: f64,
    /// Distance of the hubs from the centre along x and along y, m.
    pub arm_m: f64,
    /// Time constant of the speed, s.
    pub lag_s: f64,
    /// Electrical power over thrust to the power 3/2, W/N^1.5.
    ///
    /// ```text
    /// P = T^1.5 / (η √(2 ρ A))      η = 0.36, ρ = 1.225 kg/m³, A = 0.0507 m² (10 inch)
    /// ```
    pub power_w_per_n15: f64,
}

impl Default for RotorSettings {
    fn default() -> Self {
        Self {
            max_thrust_n: 8.0,
            torque_per_thrust_m: 0.016,
            arm_m: 0.16,
            lag_s: 0.033,
            power_w_per_n15: 7.88,
        }
    }
}

/// Signs of (x, y) of each hub in `Body`, and of the torque its drag puts on the body about z.
///
/// A rotor that turns counter-clockwise seen from above pushes the body clockwise.
const HUBS: [(f64, f64, f64); 4] =
    [(1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (1.0, 1.0, 1.0), (-1.0, -1.0, 1.0)];

/// The rotors and their present speed.
#[derive(Debug, Clone)]
pub struct Rotors {
    settings: RotorSettings,
    /// Share of the highest speed, 0 to 1.
    speed_ratio: [f64; 4],
    /// Share of the speed error that is left after one step.
    kept: f64,
}

impl Rotors {
    /// Rotors at rest that are moved in steps of `step_s`, s.
    #[must_use]
    pub fn new(settings: RotorSettings, step_s: f64) -> Self {
        Self { settings, speed_ratio: [0.0; 4], kept: (-step_s / settings.lag_s).exp() }
    }

    /// Lets the speeds follow the commands for one step; commands outside 0 to 1 saturate.
    pub fn step(&mut self, commands: &MotorCommands) {
        for (speed, command) in self.speed_ratio.iter_mut().zip(commands) {
            let target = if command.is_finite() { command.clamp(0.0, 1.0) } else { 0.0 };
            *speed = target + (*speed - target) * self.kept;
        }
    }

    /// Thrust of each rotor along +z of `Body`, N.
    #[must_use]
    pub fn thrusts_n(&self) -> [f64; 4] {
        self.speed_ratio.map(|ratio| self.settings.max_thrust_n * ratio * ratio)
    }

    /// Sum of the thrusts, N, and the torque on the body in `Body` axes, N·m.
    #[must_use]
    pub fn wrench(&self) -> (f64, Vector3<f64>) {
        let arm = self.settings.arm_m;
        let mut total = 0.0;
        let mut torque = Vector3::zeros();
        for (thrust, (x, y, spin)) in self.thrusts_n().into_iter().zip(HUBS) {
            total += thrust;
            // r × T e_z = (y T, −x T, 0)
            torque.x += y * arm * thrust;
            torque.y -= x * arm * thrust;
            torque.z += spin * self.settings.torque_per_thrust_m * thrust;
        }
        (total, torque)
    }

    /// Electrical power of all rotors, W.
    #[must_use]
    pub fn power_w(&self) -> f64 {
        let sum: f64 = self.thrusts_n().iter().map(|thrust| thrust * thrust.sqrt()).sum();
        self.settings.power_w_per_n15 * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settled(commands: MotorCommands) -> Rotors {
        let mut rotors = Rotors::new(RotorSettings::default(), 1e-3);
        for _ in 0..1000 {
            rotors.step(&commands);
        }
        rotors
    }

    #[test]
    fn speed_reaches_63_percent_after_one_lag() {
        let mut rotors = Rotors::new(RotorSettings::default(), 1e-3);
        for _ in 0..33 {
            rotors.step(&[1.0; 4]);
        }
        // 1 − 1/e of the speed, squared for the thrust.
        let expected = 8.0 * (1.0 - (-1.0_f64).exp()).powi(2);
        assert!((rotors.thrusts_n()[0] - expected).abs() < 1e-9);
    }

    #[test]
    fn left_pair_rolls_to_the_right_by_the_closed_form() {
        // Left rotors (1, 2) at full thrust, right ones off: τ_x = 2 · 8 N · 0.16 m; no yaw, no pitch.
        let (total, torque) = settled([0.0, 1.0, 1.0, 0.0]).wrench();
        assert!((total - 16.0).abs() < 1e-9);
        assert!((torque - Vector3::new(2.56, 0.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn clockwise_pair_turns_the_body_counter_clockwise() {
        let (_, torque) = settled([0.0, 0.0, 1.0, 1.0]).wrench();
        assert!((torque - Vector3::new(0.0, 0.0, 0.256)).norm() < 1e-9);
    }

    #[test]
    fn commands_saturate() {
        assert!((settled([7.0; 4]).wrench().0 - 32.0).abs() < 1e-9);
        assert!(settled([f64::NAN, -3.0, 0.0, 0.0]).wrench().0 < 1e-12);
    }
}
