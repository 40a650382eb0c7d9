//! A place of now for the autopilot when inertial samples come late or not at all.
//!
//! The filter's belief ends with the newest inertial sample. Late by more than the autopilot can look back,
//! it would pull the vehicle to where it was; so it is carried on to now. Where it is too old for that, the
//! flight ends, and the autopilot would land blind although a camera sees where the vehicle is: it gets what two
//! frames show by themselves.
//!
//! ```text
//! v = (p₁ − p₀)/Δ,   σ_v² = (σ₀² + σ₁²)/Δ² + (a Δ/2)²                       of two frames
//! p(t) = p₁ + v τ,   σ_p² = σ₁² + σ_v² τ² + (a τ²/2)²,   τ = t − t₁         carried on
//! ```
//! `a`: what a manoeuvre may do, m/s². Nothing is measured or steered by it.
//! Checked: `a_straight_flight_is_told_at_the_instant_asked_for`, fault cases 17 and 30 of the simulator.

use crate::geometry::Direction;
use crate::messages::state::{ATT, POS, VEL};
use crate::messages::{FixOutcome, NavEstimate};
use crate::time::{Mono, Stamp};
use nalgebra::{SMatrix, Vector3};
use std::collections::VecDeque;
use std::time::Duration;

/// The velocity is that over so long at least …
const LEAST_SPAN: Duration = Duration::from_millis(100);
/// … and at most.
const LONGEST_SPAN: Duration = Duration::from_secs(1);
/// Two frames between which the vehicle would have flown faster than this do not agree, m/s.
const PLAUSIBLE_SPEED_MPS: f64 = 5.0;
/// By how much the velocity may change meanwhile, m/s², and how fast the attitude, rad/s.
const MANOEUVRE_MPS2: f64 = 1.5;
const TURN_RADPS: f64 = 0.3;

/// What the latest frames showed.
#[derive(Debug, Clone, Default)]
pub(super) struct Sight {
    /// The newest last, within [`LONGEST_SPAN`].
    fixes: VecDeque<(Stamp<Mono>, FixOutcome)>,
    /// The newest is told.
    is_told: bool,
}

impl Sight {
    /// Takes in what a frame shows.
    pub(super) fn take(&mut self, at: Stamp<Mono>, fix: FixOutcome) {
        if self.fixes.back().is_some_and(|(newest, _)| *newest >= at) {
            return;
        }
        self.fixes.retain(|(earlier, _)| at.since(*earlier) <= LONGEST_SPAN);
        let place = fix.hall_from_body.origin;
        let agrees = |(earlier, other): &(Stamp<Mono>, FixOutcome)| {
            let apart_m = (place - other.hall_from_body.origin).coords.norm();
            apart_m <= PLAUSIBLE_SPEED_MPS * at.seconds_since(*earlier)
        };
        // Whichever of the two is wrong: the next ones decide.
        if !self.fixes.back().is_none_or(agrees) {
            self.fixes.clear();
        }
        self.fixes.push_back((at, fix));
        self.is_told = false;
    }

    /// The pose and velocity now, once for each frame; `None` while two frames do not tell them, and by
    /// frames older than `oldest`.
    pub(super) fn tell(
        &mut self,
        now: Stamp<Mono>,
        oldest: Duration,
        reset_counter: u8,
    ) -> Option<NavEstimate> {
        if self.is_told {
            return None;
        }
        let (at, fix) = self.fixes.back()?;
        let is_earlier = |(earlier, _): &&(_, _)| at.since(*earlier) >= LEAST_SPAN;
        let (before_at, before) = self.fixes.iter().rev().find(is_earlier)?;
        if now.since(*at) > oldest {
            return None;
        }
        let span_s = at.seconds_since(*before_at);
        let moved = fix.hall_from_body.origin - before.hall_from_body.origin;
        let mut error_cov = SMatrix::<f64, 15, 15>::zeros();
        error_cov.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.pose_cov);
        for (axis, velocity) in VEL.enumerate() {
            let var_m2 = fix.pose_cov[(axis, axis)] + before.pose_cov[(axis, axis)];
            error_cov[(velocity, velocity)] =
                var_m2 / span_s.powi(2) + (0.5 * MANOEUVRE_MPS2 * span_s).powi(2);
        }
        let estimate = NavEstimate {
            at: *at,
            hall_from_body: fix.hall_from_body,
            velocity_mps: Direction::from_coords(moved.coords / span_s),
            gyro_radps: Vector3::zeros(),
            gyro_bias_radps: Vector3::zeros(),
            accel_bias_mps2: Vector3::zeros(),
            error_cov,
            reset_counter,
        };
        self.is_told = true;
        Some(carried_on(estimate, now))
    }
}

/// The belief at a later instant, as if the vehicle went on as it did, with the σ that this deserves.
pub(super) fn carried_on(mut estimate: NavEstimate, now: Stamp<Mono>) -> NavEstimate {
    let age_s = now.since(estimate.at).as_secs_f64();
    let pose = &mut estimate.hall_from_body;
    pose.origin.coords += estimate.velocity_mps.coords * age_s;
    pose.rotation = pose.rotation.perturbed(&(estimate.gyro_radps * age_s));
    let cov = &mut estimate.error_cov;
    for axis in 0..3 {
        let [place, turn, velocity] = [POS, ATT, VEL].map(|range| range.start + axis);
        cov[(place, place)] += cov[(velocity, velocity)] * age_s.powi(2)
            + (0.5 * MANOEUVRE_MPS2 * age_s.powi(2)).powi(2);
        cov[(turn, turn)] += (TURN_RADPS * age_s).powi(2);
        cov[(velocity, velocity)] += (MANOEUVRE_MPS2 * age_s).powi(2);
    }
    estimate.at = now;
    estimate
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Point, Rotation, Transform};
    use nalgebra::Matrix6;

    const OLDEST: Duration = Duration::from_millis(300);

    fn at_ms(ms: u64) -> Stamp<Mono> {
        Stamp::ZERO.plus(Duration::from_millis(ms))
    }

    fn fix(x_m: f64) -> FixOutcome {
        FixOutcome {
            hall_from_body: Transform {
                rotation: Rotation::identity(),
                origin: Point::new(x_m, 3.0, 4.0),
            },
            pose_cov: Matrix6::identity() * 1e-4,
            residual_rms_px: 0.3,
            n_points: 16,
            q_pos: 50.0,
            q_position: 50.0,
        }
    }

    #[test]
    fn a_straight_flight_is_told_at_the_instant_asked_for() {
        let mut sight = Sight::default();
        for ms in [1_000, 1_050, 1_100] {
            sight.take(at_ms(ms), fix(2e-3 * f64::from(u32::try_from(ms).unwrap())));
        }
        // 2 m/s along x, asked for 80 ms after the frame.
        let told = sight.tell(at_ms(1_180), OLDEST, 7).unwrap();
        assert!((told.hall_from_body.origin.coords - Vector3::new(2.36, 3.0, 4.0)).norm() < 1e-9);
        assert!((told.velocity_mps.coords - Vector3::new(2.0, 0.0, 0.0)).norm() < 1e-9);
        assert_eq!((told.at, told.reset_counter), (at_ms(1_180), 7));
        // By hand: σ_v² = 2e-4/0.01 + 0.075² = 0.025625, + (1.5 · 0.08)²; σ_p² = 1e-4 + σ_v² 0.08² + 0.0048².
        assert!((told.error_cov[(VEL.start, VEL.start)] - 0.040_025).abs() < 1e-9);
        assert!((told.error_cov[(0, 0)] - 2.870_4e-4).abs() < 1e-9);
        assert_eq!(sight.tell(at_ms(1_190), OLDEST, 7), None, "told once");
    }

    #[test]
    fn lone_old_and_contradicting_frames_tell_nothing() {
        let mut sight = Sight::default();
        sight.take(at_ms(1_000), fix(2.0));
        assert_eq!(sight.tell(at_ms(1_010), OLDEST, 0), None, "no velocity");
        sight.take(at_ms(1_100), fix(2.2));
        assert_eq!(sight.tell(at_ms(1_401), OLDEST, 0), None, "too old");
        sight.take(at_ms(1_200), fix(9.0));
        assert_eq!(sight.tell(at_ms(1_210), OLDEST, 0), None, "a jump of 7 m");
        sight.take(at_ms(1_300), fix(9.2));
        assert!(sight.tell(at_ms(1_310), OLDEST, 0).is_some(), "the next one decides");
        // A frame that comes out of order changes nothing.
        sight.take(at_ms(1_250), fix(9.1));
        assert_eq!(sight.tell(at_ms(1_320), OLDEST, 0), None);
    }
}
