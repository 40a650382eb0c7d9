//! Poses to begin with: from the known tags on, frame by frame and tag by tag.

use super::tag_start::{Sight, pose_most_agree_on};
use super::{AdjustError, Survey, View, corners_in_tag};
use crate::geometry::{Body, Hall, Tag, Transform};
use crate::localization::vision_fix::{PointFeature, Settings, Start, solve_from};
use nalgebra::Vector2;

/// Frames whose pose is less sure than this are not begun with, m.
const MAX_POSITION_SIGMA_M: f64 = 1.0;
/// Places that are only roughly known let corners be off by this, px, whatever the detector's σ.
const ROUGH_SIGMA_PX: f64 = 2.5;

/// What is located so far.
#[derive(Debug, Clone)]
pub(super) struct Located {
    pub(super) tags: Vec<Option<Transform<Hall, Tag>>>,
    pub(super) bodies: Vec<Option<Transform<Hall, Body>>>,
    /// True edges over those that were told.
    pub(super) edge_factor: f64,
}

/// Begins with the known tags and goes on until nothing new is found.
pub(super) fn located(survey: &Survey) -> Result<Located, AdjustError> {
    let mut found = Located {
        tags: vec![None; survey.edges_m.len()],
        bodies: vec![None; survey.views.len()],
        edge_factor: 1.0,
    };
    for known in &survey.known {
        found.tags[known.tag] = Some(known.hall_from_tag);
    }
    extend(survey, &mut found);
    if found.bodies.iter().flatten().next().is_none() {
        return Err(AdjustError::NoStart);
    }
    Ok(found)
}

/// Goes on until nothing new is found; gives how many frames and tags are new.
pub(super) fn extend(survey: &Survey, found: &mut Located) -> usize {
    let mut n_all = 0;
    loop {
        let n_new = locate_bodies(survey, found) + locate_tags(survey, found);
        if n_new == 0 {
            return n_all;
        }
        n_all += n_new;
    }
}

/// Frames that see enough of what is located; gives how many are new.
fn locate_bodies(survey: &Survey, found: &mut Located) -> usize {
    // Strict first: what is well known decides between the two poses of a single tag.
    let sigmas_px = [survey.corner_sigma_px, survey.corner_sigma_px.max(ROUGH_SIGMA_PX)];
    let mut n_new = 0;
    for (v, view) in survey.views.iter().enumerate() {
        if found.bodies[v].is_some() {
            continue;
        }
        let features = features(survey, view, found);
        let start = Start::Cold { gravity_body: None };
        let camera = &survey.cameras[view.camera];
        let fix = sigmas_px.iter().find_map(|&corner_sigma_px| {
            let settings = Settings { corner_sigma_px, max_position_sigma_m: MAX_POSITION_SIGMA_M };
            solve_from(camera, &features, start, &settings).ok()
        });
        found.bodies[v] = fix.map(|fix| fix.hall_from_body);
        n_new += usize::from(found.bodies[v].is_some());
    }
    n_new
}

fn features(survey: &Survey, view: &View, found: &Located) -> Vec<PointFeature> {
    let mut features = Vec::new();
    for sighting in &view.sightings {
        let Some(pose) = found.tags[sighting.tag] else { continue };
        let corners = corners_in_tag(survey.edges_m[sighting.tag] * found.edge_factor);
        features.extend(corners.iter().zip(sighting.corners_px).map(|(corner, pixel)| {
            PointFeature { place: pose * *corner, pixel: Vector2::from(pixel) }
        }));
    }
    features
}

/// Tags in located frames; gives how many are new.
fn locate_tags(survey: &Survey, found: &mut Located) -> usize {
    let mut sights: Vec<Vec<Sight<'_>>> = Vec::new();
    sights.resize_with(found.tags.len(), Vec::new);
    for (view, body) in survey.views.iter().zip(&found.bodies) {
        let Some(hall_from_body) = body else { continue };
        let camera = &survey.cameras[view.camera];
        for sighting in view.sightings.iter().filter(|s| found.tags[s.tag].is_none()) {
            sights[sighting.tag].push(Sight::new(camera, hall_from_body, sighting.corners_px));
        }
    }
    let mut n_new = 0;
    for (k, sights) in sights.iter().enumerate().filter(|(_, sights)| !sights.is_empty()) {
        found.tags[k] = pose_most_agree_on(survey.edges_m[k] * found.edge_factor, sights);
        n_new += usize::from(found.tags[k].is_some());
    }
    n_new
}
