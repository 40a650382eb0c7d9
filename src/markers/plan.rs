//! `stockpilot markers plan`: where to hang how many markers.

use crate::config::{Config, TagSection};
use crate::messages::TagFamily;
use crate::planning::free_space::FreeSpace;
use crate::planning::grid_axis::Axis;
use crate::planning::marker_plan::{Demand, choose};
use crate::planning::what_if::{Layout, candidates};
use crate::service::plan::{Plan, PlanError};
use serde::Serialize;
use std::path::Path;

/// What is asked.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanRequest {
    /// Family of the new markers.
    pub family: TagFamily,
    /// Length of their sides, m.
    pub edge_m: f64,
    /// Places for them are this far apart, m.
    pub spacing_m: f64,
    /// Markers that are to be in view from everywhere.
    pub n_markers: usize,
    /// Quality of a fix that is to be everywhere, in multiples of `planning.min_fix_quality`.
    pub quality_factor: f64,
    /// No more new markers than this.
    pub n_most: usize,
    /// All headings count, not the survey's alone.
    pub all_headings: bool,
    /// The tags of the configuration are not there yet.
    pub from_nothing: bool,
}

/// A marker to hang.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedMarker {
    /// Its number.
    pub id: u32,
    /// Its middle, m.
    pub place_m: [f64; 3],
    /// Where its front looks, from x towards y, deg.
    pub facing_deg: f64,
    /// Its corners as a `[[tags]]` section has them, m.
    pub corners_m: [[f64; 3]; 4],
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedMarkers {
    /// Family of the new markers.
    pub family: &'static str,
    /// Length of their sides, m.
    pub edge_m: f64,
    /// The new markers, those that serve most before the others.
    pub markers: Vec<PlannedMarker>,
    /// Markers that hang already.
    pub n_there: usize,
    /// Poses (places at the height of the survey, and headings) that are looked at.
    pub n_poses: usize,
    /// Of them, with all that is demanded.
    pub n_served: usize,
    /// Of them, out of reach even if every place had a marker.
    pub n_hopeless: usize,
    /// Places that were tried.
    pub n_candidates: usize,
    /// Quality that is demanded.
    pub quality: f64,
}

/// Markers do not hang lower than this, and so far below the ceiling, m.
const LOWEST_M: f64 = 1.0;
const BELOW_CEILING_M: f64 = 0.4;

/// A tag far outside, so that a configuration without any can be read.
fn placeholder() -> TagSection {
    TagSection {
        family: "36h11".to_owned(),
        id: 586,
        corners_m: [[9e3, 0.0, 0.0], [9e3, 0.1, 0.0], [9e3, 0.1, 0.1], [9e3, 0.0, 0.1]],
        faces_away: true,
    }
}

/// Plans markers, and gives the configuration that has them too.
///
/// # Errors
/// A configuration that is refused, or one without walls.
pub fn plan(config: &Config, request: &PlanRequest) -> Result<(PlannedMarkers, Config), PlanError> {
    let mut config = config.clone();
    if request.from_nothing {
        config.tags.clear();
    }
    let n_there = config.tags.len();
    let mut readable = config.clone();
    if n_there == 0 {
        readable.tags.push(placeholder());
    }
    let settings = readable.pilot_settings()?;
    let localization = &settings.localization;
    let space = FreeSpace::evaluate(
        &settings.planning,
        &localization.cameras,
        &localization.marker_map,
        localization.vision.corner_sigma_px,
    );
    let walls = settings.planning.space.walls.as_ref().ok_or(PlanError::NoWalls)?;
    let top_m = settings.planning.space.ceiling_m.unwrap_or(settings.planning.height_m);
    let half_m = 0.5 * request.edge_m;
    let rows_m = (LOWEST_M.max(half_m), top_m - BELOW_CEILING_M - half_m);
    let layout = Layout { spacing_m: request.spacing_m, rows_m, edge_m: request.edge_m };
    let candidates = candidates(walls, &layout, &space.quality().sensing().tags);
    let axes = space.quality().axes();
    let n_headings = if request.all_headings { axes.n_headings } else { 1 };
    let turn = Axis::turn(axes.n_headings);
    let sites = (0..axes.n_nodes())
        .filter(|node| axes.is_of_survey(*node))
        .map(|node| axes.waypoint(node))
        .filter(|waypoint| space.clearance().is_clear(&waypoint.place.coords));
    let poses: Vec<_> = sites
        .flat_map(|waypoint| {
            (0..n_headings).map(move |k| {
                let yaw_rad = waypoint.yaw_rad + turn.at(k);
                crate::planning::Waypoint { yaw_rad, ..waypoint }.level_pose()
            })
        })
        .collect();
    let quality = request.quality_factor * settings.planning.min_fix_quality;
    let demand = Demand { n_markers: request.n_markers, quality, n_most: request.n_most };
    let chosen = choose(space.quality().sensing(), &poses, &candidates, &demand);
    let mut markers = Vec::new();
    for index in &chosen.chosen {
        let candidate = &candidates[*index];
        let section = TagSection {
            family: request.family.name().to_owned(),
            id: next_id(&config, request.family),
            corners_m: candidate.corners.map(|corner| corner.coords.into()),
            faces_away: false,
        };
        markers.push(PlannedMarker {
            id: section.id,
            place_m: candidate.place().coords.into(),
            facing_deg: candidate.facing.y.atan2(candidate.facing.x).to_degrees(),
            corners_m: section.corners_m,
        });
        config.tags.push(section);
    }
    let planned = PlannedMarkers {
        family: request.family.name(),
        edge_m: request.edge_m,
        markers,
        n_there,
        n_poses: chosen.n_poses,
        n_served: chosen.n_served,
        n_hopeless: chosen.n_hopeless,
        n_candidates: candidates.len(),
        quality,
    };
    Ok((planned, config))
}

/// The smallest number that no tag of the family has.
fn next_id(config: &Config, family: TagFamily) -> u32 {
    let is_taken = |id: &u32| {
        config.tags.iter().any(|t| t.id == *id && TagFamily::from_name(&t.family) == Some(family))
    };
    (0..family.n_tags()).find(|id| !is_taken(id)).unwrap_or_else(|| family.n_tags())
}

/// Draws the quality of fixes with all markers into a folder, every height of the grid; gives the names of the
/// pictures.
///
/// # Errors
/// A configuration that is refused, or pictures that cannot be written.
pub fn draw(config: &Config, folder: &Path) -> Result<Vec<String>, PlanError> {
    Plan::new(config)?.draw(folder, None)
}
