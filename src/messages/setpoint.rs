//! Where the vehicle shall be.

use crate::geometry::{Direction, Hall, Point};
use crate::time::{Mono, Stamp};

/// One sample of a trajectory: position, velocity and acceleration belong together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// When it applies.
    pub at: Stamp<Mono>,
    /// Body origin.
    pub position: Point<Hall>,
    /// m/s.
    pub velocity_mps: Direction<Hall>,
    /// m/s².
    pub accel_mps2: Direction<Hall>,
    /// Heading of the body's x axis in the hall, rad, from x towards y.
    pub yaw_rad: f64,
    /// rad/s.
    pub yaw_rate_radps: f64,
}

impl Setpoint {
    /// True if no field is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.is_finite()
            && self.velocity_mps.is_finite()
            && self.accel_mps2.is_finite()
            && self.yaw_rad.is_finite()
            && self.yaw_rate_radps.is_finite()
    }
}
