//! Bounds and ends of trajectory segments.

use crate::support::at_s;
use nalgebra::Vector3;
use stockpilot::planning::trajectory::{Knot, Limits, Segment};
use stockpilot::stats::{Noise, SeedBook};

/// A random vector, no longer than `length`.
fn within(noise: &mut Noise, length: f64) -> Vector3<f64> {
    let direction = noise.normal3().try_normalize(1e-9).unwrap_or_default();
    direction * (length * noise.uniform().cbrt())
}

/// Speeds and accelerations between the samples may pass the bounds by this factor.
const TOLERANCE: f64 = 1.02;

/// The largest speed and acceleration as multiples of their bounds; the larger of both.
fn worst(segment: &Segment, limits: &Limits) -> f64 {
    (0..=400)
        .map(|k| segment.knot_at(at_s(segment.duration_s() * f64::from(k) / 400.0)))
        .map(|k| (k.velocity.norm() / limits.speed_mps).max(k.accel.norm() / limits.accel_mps2))
        .fold(0.0, f64::max)
}

/// Draws segments between random places and velocities; `speed` and `accel` bound the start, as
/// shares of the limits. Returns [`worst`] of each segment that there is.
fn drawn(speed: f64, accel: f64) -> Vec<f64> {
    let mut noise = SeedBook::new(41).stream("knots");
    let mut all = Vec::new();
    for case in 0..3_000 {
        let limits =
            Limits { speed_mps: noise.between(0.5, 5.0), accel_mps2: noise.between(0.5, 5.0) };
        let from = Knot {
            position: within(&mut noise, 15.0),
            velocity: within(&mut noise, speed * limits.speed_mps),
            accel: within(&mut noise, accel * limits.accel_mps2),
        };
        let to = Knot {
            position: within(&mut noise, 15.0),
            velocity: within(&mut noise, limits.speed_mps),
            accel: Vector3::zeros(),
        };
        let Some(segment) = Segment::between(at_s(0.0), &from, &to, &limits) else { continue };
        assert!(segment.duration_s().is_finite() && segment.duration_s() > 0.0, "case {case}");
        let begins = segment.knot_at(at_s(0.0));
        assert!((begins.position - from.position).norm() < 1e-9);
        assert!((begins.velocity - from.velocity).norm() < 1e-9);
        let after = segment.knot_at(at_s(segment.duration_s() + 1.0));
        assert!((after.position - to.position).norm() < 1e-9);
        assert!(after.velocity.norm() < 1e-12);
        all.push(worst(&segment, &limits));
    }
    all
}

fn largest(all: &[f64]) -> f64 {
    all.iter().copied().fold(0.0, f64::max)
}

#[test]
fn from_rest_there_is_always_a_way_within_the_bounds() {
    let all = drawn(0.0, 0.0);
    assert_eq!(all.len(), 3_000);
    assert!(largest(&all) <= TOLERANCE, "{} of a bound", largest(&all));
}

#[test]
fn from_any_velocity_there_is_always_a_way_within_the_bounds() {
    let all = drawn(1.0, 0.0);
    assert_eq!(all.len(), 3_000);
    assert!(largest(&all) <= TOLERANCE, "{} of a bound", largest(&all));
}

#[test]
fn what_begins_accelerated_keeps_the_bounds_or_is_not_flown() {
    let all = drawn(0.7, 0.3);
    println!("{} of 3000 have a way", all.len());
    assert!(all.len() > 2_000);
    assert!(largest(&all) <= TOLERANCE, "{} of a bound", largest(&all));
}

#[test]
fn braking_while_accelerating_keeps_the_bounds() {
    let mut noise = SeedBook::new(43).stream("brakes");
    let limits = Limits { speed_mps: 2.0, accel_mps2: 1.5 };
    for _ in 0..2_000 {
        let flying = Knot {
            position: within(&mut noise, 10.0),
            velocity: within(&mut noise, 0.7 * limits.speed_mps),
            accel: within(&mut noise, 0.9 * limits.accel_mps2),
        };
        let stop = Segment::brake(at_s(0.0), &flying, &limits);
        assert!(worst(&stop, &limits) <= TOLERANCE, "{flying:?}");
    }
}

#[test]
fn braking_from_any_speed_keeps_the_bounds_and_ends_near() {
    let mut noise = SeedBook::new(42).stream("brakes");
    for _ in 0..2_000 {
        let limits =
            Limits { speed_mps: noise.between(0.5, 4.0), accel_mps2: noise.between(0.5, 4.0) };
        let flying = Knot {
            position: within(&mut noise, 10.0),
            velocity: within(&mut noise, limits.speed_mps),
            accel: Vector3::zeros(),
        };
        let stop = Segment::brake(at_s(0.0), &flying, &limits);
        assert!(worst(&stop, &limits) <= TOLERANCE, "{flying:?} {limits:?}");
        let way_m = (stop.end().position - flying.position).norm();
        // Twice the way of the sharpest stop; no stop is shorter than 0.3 s.
        let speed_mps = flying.velocity.norm();
        let bound_m = (speed_mps * speed_mps / limits.accel_mps2).max(0.15 * speed_mps) + 1e-9;
        assert!(way_m <= bound_m, "{way_m} m instead of {bound_m} m");
    }
}
