//! Where to look next, and how to get there.
//!
//! [`free_space`] says where the vehicle may be and still know where it is; [`square_wave`] and
//! [`greedy`] choose waypoints there; [`trajectory`] joins them within the airframe's bounds.

pub mod free_space;
pub mod greedy;
pub mod square_wave;
pub mod trajectory;

use crate::geometry::{Body, Hall, Point, Rotation, Transform};
use crate::mapping::region::Rect;

/// Who chooses the waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlannerKind {
    /// Parallel legs at equal distance, the baseline.
    SquareWave,
    /// The paper's: always the next waypoint that leaves the smallest σ^V.
    #[default]
    Greedy,
}

/// What the planning must know before a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Who chooses the waypoints.
    pub planner: PlannerKind,
    /// Waypoints of a survey.
    pub n_steps: usize,
    /// Height of the flight over the hall floor, m.
    pub height_m: f64,
    /// Heading during the survey, rad.
    pub yaw_rad: f64,
    /// Where waypoints may lie.
    pub bounds: Rect,
    /// Distance of neighbouring legs of the square wave, m.
    pub leg_spacing_m: f64,
    /// How far the greedy planner looks, the paper's R, m.
    pub step_radius_m: f64,
    /// Distance of neighbouring candidate waypoints, m.
    pub candidate_spacing_m: f64,
    /// Height of the surface that predictions assume, the paper's h0, m.
    pub nominal_height_m: f64,
    /// Beams beyond this angle from straight down are not counted on, rad.
    pub swath_half_angle_rad: f64,
    /// τ: waypoints need a quality of fix `q_pos` above it.
    pub min_fix_quality: f64,
    /// Bounds of the trajectory.
    pub limits: trajectory::Limits,
}

/// A place to fly to, and the heading there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Where.
    pub place: Point<Hall>,
    /// Heading of the body, rad.
    pub yaw_rad: f64,
}

impl Waypoint {
    /// Distance to another place, m; the heading does not count.
    #[must_use]
    pub fn distance_m(&self, other: &Self) -> f64 {
        (self.place - other.place).coords.norm()
    }

    /// The pose of a level body there.
    #[must_use]
    pub fn level_pose(&self) -> Transform<Hall, Body> {
        Transform::new(Rotation::from_euler_rad(0.0, 0.0, self.yaw_rad), self.place)
    }
}
