//! A pose from nothing: the two planar poses of each tag, or all points together.

use super::least_squares::{Loss, Minimum, cost, minimize};
use super::{NoFix, PointFeature};
use crate::geometry::{Body, Hall, Transform};
use crate::localization::camera_model::CameraModel;
use crate::localization::linear_pose;
use crate::localization::marker_map::is_square;
use crate::localization::planar_pose;
use nalgebra::{Vector3, Vector6};

/// Tags that give starts: the largest ones determine their own pose best.
const MAX_START_TAGS: usize = 8;
/// Pairs of starts that are worth a search, by their cost before it.
const MAX_PAIRS: usize = 3;
/// A start this near to a minimum that is known leads to it: m + rad.
const SAME_BASIN: f64 = 0.1;
/// Two poses whose χ² differ by less than this both explain the pixels: odds of 1 in 1000.
const AMBIGUOUS_CHI2: f64 = 13.8;
/// Searches that end closer than this (Mahalanobis distance squared) ended in the same place.
const SAME_MINIMUM: f64 = 0.1;
/// A pose whose gravity points farther from the measured is ruled out: 15°, the tilt that an
/// unnoticed acceleration of 2.6 m/s² feigns.
const MAX_TILT_RAD: f64 = 0.26;
/// Gravity decides between two poses if it fits one this much better: 4°.
const DECISIVE_TILT_RAD: f64 = 0.07;

/// The best pose under the Huber loss, without a prior.
pub(super) fn minimum(
    camera: &CameraModel,
    features: &[PointFeature],
    gravity_body: Option<&Vector3<f64>>,
    sigma_px: f64,
) -> Result<Minimum, NoFix> {
    let pairs = pairs_of_starts(camera, features, sigma_px);
    let minima = searched(camera, features, &pairs, sigma_px);
    chosen(minima, features.len(), gravity_body)
}

/// Two poses that explain the same plane, or one and no other.
type Pair = Vec<Transform<Hall, Body>>;

/// The starts by their cost before any search, the best pair first; inside a pair the better one
/// first.
fn pairs_of_starts(camera: &CameraModel, features: &[PointFeature], sigma_px: f64) -> Vec<Pair> {
    let tags = tags_among(features);
    let pairs: Vec<Pair> = if tags.is_empty() {
        vec![poses_of_plane(camera, features), poses_of_points(camera, features)]
    } else {
        tags.into_iter().take(MAX_START_TAGS).map(|tag| poses_of_plane(camera, tag)).collect()
    };
    let mut ranked: Vec<(f64, Pair)> = pairs
        .into_iter()
        .filter_map(|pair| {
            let mut poses: Vec<(f64, Transform<Hall, Body>)> = pair
                .into_iter()
                .map(|pose| (cost(camera, features, &pose, (sigma_px, Loss::Huber)), pose))
                .collect();
            poses.sort_by(|a, b| a.0.total_cmp(&b.0));
            Some((poses.first()?.0, poses.into_iter().map(|(_, pose)| pose).collect()))
        })
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    ranked.into_iter().map(|(_, pair)| pair).collect()
}

/// Each four consecutive features that are the corners of a square; the largest picture first.
fn tags_among(features: &[PointFeature]) -> Vec<&[PointFeature]> {
    let mut tags = Vec::new();
    let mut rest = features;
    while let Some((four, behind)) = rest.split_first_chunk::<4>() {
        if is_square(&four.map(|corner| corner.place)) {
            tags.push(four.as_slice());
            rest = behind;
        } else {
            rest = &rest[1..];
        }
    }
    let diagonal_px = |tag: &[PointFeature]| (tag[2].pixel - tag[0].pixel).norm();
    tags.sort_by(|a, b| diagonal_px(b).total_cmp(&diagonal_px(a)));
    tags
}

/// Both poses from points in a plane; none if they do not lie in one.
fn poses_of_plane(camera: &CameraModel, features: &[PointFeature]) -> Pair {
    let Some((places, bearings)) = sights(camera, features) else { return Vec::new() };
    planar_pose::camera_from_hall_candidates(&places, &bearings)
        .into_iter()
        .map(|camera_from_hall| (camera.body_from_camera * camera_from_hall).inverse())
        .collect()
}

/// The pose from points that do not lie in a plane.
fn poses_of_points(camera: &CameraModel, features: &[PointFeature]) -> Pair {
    let Some((places, bearings)) = sights(camera, features) else { return Vec::new() };
    linear_pose::camera_from_hall(&places, &bearings)
        .map(|camera_from_hall| (camera.body_from_camera * camera_from_hall).inverse())
        .into_iter()
        .collect()
}

type Sights = (Vec<Vector3<f64>>, Vec<Vector3<f64>>);

/// Places in the hall and unit vectors in camera axes.
fn sights(camera: &CameraModel, features: &[PointFeature]) -> Option<Sights> {
    features.iter().map(|f| Some((f.place.coords, camera.bearing(&f.pixel)?))).collect()
}

/// The minima that the best starts lead to, the best first. The twin of the best start is always
/// among the searched: only the search tells whether it explains the pixels as well.
fn searched(
    camera: &CameraModel,
    features: &[PointFeature],
    pairs: &[Pair],
    sigma_px: f64,
) -> Vec<Minimum> {
    let twin = pairs.first().and_then(|pair| pair.get(1));
    let firsts = pairs.iter().take(MAX_PAIRS).filter_map(|pair| pair.first());
    let mut minima: Vec<Minimum> = Vec::new();
    for start in firsts.chain(twin) {
        if minima.iter().any(|minimum| is_near(&minimum.pose, start)) {
            continue;
        }
        if let Some(found) = minimize(camera, features, start, (sigma_px, Loss::Huber)) {
            if !minima.iter().any(|known| is_same(known, &found)) {
                minima.push(found);
            }
        }
    }
    minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    minima
}

fn is_near(a: &Transform<Hall, Body>, b: &Transform<Hall, Body>) -> bool {
    (a.origin - b.origin).coords.norm() + a.rotation.minus(&b.rotation).norm() < SAME_BASIN
}

fn is_same(a: &Minimum, b: &Minimum) -> bool {
    let dp = (b.pose.origin - a.pose.origin).coords;
    let dr = b.pose.rotation.minus(&a.pose.rotation);
    let d = Vector6::new(dp.x, dp.y, dp.z, dr.x, dr.y, dr.z);
    d.dot(&(a.information * d)) < SAME_MINIMUM
}

/// The minimum that is left when reprojection and gravity have ruled out what they can.
fn chosen(
    mut minima: Vec<Minimum>,
    n_features: usize,
    gravity_body: Option<&Vector3<f64>>,
) -> Result<Minimum, NoFix> {
    if minima.is_empty() {
        return Err(NoFix::NotObservable);
    }
    if let Some(gravity) = gravity_body {
        minima.retain(|minimum| tilt_rad(minimum, gravity) <= MAX_TILT_RAD);
    }
    let best = *minima.first().ok_or(NoFix::BadResidual)?;
    // Where the corners are worse than configured, all χ² are too large by the same factor.
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let scale = (best.cost / n_features as f64).max(1.0);
    let as_good = |minimum: &Minimum| 2.0 * (minimum.cost - best.cost) < AMBIGUOUS_CHI2 * scale;
    minima.retain(as_good);
    if minima.len() == 1 {
        return Ok(best);
    }
    let gravity = gravity_body.ok_or(NoFix::NotObservable)?;
    let mut tilts: Vec<(f64, Minimum)> =
        minima.into_iter().map(|minimum| (tilt_rad(&minimum, gravity), minimum)).collect();
    tilts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let is_decided = tilts[1].0 - tilts[0].0 > DECISIVE_TILT_RAD;
    if is_decided { Ok(tilts[0].1) } else { Err(NoFix::NotObservable) }
}

/// The angle between the measured direction of gravity and the one that the pose implies.
fn tilt_rad(minimum: &Minimum, gravity_body: &Vector3<f64>) -> f64 {
    let in_hall = minimum.pose.rotation.quaternion() * gravity_body;
    in_hall.angle(&-Vector3::z())
}
