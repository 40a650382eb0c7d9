//! A pose from one frame of tags: weighted least squares on the reprojection error.
//!
//! ```text
//! χ̂ = argmin Σ_k ρ(‖P_im,k(χ) − P̄_k‖²),   Σ^χ = σ² (JᵀJ)⁻¹,   J = ∂P_im/∂χ   2N×6
//! q_pos = 1/√tr(Σ^χ)
//! ```
//! - `χ`: position in hall axes (m) and right-multiplicative attitude in body axes (rad), 6
//! - `σ`: standard deviation of a corner, px
//!
//! The paper has ρ = 1; a Huber loss and a gate per point keep a wrong corner from moving the fix.
//! Source: Balula et al. 2023, section 3; Levenberg–Marquardt as in Madsen, Nielsen, Tingleff
//! 2004, section 3.2.
//! Checked: `fix_jacobian_matches_central_difference`, `covariance_matches_the_scatter_of_fixes`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::camera_model::CameraModel;
use super::marker_map::MarkerMap;
use super::planar_pose::camera_from_hall_candidates;
use crate::geometry::{Body, Camera, Hall, Point, Transform, skew};
use crate::messages::{FixOutcome, TagDetection};
use nalgebra::{Matrix2x6, Matrix3, Matrix6, Vector2, Vector6};

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

/// Why there is no fix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoFix {
    /// No detected tag is in the map.
    NoKnownTag,
    /// Too few points, or points that leave a direction free.
    NotObservable,
    /// No pose explains most of the points.
    BadResidual,
}

const MAX_ITERATIONS: usize = 30;
/// Huber's threshold in σ: 95 % efficiency under normal noise (Huber 1981).
const HUBER_SIGMAS: f64 = 1.345;
/// Points further than this from the robust solution are left out of the final one, in σ.
const POINT_GATE_SIGMAS: f64 = 5.0;

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

/// The pose that explains the features best, with its covariance.
///
/// `features` holds four corners per tag, as [`features`] gives them. `prior` is a pose near the
/// truth, if one is known; without it every tag's own pose is tried.
///
/// # Errors
/// [`NoFix`] says why there is none.
pub fn solve(
    camera: &CameraModel,
    features: &[PointFeature],
    prior: Option<&Transform<Hall, Body>>,
    settings: &Settings,
) -> Result<FixOutcome, NoFix> {
    if features.is_empty() {
        return Err(NoFix::NoKnownTag);
    }
    let starts = prior.map_or_else(
        || cold_starts(camera, features, settings.corner_sigma_px),
        |pose| vec![*pose],
    );
    let robust = starts
        .iter()
        .filter_map(|start| minimize(camera, features, start, settings.corner_sigma_px))
        .min_by(|a, b| a.cost.total_cmp(&b.cost))
        .ok_or(NoFix::NotObservable)?;
    let kept = within_gate(camera, features, &robust.pose, settings);
    if 2 * kept.len() <= features.len() || kept.len() < 4 {
        return Err(NoFix::BadResidual);
    }
    let refined = minimize(camera, &kept, &robust.pose, settings.corner_sigma_px)
        .ok_or(NoFix::NotObservable)?;
    outcome(camera, &kept, &refined.pose, settings)
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
    let reprojector = Reprojector::new(camera, hall_from_body);
    let JtJ = places
        .iter()
        .filter_map(|place| reprojector.reproject(place))
        .filter(|(pixel, _)| camera.contains(pixel, 0.0))
        .map(|(_, J)| J.transpose() * J)
        .sum::<Matrix6<f64>>();
    inverse_if_well_posed(&JtJ).map(|inverse| inverse * corner_sigma_px.powi(2))
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

/// Projects hall points from one pose; what the points share is computed once.
struct Reprojector<'a> {
    camera: &'a CameraModel,
    body_from_hall: Transform<Body, Hall>,
    camera_from_body: Transform<Camera, Body>,
    R_cb: Matrix3<f64>,
    R_ch: Matrix3<f64>,
}

impl<'a> Reprojector<'a> {
    fn new(camera: &'a CameraModel, hall_from_body: &Transform<Hall, Body>) -> Self {
        let body_from_hall = hall_from_body.inverse();
        let camera_from_body = camera.body_from_camera.inverse();
        let R_cb = camera_from_body.rotation.matrix();
        let R_ch = R_cb * body_from_hall.rotation.matrix();
        Self { camera, body_from_hall, camera_from_body, R_cb, R_ch }
    }

    /// Pixel of a hall point, and its derivative by the pose (2×6).
    ///
    /// ```text
    /// p_c = R_cb (Rᵀ (P − p) − t_bc),   ∂p_c/∂p = −R_cb Rᵀ,   ∂p_c/∂θ = R_cb [Rᵀ (P − p)]^
    /// ```
    fn reproject(&self, place: &Point<Hall>) -> Option<(Vector2<f64>, Matrix2x6<f64>)> {
        let p_body = self.body_from_hall * *place;
        let (pixel, by_p_camera) = self.camera.project(&(self.camera_from_body * p_body))?;
        let mut J = Matrix2x6::zeros();
        J.fixed_columns_mut::<3>(0).copy_from(&(by_p_camera * -self.R_ch));
        J.fixed_columns_mut::<3>(3).copy_from(&(by_p_camera * self.R_cb * skew(&p_body.coords)));
        Some((pixel, J))
    }
}

struct Minimum {
    pose: Transform<Hall, Body>,
    cost: f64,
}

/// Huber's loss of a residual length in σ, and the weight of its square.
fn huber(sigmas: f64) -> (f64, f64) {
    if sigmas <= HUBER_SIGMAS {
        (0.5 * sigmas * sigmas, 1.0)
    } else {
        (HUBER_SIGMAS * (sigmas - 0.5 * HUBER_SIGMAS), HUBER_SIGMAS / sigmas)
    }
}

/// Points that a wrong pose puts behind the camera cost as much as one at this many σ.
const UNSEEN_SIGMAS: f64 = 200.0;

struct Normal {
    JtJ: Matrix6<f64>,
    Jtr: Vector6<f64>,
    cost: f64,
}

fn normal_equations(
    camera: &CameraModel,
    features: &[PointFeature],
    pose: &Transform<Hall, Body>,
    sigma_px: f64,
) -> Normal {
    let mut normal = Normal { JtJ: Matrix6::zeros(), Jtr: Vector6::zeros(), cost: 0.0 };
    let reprojector = Reprojector::new(camera, pose);
    for feature in features {
        let Some((pixel, J)) = reprojector.reproject(&feature.place) else {
            normal.cost += huber(UNSEEN_SIGMAS).0;
            continue;
        };
        let residual = (feature.pixel - pixel) / sigma_px;
        let (loss, weight) = huber(residual.norm());
        let J = J / sigma_px;
        normal.JtJ += J.transpose() * J * weight;
        normal.Jtr += J.transpose() * residual * weight;
        normal.cost += loss;
    }
    normal
}

fn moved(pose: &Transform<Hall, Body>, step: &Vector6<f64>) -> Transform<Hall, Body> {
    pose.perturbed(&step.fixed_rows::<3>(0).into_owned(), &step.fixed_rows::<3>(3).into_owned())
}

/// Levenberg–Marquardt from one start; `None` if the normal equations are singular.
fn minimize(
    camera: &CameraModel,
    features: &[PointFeature],
    start: &Transform<Hall, Body>,
    sigma_px: f64,
) -> Option<Minimum> {
    let mut pose = *start;
    let mut normal = normal_equations(camera, features, &pose, sigma_px);
    let mut damping = 1e-4;
    for _ in 0..MAX_ITERATIONS {
        let damped = normal.JtJ + Matrix6::from_diagonal(&normal.JtJ.diagonal()) * damping;
        let step = damped.cholesky()?.solve(&normal.Jtr);
        let candidate = moved(&pose, &step);
        let next = normal_equations(camera, features, &candidate, sigma_px);
        if next.cost < normal.cost {
            let gained = normal.cost - next.cost;
            (pose, normal) = (candidate, next);
            damping = (damping * 0.2).max(1e-12);
            if gained < 1e-9 * (1.0 + normal.cost) {
                break;
            }
        } else {
            damping *= 8.0;
            if step.norm() < 1e-10 || damping > 1e10 {
                break;
            }
        }
    }
    Some(Minimum { pose, cost: normal.cost })
}

/// Tags that give starts: the largest ones determine their own pose best.
const MAX_START_TAGS: usize = 6;
/// Starts that are worth an iteration, by their cost before it.
const MAX_STARTS: usize = 3;

/// The best starts from single tags, both planar solutions of each.
fn cold_starts(
    camera: &CameraModel,
    features: &[PointFeature],
    sigma_px: f64,
) -> Vec<Transform<Hall, Body>> {
    let mut tags: Vec<&[PointFeature; 4]> = features.as_chunks::<4>().0.iter().collect();
    let diagonal_px = |tag: &[PointFeature; 4]| (tag[2].pixel - tag[0].pixel).norm();
    tags.sort_by(|a, b| diagonal_px(b).total_cmp(&diagonal_px(a)));
    let mut starts: Vec<_> = tags
        .into_iter()
        .take(MAX_START_TAGS)
        .flat_map(|tag| single_tag_poses(camera, tag))
        .map(|pose| (normal_equations(camera, features, &pose, sigma_px).cost, pose))
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.into_iter().take(MAX_STARTS).map(|(_, pose)| pose).collect()
}

fn single_tag_poses(
    camera: &CameraModel,
    tag: &[PointFeature; 4],
) -> impl Iterator<Item = Transform<Hall, Body>> + use<> {
    let mut directions = [Vector2::zeros(); 4];
    let mut is_seen = true;
    for (direction, corner) in directions.iter_mut().zip(tag) {
        match camera.unproject(&corner.pixel) {
            Some(n) => *direction = n,
            None => is_seen = false,
        }
    }
    let corners = tag.map(|corner| corner.place);
    let body_from_camera = camera.body_from_camera;
    let candidates =
        if is_seen { camera_from_hall_candidates(&corners, &directions) } else { Vec::new() };
    candidates
        .into_iter()
        .map(move |camera_from_hall| (body_from_camera * camera_from_hall).inverse())
}

fn within_gate(
    camera: &CameraModel,
    features: &[PointFeature],
    pose: &Transform<Hall, Body>,
    settings: &Settings,
) -> Vec<PointFeature> {
    let gate_px = POINT_GATE_SIGMAS * settings.corner_sigma_px;
    let reprojector = Reprojector::new(camera, pose);
    let is_near = |feature: &&PointFeature| {
        reprojector
            .reproject(&feature.place)
            .is_some_and(|(pixel, _)| (pixel - feature.pixel).norm() <= gate_px)
    };
    features.iter().filter(is_near).copied().collect()
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
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let residual_rms_px = (squares_px2 / (2 * features.len()) as f64).sqrt();
    // Corners worse than configured widen the covariance; better ones do not narrow it.
    let sigma_px = settings.corner_sigma_px.max(residual_rms_px);
    let pose_cov = inverse_if_well_posed(&JtJ).ok_or(NoFix::NotObservable)? * (sigma_px * sigma_px);
    let position_sigma_m = (0..3).map(|axis| pose_cov[(axis, axis)].sqrt()).fold(0.0, f64::max);
    if position_sigma_m > settings.max_position_sigma_m {
        return Err(NoFix::NotObservable);
    }
    Ok(FixOutcome {
        hall_from_body: *pose,
        pose_cov,
        residual_rms_px,
        q_pos: q_pos(&pose_cov),
        q_position: q_position(&pose_cov),
    })
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
mod tests {
    use super::super::camera_model::tests::distorted_camera;
    use super::*;
    use crate::geometry::Rotation;
    use crate::stats::{Noise, SeedBook};

    /// Tags on two walls of a hall, edges of 0.5 m.
    fn wall_tags() -> Vec<[Point<Hall>; 4]> {
        let mut tags = Vec::new();
        for (y, z) in [(-3.0, 2.0), (0.0, 2.3), (3.1, 2.0), (-2.9, 5.0), (0.2, 5.2), (3.0, 5.1)] {
            tags.push(
                [(0.0, 0.0), (-0.5, 0.0), (-0.5, 0.5), (0.0, 0.5)]
                    .map(|(dy, dz)| Point::new(10.0, y + dy, z + dz)),
            );
        }
        for (x, z) in [(5.0, 3.0), (7.5, 5.0)] {
            tags.push(
                [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)]
                    .map(|(dx, dz)| Point::new(x + dx, 5.0, z + dz)),
            );
        }
        tags
    }

    fn truth() -> Transform<Hall, Body> {
        Transform::new(Rotation::from_euler_rad(0.05, 0.08, 0.12), Point::new(0.4, -0.6, 4.0))
    }

    fn seen(pose: &Transform<Hall, Body>, sigma_px: f64, noise: &mut Noise) -> Vec<PointFeature> {
        let camera = distorted_camera();
        let mut seen = Vec::new();
        for tag in wall_tags() {
            let corners: Option<Vec<PointFeature>> = tag
                .iter()
                .map(|&place| {
                    let (pixel, _) = Reprojector::new(&camera, pose).reproject(&place)?;
                    let blur = Vector2::new(noise.normal(), noise.normal()) * sigma_px;
                    camera
                        .contains(&pixel, 0.0)
                        .then_some(PointFeature { place, pixel: pixel + blur })
                })
                .collect();
            seen.extend(corners.unwrap_or_default());
        }
        assert!(seen.len() >= 16, "only {} corners in view", seen.len());
        seen
    }

    #[test]
    fn fix_jacobian_matches_central_difference() {
        let camera = distorted_camera();
        let pose = truth();
        for place in wall_tags().concat() {
            let Some((_, J)) = Reprojector::new(&camera, &pose).reproject(&place) else { continue };
            for k in 0..6 {
                let step = Vector6::ith(k, 1e-6);
                let at = |s: Vector6<f64>| {
                    let moved = moved(&pose, &s);
                    Reprojector::new(&camera, &moved).reproject(&place).map(|r| r.0)
                };
                let numeric = (at(step).expect("seen") - at(-step).expect("seen")) / 2e-6;
                let analytic: Vector2<f64> = J.column(k).into();
                assert!((numeric - analytic).norm() < 1e-4 * (1.0 + analytic.norm()));
            }
        }
    }

    #[test]
    fn cold_start_finds_the_pose_and_ignores_a_wrong_tag() {
        let mut noise = SeedBook::new(5).stream("px");
        let mut features = seen(&truth(), 0.0, &mut noise);
        for corner in &mut features[0..4] {
            corner.pixel += Vector2::new(60.0, -45.0);
        }
        let fix = solve(&distorted_camera(), &features, None, &Settings::default()).expect("a fix");
        assert!((fix.hall_from_body.origin - truth().origin).coords.norm() < 1e-6);
        assert!(fix.hall_from_body.rotation.minus(&truth().rotation).norm() < 1e-7);
    }

    #[test]
    fn covariance_matches_the_scatter_of_fixes() {
        let camera = distorted_camera();
        let settings = Settings { corner_sigma_px: 0.3, max_position_sigma_m: 1.0 };
        let mut noise = SeedBook::new(11).stream("px");
        let n = 2_000;
        let mut scatter = Matrix6::zeros();
        let places: Vec<_> = seen(&truth(), 0.0, &mut noise).iter().map(|f| f.place).collect();
        for _ in 0..n {
            let features = seen(&truth(), settings.corner_sigma_px, &mut noise);
            let fix = solve(&camera, &features, Some(&truth()), &settings).expect("a fix");
            let dp = (fix.hall_from_body.origin - truth().origin).coords;
            let dr = fix.hall_from_body.rotation.minus(&truth().rotation);
            let error = Vector6::new(dp.x, dp.y, dp.z, dr.x, dr.y, dr.z);
            scatter += error * error.transpose() / f64::from(n);
        }
        let predicted = predicted_cov(&camera, &places, &truth(), settings.corner_sigma_px)
            .expect("observable");
        for k in 0..6 {
            // A variance from 2,000 draws has a relative σ of 3.2 %; the robust loss costs 5 %.
            let ratio = scatter[(k, k)] / predicted[(k, k)];
            assert!((0.88..1.18).contains(&ratio), "axis {k}: {ratio}");
        }
    }

    #[test]
    fn a_single_distant_point_group_is_not_observable() {
        let camera = distorted_camera();
        let all = seen(&truth(), 0.0, &mut SeedBook::new(1).stream("px"));
        let line = [all[0], all[0], all[1], all[1]];
        let fix = solve(&camera, &line, Some(&truth()), &Settings::default());
        assert_eq!(fix.unwrap_err(), NoFix::NotObservable);
    }

    #[test]
    fn quality_is_one_over_the_root_of_the_trace() {
        let cov = Matrix6::from_diagonal_element(0.25 / 6.0);
        assert!((q_pos(&cov) - 2.0).abs() < 1e-12);
    }
}
