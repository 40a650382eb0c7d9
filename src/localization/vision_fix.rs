//! A pose from one frame of tags and points: least squares on the reprojection error.
//!
//! ```text
//! χ̂ = argmin Σ_k ‖P_im,k(χ) − P̄_k‖²,   Σ^χ = σ² (JᵀJ)⁻¹,   J = ∂P_im/∂χ   2N×6
//! q_pos = 1/√tr(Σ^χ)
//! ```
//! - `χ`: position in hall axes (m) and right-multiplicative attitude in body axes (rad), 6
//! - `σ`: standard deviation of a corner, px
//!
//! So that a wrong corner does not move the fix, the points of the sum are chosen first: a Huber
//! loss finds the pose that most of them support, a redescending loss frees it from the others, a
//! gate drops those. Over what remains the sum is the paper's, and so is the covariance.
//!
//! Where the points leave a direction free, or leave two poses that explain them equally well,
//! the answer is [`NoFix::NotObservable`] and not a covariance.
//!
//! Source: Balula et al. 2023, section 3; Levenberg–Marquardt as in Madsen, Nielsen, Tingleff
//! 2004, section 3.2.
//! Checked: `fix_jacobian_matches_central_difference`,
//! `covariance_equals_that_of_ten_thousand_fixes`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

mod cold_start;
mod least_squares;
mod sensitivity;

pub use sensitivity::tag_sensitivity;

use super::camera_model::CameraModel;
use super::marker_map::MarkerMap;
use crate::geometry::{Body, Hall, Point, Transform};
use crate::messages::{FixOutcome, PointDetection, TagDetection, TagDetections};
use crate::stats::chi2_gate_99;
pub(in crate::localization) use least_squares::Reprojector;
use least_squares::{Loss, Minimum, minimize};
use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector3};

/// One mapped point and the pixel where it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointFeature {
    /// Its place in the hall.
    pub place: Point<Hall>,
    /// Where it was seen, px.
    pub pixel: Vector2<f64>,
}

/// How a fix is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Standard deviation of a corner, px.
    pub corner_sigma_px: f64,
    /// Fixes whose largest position σ exceeds this are called not observable, m.
    pub max_position_sigma_m: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { corner_sigma_px: 0.5, max_position_sigma_m: 1.0 }
    }
}

/// What is known of the pose before the frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start<'a> {
    /// A pose near the truth.
    Prior(&'a Transform<Hall, Body>),
    /// Nothing, but perhaps which way is down.
    Cold {
        /// Direction of gravity in body axes, of any length, within some degrees: at rest, minus
        /// what the accelerometer reads. It rules out poses that lie on their side, and decides
        /// between poses that the pixels cannot tell apart.
        gravity_body: Option<Vector3<f64>>,
    },
}

/// Why there is no fix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoFix {
    /// No detected tag is in the map.
    NoKnownTag,
    /// Too few points, points that leave a direction free, or two poses that explain them equally
    /// well and that nothing decides between.
    NotObservable,
    /// No pose explains most of the points.
    BadResidual,
}

/// Points further than this from the robust solution are left out of the final one, in σ: one in
/// 3,000 good ones.
const POINT_GATE_SIGMAS: f64 = 4.0;
/// Fewer points leave several poses.
const MIN_POINTS: usize = 4;
/// Pixels that keep this close to one line (root mean square, in σ) determine no pose.
const MIN_SPREAD_SIGMAS: f64 = 2.0;
/// Places that keep this close to one line (root mean square) determine no pose, m.
const MIN_SPREAD_M: f64 = 1e-3;

/// The mapped corners of the detected tags; a tag that is reported twice is left out, since one of
/// the two is wrong or both are the same.
#[must_use]
pub fn features(map: &MarkerMap, tags: &[TagDetection]) -> Vec<PointFeature> {
    let is_unique = |tag: &&TagDetection| {
        tags.iter().filter(|t| (t.family, t.id) == (tag.family, tag.id)).count() == 1
    };
    tags.iter()
        .filter(is_unique)
        .filter_map(|tag| map.corners(tag.family, tag.id).map(|corners| (tag, corners)))
        .flat_map(|(tag, corners)| {
            std::iter::zip(corners, &tag.corners_px)
                .map(|(&place, &pixel)| PointFeature { place, pixel: Vector2::from(pixel) })
        })
        .collect()
}

/// Everything mapped in a frame: the corners of its tags as [`features`] gives them, then its
/// points, those that are reported twice left out.
#[must_use]
pub fn frame_features(map: &MarkerMap, frame: &TagDetections) -> Vec<PointFeature> {
    let is_unique =
        |point: &&PointDetection| frame.points.iter().filter(|p| p.id == point.id).count() == 1;
    let points = frame.points.iter().filter(is_unique).filter_map(|point| {
        let place = map.point(point.id)?;
        Some(PointFeature { place, pixel: Vector2::from(point.pixel_px) })
    });
    let mut all = features(map, &frame.tags);
    all.extend(points);
    all
}

/// The pose that explains the features best, with its covariance: [`solve_from`] a prior, or from
/// nothing without one.
///
/// # Errors
/// [`NoFix`] says why there is none.
pub fn solve(
    camera: &CameraModel,
    features: &[PointFeature],
    prior: Option<&Transform<Hall, Body>>,
    settings: &Settings,
) -> Result<FixOutcome, NoFix> {
    let start = prior.map_or(Start::Cold { gravity_body: None }, Start::Prior);
    solve_from(camera, features, start, settings)
}

/// The pose that explains the features best, with its covariance.
///
/// `features` holds four consecutive corners for each tag, and any other points, as
/// [`frame_features`] gives them. A cold start takes each tag's own two poses, or all points
/// together if no tag is among them: at least four in a plane, or six.
///
/// # Errors
/// [`NoFix`] says why there is none.
pub fn solve_from(
    camera: &CameraModel,
    features: &[PointFeature],
    start: Start<'_>,
    settings: &Settings,
) -> Result<FixOutcome, NoFix> {
    if features.is_empty() {
        return Err(NoFix::NoKnownTag);
    }
    if features.len() < MIN_POINTS {
        return Err(NoFix::NotObservable);
    }
    let sigma_px = settings.corner_sigma_px;
    let robust = match start {
        Start::Prior(pose) => minimize(camera, features, pose, (sigma_px, Loss::Huber)),
        Start::Cold { gravity_body } => {
            Some(cold_start::minimum(camera, features, gravity_body.as_ref(), sigma_px)?)
        }
    };
    let robust = robust.ok_or(NoFix::NotObservable)?;
    let (kept, pose) = without_outliers(camera, features, &robust, sigma_px)?;
    if lie_on_a_line(&kept, sigma_px) {
        return Err(NoFix::NotObservable);
    }
    let refined =
        minimize(camera, &kept, &pose, (sigma_px, Loss::Square)).ok_or(NoFix::NotObservable)?;
    outcome(camera, &kept, &refined.pose, settings)
}

/// The features that agree with most of the others, and the pose that they agree on.
fn without_outliers(
    camera: &CameraModel,
    features: &[PointFeature],
    robust: &Minimum,
    sigma_px: f64,
) -> Result<(Vec<PointFeature>, Transform<Hall, Body>), NoFix> {
    let mut pose = robust.pose;
    let mut kept = within_gate(camera, features, &pose, sigma_px);
    if kept.len() < features.len() {
        // Huber's pose leans a little towards each outlier, and may have lost good points by that.
        let freed = minimize(camera, features, &pose, (sigma_px, Loss::Redescending));
        pose = freed.ok_or(NoFix::NotObservable)?.pose;
        kept = within_gate(camera, features, &pose, sigma_px);
    }
    if 2 * kept.len() <= features.len() || kept.len() < MIN_POINTS {
        return Err(NoFix::BadResidual);
    }
    Ok((kept, pose))
}

/// The covariance that a fix from this pose would have, from the tags in view.
///
/// `None` where the tags in view do not determine a pose.
#[must_use]
pub fn predicted_cov(
    camera: &CameraModel,
    places: &[Point<Hall>],
    hall_from_body: &Transform<Hall, Body>,
    corner_sigma_px: f64,
) -> Option<Matrix6<f64>> {
    let JtJ = corner_normal_matrix(camera, places, hall_from_body);
    cov_of_normal_matrix(&JtJ, corner_sigma_px)
}

/// `JᵀJ` over the places that a camera pictures from a pose, 6×6: what corners add up to.
#[must_use]
pub fn corner_normal_matrix(
    camera: &CameraModel,
    places: &[Point<Hall>],
    hall_from_body: &Transform<Hall, Body>,
) -> Matrix6<f64> {
    let reprojector = Reprojector::new(camera, hall_from_body);
    places
        .iter()
        .filter_map(|place| reprojector.reproject(place))
        .filter(|(pixel, _)| camera.contains(pixel, 0.0))
        .map(|(_, J)| J.transpose() * J)
        .sum::<Matrix6<f64>>()
}

/// σ² (JᵀJ)⁻¹; `None` where a direction of the pose is free.
#[must_use]
pub fn cov_of_normal_matrix(JtJ: &Matrix6<f64>, corner_sigma_px: f64) -> Option<Matrix6<f64>> {
    inverse_if_well_posed(JtJ).map(|inverse| inverse * corner_sigma_px.powi(2))
}

/// The paper's quality of a fix, 1/√tr(Σ^χ); m² and rad² are added.
#[must_use]
pub fn q_pos(pose_cov: &Matrix6<f64>) -> f64 {
    1.0 / pose_cov.trace().sqrt()
}

/// The quality of the position alone, 1/m: 1/√tr of the upper left 3×3 of Σ^χ.
#[must_use]
pub fn q_position(pose_cov: &Matrix6<f64>) -> f64 {
    1.0 / pose_cov.fixed_view::<3, 3>(0, 0).trace().sqrt()
}

fn within_gate(
    camera: &CameraModel,
    features: &[PointFeature],
    pose: &Transform<Hall, Body>,
    sigma_px: f64,
) -> Vec<PointFeature> {
    let gate_px = POINT_GATE_SIGMAS * sigma_px;
    let reprojector = Reprojector::new(camera, pose);
    let is_near = |feature: &&PointFeature| {
        reprojector
            .reproject(&feature.place)
            .is_some_and(|(pixel, _)| (pixel - feature.pixel).norm() <= gate_px)
    };
    features.iter().filter(is_near).copied().collect()
}

/// True if the places or their pixels keep so close to one line that the turn about it is noise.
#[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
fn lie_on_a_line(features: &[PointFeature], sigma_px: f64) -> bool {
    let n = features.len() as f64;
    let mean_px = features.iter().map(|f| f.pixel).sum::<Vector2<f64>>() / n;
    let mean_m = features.iter().map(|f| f.place.coords).sum::<Vector3<f64>>() / n;
    let (mut across_px2, mut across_m2) = (Matrix2::zeros(), Matrix3::zeros());
    for feature in features {
        let (pixel, place) = (feature.pixel - mean_px, feature.place.coords - mean_m);
        across_px2 += pixel * pixel.transpose() / n;
        across_m2 += place * place.transpose() / n;
    }
    let narrow_px2 = across_px2.symmetric_eigenvalues().min();
    let mut spread_m2: [f64; 3] = across_m2.symmetric_eigenvalues().into();
    spread_m2.sort_by(f64::total_cmp);
    narrow_px2 < (MIN_SPREAD_SIGMAS * sigma_px).powi(2) || spread_m2[1] < MIN_SPREAD_M.powi(2)
}

fn outcome(
    camera: &CameraModel,
    features: &[PointFeature],
    pose: &Transform<Hall, Body>,
    settings: &Settings,
) -> Result<FixOutcome, NoFix> {
    let mut JtJ = Matrix6::zeros();
    let mut squares_px2 = 0.0;
    let reprojector = Reprojector::new(camera, pose);
    for feature in features {
        let (pixel, J) = reprojector.reproject(&feature.place).ok_or(NoFix::BadResidual)?;
        JtJ += J.transpose() * J;
        squares_px2 += (feature.pixel - pixel).norm_squared();
    }
    let n_rows = 2 * features.len();
    let var_px2 = variance_of_a_corner(squares_px2, n_rows - 6, settings.corner_sigma_px);
    let pose_cov = inverse_if_well_posed(&JtJ).ok_or(NoFix::NotObservable)? * var_px2;
    let position_sigma_m = (0..3).map(|axis| pose_cov[(axis, axis)].sqrt()).fold(0.0, f64::max);
    if position_sigma_m > settings.max_position_sigma_m {
        return Err(NoFix::NotObservable);
    }
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let residual_rms_px = (squares_px2 / n_rows as f64).sqrt();
    Ok(FixOutcome {
        hall_from_body: *pose,
        pose_cov,
        residual_rms_px,
        n_points: features.len(),
        q_pos: q_pos(&pose_cov),
        q_position: q_position(&pose_cov),
    })
}

/// The configured variance, unless the residuals prove it too small; smaller ones by chance or by
/// few points do not narrow it.
fn variance_of_a_corner(squares_px2: f64, dof: usize, sigma_px: f64) -> f64 {
    let configured_px2 = sigma_px * sigma_px;
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let seen_px2 = squares_px2 / dof as f64;
    if squares_px2 > chi2_gate_99(dof) * configured_px2 { seen_px2 } else { configured_px2 }
}

/// (JᵀJ)⁻¹ where all six directions are determined; `None` otherwise.
fn inverse_if_well_posed(JtJ: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    let scale = JtJ.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let S = Matrix6::from_diagonal(&scale);
    let scaled = S * JtJ * S;
    // Correlations of the six components; a free direction shows as an eigenvalue near zero.
    (scaled.symmetric_eigenvalues().min() > 1e-9)
        .then(|| scaled.cholesky().map(|c| S * c.inverse() * S))
        .flatten()
}

#[cfg(test)]
mod tests;
