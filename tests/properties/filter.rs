//! The filter and its ring under long random sequences.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use crate::support::at_ns;
use nalgebra::{Matrix6, SMatrix, Vector3};
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::localization::filter::{Covariance, FilterState, ImuNoise};
use stockpilot::localization::ring::{Insertion, Ring};
use stockpilot::messages::{FixOutcome, ImuSample};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

const STEP_NS: i64 = 5_000_000;

fn start() -> FilterState {
    FilterState {
        at: at_ns(0),
        hall_from_body: Transform::new(
            Rotation::from_euler_rad(0.1, -0.2, 2.5),
            Point::new(3.0, -1.0, 4.0),
        ),
        velocity_mps: Vector3::new(0.3, 0.2, -0.1),
        gyro_bias_radps: Vector3::new(0.002, -0.001, 0.003),
        accel_bias_mps2: Vector3::new(0.05, -0.02, 0.1),
        P: Covariance::identity() * 0.01,
        places: None,
    }
}

fn imu(at: Stamp<Mono>, noise: &mut Noise) -> ImuSample {
    ImuSample {
        at,
        accel_mps2: Vector3::z() * 9.8 + noise.normal3() * 3.0,
        gyro_radps: noise.normal3() * 1.5,
    }
}

/// A fix near a pose, its covariance random, correlated, from 1 mm to 1 m.
fn fix(near: &Transform<Hall, Body>, noise: &mut Noise) -> FixOutcome {
    let scale = 10_f64.powf(noise.between(-3.0, 0.0));
    let spread = Matrix6::from_fn(|_, _| noise.normal()) * scale;
    let pose_cov = spread * spread.transpose() + Matrix6::identity() * (1e-2 * scale * scale);
    let (p, r) = (noise.normal3() * (scale * 0.3), noise.normal3() * (scale * 0.1));
    FixOutcome {
        hall_from_body: near.perturbed(&p, &r),
        pose_cov,
        residual_rms_px: 0.3,
        n_points: 8,
        q_pos: 1.0,
        q_position: 1.0,
    }
}

/// Asymmetry and the smallest eigenvalue, both relative to the scales of the states.
fn defects(P: &Covariance) -> (f64, f64) {
    let scale: SMatrix<f64, 15, 1> = P.diagonal().map(|v| 1.0 / v.max(1e-300).sqrt());
    let unit = Covariance::from_fn(|i, j| P[(i, j)] * scale[i] * scale[j]);
    let asymmetry = (unit - unit.transpose()).amax();
    (asymmetry, ((unit + unit.transpose()) * 0.5).symmetric_eigenvalues().min())
}

#[test]
fn covariance_stays_symmetric_and_positive_over_long_sequences() {
    for seed in 0..4 {
        let mut noise = SeedBook::new(seed).stream("sequence");
        let mut state = start();
        for k in 1..=20_000 {
            let at = at_ns(k * STEP_NS);
            state = state.propagated(&imu(at, &mut noise), at, &ImuNoise::default());
            if k % 10 == 0 && noise.chance(0.9) {
                let fix = fix(&state.hall_from_body, &mut noise);
                let innovation = state.innovation(&fix);
                assert!(innovation.nis >= 0.0 && innovation.nis.is_finite());
                let before = state.P.diagonal();
                state.fuse(&fix, &innovation);
                let after = state.P.diagonal();
                let grows = (after - before).component_div(&before).max();
                assert!(grows < 1e-9, "an update made a variance grow by {grows}");
            }
            if k % 50 == 0 {
                let (asymmetry, smallest) = defects(&state.P);
                assert!(asymmetry < 1e-9, "seed {seed} step {k}: asymmetry {asymmetry}");
                assert!(smallest > -1e-9, "seed {seed} step {k}: eigenvalue {smallest}");
            }
        }
    }
}

/// Fixes with their times, all of them compatible with each other: a pose that is known well.
fn consistent_fixes(truth: &Ring, n: i64, noise: &mut Noise) -> Vec<(Stamp<Mono>, FixOutcome)> {
    (0..n)
        .map(|k| {
            // Never on the instant of a sample.
            let at = at_ns(STEP_NS * (20 + 7 * k) + 1_234_567);
            let pose = truth.state_at(at).expect("inside the ring").hall_from_body;
            let (p, r) = (noise.normal3() * 0.01, noise.normal3() * 0.005);
            let fix = FixOutcome {
                hall_from_body: pose.perturbed(&p, &r),
                pose_cov: Matrix6::from_diagonal_element(4e-4),
                residual_rms_px: 0.3,
                n_points: 8,
                q_pos: 20.0,
                q_position: 20.0,
            };
            (at, fix)
        })
        .collect()
}

fn ring_of_a_second(seed: u64) -> Ring {
    let mut noise = SeedBook::new(seed).stream("imu");
    let first = imu(at_ns(0), &mut noise);
    let mut ring = Ring::new(start(), first, ImuNoise::default(), Duration::from_secs(2));
    for k in 1..=200 {
        ring.push_imu(imu(at_ns(k * STEP_NS), &mut noise));
    }
    ring
}

fn shuffled<T>(items: &mut [T], noise: &mut Noise) {
    for k in (1..items.len()).rev() {
        let j = usize::try_from(noise.bits() % (k as u64 + 1)).expect("a small number");
        items.swap(k, j);
    }
}

/// The end of the ring after these fixes, and how many passed their gate on arrival.
fn outcome(seed: u64, fixes: &[(Stamp<Mono>, FixOutcome)]) -> (FilterState, usize) {
    let mut ring = ring_of_a_second(seed);
    let mut n_fused = 0;
    for (at, fix) in fixes {
        let insertion = ring.insert_fix(*at, fix.clone());
        let Insertion::Placed(innovation) = insertion else { unreachable!("{insertion:?}") };
        n_fused += usize::from(innovation.is_within_gate());
    }
    (ring.newest().clone(), n_fused)
}

#[test]
fn order_of_arrival_does_not_matter() {
    for seed in 0..6 {
        let mut noise = SeedBook::new(seed).stream("fixes");
        let mut fixes = consistent_fixes(&ring_of_a_second(seed), 24, &mut noise);
        let (in_order, n_fused) = outcome(seed, &fixes);
        assert_eq!(n_fused, 24, "the premise: all fixes agree");
        for _ in 0..5 {
            shuffled(&mut fixes, &mut noise);
            assert_eq!(outcome(seed, &fixes).0, in_order);
        }
    }
}

#[test]
fn order_of_arrival_does_not_matter_where_the_gate_refuses() {
    let mut n_refused = 0;
    for seed in 0..6 {
        let mut noise = SeedBook::new(seed).stream("fixes");
        let mut fixes = consistent_fixes(&ring_of_a_second(seed), 24, &mut noise);
        // Some are off by far more than their covariance, some by about as much as the gate.
        for (k, (_, fix)) in fixes.iter_mut().enumerate() {
            if k % 3 == 1 {
                let off = noise.normal3() * if k % 2 == 0 { 0.08 } else { 2.0 };
                fix.hall_from_body = fix.hall_from_body.perturbed(&off, &Vector3::zeros());
            }
        }
        let (in_order, n_fused) = outcome(seed, &fixes);
        n_refused += fixes.len() - n_fused;
        for _ in 0..5 {
            shuffled(&mut fixes, &mut noise);
            assert_eq!(outcome(seed, &fixes).0, in_order, "seed {seed}");
        }
    }
    assert!(n_refused > 10, "only {n_refused} refused");
}
