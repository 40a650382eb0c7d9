//! What the vehicle can touch.

use stockpilot::geometry::{Hall, Point};
use stockpilot::time::{Mono, Stamp};

/// The part of the world that the vehicle meets.
pub struct Surroundings<'world> {
    /// Height of the ground (floor, pad or pile) at x, y in the hall, m.
    pub ground_height_m: &'world dyn Fn(f64, f64) -> f64,
    /// True if a point lies inside a wall, a pillar, the roof or a pile.
    pub is_solid: &'world dyn Fn(&Point<Hall>) -> bool,
}

impl std::fmt::Debug for Surroundings<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Surroundings").finish_non_exhaustive()
    }
}

impl Surroundings<'_> {
    /// A level floor at height 0 without anything on it.
    #[must_use]
    pub fn open_floor() -> Surroundings<'static> {
        Surroundings { ground_height_m: &|_, _| 0.0, is_solid: &|_| false }
    }
}

/// The first time the vehicle hit something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// When.
    pub at: Stamp<Mono>,
    /// The point of the hull that hit, or the body origin on a hard landing.
    pub place: Point<Hall>,
    /// Speed of the body, m/s.
    pub speed_mps: f64,
}
