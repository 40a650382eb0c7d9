//! The tight update against the plain stacked one.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::*;
use crate::geometry::Rotation;
use crate::localization::camera_model::tests::distorted_camera;
use crate::localization::filter::Covariance;
use crate::stats::{Noise, SeedBook};
use crate::time::Stamp;
use nalgebra::{DMatrix, DVector};
use std::time::Duration;

pub(super) fn state(noise: &mut Noise, scale: f64) -> FilterState {
    let half = Covariance::from_fn(|_, _| noise.normal()) * scale;
    FilterState {
        at: Stamp::ZERO,
        hall_from_body: Transform::new(
            Rotation::from_euler_rad(0.05, 0.08, 0.12),
            Point::new(0.4, -0.6, 4.0),
        ),
        velocity_mps: Vector3::new(1.1, -0.7, 0.2),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        P: half * half.transpose() + Covariance::identity() * (0.01 * scale * scale),
        places: None,
    }
}

pub(super) const RATE: Vector3<f64> = Vector3::new(0.3, -0.5, 0.8);

/// Ten tags of half a metre on a wall ahead, seen from `truth` with noise of `noise_px`.
pub(super) fn frame(
    truth: &Viewpoint,
    noise_px: f64,
    readout: Duration,
    noise: &mut Noise,
) -> Frame {
    let camera = Arc::new(CameraModel { readout, ..distorted_camera() });
    let empty = Frame { camera, points: Vec::new(), corner_sigma_px: 0.4, capture_sigma_s: 0.002 };
    let mut points = Vec::new();
    for k in 0..10 {
        let (y, z) = (f64::from(k % 5) * 1.4 - 3.0, 3.0 + f64::from(k / 5) * 1.6);
        for (dy, dz) in [(0.0, 0.0), (-0.5, 0.0), (-0.5, 0.5), (0.0, 0.5)] {
            let mut point = Sighting {
                place: Point::new(10.0 + 0.2 * f64::from(k % 3), y + dy, z + dz),
                pixel: Vector2::zeros(),
                offset_s: 0.0,
                place_idx: usize::try_from(k).unwrap(),
            };
            // The row decides the offset and the offset the row: a few rounds settle that.
            for _ in 0..4 {
                let seen = Projector::new(&empty, truth).residual(&point).expect("in view");
                point.pixel -= seen.r * empty.corner_sigma_px;
                point.offset_s = empty.camera.row_offset_s(point.pixel.y);
            }
            point.pixel += Vector2::new(noise.normal(), noise.normal()) * noise_px;
            points.push(point);
        }
    }
    Frame { points, ..empty }
}

#[test]
fn point_jacobian_matches_central_difference_with_a_rolling_shutter() {
    let mut noise = SeedBook::new(2).stream("points");
    let view = Viewpoint::of(&state(&mut noise, 0.01), &RATE);
    let frame = frame(&view, 1.0, Duration::from_millis(30), &mut noise);
    assert!(frame.points.iter().any(|point| point.offset_s.abs() > 1e-3), "the premise");
    for point in &frame.points {
        let J = Projector::new(&frame, &view).residual(point).expect("in view").J;
        for k in 0..6 {
            let at = |step: f64| {
                let moved = view.shifted(&Vector6::ith(k, step));
                Projector::new(&frame, &moved).residual(point).expect("in view").r
            };
            // The residual falls where the projection grows.
            let numeric = (at(-1e-6) - at(1e-6)) / 2e-6;
            let analytic: Vector2<f64> = J.column(k).into();
            assert!((numeric - analytic).norm() < 1e-4 * (1.0 + analytic.norm()), "axis {k}");
        }
    }
}

#[test]
fn compressed_update_equals_the_stacked_one() {
    for (seed, capture_sigma_s) in [(1, 0.0), (2, 0.002), (3, 0.02)] {
        let mut noise = SeedBook::new(seed).stream("stacked");
        let mut compressed = state(&mut noise, 0.02);
        let prior = compressed.clone();
        let view = Viewpoint::of(&prior, &RATE);
        let frame = frame(&view, 0.4, Duration::ZERO, &mut noise);
        let residuals: Vec<_> = {
            let projector = Projector::new(&frame, &view);
            frame.points.iter().filter_map(|point| projector.residual(point)).collect()
        };
        assert_eq!(residuals.len(), 40);
        let mut all = Information::none();
        residuals.iter().for_each(|residual| all.add(residual, 1.0));
        let pose_prior = PosePrior::new(&prior, &view.motion(), capture_sigma_s).expect("regular");
        let gain = apply(&mut compressed, &pose_prior, &view.motion(), capture_sigma_s, &all)
            .expect("regular");

        // All 80 rows at once, in Joseph form, with the common time error in R.
        let mut H = DMatrix::<f64>::zeros(80, 15);
        let mut r = DVector::<f64>::zeros(80);
        for (k, residual) in residuals.iter().enumerate() {
            H.view_mut((2 * k, 0), (2, 6)).copy_from(&residual.J);
            r.rows_mut(2 * k, 2).copy_from(&residual.r);
        }
        let shift = H.columns(0, 6) * view.motion() * capture_sigma_s;
        let R = DMatrix::identity(80, 80) + &shift * shift.transpose();
        let P = DMatrix::from_iterator(15, 15, prior.P.iter().copied());
        let S = &H * &P * H.transpose() + &R;
        let K = &P * H.transpose() * S.try_inverse().expect("regular");
        let A = DMatrix::identity(15, 15) - &K * &H;
        let stacked_P = &A * &P * A.transpose() + &K * R * K.transpose();
        let error = &K * r;

        let scale = prior.P.diagonal().map(f64::sqrt);
        for i in 0..15 {
            for j in 0..15 {
                let apart = (compressed.P[(i, j)] - stacked_P[(i, j)]) / (scale[i] * scale[j]);
                assert!(apart.abs() < 1e-9, "P {i} {j}: {apart:e}");
                let of_gain = A[(i, j)] - f64::from(u8::from(i == j))
                    + if j < 6 { gain.U[(i, j)] } else { 0.0 };
                assert!((of_gain * scale[j] / scale[i]).abs() < 1e-9, "A {i} {j}: {of_gain:e}");
            }
        }
        let mut expected = prior.clone();
        let column = crate::localization::propagation::Error::from_iterator(error.iter().copied());
        expected.correct(&column);
        let apart = expected.hall_from_body.origin - compressed.hall_from_body.origin;
        assert!(apart.coords.norm() < 1e-9 * scale[0]);
        assert!((expected.velocity_mps - compressed.velocity_mps).norm() < 1e-9 * scale[6]);
        assert!((expected.accel_bias_mps2 - compressed.accel_bias_mps2).norm() < 1e-9 * scale[12]);
    }
}

#[test]
fn a_wide_prior_settles_in_the_minimum() {
    // The prior is wrong by 0.3 m and 0.1 rad and knows it; the corners have little noise.
    let mut noise = SeedBook::new(4).stream("wide");
    let mut state = state(&mut noise, 0.05);
    state.P = Covariance::identity() * 0.05;
    let prior = Viewpoint::of(&state, &RATE);
    let truth = prior.shifted(&Vector6::new(0.2, -0.15, 0.15, 0.05, -0.06, 0.05));
    let mut frame = frame(&truth, 0.1, Duration::ZERO, &mut noise);
    frame.capture_sigma_s = 0.0;
    let (outcome, _) = fuse(&mut state, &RATE, &frame);
    assert!(outcome.is_fused && outcome.n_used == 40, "{outcome:?}");
    // Brute force: Σ rᵀr + cᵀ P⁻¹ c has its minimum where the state went.
    let cost = |c: &Vector6<f64>| {
        let view = prior.shifted(c);
        let projector = Projector::new(&frame, &view);
        let squares = frame.points.iter().filter_map(|point| projector.residual(point));
        squares.map(|residual| residual.r.norm_squared()).sum::<f64>() + c.norm_squared() / 0.05
    };
    let moved = (state.hall_from_body.origin - prior.hall_from_body.origin).coords;
    let turned = state.hall_from_body.rotation.minus(&prior.hall_from_body.rotation);
    let c = Vector6::new(moved.x, moved.y, moved.z, turned.x, turned.y, turned.z);
    for k in 0..6 {
        let step = Vector6::ith(k, 1e-4);
        let (below, at, above) = (cost(&(c - step)), cost(&c), cost(&(c + step)));
        // Newton's step to the minimum along this axis.
        let rest = 1e-4 * 0.5 * (above - below) / (above - 2.0 * at + below);
        assert!(rest.abs() < 2e-6, "axis {k}: {rest:e} away");
    }
}

#[test]
fn outlying_corners_have_no_say() {
    let mut noise = SeedBook::new(5).stream("outliers");
    let start = state(&mut noise, 0.004);
    let view = Viewpoint::of(&start, &RATE);
    let clean = frame(&view, 0.4, Duration::ZERO, &mut noise);
    let mut dirty = clean.clone();
    let mut kept = clean.clone();
    kept.points.clear();
    for (k, point) in dirty.points.iter_mut().enumerate() {
        if k % 10 < 3 {
            point.pixel += Vector2::new(noise.between(20.0, 80.0), noise.between(-80.0, -20.0));
        } else {
            kept.points.push(clean.points[k]);
        }
    }
    let (mut a, mut b) = (start.clone(), start);
    let (with, _) = fuse(&mut a, &RATE, &dirty);
    let (without, _) = fuse(&mut b, &RATE, &kept);
    assert!(with.is_fused && with.n_points == 40 && with.n_used == without.n_used);
    assert!((a.hall_from_body.origin - b.hall_from_body.origin).coords.norm() < 1e-9);
    assert!((a.P - b.P).amax() < 1e-12);
}

#[test]
fn corners_that_scatter_widen_their_sigma() {
    let mut noise = SeedBook::new(6).stream("scatter");
    let mut state = state(&mut noise, 0.01);
    let view = Viewpoint::of(&state, &RATE);
    let frame = frame(&view, 0.7, Duration::ZERO, &mut noise);
    let (outcome, _) = fuse(&mut state, &RATE, &frame);
    // True σ over said σ is 1.75; the gate cuts the tails of it.
    assert!(outcome.is_fused && (1.2..1.8).contains(&outcome.sigma_factor), "{outcome:?}");
}
