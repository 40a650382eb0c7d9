//! What a program is asked.

use crate::geometry::{Hall, Point};
use crate::messages::GridGeometry;
use crate::planning::Waypoint;
use crate::planning::free_space::Site;
use crate::planning::planner::{Belief, PlanRequest};
use serde::Serialize;

/// Number of this form; it grows when a key changes its meaning.
pub const VERSION: u32 = 1;

#[derive(Serialize)]
struct Question {
    version: u32,
    pending: Vec<WaypointTwin>,
    current: Vec<WaypointTwin>,
    most_waypoints: usize,
    longest_m: Option<f64>,
    over_home: Option<PlaceTwin>,
    rules: Rules,
    lidar: Lidar,
    candidates: Vec<Candidate>,
    map: Option<Map>,
    volume_m3: f64,
    sigma_m3: Option<f64>,
}

#[derive(Serialize)]
struct WaypointTwin {
    x_m: f64,
    y_m: f64,
    z_m: f64,
    yaw_rad: f64,
}

#[derive(Serialize)]
struct PlaceTwin {
    x_m: f64,
    y_m: f64,
    z_m: f64,
}

/// What is wanted, and within which bounds.
#[derive(Serialize)]
struct Rules {
    target_sigma_over_volume: Option<f64>,
    step_m: f64,
    x_min_m: f64,
    y_min_m: f64,
    x_max_m: f64,
    y_max_m: f64,
    height_m: f64,
    yaw_rad: f64,
    max_speed_mps: f64,
    max_yaw_rate_radps: f64,
    min_fix_quality: f64,
    nominal_surface_m: f64,
    seed: u64,
}

#[derive(Serialize)]
struct Lidar {
    min_range_m: f64,
    max_range_m: f64,
    swath_half_angle_rad: f64,
    range_sigma_m: f64,
}

/// A place where the vehicle may be.
#[derive(Serialize)]
struct Candidate {
    x_m: f64,
    y_m: f64,
    z_m: f64,
    yaw_rad: f64,
    fix_quality: f64,
}

#[derive(Serialize)]
struct Map {
    x_min_m: f64,
    y_min_m: f64,
    cell_m: f64,
    n_cols: usize,
    n_rows: usize,
    mean_m: Vec<f64>,
    sigma_m: Vec<f64>,
    area_m2: Vec<f64>,
    n_hits: Vec<u32>,
}

/// The question as one JSON object on one line.
///
/// # Errors
/// Never in practice: everything in it can be written as JSON.
pub fn encoded(request: &PlanRequest) -> serde_json::Result<Vec<u8>> {
    let mut text = serde_json::to_vec(&Question::from(request))?;
    text.push(b'\n');
    Ok(text)
}

impl From<&PlanRequest> for Question {
    fn from(request: &PlanRequest) -> Self {
        let waypoints = |list: &[Waypoint]| list.iter().map(WaypointTwin::from).collect();
        Self {
            version: VERSION,
            pending: waypoints(&request.pending),
            current: waypoints(&request.current),
            most_waypoints: request.n_waypoints,
            longest_m: request.longest_m,
            over_home: request.over_home.as_ref().map(PlaceTwin::from),
            rules: Rules::from(request),
            lidar: Lidar {
                min_range_m: request.lidar.min_range_m,
                max_range_m: request.lidar.max_range_m,
                swath_half_angle_rad: request.settings.swath_half_angle_rad,
                range_sigma_m: request.lidar.range_sigma_m,
            },
            candidates: request.free_space.feasible().map(Candidate::from).collect(),
            map: Map::of(&request.belief),
            volume_m3: request.volume_m3,
            sigma_m3: request.accounted.map(|account| account.sigma_m3),
        }
    }
}

impl From<&PlanRequest> for Rules {
    fn from(request: &PlanRequest) -> Self {
        let settings = &request.settings;
        let b = settings.bounds;
        Self {
            target_sigma_over_volume: settings.target_ratio,
            step_m: settings.step_radius_m,
            x_min_m: b.x_min_m,
            y_min_m: b.y_min_m,
            x_max_m: b.x_max_m,
            y_max_m: b.y_max_m,
            height_m: settings.height_m,
            yaw_rad: settings.yaw_rad,
            max_speed_mps: settings.limits.speed_mps,
            max_yaw_rate_radps: settings.limits.yaw_rate_radps,
            min_fix_quality: settings.min_fix_quality,
            nominal_surface_m: settings.nominal_height_m,
            seed: settings.seed,
        }
    }
}

impl From<&Waypoint> for WaypointTwin {
    fn from(waypoint: &Waypoint) -> Self {
        let p = waypoint.place.coords;
        Self { x_m: p.x, y_m: p.y, z_m: p.z, yaw_rad: waypoint.yaw_rad }
    }
}

impl From<&Point<Hall>> for PlaceTwin {
    fn from(place: &Point<Hall>) -> Self {
        let p = place.coords;
        Self { x_m: p.x, y_m: p.y, z_m: p.z }
    }
}

impl From<&Site> for Candidate {
    fn from(site: &Site) -> Self {
        let WaypointTwin { x_m, y_m, z_m, yaw_rad } = WaypointTwin::from(&site.waypoint);
        Self { x_m, y_m, z_m, yaw_rad, fix_quality: site.quality() }
    }
}

impl Map {
    /// The cells; `None` for a belief without any.
    fn of(belief: &Belief) -> Option<Self> {
        let Belief::Grid { cells, areas_m2 } = belief else { return None };
        let GridGeometry { x_min_m, y_min_m, cell_m, n_cols, n_rows } = *cells.geometry();
        Some(Self {
            x_min_m,
            y_min_m,
            cell_m,
            n_cols,
            n_rows,
            mean_m: cells.mean_m().iter().map(|m| to_tenth_mm(*m)).collect(),
            sigma_m: cells.var_m2().iter().map(|var| to_tenth_mm(var.sqrt())).collect(),
            area_m2: areas_m2.to_vec(),
            n_hits: cells.n_hits().to_vec(),
        })
    }
}

/// Shorter text; nobody plans by less.
fn to_tenth_mm(value_m: f64) -> f64 {
    (value_m * 1e4).round() / 1e4
}
