//! The last second of inertial samples and fixes, so that late fixes land at their own time.
//!
//! Every entry holds the state after it. A fix that arrives late is put in its place, and all
//! later entries are computed again; so the result does not depend on the order of arrival.

use super::filter::{FilterState, ImuNoise, Innovation};
use crate::geometry::{Body, Hall, Point, Transform};
use crate::messages::{FixOutcome, ImuSample};
use crate::time::{Mono, Stamp};
use nalgebra::Matrix6;
use std::collections::VecDeque;
use std::time::Duration;

#[derive(Debug, Clone)]
enum Input {
    Imu(ImuSample),
    Fix(Box<FixOutcome>),
}

#[derive(Debug, Clone)]
struct Entry {
    input: Input,
    /// The state after this input; its stamp orders the entries.
    state: FilterState,
}

/// States and inputs of the last second, in order of time.
#[derive(Debug, Clone)]
pub struct Ring {
    entries: VecDeque<Entry>,
    span: Duration,
    noise: ImuNoise,
}

/// What became of a fix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Insertion {
    /// In the ring; the innovation says whether it passed its gate.
    Placed(Innovation),
    /// Older than the ring.
    TooOld,
    /// Newer than the newest inertial sample by more than the tolerance.
    FromTheFuture,
}

/// A fix may be this much newer than the newest inertial sample: samples travel too.
const FUTURE_TOLERANCE: Duration = Duration::from_millis(20);

impl Ring {
    /// A ring that starts with this state.
    #[must_use]
    pub fn new(start: FilterState, last_imu: ImuSample, noise: ImuNoise, span: Duration) -> Self {
        let first = Entry { input: Input::Imu(last_imu), state: start };
        Self { entries: VecDeque::from([first]), span, noise }
    }

    /// The newest state.
    #[must_use]
    pub fn newest(&self) -> &FilterState {
        // A ring is made with one entry and never emptied.
        &self.entries[self.entries.len() - 1].state
    }

    /// The oldest instant that is still known.
    #[must_use]
    pub fn oldest_at(&self) -> Stamp<Mono> {
        self.entries[0].state.at
    }

    /// Takes in an inertial sample; one that is not newer than the last sample is ignored.
    ///
    /// A fix may have come before the sample that covers its time; it is computed again then.
    pub fn push_imu(&mut self, imu: ImuSample) {
        let is_imu = |entry: &Entry| matches!(entry.input, Input::Imu(_));
        let last_imu = self.entries.iter().rev().find(|entry| is_imu(entry));
        if last_imu.is_some_and(|last| imu.at <= last.state.at) {
            return;
        }
        let place = self.entries.partition_point(|entry| entry.state.at <= imu.at);
        let first_fix = self.entries.iter().rposition(is_imu).map_or(place, |last| last + 1);
        let state = self.entries[place - 1].state.propagated(&imu, imu.at, &self.noise);
        self.entries.insert(place, Entry { input: Input::Imu(imu), state });
        if first_fix < place || place + 1 < self.entries.len() {
            self.recompute_from(first_fix);
        }
        let horizon = imu.at.minus(self.span);
        while self.entries.len() > 2 && self.entries[1].state.at < horizon {
            self.entries.pop_front();
        }
    }

    /// Puts a fix at its own time; fuses it as long as it passes the gate.
    pub fn insert_fix(&mut self, at: Stamp<Mono>, fix: FixOutcome) -> Insertion {
        if at < self.oldest_at() {
            return Insertion::TooOld;
        }
        if at > self.newest().at.plus(FUTURE_TOLERANCE) {
            return Insertion::FromTheFuture;
        }
        let place = self.entries.partition_point(|entry| entry.state.at <= at);
        let imu = self.imu_in_force(place);
        let mut state = self.entries[place - 1].state.propagated(&imu, at, &self.noise);
        let innovation = state.innovation(&fix);
        if innovation.is_within_gate() {
            state.fuse(&fix, &innovation);
        }
        // A refused fix stays too: another that arrives later may lie before it and speak for it.
        self.entries.insert(place, Entry { input: Input::Fix(Box::new(fix)), state });
        self.recompute_from(place + 1);
        Insertion::Placed(innovation)
    }

    /// The pose at an instant inside the ring, and the covariance of its error (6×6).
    ///
    /// Between two states position and attitude are interpolated along the straight line and the
    /// shortest turn; the covariance is the later state's.
    #[must_use]
    pub fn pose_at(&self, at: Stamp<Mono>) -> Option<(Transform<Hall, Body>, Matrix6<f64>)> {
        if at < self.oldest_at() || at > self.newest().at {
            return None;
        }
        let place = self.entries.partition_point(|entry| entry.state.at <= at);
        let before = &self.entries[place - 1].state;
        let Some(after) = self.entries.get(place).map(|entry| &entry.state) else {
            return Some((before.hall_from_body, pose_cov(before)));
        };
        let ratio = at.seconds_since(before.at) / after.at.seconds_since(before.at);
        let (a, b) = (&before.hall_from_body, &after.hall_from_body);
        let turn = b.rotation.minus(&a.rotation) * ratio;
        let origin = a.origin.coords.lerp(&b.origin.coords, ratio);
        let pose = Transform::new(a.rotation.perturbed(&turn), Point::from_coords(origin));
        Some((pose, pose_cov(after)))
    }

    /// The state at an instant inside the ring, propagated from the one before.
    #[must_use]
    pub fn state_at(&self, at: Stamp<Mono>) -> Option<FilterState> {
        if at < self.oldest_at() || at > self.newest().at.plus(FUTURE_TOLERANCE) {
            return None;
        }
        let place = self.entries.partition_point(|entry| entry.state.at <= at);
        Some(self.entries[place - 1].state.propagated(&self.imu_in_force(place), at, &self.noise))
    }

    /// The sample that covers the time just before entry `place`: the next one, else the last.
    fn imu_in_force(&self, place: usize) -> ImuSample {
        let imu_of = |entry: &Entry| match &entry.input {
            Input::Imu(imu) => Some(*imu),
            Input::Fix(_) => None,
        };
        let next = self.entries.range(place..).find_map(imu_of);
        next.or_else(|| self.entries.range(..place).rev().find_map(imu_of)).unwrap_or(ImuSample {
            // Not reached while the ring's first entry is an inertial sample; at rest is harmless.
            at: self.newest().at,
            accel_mps2: nalgebra::Vector3::z() * crate::units::GRAVITY_MPS2,
            gyro_radps: nalgebra::Vector3::zeros(),
        })
    }

    fn recompute_from(&mut self, first: usize) {
        for place in first..self.entries.len() {
            let imu = self.imu_in_force(place);
            let at = self.entries[place].state.at;
            let mut state = self.entries[place - 1].state.propagated(&imu, at, &self.noise);
            if let Input::Fix(fix) = &self.entries[place].input {
                let innovation = state.innovation(fix);
                if innovation.is_within_gate() {
                    state.fuse(fix, &innovation);
                }
            }
            self.entries[place].state = state;
        }
    }
}

fn pose_cov(state: &FilterState) -> Matrix6<f64> {
    state.P.fixed_view::<6, 6>(0, 0).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;
    use crate::localization::filter::Covariance;
    use crate::stats::SeedBook;
    use nalgebra::Vector3;

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
}
