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
const STRETCH: f64 = 1.08;
const MAX_STRETCHES: usize = 90;

impl Segment {
    /// Keeps a place.
    #[must_use]
    pub fn hold(start: Stamp<Mono>, position: Vector3<f64>) -> Self {
        let mut coefficients = [Vector3::zeros(); 6];
        coefficients[0] = position;
        Self { start, duration_s: 0.0, coefficients, end: Knot::at_rest(position) }
    }

    /// The fastest quintic from `from` to `to` within the limits.
    ///
    /// If no duration keeps the limits with the wanted end velocity, the end is at rest instead.
    #[must_use]
    pub fn between(start: Stamp<Mono>, from: &Knot, to: &Knot, limits: &Limits) -> Self {
        let distance_m = (to.position - from.position).norm();
        let first_s = (distance_m / limits.speed_mps).max(0.2);
        let mut duration_s = first_s;
        for _ in 0..MAX_STRETCHES {
            let segment = Self::with_duration(start, from, to, duration_s);
            if segment.keeps(limits) {
                return segment;
            }
            duration_s *= STRETCH;
        }
        let at_rest = Knot::at_rest(to.position);
        if *to == at_rest {
            // The start breaks the limits already (a braking command in a gust): go gently.
            return Self::with_duration(start, from, to, first_s.max(2.0) * 2.0);
        }
        Self::between(start, from, &at_rest, limits)
    }

    /// Brakes to a stop as fast as the limits allow.
    #[must_use]
    pub fn brake(start: Stamp<Mono>, from: &Knot, limits: &Limits) -> Self {
        let braking_m = from.velocity.norm_squared() / (2.0 * limits.accel_mps2);
        let ahead = from.velocity.try_normalize(1e-6).unwrap_or_default();
        // A smooth stop needs more room than the sharpest: the quintic peaks at 1.9 times its mean.
        let target = from.position + ahead * (1.9 * braking_m);
        Self::between(start, from, &Knot::at_rest(target), limits)
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

    fn keeps(&self, limits: &Limits) -> bool {
        (0..=BOUND_SAMPLES).all(|k| {
            let knot = self.knot_after(self.duration_s * f64::from(k) / f64::from(BOUND_SAMPLES));
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
        let seconds = at.seconds_since(self.start).max(0.0);
        if seconds >= self.duration_s {
            return Knot::at_rest(self.end.position);
        }
        self.knot_after(seconds)
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

    /// True once its end is reached.
    #[must_use]
    pub fn is_over(&self, at: Stamp<Mono>) -> bool {
        at.seconds_since(self.start) >= self.duration_s
    }

    /// How long the segment takes, s.
    #[must_use]
    pub const fn duration_s(&self) -> f64 {
        self.duration_s
    }
}

/// Velocity with which to pass a waypoint: along the bisector, slower in sharper turns.
///
/// ```text
/// v = v_max cos²(β/2) · (u_in + u_out)/|u_in + u_out|,   β the angle of the turn
/// ```
/// A turn of more than 120° stops, and short legs bound the speed by what they can brake.
#[must_use]
pub fn passing_velocity(
    before: &Vector3<f64>,
    waypoint: &Vector3<f64>,
    after: &Vector3<f64>,
    limits: &Limits,
) -> Vector3<f64> {
    let (leg_in, leg_out) = (waypoint - before, after - waypoint);
    let (Some(u_in), Some(u_out)) = (leg_in.try_normalize(1e-6), leg_out.try_normalize(1e-6))
    else {
        return Vector3::zeros();
    };
    let cos_turn = u_in.dot(&u_out);
    if cos_turn < -0.5 {
        return Vector3::zeros();
    }
    let slow_down = 0.5 * (1.0 + cos_turn);
    // Half of what the sharpest stop within the outgoing leg allows, since quintics are gentler.
    let stoppable_mps = (limits.accel_mps2 * leg_out.norm()).sqrt();
    let speed_mps = (limits.speed_mps * slow_down).min(stoppable_mps);
    (u_in + u_out).try_normalize(1e-6).unwrap_or_default() * speed_mps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;
    use std::time::Duration;

    #[test]
    fn bounds_and_continuity_hold_for_random_waypoints() {
        let limits = Limits { speed_mps: 2.0, accel_mps2: 1.5 };
        let mut noise = SeedBook::new(8).stream("waypoints");
        for _ in 0..300 {
            let mut place = || Vector3::from_fn(|_, _| noise.between(-8.0, 8.0));
            let points = [place(), place(), place()];
            let via = passing_velocity(&points[0], &points[1], &points[2], &limits);
            let knot = Knot { position: points[1], velocity: via, accel: Vector3::zeros() };
            let first = Segment::between(Stamp::ZERO, &Knot::at_rest(points[0]), &knot, &limits);
            let joint = Stamp::ZERO.plus(Duration::from_secs_f64(first.duration_s()));
            let second = Segment::between(joint, first.end(), &Knot::at_rest(points[2]), &limits);
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
        );
        for k in 1..20 {
            let t = segment.duration_s() * f64::from(k) / 20.0;
            let (a, b) = (segment.knot_after(t - 1e-5), segment.knot_after(t + 1e-5));
            let knot = segment.knot_after(t);
            assert!(((b.position - a.position) / 2e-5 - knot.velocity).norm() < 1e-6);
            assert!(((b.velocity - a.velocity) / 2e-5 - knot.accel).norm() < 1e-6);
        }
    }

    #[test]
    fn straight_cruise_keeps_its_speed() {
        let limits = Limits { speed_mps: 2.0, accel_mps2: 1.5 };
        let [a, b, c] = [0.0, 1.5, 3.0].map(|x| Vector3::new(x, 0.0, 7.0));
        let via = passing_velocity(&a, &b, &c, &limits);
        assert!((via - Vector3::new(1.5, 0.0, 0.0)).norm() < 1e-9 || via.x > 1.4);
        let stop = passing_velocity(&a, &b, &a, &limits);
        assert!(stop.norm() < 1e-12);
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
