//! Inertial samples.

use crate::time::{Mono, Stamp};
use nalgebra::Vector3;

/// One sample of the autopilot's inertial sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// When it was measured.
    pub at: Stamp<Mono>,
    /// Specific force in `Body` axes, m/s²; (0, 0, +9.8) at rest and level.
    pub accel_mps2: Vector3<f64>,
    /// Angular velocity of the body against the hall in `Body` axes, rad/s.
    pub gyro_radps: Vector3<f64>,
}

impl ImuSample {
    /// True if no field is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.accel_mps2.iter().chain(self.gyro_radps.iter()).all(|v| v.is_finite())
    }
}
