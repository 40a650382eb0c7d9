//! A path that is thought of, with what each of its legs would see.

use crate::mapping::belief::Sightings;
use crate::planning::Waypoint;
use std::sync::Arc;

/// Waypoints behind the start, and what they come to.
#[derive(Debug, Clone)]
pub(super) struct Path {
    pub(super) waypoints: Vec<Waypoint>,
    /// What is seen on the way to each waypoint.
    pub(super) legs: Vec<Arc<Sightings>>,
    /// Metres of the path.
    pub(super) length_m: f64,
    /// What they cost, waiting for turns included, m.
    pub(super) cost_m: f64,
    /// σ^V at its end, m³.
    pub(super) sigma_m3: f64,
    /// What the search makes small.
    pub(super) score: f64,
}
