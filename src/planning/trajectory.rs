//! Smooth motion between waypoints: quintic segments, continuous up to the acceleration.
//!
//! ```text
//! p(t) = Σ_{k=0..5} c_k t^k,   fixed by p, v, a at both ends
//! ```
//! The duration of a segment is the shortest of a geometric series that keeps speed and
//! acceleration inside the bounds.
//! Checked: `bounds_and_continuity_hold_for_random_waypoints`.

use crate::geometry::{Direction, Hall, Point};
use crate::messages::Setpoint;
use crate::time::{Mono, Stamp};
use nalgebra::Vector3;
use std::time::Duration;

/// What the vehicle can follow closely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest speed, m/s.
    pub speed_mps: f64,
    /// Largest acceleration, m/s².
    pub accel_mps2: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { speed_mps: 2.0, accel_mps2: 1.5 }
    }
}

/// Position, velocity and acceleration at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// Position in the hall, m.
    pub position: Vector3<f64>,
    /// Velocity in hall axes, m/s.
    pub velocity: Vector3<f64>,
    /// Acceleration in hall axes, m/s².
    pub accel: Vector3<f64>,
}

impl Knot {
    /// At rest.
    #[must_use]
    pub fn at_rest(position: Vector3<f64>) -> Self {
        Self { position, velocity: Vector3::zeros(), accel: Vector3::zeros() }
    }
}

/// One quintic piece; after its end it stays at its last place.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    start: Stamp<Mono>,
    duration_s: f64,
    coefficients: [Vector3<f64>; 6],
    end: Knot,
}

/// Points at which the bounds are checked; between them a quintic of this length cannot stray by
/// more than the tolerance.
const BOUND_SAMPLES: u32 = 48;
const BOUND_TOLERANCE: f64 = 1.01;
/// Shares of the wanted end velocity that are tried.
const END_VELOCITY_SHARES: [f64; 4] = [1.0, 0.7, 0.4, 0.0];
const STRETCH: f64 = 1.08;
const MAX_STRETCHES: usize = 90;
const MAX_BRAKE_STRETCHES: usize = 20;

impl Segment {
    /// Keeps a place.
    #[must_use]
    pub fn hold(start: Stamp<Mono>, position: Vector3<f64>) -> Self {
        let mut coefficients = [Vector3::zeros(); 6];
        coefficients[0] = position;
        Self { start, duration_s: 0.0, coefficients, end: Knot::at_rest(position) }
    }

    /// The fastest quintic from `from` to `to` within the limits; `None` if none keeps them, which
    /// happens to starts that are accelerated already.
    ///
    /// An end velocity that cannot be reached without backing off first is lowered, to rest if
    /// need be.
    #[must_use]
    pub fn between(start: Stamp<Mono>, from: &Knot, to: &Knot, limits: &Limits) -> Option<Self> {
        END_VELOCITY_SHARES.into_iter().find_map(|share| {
            let end = Knot { velocity: to.velocity * share, ..*to };
            Self::fastest(start, from, &end, limits)
                .filter(|segment| share == 0.0 || segment.goes_forward(from))
        })
    }

    /// The shortest duration of a geometric series that keeps the limits, if one does.
    fn fastest(start: Stamp<Mono>, from: &Knot, to: &Knot, limits: &Limits) -> Option<Self> {
        let distance_m = (to.position - from.position).norm();
        let first_s = (distance_m / limits.speed_mps).max(0.2);
        std::iter::successors(Some(first_s), |duration_s| Some(duration_s * STRETCH))
            .take(MAX_STRETCHES)
            .map(|duration_s| Self::with_duration(start, from, to, duration_s))
            .find(|segment| segment.keeps(limits))
    }

    /// True if the motion along the chord never turns back further than it did at the start.
    fn goes_forward(&self, from: &Knot) -> bool {
        let chord = self.end.position - from.position;
        let slowest = from.velocity.dot(&chord).min(0.0) - 0.02 * chord.norm();
        self.samples().all(|knot| knot.velocity.dot(&chord) >= slowest)
    }

    /// Brakes to a stop, wherever that is, as fast as the limits allow.
    ///
    /// ```text
    /// v(t) the cubic from (v₀, a₀) to (0, 0):   p₁ = p₀ + v₀ T/2 + a₀ T²/12
    /// ```
    #[must_use]
    pub fn brake(start: Stamp<Mono>, from: &Knot, limits: &Limits) -> Self {
        let stop_in = |t: f64| {
            let place = from.position + from.velocity * (t / 2.0) + from.accel * (t * t / 12.0);
            Self::with_duration(start, from, &Knot::at_rest(place), t)
        };
        // The cubic's peak deceleration from a steady speed is 1.5 times its mean.
        let shortest_s = (1.5 * from.velocity.norm() / limits.accel_mps2).max(0.3);
        std::iter::successors(Some(shortest_s), |t| Some(t * STRETCH))
            .take(MAX_BRAKE_STRETCHES)
            .map(stop_in)
            .find(|segment| segment.keeps(limits))
            // A start outside of the limits (never of our own making) still stops.
            .unwrap_or_else(|| stop_in(shortest_s))
    }

    fn with_duration(start: Stamp<Mono>, from: &Knot, to: &Knot, duration_s: f64) -> Self {
        let t = duration_s;
        let dp = to.position - from.position - from.velocity * t - from.accel * (0.5 * t * t);
        let dv = to.velocity - from.velocity - from.accel * t;
        let da = to.accel - from.accel;
        let coefficients = [
            from.position,
            from.velocity,
            from.accel * 0.5,
            (dp * 10.0 - dv * (4.0 * t) + da * (0.5 * t * t)) / t.powi(3),
            (-dp * 15.0 + dv * (7.0 * t) - da * (t * t)) / t.powi(4),
            (dp * 6.0 - dv * (3.0 * t) + da * (0.5 * t * t)) / t.powi(5),
        ];
        Self { start, duration_s, coefficients, end: *to }
    }

    fn samples(&self) -> impl Iterator<Item = Knot> {
        (0..=BOUND_SAMPLES)
            .map(|k| self.knot_after(self.duration_s * f64::from(k) / f64::from(BOUND_SAMPLES)))
    }

    fn keeps(&self, limits: &Limits) -> bool {
        self.samples().all(|knot| {
            knot.velocity.norm() <= limits.speed_mps * BOUND_TOLERANCE
                && knot.accel.norm() <= limits.accel_mps2 * BOUND_TOLERANCE
        })
    }

    fn knot_after(&self, seconds: f64) -> Knot {
        let t = seconds;
        let [c0, c1, c2, c3, c4, c5] = &self.coefficients;
        Knot {
            position: c0 + (c1 + (c2 + (c3 + (c4 + c5 * t) * t) * t) * t) * t,
            velocity: c1 + (c2 * 2.0 + (c3 * 3.0 + (c4 * 4.0 + c5 * (5.0 * t)) * t) * t) * t,
            accel: c2 * 2.0 + (c3 * 6.0 + (c4 * 12.0 + c5 * (20.0 * t)) * t) * t,
        }
    }

    /// Where the segment is at an instant; past its end it rests at the end.
    #[must_use]
    pub fn knot_at(&self, at: Stamp<Mono>) -> Knot {
        if self.is_over(at) {
            return Knot::at_rest(self.end.position);
        }
        self.knot_after(at.seconds_since(self.start).max(0.0))
    }

    /// The setpoint at an instant.
    #[must_use]
    pub fn setpoint_at(&self, at: Stamp<Mono>, yaw_rad: f64) -> Setpoint {
        let knot = self.knot_at(at);
        Setpoint {
            at,
            position: Point::from_coords(knot.position),
            velocity_mps: Direction::<Hall>::from_coords(knot.velocity),
            accel_mps2: Direction::from_coords(knot.accel),
            yaw_rad,
            yaw_rate_radps: 0.0,
        }
    }

    /// State at the segment's end.
    #[must_use]
    pub const fn end(&self) -> &Knot {
        &self.end
    }

    /// When the segment ends; the next one begins there.
    #[must_use]
    pub fn end_at(&self) -> Stamp<Mono> {
        self.start.plus(Duration::from_secs_f64(self.duration_s))
    }

    /// True once its end is reached.
    #[must_use]
    pub fn is_over(&self, at: Stamp<Mono>) -> bool {
        at >= self.end_at()
    }

    /// How long the segment takes, s.
    #[must_use]
    pub const fn duration_s(&self) -> f64 {
        self.duration_s
    }
}

/// Velocity with which to pass the first waypoint of a path: along the bisector, slower in sharper
/// turns, and slow enough to brake for everything behind it.
///
/// ```text
/// v_k ≤ v_max cos²(β_k/2),   v_k² ≤ v_{k+1}² + a_max d_k,   v_1² ≤ v_0² + a_max d_0
/// direction (u_in + u_out)/|u_in + u_out|
/// ```
/// - `speed_mps`: speed at the start of the path, `v_0`
/// - `path`: where the vehicle is, the waypoint to pass, and those behind it; the last one is a stop
/// - `β_k`: angle of the turn at waypoint k; more than 120° stops
/// - `d_k`: length of the leg to the next waypoint, m; half the sharpest braking is counted on,
///   because quintics are gentler
#[must_use]
pub fn passing_velocity(speed_mps: f64, path: &[Vector3<f64>], limits: &Limits) -> Vector3<f64> {
    let passing_mps = path.windows(3).rev().fold(0.0, |next_mps: f64, triple| {
        let brakable_mps2 = limits.accel_mps2 * (triple[2] - triple[1]).norm();
        cornering_speed_mps(triple, limits).min((next_mps.powi(2) + brakable_mps2).sqrt())
    });
    let [before, waypoint, after, ..] = path else { return Vector3::zeros() };
    let reachable_mps2 = limits.accel_mps2 * (waypoint - before).norm();
    let passing_mps = passing_mps.min((speed_mps.powi(2) + reachable_mps2).sqrt());
    let directions =
        (waypoint - before).try_normalize(1e-6).zip((after - waypoint).try_normalize(1e-6));
    directions
        .and_then(|(u_in, u_out)| (u_in + u_out).try_normalize(1e-6))
        .map_or_else(Vector3::zeros, |bisector| bisector * passing_mps)
}

fn cornering_speed_mps(triple: &[Vector3<f64>], limits: &Limits) -> f64 {
    let legs = (triple[1] - triple[0])
        .try_normalize(1e-6)
        .zip((triple[2] - triple[1]).try_normalize(1e-6));
    let cos_turn = legs.map_or(-1.0, |(u_in, u_out)| u_in.dot(&u_out));
    if cos_turn < -0.5 { 0.0 } else { limits.speed_mps * 0.5 * (1.0 + cos_turn) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;
    #[test]
    fn bounds_and_continuity_hold_for_random_waypoints() {
        let limits = Limits { speed_mps: 2.0, accel_mps2: 1.5 };
        let mut noise = SeedBook::new(8).stream("waypoints");
        for _ in 0..300 {
            let mut place = || Vector3::from_fn(|_, _| noise.between(-8.0, 8.0));
            let points = [place(), place(), place()];
            let via = passing_velocity(0.0, &points, &limits);
            let knot = Knot { position: points[1], velocity: via, accel: Vector3::zeros() };
            let first = Segment::between(Stamp::ZERO, &Knot::at_rest(points[0]), &knot, &limits)
                .expect("from rest");
            let joint = Stamp::ZERO.plus(Duration::from_secs_f64(first.duration_s()));
            let second = Segment::between(joint, first.end(), &Knot::at_rest(points[2]), &limits)
                .expect("from a steady speed");
            for segment in [&first, &second] {
                for k in 0..=1000 {
                    let knot = segment.knot_after(segment.duration_s() * f64::from(k) / 1000.0);
                    assert!(knot.velocity.norm() <= limits.speed_mps * 1.02);
                    assert!(knot.accel.norm() <= limits.accel_mps2 * 1.02);
                }
            }
            let (a, b) = (first.knot_after(first.duration_s()), second.knot_after(0.0));
            assert!((a.position - b.position).norm() < 1e-9);
            assert!((a.velocity - b.velocity).norm() < 1e-9);
            assert!((a.accel - b.accel).norm() < 1e-8);
        }
    }

    #[test]
    fn velocity_is_the_derivative_of_position() {
        let limits = Limits::default();
        let from = Knot {
            position: Vector3::new(1.0, 2.0, 3.0),
            velocity: Vector3::new(0.5, -0.2, 0.1),
            accel: Vector3::new(0.1, 0.2, -0.1),
        };
        let segment = Segment::between(
            Stamp::ZERO,
            &from,
            &Knot::at_rest(Vector3::new(4.0, -1.0, 5.0)),
            &limits,
        )
        .expect("gently accelerated");
        for k in 1..20 {
            let t = segment.duration_s() * f64::from(k) / 20.0;
            let (a, b) = (segment.knot_after(t - 1e-5), segment.knot_after(t + 1e-5));
            let knot = segment.knot_after(t);
            assert!(((b.position - a.position) / 2e-5 - knot.velocity).norm() < 1e-6);
            assert!(((b.velocity - a.velocity) / 2e-5 - knot.accel).norm() < 1e-6);
        }
    }

    #[test]
    fn a_long_straight_is_passed_at_full_speed_and_its_last_leg_is_not() {
        let limits = Limits { speed_mps: 2.0, accel_mps2: 1.5 };
        let path: Vec<_> = (0..6).map(|k| Vector3::new(1.5 * f64::from(k), 0.0, 7.0)).collect();
        let cruise = passing_velocity(1.9, &path, &limits);
        assert!((cruise - Vector3::new(2.0, 0.0, 0.0)).norm() < 1e-12);
        // One leg of 1.5 m to brake in: √(1.5 · 1.5).
        let braking = passing_velocity(1.9, &path[..3], &limits);
        assert!((braking - Vector3::new(1.5, 0.0, 0.0)).norm() < 1e-12);
        let back = passing_velocity(1.9, &[path[0], path[1], path[0]], &limits);
        assert!(back.norm() < 1e-12);
    }

    #[test]
    fn braking_ends_at_rest_within_the_bounds() {
        let limits = Limits::default();
        let flying = Knot {
            position: Vector3::new(0.0, 0.0, 7.0),
            velocity: Vector3::new(1.6, 1.0, 0.0),
            accel: Vector3::zeros(),
        };
        let stop = Segment::brake(Stamp::ZERO, &flying, &limits);
        let late = Stamp::ZERO.plus(Duration::from_secs(20));
        assert!(stop.knot_at(late).velocity.norm() < 1e-12);
        let way_m = (stop.end().position - flying.position).norm();
        assert!(way_m < 3.0, "braking takes {way_m} m");
    }
}
