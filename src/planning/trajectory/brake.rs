//! Stops from any state of motion.
//!
//! ```text
//! v(t) of degree 5 from (v₀, a₀, j₀) to (0, 0, 0):   p₁ = p₀ + v₀ T/2 + a₀ T²/10 + j₀ T³/120
//! ```
//! - A *gentle* stop keeps every bound. From some states none does at once: where the acceleration
//!   still grows, it has to be led out first. Then the present trajectory is flown on until one
//!   does, at the longest until its own rest.
//! - An *emergency* stop begins at once. It has more acceleration, jerk and snap than planned
//!   motion, see [`Limits::in_emergency`]; it is still continuous up to the jerk.
//!
//! Checked: `every_state_can_be_braked_within_the_bounds`, `an_emergency_stop_begins_at_once_and_is_shorter`.

use super::segment::Segment;
use super::{Knot, Limits, Yaw};

/// Growth of the duration while one that keeps the bounds is sought.
const GROWTH: f64 = 1.06;
const MAX_GROWTHS: usize = 50;
/// No stop is shorter, s: below that snap alone decides.
const LEAST_S: f64 = 0.1;
/// Largest acceleration of a quintic change of speed over its mean.
const PEAK_OVER_MEAN: f64 = 1.875;

/// The shortest stop that keeps the limits, to 6 %.
pub(super) fn gentle(from: &Knot, limits: &Limits) -> Option<Segment> {
    if from.is_at_rest() {
        return Some(Segment::point(from));
    }
    durations(from, limits).map(|t| stop_in(from, t)).find(|segment| segment.keeps(limits))
}

/// The shortest stop within the emergency's limits; from a state where none keeps them, the one
/// that passes them least.
pub(super) fn emergency(from: &Knot, limits: &Limits) -> Segment {
    let limits = limits.in_emergency();
    let load = |segment: &Segment| segment.load(&limits);
    gentle(from, &limits).unwrap_or_else(|| {
        durations(from, &limits)
            .map(|t| stop_in(from, t))
            .min_by(|a, b| load(a).total_cmp(&load(b)))
            .unwrap_or_else(|| stop_in(from, 1.0))
    })
}

fn durations(from: &Knot, limits: &Limits) -> impl Iterator<Item = f64> {
    let shortest_s = (PEAK_OVER_MEAN * from.velocity.norm() / limits.accel_mps2)
        .max(PEAK_OVER_MEAN * from.yaw.rate_radps.abs() / limits.yaw_accel_radps2)
        .max(LEAST_S);
    std::iter::successors(Some(shortest_s), |t| Some(t * GROWTH)).take(MAX_GROWTHS)
}

fn stop_in(from: &Knot, t: f64) -> Segment {
    let (t2, t3) = (t * t / 10.0, t * t * t / 120.0);
    let place = from.position + from.velocity * (0.5 * t) + from.accel * t2 + from.jerk * t3;
    let Yaw { angle_rad, rate_radps, accel_radps2, jerk_radps3 } = from.yaw;
    let yaw_rad = angle_rad + rate_radps * (0.5 * t) + accel_radps2 * t2 + jerk_radps3 * t3;
    Segment::with_duration(from, &Knot::at_rest(place, yaw_rad), t)
}
