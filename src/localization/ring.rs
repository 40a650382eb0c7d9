//! The last second of inertial samples and fixes, so that late fixes land at their own time.
//!
//! Every entry holds the state after it. A fix that arrives late is put in its place, and all
//! later entries are computed again; so the result does not depend on the order of arrival.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::filter::{Covariance, FilterState, Gain, ImuNoise, Innovation};
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
    /// What the input's update did to the error, if it was fused.
    gain: Option<Box<Gain>>,
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
        let first = Entry { input: Input::Imu(last_imu), state: start, gain: None };
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
        self.entries.insert(place, Entry { input: Input::Imu(imu), state, gain: None });
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
        let gain = fused(&mut state, &fix, &innovation);
        // A refused fix stays too: another that arrives later may lie before it and speak for it.
        self.entries.insert(place, Entry { input: Input::Fix(Box::new(fix)), state, gain });
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

    /// How the error at `from` lives on in the error at `to`; `None` if either is outside the ring
    /// or they are out of order.
    ///
    /// ```text
    /// e(to) = A e(from) + new noise,   A = Π (I − U H) Φ over the entries in between
    /// ```
    /// An instant between two entries is reached from the entry before it, as by
    /// [`Self::state_at`]. Checked: `transition_matches_a_cloned_error`.
    #[must_use]
    pub fn error_transition(&self, from: Stamp<Mono>, to: Stamp<Mono>) -> Option<Covariance> {
        if to < from || to > self.newest().at.plus(FUTURE_TOLERANCE) {
            return None;
        }
        let start = self.state_at(from)?;
        let first = self.entries.partition_point(|entry| entry.state.at <= from);
        let end = self.entries.partition_point(|entry| entry.state.at <= to);
        let mut before = &start;
        let mut A = Covariance::identity();
        for place in first..end {
            let entry = &self.entries[place];
            A = before.transition(&self.imu_in_force(place), entry.state.at).times(&A);
            if let Some(gain) = &entry.gain {
                gain.apply(&mut A);
            }
            before = &entry.state;
        }
        Some(before.transition(&self.imu_in_force(end), to).times(&A))
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
            let entry = &mut self.entries[place];
            if let Input::Fix(fix) = &entry.input {
                let innovation = state.innovation(fix);
                entry.gain = fused(&mut state, fix, &innovation);
            }
            entry.state = state;
        }
    }
}

/// Fuses a fix within its gate.
fn fused(state: &mut FilterState, fix: &FixOutcome, innovation: &Innovation) -> Option<Box<Gain>> {
    innovation.is_within_gate().then(|| state.fuse(fix, innovation).map(Box::new)).flatten()
}

fn pose_cov(state: &FilterState) -> Matrix6<f64> {
    state.P.fixed_view::<6, 6>(0, 0).into_owned()
}

#[cfg(test)]
mod tests;
