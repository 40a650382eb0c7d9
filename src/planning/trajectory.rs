//! Smooth motion through waypoints: segments of least snap, continuous up to the jerk, in position
//! and heading.
//!
//! ```text
//! x(t) = Σ_{k=0..7} c_k t^k per segment, fixed by x, ẋ, ẍ, x⃛ at both ends      x = (p, ψ)
//! |v| ≤ v_max   |a| ≤ a_max   |j| ≤ j_max   |s| ≤ s_max   |ψ̇| ≤ ω_max   |ψ̈| ≤ α_max
//! ```
//! - Every trajectory ends at rest. So the last one that was found can always be flown to its
//!   end, and a new one is only taken if it begins in the very state of the old one.
//! - Bounds hold on the whole curve: they are judged by control points, whose hull holds the
//!   curve, split until decided (`bezier`). Tolerance: 1e-9 of a bound.
//! - The duration of each segment is its shortest one within the bounds, to 0.1 %; the speeds at
//!   the waypoints are chosen by rules and improved (`course`).
//! - Corners are not cut: the curve passes through each waypoint, and swings out beside it.
//!   [`Trajectory::departure_m`] says how far; [`Trajectory::through_free`] lets the caller judge
//!   the curve, and falls back to straight legs.
//!
//! Source: Mellinger and Kumar 2011, section IV (least snap); Richter, Bry and Roy 2013 (times).

mod bezier;
mod brake;
mod chain;
mod course;
mod segment;

pub use chain::Trajectory;

use crate::geometry::{Hall, Point};
use crate::units::wrapped_rad;
use nalgebra::Vector3;
use segment::Segment;

/// What the vehicle can follow closely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest speed, m/s.
    pub speed_mps: f64,
    /// Largest acceleration, m/s².
    pub accel_mps2: f64,
    /// Largest jerk, m/s³. Over gravity it is the rate of the tilt, rad/s.
    pub jerk_mps3: f64,
    /// Largest snap, m/s⁴. Over gravity it is the angular acceleration of the tilt, rad/s².
    pub snap_mps4: f64,
    /// Largest rate of the heading, rad/s.
    pub yaw_rate_radps: f64,
    /// Largest acceleration of the heading, rad/s².
    pub yaw_accel_radps2: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            speed_mps: 2.0,
            accel_mps2: 2.0,
            jerk_mps3: 12.0,
            snap_mps4: 150.0,
            yaw_rate_radps: std::f64::consts::FRAC_PI_4,
            yaw_accel_radps2: std::f64::consts::FRAC_PI_2,
        }
    }
}

impl Limits {
    /// What an emergency may use: half as much acceleration again, three times the jerk, six times
    /// the snap, twice the angular acceleration of the heading.
    #[must_use]
    pub fn in_emergency(&self) -> Self {
        Self {
            accel_mps2: 1.5 * self.accel_mps2,
            jerk_mps3: 3.0 * self.jerk_mps3,
            snap_mps4: 6.0 * self.snap_mps4,
            yaw_accel_radps2: 2.0 * self.yaw_accel_radps2,
            ..*self
        }
    }
}

/// Heading and its derivatives at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Yaw {
    /// Heading, rad; goes on beyond ±π along a trajectory.
    pub angle_rad: f64,
    /// rad/s.
    pub rate_radps: f64,
    /// rad/s².
    pub accel_radps2: f64,
    /// rad/s³.
    pub jerk_radps3: f64,
}

impl Yaw {
    /// A heading that stays.
    #[must_use]
    pub const fn at_rest(angle_rad: f64) -> Self {
        Self { angle_rad, rate_radps: 0.0, accel_radps2: 0.0, jerk_radps3: 0.0 }
    }

    const fn derivatives(&self) -> [[f64; 1]; 4] {
        [[self.angle_rad], [self.rate_radps], [self.accel_radps2], [self.jerk_radps3]]
    }
}

/// The state of motion at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// Position in the hall, m.
    pub position: Vector3<f64>,
    /// Velocity in hall axes, m/s.
    pub velocity: Vector3<f64>,
    /// Acceleration in hall axes, m/s².
    pub accel: Vector3<f64>,
    /// Jerk in hall axes, m/s³.
    pub jerk: Vector3<f64>,
    /// Heading.
    pub yaw: Yaw,
}

impl Knot {
    /// At rest.
    #[must_use]
    pub fn at_rest(position: Vector3<f64>, yaw_rad: f64) -> Self {
        Self::steady(position, Vector3::zeros(), yaw_rad)
    }

    /// At a constant velocity and heading.
    #[must_use]
    pub fn steady(position: Vector3<f64>, velocity: Vector3<f64>, yaw_rad: f64) -> Self {
        let none = Vector3::zeros();
        Self { position, velocity, accel: none, jerk: none, yaw: Yaw::at_rest(yaw_rad) }
    }

    /// True if nothing moves, to rounding.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.is_steady() && self.velocity.norm() < AT_REST && self.yaw.rate_radps.abs() < AT_REST
    }

    fn is_steady(&self) -> bool {
        self.accel.norm() < AT_REST
            && self.jerk.norm() < AT_REST
            && self.yaw.accel_radps2.abs() < AT_REST
    }

    fn derivatives(&self) -> [[f64; 3]; 4] {
        [self.position.into(), self.velocity.into(), self.accel.into(), self.jerk.into()]
    }
}

/// Derivatives below this are rounding.
const AT_REST: f64 = 1e-9;
/// Waypoints closer than this are one, m and rad.
const SAME: f64 = 1e-3;
/// What a curve must keep clear of.
#[derive(Clone, Copy)]
pub struct Corridor<'a> {
    /// Judges a position in the hall and a heading, rad.
    pub is_free: &'a dyn Fn(&Point<Hall>, f64) -> bool,
    /// It is asked along the curve at places that are this far apart at most, m.
    pub spacing_m: f64,
}

impl std::fmt::Debug for Corridor<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Corridor").field("spacing_m", &self.spacing_m).finish_non_exhaustive()
    }
}

impl Corridor<'_> {
    fn holds(&self, segment: &Segment) -> bool {
        let is_free = |place: &Vector3<f64>, yaw_rad: f64| {
            (self.is_free)(&Point::from_coords(*place), wrapped_rad(yaw_rad))
        };
        segment.is_free(self.spacing_m, &is_free)
    }
}

/// Why there is no trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoWay {
    /// From the present motion no way begins within the limits yet.
    #[error("the present motion leaves no way within the limits yet")]
    TooFast,
    /// Not even the straight leg to this waypoint is free; or the motion does not allow it.
    #[error("the leg to waypoint {waypoint} is not free")]
    Blocked {
        /// Its index.
        waypoint: usize,
    },
}

#[cfg(test)]
mod tests;
