//! The joint update against dense algebra, and against filters in moved maps.

use super::super::tests::{RATE, frame, state};
use super::super::{self as tight_update, Projector};
use super::*;
use crate::localization::place_errors::PlaceErrors;
use crate::localization::propagation::Error;
use crate::messages::ImuSample;
use crate::stats::{Noise, SeedBook};
use crate::time::Stamp;
use nalgebra::{DMatrix, DVector, Vector3};
use std::time::Duration;

const SIGMA_M: f64 = 0.005;
/// Ten tags in view, and one that was seen before.
const N_PLACES: usize = 11;

/// A state whose errors owe something to all places.
fn owing(noise: &mut Noise, scale: f64) -> FilterState {
    let mut state = state(noise, scale);
    let mut errors = PlaceErrors::new(SIGMA_M).expect("a map with errors");
    let share = |noise: &mut Noise| Share::from_fn(|_, _| 0.3 * noise.normal());
    errors.add(&(0..N_PLACES).map(|place| (place, share(noise))).collect::<Vec<_>>());
    state.places = Some(errors);
    state
}

/// `cov(e, τ_0 … τ_n)` and cov(τ), as one matrix of 15 + 3 n rows.
fn dense(state: &FilterState) -> DMatrix<f64> {
    let errors = state.places.as_ref().expect("places");
    let var_m2 = SIGMA_M * SIGMA_M;
    let n = 15 + 3 * N_PLACES;
    let mut cov = DMatrix::identity(n, n) * var_m2;
    let mut own = DMatrix::from_iterator(15, 15, state.P.iter().copied());
    for place in 0..N_PLACES {
        let E = DMatrix::from_iterator(15, 3, errors.share(place).iter().copied());
        own += &E * E.transpose() * var_m2;
        cov.view_mut((0, 15 + 3 * place), (15, 3)).copy_from(&(&E * var_m2));
        cov.view_mut((15 + 3 * place, 0), (3, 15)).copy_from(&(E.transpose() * var_m2));
    }
    cov.view_mut((0, 0), (15, 15)).copy_from(&own);
    cov
}

#[test]
fn joint_update_equals_the_dense_consider_filter() {
    for (seed, capture_sigma_s) in [(1, 0.0), (2, 0.002), (3, 0.02)] {
        let mut noise = SeedBook::new(seed).stream("consider");
        let mut joint = owing(&mut noise, 0.02);
        let before = joint.clone();
        let view = Viewpoint::of(&before, &RATE);
        let frame = frame(&view, 0.4, Duration::ZERO, &mut noise);
        let projector = Projector::new(&frame, &view);
        let seen: Vec<(usize, Residual)> = frame
            .points
            .iter()
            .filter_map(|point| Some((point.place_idx, projector.residual(point)?)))
            .collect();
        assert_eq!(seen.len(), 40);
        let mut said = vec![Information::none(); 10];
        seen.iter().for_each(|(place, residual)| said[*place].add(residual, 1.0));
        let (motion, errors) = (view.motion(), before.places.clone().expect("places"));
        let places: Vec<usize> = (0..10).collect();
        let prior =
            JointPrior::new(&before, &errors, &motion, capture_sigma_s, &places).expect("regular");
        let posterior = prior.posterior(&said).expect("regular");
        let gain = apply(&mut joint, &posterior, &motion, capture_sigma_s, &said);

        // All rows and all places at once; the gain of the places is set to zero.
        let full = dense(&before);
        let n = full.nrows();
        let mut H = DMatrix::<f64>::zeros(80, n);
        let mut r = DVector::<f64>::zeros(80);
        for (k, (place, residual)) in seen.iter().enumerate() {
            H.view_mut((2 * k, 0), (2, 6)).copy_from(&residual.J);
            let by_place = -residual.J.fixed_columns::<3>(0);
            H.view_mut((2 * k, 15 + 3 * place), (2, 3)).copy_from(&by_place);
            r.rows_mut(2 * k, 2).copy_from(&residual.r);
        }
        let shift = H.columns(0, 6) * motion * capture_sigma_s;
        let R = DMatrix::identity(80, 80) + &shift * shift.transpose();
        let S = &H * &full * H.transpose() + &R;
        let S_inverse = S.try_inverse().expect("regular");
        let nis = r.dot(&(&S_inverse * &r));
        let mut K = &full * H.transpose() * S_inverse;
        K.rows_mut(15, n - 15).fill(0.0);
        let A = DMatrix::identity(n, n) - &K * &H;
        let expected = &A * &full * A.transpose() + &K * R * K.transpose();
        let found = dense(&joint);
        for i in 0..n {
            for j in 0..n {
                let scale = (full[(i, i)] * full[(j, j)]).sqrt();
                let apart = (found[(i, j)] - expected[(i, j)]) / scale;
                assert!(apart.abs() < 1e-8, "cov {i} {j}: {apart:e}");
            }
        }
        for i in 0..15 {
            for j in 0..6 {
                let scale = (full[(j, j)] / full[(i, i)]).sqrt();
                let expected = if i == j { 1.0 } else { 0.0 } - A[(i, j)];
                assert!(((gain.U[(i, j)] - expected) * scale).abs() < 1e-8, "U {i} {j}");
            }
        }
        let mut moved = before.clone();
        moved.correct(&Error::from_iterator((&K * &r).iter().take(15).copied()));
        let apart = moved.hall_from_body.origin - joint.hall_from_body.origin;
        assert!(apart.coords.norm() < 1e-9, "{}", apart.coords.norm());
        assert!((moved.velocity_mps - joint.velocity_mps).norm() < 1e-8);
        assert!((moved.accel_bias_mps2 - joint.accel_bias_mps2).norm() < 1e-8);

        // The squares that are left, and those of ẑ, are the innovation's squares in all.
        let left: f64 =
            said.iter().enumerate().map(|(k, s)| s.left_at(&posterior.view(k)).squares).sum();
        let found = left + posterior.squares;
        assert!((found - nis).abs() < 1e-6 * nis, "{found} and {nis}");

        // A tag left out, against an update that never heard it.
        for k in [0, 7] {
            let mut others = said.clone();
            others[k] = Information::none();
            let without = prior.posterior(&others).expect("regular");
            let (d, cov) = posterior.view_without(k, &said[k]).expect("regular");
            let expected = without.view_cov(k);
            assert!((d - without.view(k)).norm() < 1e-8, "tag {k}");
            assert!((cov - expected).amax() < 1e-6 * expected.amax(), "tag {k}");
        }
    }
}

#[test]
fn places_without_errors_change_nothing() {
    let mut noise = SeedBook::new(5).stream("exact");
    let mut exact = state(&mut noise, 0.01);
    let view = Viewpoint::of(&exact, &RATE);
    let frame = frame(&view, 0.4, Duration::from_millis(20), &mut noise);
    let mut joint = exact.clone();
    joint.places = PlaceErrors::new(1e-9);
    let (as_exact, _) = tight_update::fuse(&mut exact, &RATE, &frame);
    let (as_joint, _) = tight_update::fuse(&mut joint, &RATE, &frame);
    assert!(as_exact.is_fused && as_joint.is_fused);
    assert!((as_exact.nis - as_joint.nis).abs() < 1e-4 * as_exact.nis);
    assert!((exact.P - joint.total_cov()).amax() < 1e-6 * exact.P.amax());
    let apart = exact.hall_from_body.origin - joint.hall_from_body.origin;
    assert!(apart.coords.norm() < 1e-7);
}

/// Three seconds of flight, a frame every 0.1 s, in a map where one tag is `moved_m` off.
fn flown(moved_m: Vector3<f64>) -> FilterState {
    let mut noise = SeedBook::new(6).stream("flight");
    let mut state = state(&mut noise, 0.002);
    state.velocity_mps = Vector3::new(0.2, -0.1, 0.05);
    let mut truth = state.clone();
    state.places = PlaceErrors::new(SIGMA_M);
    for step in 1..=300 {
        let at = Stamp::from_nanos(step * 10_000_000);
        let phase = at.seconds();
        let imu = ImuSample {
            at,
            accel_mps2: Vector3::new(phase.sin(), 0.3, 9.8 + 0.2 * phase.cos()),
            gyro_radps: Vector3::new(0.02, -0.03, 0.04 * phase.cos()),
        };
        truth = truth.propagated(&imu, at, &Default::default());
        state = state.propagated(&imu, at, &Default::default());
        if step % 10 != 0 {
            continue;
        }
        let mut frame =
            frame(&Viewpoint::of(&truth, &imu.gyro_radps), 0.0, Duration::ZERO, &mut noise);
        let of_tag = frame.points.iter_mut().filter(|point| point.place_idx == 3);
        of_tag.for_each(|point| point.place.coords += moved_m);
        let (outcome, _) = tight_update::fuse(&mut state, &imu.gyro_radps, &frame);
        assert!(outcome.is_fused && outcome.n_used == 40, "{outcome:?}");
    }
    state
}

#[test]
fn place_errors_equal_those_of_a_filter_in_a_moved_map() {
    let share = flown(Vector3::zeros()).places.expect("places").share(3);
    for axis in 0..3 {
        let by = Vector3::ith(axis, 1e-3);
        let (a, b) = (flown(by), flown(-by));
        let (a_pose, b_pose) = (&a.hall_from_body, &b.hall_from_body);
        let position = (a_pose.origin - b_pose.origin).coords / 2e-3;
        let attitude = a_pose.rotation.minus(&b_pose.rotation) / 2e-3;
        let velocity = (a.velocity_mps - b.velocity_mps) / 2e-3;
        let column = share.column(axis);
        let largest = column.fixed_rows::<3>(0).amax();
        assert!(largest > 0.02, "the premise: {largest}");
        // A millimetre moves the linearisation by a few parts in a thousand.
        let apart =
            |found: Vector3<f64>, first: usize| (found - column.fixed_rows::<3>(first)).norm();
        assert!(apart(position, 0) < 0.02 * largest, "{position} {column}");
        assert!(apart(attitude, 3) < 0.02 * largest, "{attitude} {column}");
        assert!(apart(velocity, 6) < 0.02 * largest, "{velocity} {column}");
    }
}
