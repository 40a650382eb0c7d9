//! Where to look next, and how to get there.
//!
//! [`free_space`] says where the vehicle may be and still know where it is: [`clearance`] is its
//! geometry, [`quality_grid`] its fixes. Planners ([`planner`]) choose waypoints there:
//! [`square_wave`], the default, [`greedy`] and [`horizon`], or a program outside ([`external`]).
//! After a survey [`gap_way`] leads over what it left out. [`trajectory`] joins them within the airframe's bounds.

pub mod clearance;
pub mod external;
pub mod free_space;
pub mod gap_way;
pub mod greedy;
pub mod grid_axis;
pub mod height_view;
pub mod horizon;
pub mod marker_plan;
pub mod planner;
pub mod quality_grid;
pub mod sight;
pub mod space;
pub mod square_wave;
pub mod trajectory;
pub mod way;
pub mod what_if;

use crate::geometry::{Body, Hall, Point, Rotation, Transform};
use crate::mapping::region::Rect;
use crate::units::wrapped_rad;

/// Who chooses the waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlannerKind {
    /// Parallel legs at equal distance.
    #[default]
    SquareWave,
    /// The paper's: always the next waypoint that leaves the smallest σ^V.
    Greedy,
    /// Whole paths, scored by the σ^V that they leave.
    Horizon,
    /// A program outside: see [`external`].
    External,
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
    /// The survey ends once σ^V/V is this small; `None`: it flies all its waypoints.
    pub target_ratio: Option<f64>,
    /// Distance of neighbouring legs of the square wave, m; `None`: whatever leaves the smallest σ^V.
    pub leg_spacing_m: Option<f64>,
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
    /// Standard deviation of the slope of ground that is not known, no unit.
    pub slope_sigma: f64,
    /// What the map knows hides what is behind it; otherwise predictions see a flat surface.
    pub sees_shadows: bool,
    /// Variance of the filter's pose over that of one fix, as predictions assume it.
    pub fix_var_share: f64,
    /// Seed of the search for paths.
    pub seed: u64,
    /// Changes of paths that the search tries, over their usual number; the paths that it begins with are always looked at.
    pub search_effort: f64,
    /// The program that plans, if one does.
    pub external: Option<external::ExternalSettings>,
    /// Bounds of the trajectory.
    pub limits: trajectory::Limits,
    /// What the vehicle keeps away from.
    pub space: space::SpaceSettings,
}

impl Settings {
    /// Usual settings for waypoints inside `bounds`.
    #[must_use]
    pub fn over(bounds: Rect) -> Self {
        Self {
            planner: PlannerKind::default(),
            n_steps: 50,
            height_m: 7.0,
            yaw_rad: 0.0,
            bounds,
            target_ratio: None,
            leg_spacing_m: None,
            step_radius_m: 2.0,
            candidate_spacing_m: 1.0,
            nominal_height_m: 1.5,
            swath_half_angle_rad: 0.87,
            min_fix_quality: 2.0,
            slope_sigma: 0.6,
            sees_shadows: false,
            fix_var_share: 0.1,
            seed: 0,
            search_effort: 1.0,
            external: None,
            limits: trajectory::Limits::default(),
            space: space::SpaceSettings::default(),
        }
    }
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

    /// The place and the heading at this share of the straight way to another waypoint, turning the
    /// shorter way.
    #[must_use]
    pub fn towards(&self, other: &Self, share: f64) -> Self {
        Self {
            place: Point::from_coords(self.place.coords.lerp(&other.place.coords, share)),
            yaw_rad: self.yaw_rad + wrapped_rad(other.yaw_rad - self.yaw_rad) * share,
        }
    }

    /// The waypoints of the straight leg to another one, no further apart than a step, m.
    #[must_use]
    pub fn steps_to(&self, to: &Self, step_m: f64) -> Vec<Self> {
        let n_parts = self.n_steps_to(to, step_m);
        std::iter::successors(Some(1.0), |k| (*k < n_parts).then_some(k + 1.0))
            .map(|k| self.towards(to, k / n_parts))
            .collect()
    }

    /// How many they are, one at least: a whole number.
    #[must_use]
    pub fn n_steps_to(&self, to: &Self, step_m: f64) -> f64 {
        (self.distance_m(to) / step_m - 1e-9).ceil().max(1.0)
    }

    /// The pose of a level body there.
    #[must_use]
    pub fn level_pose(&self) -> Transform<Hall, Body> {
        Transform::new(Rotation::from_euler_rad(0.0, 0.0, self.yaw_rad), self.place)
    }
}
