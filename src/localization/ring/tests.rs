//! The ring against plain sequences of steps.

#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::*;
use crate::geometry::Rotation;
use crate::localization::propagation::Error;
use crate::messages::FixOutcome;
use crate::stats::SeedBook;
use nalgebra::SMatrix;

fn at_ms(ms: i64) -> Stamp<Mono> {
    Stamp::from_nanos(ms * 1_000_000)
}

fn ring() -> Ring {
    let start = FilterState {
        at: at_ms(0),
        hall_from_body: Transform::new(
            Rotation::from_euler_rad(0.1, -0.05, 0.8),
            Point::new(1.0, 2.0, 3.0),
        ),
        velocity_mps: Vector3::new(0.5, -0.2, 0.1),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        P: Covariance::identity() * 0.01,
        places: None,
    };
    Ring::new(start, imu(0), ImuNoise::default(), Duration::from_secs(1))
}

fn imu(ms: i64) -> ImuSample {
    let phase = Stamp::<Mono>::from_nanos(ms * 1_000_000).seconds() * 3.0;
    ImuSample {
        at: at_ms(ms),
        accel_mps2: Vector3::new(phase.sin(), 0.3, 9.8 + 0.2 * phase.cos()),
        gyro_radps: Vector3::new(0.1, -0.2, phase.cos() * 0.3),
    }
}

fn fix(noise: &mut crate::stats::Noise) -> FixOutcome {
    let pose = Transform::<Hall, Body>::new(
        Rotation::from_euler_rad(0.1, -0.05, 0.8),
        Point::new(1.0, 2.0, 3.0),
    );
    FixOutcome {
        hall_from_body: pose.perturbed(&(noise.normal3() * 0.02), &(noise.normal3() * 0.01)),
        pose_cov: Matrix6::identity() * 0.01,
        residual_rms_px: 0.3,
        n_points: 8,
        q_pos: 10.0,
        q_position: 10.0,
    }
}

#[test]
fn order_of_arrival_does_not_matter() {
    let mut noise = SeedBook::new(4).stream("fixes");
    let (early, late) = (fix(&mut noise), fix(&mut noise));
    let run = |in_order: bool| {
        let mut ring = ring();
        for step in 1..=60 {
            ring.push_imu(imu(step * 5));
            if in_order && step == 21 {
                ring.insert_fix(at_ms(103), early.clone());
            }
            if in_order && step == 31 {
                ring.insert_fix(at_ms(151), late.clone());
            }
        }
        if !in_order {
            ring.insert_fix(at_ms(151), late.clone());
            ring.insert_fix(at_ms(103), early.clone());
        }
        ring.newest().clone()
    };
    let (a, b) = (run(true), run(false));
    assert!((a.P - b.P).norm() < 1e-12);
    assert!((a.hall_from_body.origin - b.hall_from_body.origin).coords.norm() < 1e-12);
}

#[test]
fn a_fix_ahead_of_the_samples_does_not_shadow_them() {
    let fix = fix(&mut SeedBook::new(6).stream("fix"));
    let run = |fix_after_ms: i64| {
        let mut ring = ring();
        for step in 1..=60 {
            ring.push_imu(imu(step * 5));
            if step * 5 == fix_after_ms {
                ring.insert_fix(at_ms(112), fix.clone());
            }
        }
        ring.newest().clone()
    };
    let (early, in_time) = (run(100), run(115));
    assert!((early.P - in_time.P).norm() < 1e-12);
    let apart = early.hall_from_body.origin - in_time.hall_from_body.origin;
    assert!(apart.coords.norm() < 1e-12);
}

#[test]
fn fixes_outside_the_ring_are_refused_and_change_nothing() {
    let mut ring = ring();
    for step in 1..=400 {
        ring.push_imu(imu(step * 5));
    }
    let before = ring.newest().clone();
    let fix = fix(&mut SeedBook::new(1).stream("fix"));
    assert_eq!(ring.insert_fix(at_ms(500), fix.clone()), Insertion::TooOld);
    assert_eq!(ring.insert_fix(at_ms(2_500), fix), Insertion::FromTheFuture);
    assert_eq!(*ring.newest(), before);
}

#[test]
fn interpolated_pose_lies_between_its_neighbours() {
    let mut ring = ring();
    for step in 1..=20 {
        ring.push_imu(imu(step * 5));
    }
    let (pose, _) = ring.pose_at(at_ms(52)).expect("inside");
    let exact = ring.state_at(at_ms(52)).expect("inside");
    // Over 5 ms the straight line and the propagated arc differ by a·dt²/8 = 4e-6 m.
    assert!((pose.origin - exact.hall_from_body.origin).coords.norm() < 1e-4);
    assert!(ring.pose_at(at_ms(101)).is_none());
}

/// The error of one run at the end of its steps and its correlation with a clone of the error at
/// `from`: the covariance of (clone, error), 30×30, through dense steps in order of time.
struct Cloned {
    state: FilterState,
    joint: SMatrix<f64, 30, 30>,
}

impl Cloned {
    /// The 30×30 transition with `F` for the error and nothing for its clone.
    fn on_error(F: &Covariance) -> SMatrix<f64, 30, 30> {
        let mut both = SMatrix::<f64, 30, 30>::identity();
        both.fixed_view_mut::<15, 15>(15, 15).copy_from(F);
        both
    }

    fn step(&mut self, sample: &ImuSample, until: Stamp<Mono>) {
        // Φ by central differences of the nominal step.
        let mut F = Covariance::zeros();
        for k in 0..15 {
            let moved = |by: f64| {
                let mut state = self.state.clone();
                state.correct(&Error::ith(k, by));
                state.propagated(sample, until, &ImuNoise::default())
            };
            let column = difference(&moved(1e-4), &moved(-1e-4)) / 2e-4;
            F.set_column(k, &column);
        }
        let next = self.state.propagated(sample, until, &ImuNoise::default());
        let Q = next.P - F * self.state.P * F.transpose();
        let both = Self::on_error(&F);
        self.joint = both * self.joint * both.transpose();
        let mut noise = self.joint.fixed_view_mut::<15, 15>(15, 15);
        noise += Q;
        self.state = next;
    }

    fn fuse(&mut self, fix: &FixOutcome) {
        let mut H = SMatrix::<f64, 6, 30>::zeros();
        H.fixed_columns_mut::<6>(15).fill_with_identity();
        let S = H * self.joint * H.transpose() + fix.pose_cov;
        // The clone is carried along, never corrected: its gain is set to zero.
        let mut K = self.joint * H.transpose() * S.try_inverse().expect("S is regular");
        K.fixed_rows_mut::<15>(0).fill(0.0);
        let A = SMatrix::<f64, 30, 30>::identity() - K * H;
        self.joint = A * self.joint * A.transpose() + K * fix.pose_cov * K.transpose();
        let innovation = self.state.innovation(fix);
        self.state.fuse(fix, &innovation);
    }

    fn clone_error(&mut self) {
        let P = self.state.P;
        for (row, col) in [(0, 0), (0, 15), (15, 0), (15, 15)] {
            self.joint.fixed_view_mut::<15, 15>(row, col).copy_from(&P);
        }
    }
}

fn difference(a: &FilterState, b: &FilterState) -> Error {
    let parts = [
        (a.hall_from_body.origin - b.hall_from_body.origin).coords,
        a.hall_from_body.rotation.minus(&b.hall_from_body.rotation),
        a.velocity_mps - b.velocity_mps,
        a.gyro_bias_radps - b.gyro_bias_radps,
        a.accel_bias_mps2 - b.accel_bias_mps2,
    ];
    Error::from_iterator(parts.iter().flat_map(|part| part.iter().copied()))
}

/// Irregular sample times, ms.
const SAMPLES_MS: [i64; 12] = [4, 9, 17, 21, 30, 34, 41, 52, 58, 63, 70, 79];
/// Irregular times of fixes, ms; the second falls on a sample.
const FIXES_MS: [i64; 3] = [25, 41, 66];

/// (A, cross-covariance of the reference, P at `from`, P at `to` of the ring and the reference).
fn chained(from_ms: i64, to_ms: i64) -> (Covariance, Covariance, Covariance, [Covariance; 2]) {
    let mut noise = SeedBook::new(8).stream("fixes");
    let fixes = FIXES_MS.map(|ms| (ms, fix(&mut noise)));
    let mut ring = ring();
    let start = ring.newest().clone();
    SAMPLES_MS.iter().for_each(|ms| ring.push_imu(imu(*ms)));
    // Out of order: every entry is computed again with its gain.
    for (ms, fix) in [&fixes[2], &fixes[0], &fixes[1]] {
        let placed = ring.insert_fix(at_ms(*ms), fix.clone());
        assert!(matches!(placed, Insertion::Placed(i) if i.is_within_gate()));
    }
    let mut reference = Cloned { state: start, joint: SMatrix::zeros() };
    reference.clone_error();
    let mut stops: Vec<i64> =
        SAMPLES_MS.into_iter().chain(FIXES_MS).chain([from_ms, to_ms]).collect();
    stops.sort_unstable();
    stops.dedup();
    let mut P_from = Covariance::zeros();
    for stop in stops.into_iter().filter(|stop| *stop <= to_ms) {
        let ms = SAMPLES_MS.into_iter().find(|ms| *ms >= stop).unwrap_or(SAMPLES_MS[11]);
        reference.step(&imu(ms), at_ms(stop));
        for (_, fix) in fixes.iter().filter(|(ms, _)| *ms == stop) {
            reference.fuse(fix);
        }
        if stop == from_ms {
            reference.clone_error();
            P_from = reference.state.P;
        }
    }
    let A = ring.error_transition(at_ms(from_ms), at_ms(to_ms)).expect("inside the ring");
    let cross = reference.joint.fixed_view::<15, 15>(15, 0).into_owned();
    let P_to = ring.state_at(at_ms(to_ms)).expect("inside the ring").P;
    (A, cross, P_from, [P_to, reference.joint.fixed_view::<15, 15>(15, 15).into_owned()])
}

/// The largest difference in units of the standard deviations of both errors.
fn scaled_difference(
    a: &Covariance,
    b: &Covariance,
    P_to: &Covariance,
    P_from: &Covariance,
) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..15 {
        for j in 0..15 {
            let scale = (P_to[(i, i)] * P_from[(j, j)]).sqrt();
            worst = worst.max((a[(i, j)] - b[(i, j)]).abs() / scale);
        }
    }
    worst
}

#[test]
fn transition_matches_a_cloned_error() {
    // On entries the steps are the same: only the differences' rounding is left. Between entries
    // the reference splits steps that the ring takes in one; with constant force and rate that
    // changes the noise by the order of its own couplings.
    for (from_ms, to_ms, tolerance) in
        [(9, 79, 1e-8), (25, 66, 1e-8), (12, 74, 1e-6), (27, 41, 1e-6)]
    {
        let (A, cross, P_from, [P_to, P_ref]) = chained(from_ms, to_ms);
        let apart = scaled_difference(&(A * P_from), &cross, &P_to, &P_from);
        assert!(apart < tolerance, "{from_ms} to {to_ms} ms: {apart:e}");
        let apart = scaled_difference(&P_to, &P_ref, &P_to, &P_to);
        assert!(apart < tolerance, "P at {to_ms} ms: {apart:e}");
        // The premise: the fixes in between took a good part of the old error away.
        assert!(A[(0, 0)] < 0.75, "{}", A[(0, 0)]);
    }
}

#[test]
fn transitions_chain() {
    let (whole, ..) = chained(9, 79);
    let ((first, ..), (second, ..)) = (chained(9, 41), chained(41, 79));
    assert!((second * first - whole).amax() < 1e-12);
}

#[test]
fn there_is_no_transition_from_outside_the_ring_or_backwards() {
    let mut ring = ring();
    SAMPLES_MS.iter().for_each(|ms| ring.push_imu(imu(*ms)));
    assert!(ring.error_transition(at_ms(-5), at_ms(40)).is_none());
    assert!(ring.error_transition(at_ms(40), at_ms(30)).is_none());
    assert!(ring.error_transition(at_ms(40), at_ms(300)).is_none());
    let same = ring.error_transition(at_ms(40), at_ms(40)).expect("inside the ring");
    assert!((same - Covariance::identity()).amax() < 1e-12);
}

#[test]
fn frames_do_not_carry_the_pose_on_without_samples() {
    // Two cameras of 30 fps, staggered by 16 ms: each fix lies within 20 ms of the one before.
    let mut ring = ring();
    (1..=20).for_each(|step| ring.push_imu(imu(step * 5)));
    let fix = fix(&mut SeedBook::new(7).stream("fix"));
    let placed: Vec<bool> = (0..30)
        .map(|k| matches!(ring.insert_fix(at_ms(101 + 16 * k), fix.clone()), Insertion::Placed(_)))
        .collect();
    // 101 and 117 ms lie within the tolerance of the last sample, at 100 ms.
    assert!(placed[..2].iter().all(|is_in| *is_in), "{placed:?}");
    assert!(placed[2..].iter().all(|is_in| !is_in), "{placed:?}");
    assert!(ring.motion_at(at_ms(121)).is_none() && ring.motion_at(at_ms(120)).is_some());
    assert!(ring.error_transition(at_ms(50), at_ms(121)).is_none());
    // Samples that come back carry on.
    ring.push_imu(imu(130));
    assert!(matches!(ring.insert_fix(at_ms(149), fix), Insertion::Placed(_)));
}
