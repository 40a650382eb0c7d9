//! Bounds, continuity and ends of trajectories, judged by dense sampling.

use crate::support::at_s;
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::geometry::Point;
use stockpilot::planning::Waypoint;
use stockpilot::planning::trajectory::{Knot, Limits, Trajectory};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};
use stockpilot::units::wrapped_rad;

/// Rounding of stamps (1 ns) and of derivatives, as a share of a bound.
const ROUNDING: f64 = 1e-6;

fn limits(noise: &mut Noise) -> Limits {
    Limits {
        speed_mps: noise.between(0.3, 6.0),
        accel_mps2: noise.between(0.5, 6.0),
        jerk_mps3: noise.between(3.0, 40.0),
        snap_mps4: noise.between(15.0, 400.0),
        yaw_rate_radps: noise.between(0.2, 3.0),
        yaw_accel_radps2: noise.between(0.3, 6.0),
    }
}

/// Up to seven waypoints from `place` on: far, near, nearly and exactly the same, straight ahead,
/// there and back, with and without a turn of the heading.
fn waypoints(noise: &mut Noise, from: &Vector3<f64>) -> Vec<Waypoint> {
    let mut place = *from;
    let mut step = Vector3::x();
    let mut yaw_rad = 0.0;
    let n = 1 + (noise.bits() % 7) as usize;
    let next = |_| {
        let direction = noise.normal3().try_normalize(1e-9).unwrap_or_default();
        step = match noise.bits() % 8 {
            0 => direction * noise.between(10.0, 40.0),
            1 => direction * noise.between(1e-5, 0.02),
            2 => direction * noise.between(0.02, 0.4),
            3 => Vector3::zeros(),
            4 => -step,
            5 => step + direction * (0.05 * step.norm()),
            _ => direction * noise.between(0.4, 10.0),
        };
        place += step;
        if noise.chance(0.3) {
            yaw_rad = noise.between(-4.0, 4.0);
        }
        Waypoint { place: Point::from_coords(place), yaw_rad }
    };
    (0..n).map(next).collect()
}

/// The states of a trajectory at even distances and just beside its joints.
fn states(trajectory: &Trajectory, from: Stamp<Mono>) -> Vec<(f64, Knot)> {
    let end_s = trajectory.end_at().seconds_since(from) + 0.02;
    let joints = trajectory.joints().flat_map(|joint| {
        let t = joint.seconds_since(from);
        [t - 1e-4, t + 1e-4]
    });
    let mut times: Vec<f64> = (0..=120).map(|k| end_s * f64::from(k) / 120.0).collect();
    times.extend(joints.filter(|t| (0.0..end_s).contains(t)));
    times.sort_by(f64::total_cmp);
    let nanos = |t: f64| from.plus(Duration::from_secs_f64(t));
    times.iter().map(|t| ((t * 1e9).round() * 1e-9, trajectory.knot_at(nanos(*t)))).collect()
}

/// Fails unless all states keep the bounds and follow from each other:
///
/// ```text
/// |j₁ − j₀| ≤ s h,   |a₁ − a₀ − j₀ h| ≤ s h²/2,   |v₁ − …| ≤ s h³/6,   |p₁ − …| ≤ s h⁴/24
/// ```
/// which no jump and no wrong derivative survives.
fn assert_smooth(states: &[(f64, Knot)], limits: &Limits, case: &str) {
    let share = |norm: f64, bound: f64| norm / bound;
    for (t, k) in states {
        let worst = share(k.velocity.norm(), limits.speed_mps)
            .max(share(k.accel.norm(), limits.accel_mps2))
            .max(share(k.jerk.norm(), limits.jerk_mps3))
            .max(share(k.yaw.rate_radps.abs(), limits.yaw_rate_radps))
            .max(share(k.yaw.accel_radps2.abs(), limits.yaw_accel_radps2));
        assert!(worst <= 1.0 + ROUNDING, "{case}: {worst} of a bound at {t} s, {k:?} {limits:?}");
    }
    for pair in states.windows(2) {
        let ((t0, k0), (t1, k1)) = (&pair[0], &pair[1]);
        let h = t1 - t0;
        let s = limits.snap_mps4;
        let jerk = (k1.jerk - k0.jerk).norm();
        let accel = (k1.accel - k0.accel - k0.jerk * h).norm();
        let velocity = k1.velocity - k0.velocity - (k0.accel + k0.jerk * (0.5 * h)) * h;
        let place = k1.position
            - k0.position
            - (k0.velocity + (k0.accel + k0.jerk * (h / 3.0)) * (0.5 * h)) * h;
        // One nanosecond of the stamps at the bounds.
        let slack = 1e-8 * (1.0 + s + limits.jerk_mps3 + limits.accel_mps2 + limits.speed_mps);
        let what = |name: &str, is: f64, bound: f64| {
            assert!(
                is <= bound * (1.0 + ROUNDING) + slack,
                "{case}: {name} {is} > {bound} at {t0} s + {h} s"
            );
        };
        what("jerk", jerk, s * h);
        what("acceleration", accel, s * h * h / 2.0);
        what("velocity", velocity.norm(), s * h.powi(3) / 6.0);
        what("place", place.norm(), s * h.powi(4) / 24.0);
        let yaw_rate = k1.yaw.rate_radps - k0.yaw.rate_radps;
        what("yaw rate", yaw_rate.abs(), limits.yaw_accel_radps2 * h);
        let yaw = k1.yaw.angle_rad - k0.yaw.angle_rad - k0.yaw.rate_radps * h;
        what("yaw", yaw.abs(), limits.yaw_accel_radps2 * h * h / 2.0);
    }
}

/// Fails unless each waypoint is passed, in order, with its heading.
fn assert_passes(trajectory: &Trajectory, waypoints: &[Waypoint], case: &str) {
    assert_eq!(trajectory.n_waypoints(), waypoints.len(), "{case}");
    let mut passed = vec![at_s(0.0)];
    passed.extend(trajectory.joints());
    for (k, waypoint) in waypoints.iter().enumerate() {
        let just_after = |at: &Stamp<Mono>| Stamp::from_nanos(at.nanos() + 2);
        let at = passed
            .iter()
            .find(|at| trajectory.n_reached(just_after(at)) > k)
            .expect("each waypoint is reached at some joint");
        let knot = trajectory.knot_at(*at);
        let off_m = (knot.position - waypoint.place.coords).norm();
        let off_rad = wrapped_rad(knot.yaw.angle_rad - waypoint.yaw_rad).abs();
        // Places of a millimetre are one place; they may add up over repetitions.
        assert!(off_m < 2e-3 && off_rad < 2e-3, "{case}: {off_m} m {off_rad} rad from {k}");
    }
}

#[test]
fn from_rest_through_any_waypoints_within_every_bound() {
    let mut noise = SeedBook::new(41).stream("waypoints");
    for case in 0..5_000 {
        let limits = limits(&mut noise);
        let from = Knot::at_rest(noise.normal3() * 5.0, noise.between(-3.0, 3.0));
        let waypoints = waypoints(&mut noise, &from.position);
        let case = format!("case {case}");
        let trajectory = Trajectory::through(at_s(0.0), &from, &waypoints, &limits)
            .unwrap_or_else(|| panic!("{case}: no way {waypoints:?} {limits:?}"));
        assert_smooth(&states(&trajectory, at_s(0.0)), &limits, &case);
        assert_passes(&trajectory, &waypoints, &case);
        assert!(trajectory.duration_s() < 4000.0, "{case}: {} s", trajectory.duration_s());
    }
}

/// The states of the first trajectory up to `at`, and of the second one from there.
fn joined(first: &Trajectory, second: &Trajectory, at: Stamp<Mono>) -> Vec<(f64, Knot)> {
    let at_s = at.seconds();
    let mut all: Vec<(f64, Knot)> =
        states(first, Stamp::ZERO).into_iter().filter(|(t, _)| *t <= at_s - 1e-5).collect();
    all.extend(states(second, at).into_iter().map(|(t, k)| (t + at_s, k)));
    all
}

#[test]
fn any_motion_can_be_replanned_without_a_jump() {
    let mut noise = SeedBook::new(42).stream("waypoints");
    let mut n_later = 0;
    for case in 0..3_000 {
        let limits = limits(&mut noise);
        let from = Knot::at_rest(noise.normal3() * 5.0, noise.between(-3.0, 3.0));
        let first = waypoints(&mut noise, &from.position);
        let flown = Trajectory::through(at_s(0.0), &from, &first, &limits).expect("from rest");
        let at = at_s(noise.uniform() * flown.duration_s());
        let here = flown.knot_at(at);
        let n_reached = flown.n_reached(at);
        // Elsewhere, or the same and more behind it.
        let mut next = if noise.chance(0.5) { first[n_reached..].to_vec() } else { Vec::new() };
        let from = next.last().map_or(here.position, |last| last.place.coords);
        next.extend(waypoints(&mut noise, &from));
        next.truncate(Trajectory::LOOK_AHEAD);
        let case = format!("case {case}");
        match flown.replanned(at, &next, &limits, None) {
            Ok(second) => {
                assert_smooth(&joined(&flown, &second, at), &limits, &case);
                assert_passes(&second, &next, &case);
            }
            Err(_) => n_later += 1,
        }
    }
    // A stop is always possible, and from there every way is.
    assert_eq!(n_later, 0);
}

#[test]
fn every_state_can_be_braked_within_the_bounds() {
    let mut noise = SeedBook::new(43).stream("waypoints");
    let (mut n_at_once, mut longest_delay_s) = (0, 0.0_f64);
    for case in 0..2_000 {
        let limits = limits(&mut noise);
        let from = Knot::at_rest(noise.normal3() * 5.0, noise.between(-3.0, 3.0));
        let waypoints = waypoints(&mut noise, &from.position);
        let flown =
            Trajectory::through(at_s(0.0), &from, &waypoints, &limits).unwrap_or_else(|| {
                panic!("case {case}: no way from {from:?} {waypoints:?} {limits:?}")
            });
        let at = at_s(noise.uniform() * flown.duration_s());
        let stop = flown.braked(at, &limits);
        let case = format!("case {case}");
        assert_smooth(&joined(&flown, &stop, at), &limits, &case);
        // What comes before the last segment is motion as planned.
        let joints: Vec<Stamp<Mono>> = stop.joints().collect();
        let delay_s = joints.iter().rev().nth(1).map_or(0.0, |joint| joint.seconds_since(at));
        n_at_once += usize::from(joints.len() <= 1);
        longest_delay_s = longest_delay_s.max(delay_s);
        let hard = Trajectory::emergency_stop(at, &flown.knot_at(at), &limits);
        let whole = joined(&flown, &hard, at);
        assert_smooth(&whole, &limits.in_emergency(), &case);
    }
    println!("{n_at_once} of 2000 at once, the longest wait {longest_delay_s} s");
    assert!(n_at_once > 1_900 && longest_delay_s < 1.0, "{n_at_once} {longest_delay_s}");
}
