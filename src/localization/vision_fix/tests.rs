use super::least_squares::moved;
use super::*;
use crate::geometry::Rotation;
use crate::localization::camera_model::tests::{distorted_camera, fisheye_camera};
use crate::messages::{CameraId, TagFamily};
use crate::stats::{Noise, SeedBook};
use crate::time::Stamp;
use nalgebra::Vector6;

mod faults;
mod observability;
mod points;

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

/// The pixel of a place, if it is in the picture.
fn pixel_of(
    camera: &CameraModel,
    pose: &Transform<Hall, Body>,
    place: &Point<Hall>,
) -> Option<Vector2<f64>> {
    let camera_from_hall = (*pose * camera.body_from_camera).inverse();
    let (pixel, _) = camera.project(&(camera_from_hall * *place))?;
    camera.contains(&pixel, 0.0).then_some(pixel)
}

/// The corners of those tags that are wholly in the picture, four by four.
fn seen_tags(
    camera: &CameraModel,
    tags: &[[Point<Hall>; 4]],
    pose: &Transform<Hall, Body>,
    (sigma_px, noise): (f64, &mut Noise),
) -> Vec<PointFeature> {
    let mut seen = Vec::new();
    for tag in tags {
        let corners: Option<Vec<PointFeature>> = tag
            .iter()
            .map(|&place| {
                let blur = Vector2::new(noise.normal(), noise.normal()) * sigma_px;
                Some(PointFeature { place, pixel: pixel_of(camera, pose, &place)? + blur })
            })
            .collect();
        seen.extend(corners.unwrap_or_default());
    }
    seen
}

fn seen(pose: &Transform<Hall, Body>, sigma_px: f64, noise: &mut Noise) -> Vec<PointFeature> {
    let seen = seen_tags(&distorted_camera(), &wall_tags(), pose, (sigma_px, noise));
    assert!(seen.len() >= 16, "only {} corners in view", seen.len());
    seen
}

/// Error of a fix in the order of its covariance.
fn error(fix: &FixOutcome, truth: &Transform<Hall, Body>) -> Vector6<f64> {
    let dp = (fix.hall_from_body.origin - truth.origin).coords;
    let dr = fix.hall_from_body.rotation.minus(&truth.rotation);
    Vector6::new(dp.x, dp.y, dp.z, dr.x, dr.y, dr.z)
}

fn cold(gravity_body: Option<Vector3<f64>>) -> Start<'static> {
    Start::Cold { gravity_body }
}

/// Gravity in body axes as a body at this pose feels it.
fn gravity(pose: &Transform<Hall, Body>) -> Vector3<f64> {
    pose.rotation.quaternion().inverse() * Vector3::new(0.0, 0.0, -9.81)
}

#[test]
fn fix_jacobian_matches_central_difference() {
    let mut noise = SeedBook::new(21).stream("poses");
    for camera in [distorted_camera(), fisheye_camera()] {
        let mut n_judged = 0;
        for _ in 0..40 {
            let turn = Vector3::new(noise.between(-0.5, 0.5), noise.between(-0.4, 0.4), 0.0);
            let shift = noise.normal3() * 1.5;
            let yaw = Vector3::new(0.0, 0.0, noise.between(-0.8, 0.8));
            let pose = truth().perturbed(&shift, &yaw).perturbed(&Vector3::zeros(), &turn);
            for place in wall_tags().concat() {
                let Some((_, J)) = Reprojector::new(&camera, &pose).reproject(&place) else {
                    continue;
                };
                let at = |s: Vector6<f64>| {
                    let pose = moved(&pose, &s);
                    Reprojector::new(&camera, &pose).reproject(&place).map(|r| r.0)
                };
                for k in 0..6 {
                    let step = Vector6::ith(k, 1e-6);
                    let (Some(plus), Some(minus)) = (at(step), at(-step)) else { continue };
                    let numeric = (plus - minus) / 2e-6;
                    let analytic: Vector2<f64> = J.column(k).into();
                    assert!((numeric - analytic).norm() < 1e-5 * (10.0 + analytic.norm()));
                    n_judged += 1;
                }
            }
        }
        assert!(n_judged > 2000, "{n_judged}");
    }
}

#[test]
fn cold_start_finds_the_pose_from_nothing() {
    for camera in [distorted_camera(), fisheye_camera()] {
        let mut noise = SeedBook::new(5).stream("px");
        let features = seen_tags(&camera, &wall_tags(), &truth(), (0.0, &mut noise));
        for start in [cold(None), cold(Some(gravity(&truth()))), Start::Prior(&truth())] {
            let fix = solve_from(&camera, &features, start, &Settings::default()).expect("a fix");
            assert!(error(&fix, &truth()).norm() < 1e-6, "{start:?}");
            assert!(fix.residual_rms_px < 1e-6);
        }
    }
}

/// Fixes of `n` noisy frames: their scatter about the truth, and the covariance they are promised.
fn scatter(
    camera: &CameraModel,
    tags: &[[Point<Hall>; 4]],
    n: u32,
    seed: u64,
) -> (Matrix6<f64>, Matrix6<f64>) {
    let settings = Settings { corner_sigma_px: 0.3, max_position_sigma_m: 1.0 };
    let mut noise = SeedBook::new(seed).stream("px");
    let mut scatter = Matrix6::zeros();
    let exact = seen_tags(camera, tags, &truth(), (0.0, &mut noise));
    let places: Vec<_> = exact.iter().map(|f| f.place).collect();
    for _ in 0..n {
        let mut features = exact.clone();
        for feature in &mut features {
            feature.pixel += Vector2::new(noise.normal(), noise.normal()) * 0.3;
        }
        let fix = solve(camera, &features, Some(&truth()), &settings).expect("a fix");
        let error = error(&fix, &truth());
        scatter += error * error.transpose() / f64::from(n);
    }
    let promised = predicted_cov(camera, &places, &truth(), 0.3).expect("observable");
    (scatter, promised)
}

#[test]
fn covariance_equals_that_of_ten_thousand_fixes() {
    // Four tags on two walls. A variance from 10,000 draws has a relative σ of 1.4 %.
    let tags: Vec<_> = [0, 2, 4, 7].map(|k| wall_tags()[k]).to_vec();
    let (scatter, promised) = scatter(&distorted_camera(), &tags, 10_000, 11);
    for k in 0..6 {
        let ratio = scatter[(k, k)] / promised[(k, k)];
        assert!((0.95..1.05).contains(&ratio), "axis {k}: {ratio}");
    }
    // All of it, correlations included: the eigenvalues of Σ⁻¹ times the scatter.
    let L = promised.cholesky().expect("positive definite").l();
    let half = L.try_inverse().expect("regular");
    let whitened = half * scatter * half.transpose();
    for eigenvalue in whitened.symmetric_eigenvalues().iter() {
        assert!((0.93..1.07).contains(eigenvalue), "{eigenvalue}");
    }
}

#[test]
fn covariance_holds_behind_a_fisheye_lens() {
    let (scatter, promised) = scatter(&fisheye_camera(), &wall_tags(), 1_500, 12);
    for k in 0..6 {
        // 1,500 draws: σ of 3.7 %.
        let ratio = scatter[(k, k)] / promised[(k, k)];
        assert!((0.88..1.12).contains(&ratio), "axis {k}: {ratio}");
    }
}

#[test]
fn residuals_widen_the_covariance_only_when_they_prove_it_too_small() {
    // 99 % quantile of χ² with 10 degrees of freedom: 23.21.
    let widened = |squares| variance_of_a_corner(squares, 10, 0.5) / 0.25;
    assert!((widened(0.25 * 23.0) - 1.0).abs() < 1e-12);
    assert!((widened(0.25 * 40.0) - 4.0).abs() < 1e-12);
    assert!((widened(0.0) - 1.0).abs() < 1e-12);
}

#[test]
fn qualities_are_one_over_the_root_of_the_trace() {
    let mut cov = Matrix6::from_diagonal_element(0.25 / 6.0);
    assert!((q_pos(&cov) - 2.0).abs() < 1e-12);
    cov[(4, 4)] = 7.0;
    assert!((q_position(&cov) - 8.0_f64.sqrt()).abs() < 1e-12);
}

/// A map of the wall tags, whose ids count from 10 in their order.
fn map_of(tags: &[[Point<Hall>; 4]]) -> MarkerMap {
    let mut map = MarkerMap::default();
    for (id, corners) in (10..).zip(tags) {
        map.insert(TagFamily::Tag36h11, id, *corners).expect("a square");
    }
    map
}

#[test]
fn sensitivity_equals_that_of_a_fix_in_a_moved_map() {
    let (camera, tags) = (distorted_camera(), wall_tags());
    let used: Vec<(TagFamily, u32)> =
        [1, 2, 4, 7].map(|k: u32| (TagFamily::Tag36h11, 10 + k)).to_vec();
    let exact: Vec<Vector2<f64>> = used
        .iter()
        .flat_map(|(_, id)| tags[*id as usize - 10])
        .map(|place| pixel_of(&camera, &truth(), &place).expect("in view"))
        .collect();
    // The same pixels in a map whose tag `moved` hangs elsewhere.
    let fix = |moved: usize, by: Vector3<f64>| {
        let features: Vec<PointFeature> = used
            .iter()
            .flat_map(|(_, id)| {
                let by = if *id as usize - 10 == moved { by } else { Vector3::zeros() };
                tags[*id as usize - 10].map(|corner| Point::from_coords(corner.coords + by))
            })
            .zip(&exact)
            .map(|(place, &pixel)| PointFeature { place, pixel })
            .collect();
        let fix = solve(&camera, &features, Some(&truth()), &Settings::default()).expect("a fix");
        error(&fix, &truth())
    };
    let sensitivities = tag_sensitivity(&camera, &map_of(&tags), &used, &truth());
    assert_eq!(sensitivities.iter().map(|s| s.tag_idx).collect::<Vec<_>>(), [1, 2, 4, 7]);
    for sensitivity in &sensitivities {
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-4);
            let numeric = (fix(sensitivity.tag_idx, step) - fix(sensitivity.tag_idx, -step)) / 2e-4;
            let analytic: Vector6<f64> = sensitivity.pose_by_place.column(axis).into();
            // The third order of a step of 0.1 mm, and where the search stops.
            let gap = (numeric - analytic).norm();
            assert!(gap < 1e-3 * analytic.norm(), "{sensitivity:?} axis {axis}: {numeric}");
        }
    }
    let sum: nalgebra::Matrix6x3<f64> = sensitivities.iter().map(|s| s.pose_by_place).sum();
    let mut together = nalgebra::Matrix6x3::zeros();
    together.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    assert!((sum - together).norm() < 1e-9, "all tags together carry the pose with them");
}

#[test]
fn sensitivity_of_what_determines_no_pose_is_empty() {
    let map = map_of(&wall_tags());
    let unknown = [(TagFamily::Tag16h5, 10), (TagFamily::Tag36h11, 99)];
    assert!(tag_sensitivity(&distorted_camera(), &map, &unknown, &truth()).is_empty());
    assert!(tag_sensitivity(&distorted_camera(), &map, &[], &truth()).is_empty());
}
