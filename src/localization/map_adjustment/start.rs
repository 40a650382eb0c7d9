//! Poses to begin with: from the known tags on, frame by frame and tag by tag.

use super::{AdjustError, Survey, View, corners_in_tag, pose_of_corners};
use crate::geometry::{Body, Hall, Point, Tag, Transform};
use crate::localization::vision_fix::{PointFeature, Settings, Start, solve_from};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Frames whose pose is less sure than this are not begun with, m.
const MAX_POSITION_SIGMA_M: f64 = 0.5;
/// A tag's own pose in a camera is believed from this edge on, px: smaller ones flip.
const MIN_EDGE_PX: f64 = 24.0;

/// Rays to one corner must spread by this at least, rad (root mean square).
const MIN_SPREAD_RAD: f64 = 0.04;
/// Edges of a tag from rays may be off by this share.
const MAX_UNEVENNESS: f64 = 0.2;

/// What is located so far.
#[derive(Debug, Clone)]
pub(super) struct Located {
    pub(super) tags: Vec<Option<Transform<Hall, Tag>>>,
    pub(super) bodies: Vec<Option<Transform<Hall, Body>>>,
}

/// Begins with the known tags and goes on until nothing new is found.
pub(super) fn located(survey: &Survey) -> Result<Located, AdjustError> {
    let mut found =
        Located { tags: vec![None; survey.edges_m.len()], bodies: vec![None; survey.views.len()] };
    for known in &survey.known {
        found.tags[known.tag] = Some(known.hall_from_tag);
    }
    loop {
        let n_bodies = locate_bodies(survey, &mut found);
        let n_tags = triangulate_tags(survey, &mut found) + locate_tags(survey, &mut found);
        if n_bodies + n_tags == 0 {
            break;
        }
    }
    if found.bodies.iter().flatten().next().is_none() {
        return Err(AdjustError::NoStart);
    }
    Ok(found)
}

/// Frames that see enough of what is located; gives how many are new.
fn locate_bodies(survey: &Survey, found: &mut Located) -> usize {
    let settings = Settings {
        corner_sigma_px: survey.corner_sigma_px,
        max_position_sigma_m: MAX_POSITION_SIGMA_M,
    };
    let mut n_new = 0;
    for (view, body) in survey.views.iter().zip(&mut found.bodies) {
        if body.is_some() {
            continue;
        }
        let features = features(survey, view, &found.tags);
        let start = Start::Cold { gravity_body: None };
        let camera = &survey.cameras[view.camera];
        if let Ok(fix) = solve_from(camera, &features, start, &settings) {
            *body = Some(fix.hall_from_body);
            n_new += 1;
        }
    }
    n_new
}

fn features(
    survey: &Survey,
    view: &View,
    tags: &[Option<Transform<Hall, Tag>>],
) -> Vec<PointFeature> {
    let mut features = Vec::new();
    for sighting in &view.sightings {
        let Some(pose) = tags[sighting.tag] else { continue };
        let corners = corners_in_tag(survey.edges_m[sighting.tag]);
        features.extend(corners.iter().zip(sighting.corners_px).map(|(corner, pixel)| {
            PointFeature { place: pose * *corner, pixel: Vector2::from(pixel) }
        }));
    }
    features
}

/// Where the rays to one corner come nearest to each other.
///
/// ```text
/// Σ (I − d dᵀ) p = Σ (I − d dᵀ) o
/// ```
/// - `o`, `d`: where a ray begins and its direction, in the hall
#[derive(Debug, Clone, Copy)]
struct Rays {
    sum: Matrix3<f64>,
    right: Vector3<f64>,
    n: f64,
}

impl Rays {
    const NONE: Self = Self {
        sum: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        right: Vector3::new(0.0, 0.0, 0.0),
        n: 0.0,
    };

    fn add(&mut self, origin: &Vector3<f64>, direction: &Vector3<f64>) {
        let across = Matrix3::identity() - direction * direction.transpose();
        self.sum += across;
        self.right += across * origin;
        self.n += 1.0;
    }

    fn nearest(&self) -> Option<Vector3<f64>> {
        // The smallest eigenvalue is the mean square of the angles between the rays and their mean.
        let spread = self.sum.symmetric_eigenvalues().min() / self.n;
        (spread > MIN_SPREAD_RAD * MIN_SPREAD_RAD)
            .then(|| self.sum.cholesky())?
            .map(|f| f.solve(&self.right))
    }
}

/// Tags that located frames see from different sides; gives how many are new.
fn triangulate_tags(survey: &Survey, found: &mut Located) -> usize {
    let mut rays = vec![[Rays::NONE; 4]; found.tags.len()];
    for (view, body) in survey.views.iter().zip(&found.bodies) {
        let Some(hall_from_body) = body else { continue };
        let camera = &survey.cameras[view.camera];
        let hall_from_camera = *hall_from_body * camera.body_from_camera;
        let turn = hall_from_camera.rotation.matrix();
        for sighting in view.sightings.iter().filter(|s| found.tags[s.tag].is_none()) {
            for (rays, pixel) in rays[sighting.tag].iter_mut().zip(sighting.corners_px) {
                if let Some(bearing) = camera.bearing(&Vector2::from(pixel)) {
                    rays.add(&hall_from_camera.origin.coords, &(turn * bearing));
                }
            }
        }
    }
    let mut n_new = 0;
    for (k, rays) in rays.iter().enumerate() {
        let [Some(a), Some(b), Some(c), Some(d)] =
            [0, 1, 2, 3].map(|corner| rays[corner].nearest())
        else {
            continue;
        };
        let edge_m = survey.edges_m[k];
        let is_even = [(a, b), (b, c), (c, d), (d, a)]
            .iter()
            .all(|(p, q)| ((p - q).norm() / edge_m - 1.0).abs() < MAX_UNEVENNESS);
        if is_even {
            found.tags[k] = Some(pose_of_corners(&[a, b, c, d].map(Point::from_coords)));
            n_new += 1;
        }
    }
    n_new
}

/// Tags in located frames, each from the frame where it is largest and its pose without doubt.
fn locate_tags(survey: &Survey, found: &mut Located) -> usize {
    let mut best: Vec<Option<(f64, Transform<Hall, Tag>)>> = vec![None; found.tags.len()];
    let settings = Settings { corner_sigma_px: survey.corner_sigma_px, ..Settings::default() };
    for (view, body) in survey.views.iter().zip(&found.bodies) {
        let Some(hall_from_body) = body else { continue };
        for sighting in &view.sightings {
            let diagonal = |a: usize, b: usize| {
                let [a, b] = [a, b].map(|k| Vector2::from(sighting.corners_px[k]));
                (a - b).norm()
            };
            let edge_px = (diagonal(0, 2) + diagonal(1, 3)) / 8.0_f64.sqrt();
            let is_better = best[sighting.tag].is_none_or(|(size_px, _)| edge_px > size_px);
            if found.tags[sighting.tag].is_some() || edge_px < MIN_EDGE_PX || !is_better {
                continue;
            }
            let camera = &survey.cameras[view.camera];
            let in_own_axes = corners_in_tag(survey.edges_m[sighting.tag]);
            let features: Vec<PointFeature> = in_own_axes
                .iter()
                .zip(sighting.corners_px)
                .map(|(corner, pixel)| PointFeature {
                    // The tag's own axes stand for the hall's here.
                    place: Point::from_coords(corner.coords),
                    pixel: Vector2::from(pixel),
                })
                .collect();
            let start = Start::Cold { gravity_body: None };
            if let Ok(fix) = solve_from(camera, &features, start, &settings) {
                let tag_from_body = Transform::<Tag, Body>::new(
                    crate::geometry::Rotation::from_matrix(&fix.hall_from_body.rotation.matrix()),
                    Point::from_coords(fix.hall_from_body.origin.coords),
                );
                best[sighting.tag] = Some((edge_px, *hall_from_body * tag_from_body.inverse()));
            }
        }
    }
    let mut n_new = 0;
    for (tag, best) in found.tags.iter_mut().zip(best) {
        if let (None, Some((_, pose))) = (&tag, best) {
            *tag = Some(pose);
            n_new += 1;
        }
    }
    n_new
}
