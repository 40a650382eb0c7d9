//! Normalised estimation errors of the filter, over 30 runs of 20 s with 20 fixes a second.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use crate::truth::{Motion, Sensors, fix, stamp};
use nalgebra::{Matrix6, SVector, Vector3};
use std::ops::Range;
use stockpilot::localization::filter::{Covariance, FilterState, ImuNoise};
use stockpilot::messages::state::{ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL};
use stockpilot::stats::{Noise, SeedBook};

const N_RUNS: u64 = 30;
const IMU_RATE_HZ: f64 = 200.0;
const STEPS_PER_FIX: u32 = 10;
const N_STEPS: u32 = 4_000;
/// Errors are looked at this often, the first seconds left out.
const LOOK_EVERY: u32 = 1_000;

/// Sharp where markers give much, wide along the line of sight, position and attitude correlated.
fn fix_cov() -> Matrix6<f64> {
    let mut cov =
        Matrix6::from_diagonal(&nalgebra::Vector6::new(9e-4, 4e-4, 4e-4, 1.6e-5, 2.5e-5, 9e-6));
    for (i, j, correlation) in [(1, 5, 0.6), (2, 4, -0.7), (1, 3, 0.4)] {
        let covariance: f64 = correlation * f64::sqrt(cov[(i, i)] * cov[(j, j)]);
        cov[(i, j)] = covariance;
        cov[(j, i)] = covariance;
    }
    cov
}

const SIGMAS: [(Range<usize>, f64); 5] =
    [(POS, 0.05), (ATT, 0.02), (VEL, 0.1), (GYRO_BIAS, 0.003), (ACCEL_BIAS, 0.1)];

/// Truth minus estimate in the order of the error state.
fn error(truth: (&Motion, f64, &Sensors), state: &FilterState) -> SVector<f64, 15> {
    let (motion, t, sensors) = truth;
    let pose = motion.pose(t);
    let parts = [
        (pose.origin - state.hall_from_body.origin).coords,
        pose.rotation.minus(&state.hall_from_body.rotation),
        motion.velocity_mps(t) - state.velocity_mps,
        sensors.gyro_bias_radps - state.gyro_bias_radps,
        sensors.accel_bias_mps2 - state.accel_bias_mps2,
    ];
    SVector::from_iterator(parts.iter().flat_map(|part| part.iter().copied()))
}

/// eᵀ P⁻¹ e of one group of states.
fn nees(error: &SVector<f64, 15>, P: &Covariance, group: &Range<usize>) -> f64 {
    let e: Vector3<f64> = error.fixed_rows::<3>(group.start).into();
    let cov = P.fixed_view::<3, 3>(group.start, group.start).into_owned();
    e.dot(&cov.cholesky().expect("a positive definite block").solve(&e))
}

/// The start: an error drawn from the covariance that the filter is told.
fn drawn_start(motion: &Motion, noise: &mut Noise) -> (FilterState, Sensors) {
    let mut P = Covariance::zeros();
    for (group, sigma) in SIGMAS {
        for k in group {
            P[(k, k)] = f64::powi(sigma, 2);
        }
    }
    let draws = SIGMAS.map(|(_, sigma)| noise.normal3() * sigma);
    let [dp, dr, dv, gyro_bias, accel_bias] = draws;
    let state = FilterState {
        at: stamp(0.0),
        hall_from_body: motion.pose(0.0).perturbed(&dp, &dr),
        velocity_mps: motion.velocity_mps(0.0) + dv,
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        P,
        places: None,
    };
    (state, Sensors::new(gyro_bias, accel_bias, ImuNoise::default()))
}

/// The looks of one run: NEES per group of [`SIGMAS`], and the NIS of every fix.
fn run(seed: u64) -> (Vec<[f64; 5]>, Vec<f64>) {
    let mut noise = SeedBook::new(seed).stream("consistency");
    let motion = Motion::drawn(&mut noise);
    let (mut state, mut sensors) = drawn_start(&motion, &mut noise);
    let (cov, dt) = (fix_cov(), 1.0 / IMU_RATE_HZ);
    let (mut looks, mut fixes) = (Vec::new(), Vec::new());
    for k in 1..=N_STEPS {
        let t = f64::from(k) * dt;
        let imu = sensors.sample(&motion, t, dt, &mut noise);
        state = state.propagated(&imu, stamp(t), &ImuNoise::default());
        if k % STEPS_PER_FIX == 0 {
            let fix = fix(&motion, t, &cov, &mut noise);
            let innovation = state.innovation(&fix);
            fixes.push(innovation.nis);
            state.fuse(&fix, &innovation);
        }
        if k % LOOK_EVERY == 0 {
            let error = error((&motion, t, &sensors), &state);
            looks.push(SIGMAS.map(|(group, _)| nees(&error, &state.P, &group)));
        }
    }
    (looks, fixes)
}

/// The band that the mean of `n` independent χ² draws with `dof` degrees keeps in 99.9 of 100
/// cases: mean dof, variance 2 dof/n, nearly normal for n·dof = 90 and more.
fn band(dof: f64, n: f64) -> (f64, f64) {
    let reach = 3.29 * (2.0 * dof / n).sqrt();
    (dof - reach, dof + reach)
}

#[test]
fn nees_of_every_group_stays_in_its_band() {
    let runs: Vec<_> = (0..N_RUNS).map(run).collect();
    // Looks five seconds apart are nearly independent for pose and velocity; biases are not, so
    // each look is judged alone, over the runs.
    let n_looks = runs[0].0.len();
    assert_eq!(n_looks, 4);
    #[expect(clippy::cast_precision_loss, reason = "few runs")]
    let n = N_RUNS as f64;
    let (low, high) = band(3.0, n);
    let mut wrong = Vec::new();
    for (group, name) in
        ["position", "attitude", "velocity", "gyro bias", "accel bias"].iter().enumerate()
    {
        for look in 0..n_looks {
            let mean = runs.iter().map(|(looks, _)| looks[look][group]).sum::<f64>() / n;
            println!("{name}, look {look}: mean NEES {mean:.2}, band {low:.2} to {high:.2}");
            if !(low..=high).contains(&mean) {
                wrong.push(format!("{name}, look {look}: {mean:.2}"));
            }
        }
    }
    assert!(wrong.is_empty(), "outside of {low:.2} to {high:.2}: {wrong:?}");
}

#[test]
fn nis_of_the_fixes_stays_in_its_band_and_the_gate_refuses_one_in_a_hundred() {
    let nis: Vec<f64> = (100..100 + N_RUNS).flat_map(|seed| run(seed).1).collect();
    #[expect(clippy::cast_precision_loss, reason = "thousands")]
    let n = nis.len() as f64;
    assert!(n > 10_000.0);
    let mean = nis.iter().sum::<f64>() / n;
    let (low, high) = band(6.0, n);
    println!("mean NIS {mean:.3} of {n} fixes, band {low:.3} to {high:.3}");
    assert!((low..=high).contains(&mean), "{mean} outside of {low} to {high}");
    // 16.81 is the 99 % quantile for six degrees of freedom.
    let refused =
        nis.iter().fold(0.0, |count, nis| if *nis > 16.8119 { count + 1.0 } else { count });
    let share = refused / n;
    // The share of 12,000 draws has a standard error of 0.09 %.
    assert!((share - 0.01).abs() < 0.003, "{share} of the fixes outside of the gate");
}
