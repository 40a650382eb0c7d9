//! A pose from nothing: the two planar poses of each tag, or all points together.

use super::least_squares::{Loss, Minimum, Reprojector, cost, minimize};
use super::{NoFix, PointFeature};
use crate::geometry::{Body, Hall, Transform};
use crate::localization::camera_model::CameraModel;
use crate::localization::linear_pose;
use crate::localization::marker_map::is_square;
use crate::localization::planar_pose;
use nalgebra::{Vector3, Vector6};

/// Tags that give starts: the largest ones determine their own pose best.
const MAX_START_TAGS: usize = 8;
/// Starts that are worth a search, by their cost before it.
const MAX_STARTS: usize = 3;
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

type Pose = Transform<Hall, Body>;

/// The best pose under the Huber loss, without a prior.
pub(super) fn minimum(
    camera: &CameraModel,
    features: &[PointFeature],
    gravity_body: Option<&Vector3<f64>>,
    sigma_px: f64,
) -> Result<Minimum, NoFix> {
    let starts = ranked_starts(camera, features, sigma_px);
    let minima = searched(camera, features, &starts, sigma_px);
    let best = minima.first().ok_or(NoFix::NotObservable)?;
    let excess = excess_variance(camera, features, &best.pose, sigma_px);
    chosen(minima, excess, gravity_body)
}

/// Poses that some of the points propose, by their cost before any search, the best first.
fn ranked_starts(camera: &CameraModel, features: &[PointFeature], sigma_px: f64) -> Vec<Pose> {
    let tags = tags_among(features);
    let proposed: Vec<Pose> = if tags.is_empty() {
        [poses_of_plane(camera, features), poses_of_points(camera, features)].concat()
    } else {
        tags.into_iter().take(MAX_START_TAGS).flat_map(|tag| poses_of_plane(camera, tag)).collect()
    };
    let cost = |pose: &Pose| cost(camera, features, pose, (sigma_px, Loss::Huber));
    let mut ranked: Vec<(f64, Pose)> =
        proposed.into_iter().map(|pose| (cost(&pose), pose)).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    ranked.into_iter().map(|(_, pose)| pose).collect()
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
fn poses_of_plane(camera: &CameraModel, features: &[PointFeature]) -> Vec<Pose> {
    let Some((places, bearings)) = sights(camera, features) else { return Vec::new() };
    planar_pose::camera_from_hall_candidates(&places, &bearings)
        .into_iter()
        .map(|camera_from_hall| (camera.body_from_camera * camera_from_hall).inverse())
        .collect()
}

/// The pose from points that do not lie in a plane.
fn poses_of_points(camera: &CameraModel, features: &[PointFeature]) -> Vec<Pose> {
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

/// The minima that the best starts lead to, the best first. If all points lie in one plane, the
/// flip of the best is among the searched: only the search tells whether it explains the pixels as
/// well.
fn searched(
    camera: &CameraModel,
    features: &[PointFeature],
    starts: &[Pose],
    sigma_px: f64,
) -> Vec<Minimum> {
    let mut minima: Vec<Minimum> = Vec::new();
    for start in starts.iter().take(MAX_STARTS) {
        search(camera, features, start, sigma_px, &mut minima);
    }
    minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    if let Some(flip) = minima.first().and_then(|best| flipped(camera, features, &best.pose)) {
        search(camera, features, &flip, sigma_px, &mut minima);
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    }
    minima
}

/// Adds the minimum that a start leads to, if it is a new one.
fn search(
    camera: &CameraModel,
    features: &[PointFeature],
    start: &Pose,
    sigma_px: f64,
    minima: &mut Vec<Minimum>,
) {
    if minima.iter().any(|minimum| is_near(&minimum.pose, start)) {
        return;
    }
    let found = minimize(camera, features, start, (sigma_px, Loss::Huber));
    minima.extend(found.filter(|new| !minima.iter().any(|known| is_same(known, new))));
}

/// The other pose that nearly explains points in a plane; `None` if they lie in none.
fn flipped(camera: &CameraModel, features: &[PointFeature], pose: &Pose) -> Option<Pose> {
    let places: Vec<Vector3<f64>> = features.iter().map(|f| f.place.coords).collect();
    let camera_from_hall = (*pose * camera.body_from_camera).inverse();
    let flipped = planar_pose::flipped(&camera_from_hall, &places)?;
    Some((camera.body_from_camera * flipped).inverse())
}

fn is_near(a: &Pose, b: &Pose) -> bool {
    (a.origin - b.origin).coords.norm() + a.rotation.minus(&b.rotation).norm() < SAME_BASIN
}

fn is_same(a: &Minimum, b: &Minimum) -> bool {
    let dp = (b.pose.origin - a.pose.origin).coords;
    let dr = b.pose.rotation.minus(&a.pose.rotation);
    let d = Vector6::new(dp.x, dp.y, dp.z, dr.x, dr.y, dr.z);
    d.dot(&(a.information * d)) < SAME_MINIMUM
}

/// How much larger the corners' variance is than configured, at least 1: then all χ² are too large
/// by the same factor. From the median, which outliers do not move.
fn excess_variance(
    camera: &CameraModel,
    features: &[PointFeature],
    pose: &Pose,
    sigma_px: f64,
) -> f64 {
    /// Median of χ² with two degrees of freedom: 2 ln 2.
    const MEDIAN_CHI2: f64 = 2.0 * std::f64::consts::LN_2;
    let reprojector = Reprojector::new(camera, pose);
    let mut squares: Vec<f64> = features
        .iter()
        .filter_map(|f| Some((reprojector.reproject(&f.place)?.0 - f.pixel).norm_squared()))
        .collect();
    squares.sort_by(f64::total_cmp);
    let median_px2 = squares.get(squares.len() / 2).copied().unwrap_or(f64::INFINITY);
    (median_px2 / (sigma_px * sigma_px * MEDIAN_CHI2)).max(1.0)
}

/// The minimum that is left when reprojection and gravity have ruled out what they can.
fn chosen(
    mut minima: Vec<Minimum>,
    excess: f64,
    gravity_body: Option<&Vector3<f64>>,
) -> Result<Minimum, NoFix> {
    if let Some(gravity) = gravity_body {
        minima.retain(|minimum| tilt_rad(minimum, gravity) <= MAX_TILT_RAD);
    }
    // Absurd pixels can make every cost infinite or none at all.
    minima.retain(|minimum| minimum.cost.is_finite());
    let best = *minima.first().ok_or(NoFix::BadResidual)?;
    let as_good = |minimum: &Minimum| 2.0 * (minimum.cost - best.cost) < AMBIGUOUS_CHI2 * excess;
    minima.retain(as_good);
    if minima.len() <= 1 {
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
