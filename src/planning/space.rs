//! What the free space is made of, as it is configured.

use crate::mapping::polygon::Polygon;
use crate::mapping::solid::Solid;

/// Where the vehicle may be at most, whatever else is free.
#[derive(Debug, Clone, PartialEq)]
pub struct Fence {
    /// The body origin stays inside; `None` for no limit sideways.
    pub outline: Option<Polygon>,
    /// Lowest height of the body origin over the hall's zero outside of take-off and landing, m.
    pub min_height_m: f64,
    /// Highest height of the body origin, m.
    pub max_height_m: f64,
}

/// What the vehicle keeps away from, and how finely the quality of a fix is looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceSettings {
    /// Distance of neighbouring places of the grid, along x and y, m.
    pub grid_m: f64,
    /// Distance of neighbouring heights of the grid, m.
    pub height_step_m: f64,
    /// Headings of the grid; the survey's is the first.
    pub n_headings: usize,
    /// Radius of a ball about the body origin that holds the whole vehicle, m.
    pub vehicle_radius_m: f64,
    /// Free room between that ball and walls, ceiling and obstacles, m.
    pub margin_m: f64,
    /// Free room between that ball and the surface below, m.
    pub surface_clearance_m: f64,
    /// No pile is higher than this over the hall's zero, m; `None` if nothing is known.
    pub highest_surface_m: Option<f64>,
    /// Inner faces of the walls; `None` if there are none to keep away from.
    pub walls: Option<Polygon>,
    /// Lower face of the ceiling over the hall's zero, m.
    pub ceiling_m: Option<f64>,
    /// What stands or hangs in the hall.
    pub obstacles: Vec<Solid>,
    /// The geofence.
    pub fence: Option<Fence>,
}

impl Default for SpaceSettings {
    /// An open hall without anything in it.
    fn default() -> Self {
        Self {
            grid_m: 1.0,
            height_step_m: 1.0,
            n_headings: 8,
            vehicle_radius_m: 0.3,
            margin_m: 0.2,
            surface_clearance_m: 0.2,
            highest_surface_m: None,
            walls: None,
            ceiling_m: None,
            obstacles: Vec::new(),
            fence: None,
        }
    }
}
