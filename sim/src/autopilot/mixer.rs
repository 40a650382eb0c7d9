//! From collective thrust and torque to rotor commands, for the nominal airframe.

use crate::vehicle::MotorCommands;
use nalgebra::Vector3;

/// The airframe as the autopilot was tuned for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Airframe {
    pub(super) inertia_kgm2: Vector3<f64>,
    pub(super) max_thrust_n: f64,
    arm_m: f64,
    torque_per_thrust_m: f64,
}

impl Airframe {
    pub(super) const NOMINAL: Self = Self {
        inertia_kgm2: Vector3::new(0.018, 0.018, 0.032),
        max_thrust_n: 8.0,
        arm_m: 0.16,
        torque_per_thrust_m: 0.016,
    };

    /// Thrust of all rotors together, N.
    pub(super) fn max_total_n(&self) -> f64 {
        4.0 * self.max_thrust_n
    }

    /// Rotor commands for a collective thrust, N, and a torque in FRD, N·m.
    ///
    /// Roll and pitch win over heading, and heading over thrust.
    pub(super) fn mixed(&self, total_n: f64, torque_nm: &Vector3<f64>) -> MotorCommands {
        // Places of the rotors in FRD: front right, rear left, front left, rear right.
        const PLACES: [(f64, f64, f64); 4] =
            [(1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0)];
        let per_arm = 0.25 / self.arm_m;
        let tilt = PLACES.map(|(x, y, _)| (x * torque_nm.y - y * torque_nm.x) * per_arm);
        let base_n = total_n * 0.25;
        let room = tilt.iter().fold(f64::INFINITY, |room: f64, part| {
            let thrust = (base_n + part).clamp(0.0, self.max_thrust_n);
            room.min(thrust).min(self.max_thrust_n - thrust)
        });
        let wanted = 0.25 * torque_nm.z / self.torque_per_thrust_m;
        let turn = wanted.clamp(-room.max(0.2), room.max(0.2));
        let mut thrusts = [0.0; 4];
        for (index, (_, _, spin)) in PLACES.iter().enumerate() {
            thrusts[index] = base_n + tilt[index] + spin * turn;
        }
        let lowest = thrusts.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = thrusts.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shift = if lowest < 0.0 { -lowest } else { (self.max_thrust_n - highest).min(0.0) };
        thrusts.map(|thrust| ((thrust + shift) / self.max_thrust_n).clamp(0.0, 1.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::{RotorSettings, Rotors};

    #[test]
    fn rotors_give_back_what_was_asked() {
        let asked = Vector3::new(0.2, -0.15, 0.02);
        let commands = Airframe::NOMINAL.mixed(14.0, &asked);
        let mut rotors =
            Rotors::new(RotorSettings { lag_s: 1e-9, ..RotorSettings::default() }, 1e-3);
        rotors.step(&commands);
        let (total, torque) = rotors.wrench();
        assert!((total - 14.0).abs() < 1e-9);
        // FRD against FLU: pitch and yaw change sign.
        assert!((torque - Vector3::new(0.2, 0.15, -0.02)).norm() < 1e-9);
    }
}
