//! One piece of a trajectory: the curve of least snap between two states.
//!
//! ```text
//! p, v, a, j at both ends  ⇒  degree 7;   ∫ |p⁗|² dt is least among all curves with these ends
//! P_0 = p                           P_2 = p + 2vT/7 + aT²/42
//! P_1 = p + vT/7                    P_3 = p + 3vT/7 + aT²/14 + jT³/210     and alike from the end
//! ```
//! Source: Mellinger and Kumar 2011, section IV; control points from the derivatives at the ends.
//! Checked: `from_rest_to_rest_takes_the_time_of_the_closed_form`, and by properties.

use super::bezier::{
    Points, derivative, dot, halves, is_ahead, is_within, jet, largest_norm, split,
};
use super::{Knot, Limits, Yaw};
use crate::units::wrapped_rad;
use nalgebra::Vector3;

/// Position and heading over a time span.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segment {
    position: Points<3, 8>,
    yaw: Points<1, 8>,
    duration_s: f64,
}

/// How a duration fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fit {
    Kept,
    /// Some bound is broken; more time may help.
    TooFast,
    /// The motion backs off; less time might have helped.
    TurnsBack,
}

/// Growth of the duration while the first one that fits is sought, and the number of such steps.
const GROWTH: f64 = 1.15;
const MAX_GROWTHS: usize = 40;
/// Far below the shortest duration, this share of the growth that the snap at the ends asks for is
/// taken at once.
const LEAP_SHARE: f64 = 0.8;
/// Halvings of the last step of growth: the duration found is within 15 %/2⁸ of the shortest.
const BISECTIONS: usize = 8;
/// Share of the speed bound with which a curve may go back along its chord.
const MAX_BACK_SHARE: f64 = 0.03;
/// The same for a start that accelerates already.
const MAX_BACK_SHARE_ACCELERATED: f64 = 0.4;
/// A turn on the spot takes no way at all, and no time below this, s.
const LEAST_DURATION_S: f64 = 1e-3;
/// Ends closer than this, m or rad, are the same place.
const SAME: f64 = 1e-6;

impl Segment {
    /// Stays at a place for no time.
    pub(super) fn point(at: &Knot) -> Self {
        Self { position: [at.position.into(); 8], yaw: [[at.yaw.angle_rad]; 8], duration_s: 0.0 }
    }

    /// The curve of least snap with this duration. The heading goes the shortest way round.
    pub(super) fn with_duration(from: &Knot, to: &Knot, duration_s: f64) -> Self {
        let turn_rad = wrapped_rad(to.yaw.angle_rad - from.yaw.angle_rad);
        let end_yaw = Yaw { angle_rad: from.yaw.angle_rad + turn_rad, ..to.yaw };
        Self {
            position: control_points(&from.derivatives(), &to.derivatives(), duration_s),
            yaw: control_points(&from.yaw.derivatives(), &end_yaw.derivatives(), duration_s),
            duration_s,
        }
    }

    /// The fastest curve of least snap from `from` to `to` within the limits that does not back
    /// off; `None` if there is none.
    pub(super) fn fastest(from: &Knot, to: &Knot, limits: &Limits) -> Option<Self> {
        let chord = to.position - from.position;
        let turn_rad = wrapped_rad(to.yaw.angle_rad - from.yaw.angle_rad).abs();
        if chord.norm() < SAME && turn_rad < SAME && from.is_at_rest() && to.is_at_rest() {
            return Some(Self::point(to));
        }
        let least_s = (chord.norm() / limits.speed_mps)
            .max(turn_rad / limits.yaw_rate_radps)
            .max((to.velocity - from.velocity).norm() / limits.accel_mps2)
            .max((to.accel - from.accel).norm() / limits.jerk_mps3)
            .max((to.jerk - from.jerk).norm() / limits.snap_mps4)
            .max(LEAST_DURATION_S);
        let way = Way::new(from, to, &chord, limits);
        let fits = |duration_s| {
            let segment = Self::with_duration(from, to, duration_s);
            (segment.fit(limits, &way), segment)
        };
        let (mut too_short_s, mut best) = (least_s, None);
        let mut duration_s = least_s;
        for _ in 0..MAX_GROWTHS {
            let (fit, segment) = fits(duration_s);
            match fit {
                Fit::Kept => {
                    best = Some(segment);
                    break;
                }
                Fit::TurnsBack => return None,
                Fit::TooFast => too_short_s = duration_s,
            }
            duration_s *= segment.leap(limits);
        }
        let mut best = best?;
        for _ in 0..BISECTIONS {
            if best.duration_s <= least_s {
                break;
            }
            let middle_s = 0.5 * (too_short_s + best.duration_s);
            match fits(middle_s) {
                (Fit::Kept, segment) => best = segment,
                _ => too_short_s = middle_s,
            }
        }
        Some(best)
    }

    /// By how much to lengthen a duration that is too short.
    fn leap(&self, limits: &Limits) -> f64 {
        let at_ends = [0.0, 1.0].map(|at| Vector3::from(jet(&self.position, at)[4]).norm());
        let snap_mps4 = at_ends[0].max(at_ends[1]) / self.duration_s.powi(4);
        (LEAP_SHARE * (snap_mps4 / limits.snap_mps4).sqrt().sqrt()).clamp(GROWTH, 10.0)
    }

    fn fit(&self, limits: &Limits, way: &Way) -> Fit {
        if !self.keeps(limits) {
            return Fit::TooFast;
        }
        let velocity: Points<3, 7> = derivative(&self.position, self.duration_s);
        if is_ahead(&velocity, &way.direction, way.slowest_mps) {
            Fit::Kept
        } else {
            Fit::TurnsBack
        }
    }

    /// True if every bound holds on the whole curve, not only at samples.
    pub(super) fn keeps(&self, limits: &Limits) -> bool {
        let t = self.duration_s;
        if t <= 0.0 {
            return true;
        }
        let velocity: Points<3, 7> = derivative(&self.position, t);
        let accel: Points<3, 6> = derivative(&velocity, t);
        let jerk: Points<3, 5> = derivative(&accel, t);
        let snap: Points<3, 4> = derivative(&jerk, t);
        let yaw_rate: Points<1, 7> = derivative(&self.yaw, t);
        let yaw_accel: Points<1, 6> = derivative(&yaw_rate, t);
        is_within(&snap, limits.snap_mps4)
            && is_within(&accel, limits.accel_mps2)
            && is_within(&velocity, limits.speed_mps)
            && is_within(&jerk, limits.jerk_mps3)
            && is_within(&yaw_rate, limits.yaw_rate_radps)
            && is_within(&yaw_accel, limits.yaw_accel_radps2)
    }

    /// The largest of the bounds' violations, 1 where a bound is just met; to a per cent.
    pub(super) fn load(&self, limits: &Limits) -> f64 {
        let t = self.duration_s;
        let velocity: Points<3, 7> = derivative(&self.position, t);
        let accel: Points<3, 6> = derivative(&velocity, t);
        let jerk: Points<3, 5> = derivative(&accel, t);
        let snap: Points<3, 4> = derivative(&jerk, t);
        let yaw_rate: Points<1, 7> = derivative(&self.yaw, t);
        let yaw_accel: Points<1, 6> = derivative(&yaw_rate, t);
        let share = |norm: f64, bound: f64| norm / bound;
        share(largest_norm(&velocity, 0.01 * limits.speed_mps), limits.speed_mps)
            .max(share(largest_norm(&accel, 0.01 * limits.accel_mps2), limits.accel_mps2))
            .max(share(largest_norm(&jerk, 0.01 * limits.jerk_mps3), limits.jerk_mps3))
            .max(share(largest_norm(&snap, 0.01 * limits.snap_mps4), limits.snap_mps4))
            .max(share(
                largest_norm(&yaw_rate, 0.01 * limits.yaw_rate_radps),
                limits.yaw_rate_radps,
            ))
            .max(share(
                largest_norm(&yaw_accel, 0.01 * limits.yaw_accel_radps2),
                limits.yaw_accel_radps2,
            ))
    }

    /// How long it takes, s.
    pub(super) const fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The state after some seconds, at the latest the end's.
    pub(super) fn knot_after(&self, seconds: f64) -> Knot {
        let t = self.duration_s;
        if t <= 0.0 {
            let [x] = self.yaw[7];
            return Knot::at_rest(Vector3::from(self.position[7]), x);
        }
        let at = (seconds / t).clamp(0.0, 1.0);
        let [position, v, a, j, _] = jet(&self.position, at).map(Vector3::from);
        let [[yaw], [yaw_v], [yaw_a], [yaw_j], _] = jet(&self.yaw, at);
        let (t2, t3) = (t * t, t * t * t);
        Knot {
            position,
            velocity: v / t,
            accel: a / t2,
            jerk: j / t3,
            yaw: Yaw {
                angle_rad: yaw,
                rate_radps: yaw_v / t,
                accel_radps2: yaw_a / t2,
                jerk_radps3: yaw_j / t3,
            },
        }
    }

    /// The part from `from_s` to `to_s`.
    pub(super) fn part(&self, from_s: f64, to_s: f64) -> Self {
        let t = self.duration_s;
        if t <= 0.0 {
            return self.clone();
        }
        let (from_s, to_s) = (from_s.clamp(0.0, t), to_s.clamp(0.0, t));
        let cut = |from: f64, to: f64| {
            let position = split(&split(&self.position, to).0, from / to.max(f64::MIN_POSITIVE)).1;
            let yaw = split(&split(&self.yaw, to).0, from / to.max(f64::MIN_POSITIVE)).1;
            (position, yaw)
        };
        let (position, yaw) = cut(from_s / t, to_s / t);
        Self { position, yaw, duration_s: to_s - from_s }
    }

    /// How far the curve leaves the straight line between its ends, m: a bound from above, within
    /// a millimetre.
    pub(super) fn departure_m(&self) -> f64 {
        let from = self.position[0];
        let mut chord = [0.0; 3];
        for d in 0..3 {
            chord[d] = self.position[7][d] - from[d];
        }
        let length_squared = dot(&chord, &chord);
        let aside = self.position.map(|p| {
            let mut offset = [p[0] - from[0], p[1] - from[1], p[2] - from[2]];
            if length_squared > SAME * SAME {
                let along = dot(&offset, &chord) / length_squared;
                for d in 0..3 {
                    offset[d] -= along * chord[d];
                }
            }
            offset
        });
        largest_norm(&aside, 1e-3)
    }

    /// True if `is_free` holds at places along the curve that are `spacing_m` apart at most, both
    /// ends included.
    pub(super) fn is_free(
        &self,
        spacing_m: f64,
        is_free: &dyn Fn(&Vector3<f64>, f64) -> bool,
    ) -> bool {
        is_part_free(&self.position, &self.yaw, spacing_m, is_free) && {
            let end = self.knot_after(self.duration_s);
            is_free(&end.position, end.yaw.angle_rad)
        }
    }
}

/// Halves a curve until its control polygon, which is longer, is shorter than the spacing; asks
/// at the beginning of each part.
fn is_part_free(
    position: &Points<3, 8>,
    yaw: &Points<1, 8>,
    spacing_m: f64,
    is_free: &dyn Fn(&Vector3<f64>, f64) -> bool,
) -> bool {
    let sides = position.windows(2).map(|p| (Vector3::from(p[1]) - Vector3::from(p[0])).norm());
    if sides.sum::<f64>() <= spacing_m {
        return is_free(&Vector3::from(position[0]), yaw[0][0]);
    }
    let ((p_left, p_right), (y_left, y_right)) = (halves(position), halves(yaw));
    is_part_free(&p_left, &y_left, spacing_m, is_free)
        && is_part_free(&p_right, &y_right, spacing_m, is_free)
}

/// Which way is forward, and how slow the motion along it may become.
struct Way {
    direction: [f64; 3],
    slowest_mps: f64,
}

impl Way {
    fn new(from: &Knot, to: &Knot, chord: &Vector3<f64>, limits: &Limits) -> Self {
        let direction = chord.try_normalize(SAME).unwrap_or_default();
        let of_ends = from.velocity.dot(&direction).min(to.velocity.dot(&direction)).min(0.0);
        let share = if from.is_steady() { MAX_BACK_SHARE } else { MAX_BACK_SHARE_ACCELERATED };
        Self { direction: direction.into(), slowest_mps: of_ends - share * limits.speed_mps }
    }
}

/// Control points from position, velocity, acceleration and jerk at both ends.
fn control_points<const D: usize>(
    from: &[[f64; D]; 4],
    to: &[[f64; D]; 4],
    duration_s: f64,
) -> Points<D, 8> {
    let t = duration_s;
    let side = |knot: &[[f64; D]; 4], t: f64| {
        let mut points = [[0.0; D]; 4];
        for d in 0..D {
            let (p, v, a, j) =
                (knot[0][d], knot[1][d] * t, knot[2][d] * t * t, knot[3][d] * t * t * t);
            points[0][d] = p;
            points[1][d] = p + v / 7.0;
            points[2][d] = p + v * (2.0 / 7.0) + a / 42.0;
            points[3][d] = p + v * (3.0 / 7.0) + a / 14.0 + j / 210.0;
        }
        points
    };
    let [p0, p1, p2, p3] = side(from, t);
    let [p7, p6, p5, p4] = side(to, -t);
    [p0, p1, p2, p3, p4, p5, p6, p7]
}
