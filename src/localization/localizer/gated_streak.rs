//! Fixes that the filter refused although they agree with each other: they outvote it, and tell how fast the
//! vehicle is.

use super::super::start::IN_FLIGHT;
use crate::geometry::{Hall, Point};
use crate::messages::FixOutcome;
use crate::time::{Mono, Stamp};
use nalgebra::Vector3;
use std::collections::VecDeque;

/// Fixes in a row that the gate refused although they agree with each other, the newest last.
#[derive(Debug, Clone, Default)]
pub(super) struct GatedStreak {
    count: usize,
    /// Those of the last [`VELOCITY_SPAN_S`].
    fixes: VecDeque<StreakFix>,
}

/// Place and its largest variance, m².
#[derive(Debug, Clone, Copy)]
struct StreakFix {
    at: Stamp<Mono>,
    place: Point<Hall>,
    var_m2: f64,
}

/// A velocity and the standard deviation of each of its components, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Velocity {
    pub(super) mps: Vector3<f64>,
    pub(super) sigma_mps: f64,
}

impl Velocity {
    /// On the ground.
    pub(super) const NONE: Self =
        Self { mps: Vector3::new(0.0, 0.0, 0.0), sigma_mps: IN_FLIGHT[0].1 };

    /// Another velocity, if this one does not speak against it.
    pub(super) fn not_contradicted(&self, mps: Vector3<f64>) -> Option<Self> {
        const MOST_SIGMAS: f64 = 2.0;
        let is_near = (mps - self.mps).norm() < MOST_SIGMAS * self.sigma_mps;
        is_near.then_some(Self { mps, sigma_mps: IN_FLIGHT[0].1 })
    }
}

/// This many agreeing fixes in a row outvote the filter: half a second at 20 Hz.
const RESET_AFTER_GATED: usize = 10;
/// Two fixes agree if the vehicle could have flown from one to the other, m/s.
pub const PLAUSIBLE_SPEED_MPS: f64 = 5.0;
/// The velocity is that over so long, s: the shortest span of these that two fixes have between them.
const VELOCITY_SPAN_S: (f64, f64) = (0.1, 1.0);
/// By how much a velocity may change in flight, m/s².
pub const MANOEUVRE_MPS2: f64 = 1.5;
impl GatedStreak {
    /// Counts a refused fix; true once enough of them in a row agree with each other.
    pub(super) fn outvotes_filter(&mut self, at: Stamp<Mono>, fix: &FixOutcome) -> bool {
        let place = fix.hall_from_body.origin;
        let agrees = self.fixes.back().is_some_and(|last| {
            let reach_m = 0.3 + PLAUSIBLE_SPEED_MPS * at.seconds_since(last.at).abs();
            (place - last.place).coords.norm() < reach_m
        });
        if !agrees {
            *self = Self::default();
        }
        self.count += 1;
        let var_m2 = (0..3).map(|k| fix.pose_cov[(k, k)]).fold(0.0, f64::max);
        self.fixes.push_back(StreakFix { at, place, var_m2 });
        let is_old = |fix: &StreakFix| at.seconds_since(fix.at) > VELOCITY_SPAN_S.1;
        while self.fixes.front().is_some_and(is_old) {
            self.fixes.pop_front();
        }
        self.count >= RESET_AFTER_GATED
    }

    /// Velocity between the newest of the fixes and the last one that is old enough for that; `None` without
    /// such a one, or with one that no vehicle of ours has.
    pub(super) fn velocity(&self) -> Option<Velocity> {
        let newest = self.fixes.back()?;
        let spans = self.fixes.iter().rev().map(|old| (newest.at.seconds_since(old.at), old));
        let (span_s, old) = { spans }.find(|(span_s, _)| *span_s >= VELOCITY_SPAN_S.0)?;
        let mps = (newest.place - old.place).coords / span_s;
        let var = IN_FLIGHT[0].1.powi(2)
            + (newest.var_m2 + old.var_m2) / span_s.powi(2)
            + (MANOEUVRE_MPS2 * span_s).powi(2);
        (mps.norm() <= PLAUSIBLE_SPEED_MPS).then_some(Velocity { mps, sigma_mps: var.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Rotation, Transform};
    use nalgebra::Matrix6;
    use std::time::Duration;

    fn fix(place: Vector3<f64>) -> FixOutcome {
        FixOutcome {
            hall_from_body: Transform::new(Rotation::identity(), Point::from_coords(place)),
            pose_cov: Matrix6::identity() * 1e-4,
            residual_rms_px: 0.3,
            n_points: 8,
            q_pos: 50.0,
            q_position: 60.0,
        }
    }

    /// Past a filter that has gone astray, with slow cameras and with fast ones.
    #[test]
    fn fixes_that_outvote_the_filter_tell_their_velocity() {
        for period_ms in [5, 50, 200, 900] {
            let mut streak = GatedStreak::default();
            let velocity_mps = Vector3::new(1.6, -1.2, 0.1);
            let at = |n: u64| Stamp::ZERO.plus(Duration::from_millis(period_ms * n));
            let place = |n| Vector3::new(3.0, 4.0, 7.0) + velocity_mps * at(n).seconds();
            let n_until = (0..).find(|n| streak.outvotes_filter(at(*n), &fix(place(*n)))).unwrap();
            assert_eq!(n_until, 9, "the tenth");
            (10..30).for_each(|n| {
                streak.outvotes_filter(at(n), &fix(place(n)));
            });
            let found = streak.velocity().unwrap();
            assert!((found.mps - velocity_mps).norm() < 1e-9);
            assert!((0.5..2.0).contains(&found.sigma_mps), "{found:?}");
            // One that does not agree begins anew, and tells none.
            assert!(!streak.outvotes_filter(at(30), &fix(Vector3::zeros())));
            assert_eq!(streak.velocity(), None);
        }
    }
}
