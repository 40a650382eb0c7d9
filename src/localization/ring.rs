//! The last second of inertial samples and fixes, so that late fixes land at their own time.
//!
//! Every entry holds the state after it. A fix that arrives late is put in its place, and all
//! later entries are computed again; so the result does not depend on the order of arrival.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::filter::{Covariance, FilterState, Gain, ImuNoise, Innovation, PlacedFix};
use super::tight_update::{self, Frame, TightOutcome};
use crate::geometry::{Body, Hall, Point, Transform};
use crate::messages::ImuSample;
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, Vector3};
use std::collections::VecDeque;
use std::time::Duration;

#[derive(Debug, Clone)]
enum Input {
    Imu(Covered),
    Fix(Box<PlacedFix>),
    Frame(Box<FrameInput>),
    /// The vehicle stands: no velocity, and this mean of the gyroscope.
    Standstill(Vector3<f64>),
}

/// A sample, and the noise of the time that it stands for.
#[derive(Debug, Clone, Copy)]
struct Covered {
    imu: ImuSample,
    noise: ImuNoise,
}

/// A frame, and the fix to fuse where its points and the state do not agree.
#[derive(Debug, Clone)]
struct FrameInput {
    frame: Frame,
    fallback: Option<PlacedFix>,
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
#[derive(Debug, Clone, PartialEq)]
pub enum Insertion {
    /// In the ring; the innovation says whether it passed its gate.
    Placed(Box<Innovation>),
    /// Older than the ring.
    TooOld,
    /// Newer than the newest inertial sample by more than the tolerance.
    FromTheFuture,
}

/// What became of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameInsertion {
    /// In the ring, with how its points met the state.
    Placed(Box<FramePlaced>),
    /// Older than the ring.
    TooOld,
    /// Newer than the newest inertial sample by more than the tolerance.
    FromTheFuture,
}

/// How a frame met the state at its own time.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePlaced {
    /// Its points, one by one.
    pub tight: TightOutcome,
    /// The fix that stood in for points that were refused, and how it met the state.
    pub fallback: Option<(PlacedFix, Innovation)>,
}

/// A sample stands for this long without a penalty, s: one period of an autopilot that sends 100
/// a second, with its jitter.
const EVEN_GAP_S: f64 = 0.012;
/// From this gap on all is possible that the vehicle may do unseen, s; in between its share grows
/// evenly.
const UNSEEN_GAP_S: f64 = 0.04;
/// What the vehicle may do unseen in a gap: forces and turns that hold all through it.
const UNSEEN_ACCEL_MPS2: f64 = 2.0;
const UNSEEN_RATE_RADPS: f64 = 1.0;

/// A fix may be this much newer than the newest inertial sample: samples travel too.
const FUTURE_TOLERANCE: Duration = Duration::from_millis(20);

impl Ring {
    /// A ring that starts with this state.
    #[must_use]
    pub fn new(start: FilterState, last_imu: ImuSample, noise: ImuNoise, span: Duration) -> Self {
        let first =
            Entry { input: Input::Imu(Covered { imu: last_imu, noise }), state: start, gain: None };
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
        // The filter begins at an instant of the past. What lies between it and the first sample that was
        // kept is no hole in the stream.
        let began_before = last_imu.filter(|_| self.entries.len() > 1);
        let gap_s = began_before.map_or(0.0, |last| imu.at.seconds_since(last.state.at));
        let covered = Covered { imu, noise: self.noise_over(gap_s) };
        let place = self.entries.partition_point(|entry| entry.state.at <= imu.at);
        let first_fix = self.entries.iter().rposition(is_imu).map_or(place, |last| last + 1);
        let state = self.entries[place - 1].state.propagated(&imu, imu.at, &covered.noise);
        self.entries.insert(place, Entry { input: Input::Imu(covered), state, gain: None });
        if first_fix < place || place + 1 < self.entries.len() {
            self.recompute_from(first_fix);
        }
        let horizon = imu.at.minus(self.span);
        while self.entries.len() > 2 && self.entries[1].state.at < horizon {
            self.entries.pop_front();
        }
    }

    /// Puts a fix at its own time; fuses it as long as it passes the gate.
    pub fn insert_fix(&mut self, at: Stamp<Mono>, fix: impl Into<PlacedFix>) -> Insertion {
        let fix = fix.into();
        match self.place_of(at) {
            Err(refusal) => refusal,
            Ok(place) => {
                let (mut state, _) = self.before(place, at);
                let innovation = state.innovation_of(&fix.outcome, &fix.by_place);
                let gain = fused(&mut state, &fix, &innovation);
                // A refused fix stays too: another that arrives later may lie before it and speak
                // for it.
                self.put(place, Entry { input: Input::Fix(Box::new(fix)), state, gain });
                Insertion::Placed(Box::new(innovation))
            }
        }
    }

    /// Puts the points of a frame at their own time; fuses them as long as they agree with the
    /// state. `fallback` is asked for a fix where they do not.
    pub fn insert_frame(
        &mut self,
        at: Stamp<Mono>,
        frame: Frame,
        fallback: impl FnOnce(&FilterState, &Vector3<f64>) -> Option<PlacedFix>,
    ) -> FrameInsertion {
        let place = match self.place_of(at) {
            Ok(place) => place,
            Err(Insertion::TooOld) => return FrameInsertion::TooOld,
            Err(_) => return FrameInsertion::FromTheFuture,
        };
        let (mut state, rate_radps) = self.before(place, at);
        let (tight, mut gain) = tight_update::fuse(&mut state, &rate_radps, &frame);
        let fallback = if tight.is_fused { None } else { fallback(&state, &rate_radps) };
        let fallback = fallback.map(|fix| {
            let innovation = state.innovation_of(&fix.outcome, &fix.by_place);
            gain = fused(&mut state, &fix, &innovation).map(|boxed| *boxed);
            (fix, innovation)
        });
        let kept = FrameInput { frame, fallback: fallback.as_ref().map(|(fix, _)| fix.clone()) };
        let entry = Entry { input: Input::Frame(Box::new(kept)), state, gain: gain.map(Box::new) };
        self.put(place, entry);
        FrameInsertion::Placed(Box::new(FramePlaced { tight, fallback }))
    }

    /// Tells the filter that the vehicle stands at `at`, with this mean of the gyroscope.
    pub fn insert_standstill(&mut self, at: Stamp<Mono>, gyro_radps: Vector3<f64>) -> Insertion {
        match self.place_of(at) {
            Err(refusal) => refusal,
            Ok(place) => {
                let (mut state, _) = self.before(place, at);
                let (innovation, gain) = state.stand(&gyro_radps);
                let input = Input::Standstill(gyro_radps);
                self.put(place, Entry { input, state, gain: gain.map(Box::new) });
                Insertion::Placed(Box::new(innovation))
            }
        }
    }

    /// How far the newest inertial sample carries. Frames do not move this on: without samples
    /// nothing says how the vehicle moves.
    #[must_use]
    pub fn covered_until(&self) -> Stamp<Mono> {
        let is_imu = |entry: &&Entry| matches!(entry.input, Input::Imu(_));
        // A ring is made with a sample, and the newest one is never dropped before others.
        let last = self.entries.iter().rev().find(is_imu);
        last.map_or(self.oldest_at(), |entry| entry.state.at).plus(FUTURE_TOLERANCE)
    }

    /// Where an input of this time belongs, if it belongs at all.
    fn place_of(&self, at: Stamp<Mono>) -> Result<usize, Insertion> {
        if at < self.oldest_at() {
            Err(Insertion::TooOld)
        } else if at > self.covered_until() {
            Err(Insertion::FromTheFuture)
        } else {
            Ok(self.entries.partition_point(|entry| entry.state.at <= at))
        }
    }

    /// State and angular velocity (without its bias) at `at`, which lies before entry `place`.
    fn before(&self, place: usize, at: Stamp<Mono>) -> (FilterState, Vector3<f64>) {
        let Covered { imu, noise } = self.in_force(place);
        let state = self.entries[place - 1].state.propagated(&imu, at, &noise);
        let rate_radps = imu.gyro_radps - state.gyro_bias_radps;
        (state, rate_radps)
    }

    fn put(&mut self, place: usize, entry: Entry) {
        self.entries.insert(place, entry);
        self.recompute_from(place + 1);
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
            return Some((before.hall_from_body, before.pose_cov()));
        };
        let ratio = at.seconds_since(before.at) / after.at.seconds_since(before.at);
        let (a, b) = (&before.hall_from_body, &after.hall_from_body);
        let turn = b.rotation.minus(&a.rotation) * ratio;
        let origin = a.origin.coords.lerp(&b.origin.coords, ratio);
        let pose = Transform::new(a.rotation.perturbed(&turn), Point::from_coords(origin));
        Some((pose, after.pose_cov()))
    }

    /// The state at an instant inside the ring, propagated from the one before.
    #[must_use]
    pub fn state_at(&self, at: Stamp<Mono>) -> Option<FilterState> {
        self.motion_at(at).map(|(state, _)| state)
    }

    /// The state at an instant inside the ring, and the angular velocity without its bias there,
    /// body axes, rad/s.
    #[must_use]
    pub fn motion_at(&self, at: Stamp<Mono>) -> Option<(FilterState, Vector3<f64>)> {
        self.place_of(at).ok().map(|place| self.before(place, at))
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
        if to < from || to > self.covered_until() {
            return None;
        }
        let start = self.state_at(from)?;
        let first = self.entries.partition_point(|entry| entry.state.at <= from);
        let end = self.entries.partition_point(|entry| entry.state.at <= to);
        let mut before = &start;
        let mut A = Covariance::identity();
        for place in first..end {
            let entry = &self.entries[place];
            A = before.transition(&self.in_force(place).imu, entry.state.at).times(&A);
            if let Some(gain) = &entry.gain {
                gain.apply(&mut A);
            }
            before = &entry.state;
        }
        Some(before.transition(&self.in_force(end).imu, to).times(&A))
    }

    /// The noise of the time that a sample stands for: wider where samples are missing.
    ///
    /// A density `σ_a √T` integrates over the gap `T` to the velocity that a force `σ_a` gives
    /// in it.
    fn noise_over(&self, gap_s: f64) -> ImuNoise {
        if gap_s <= EVEN_GAP_S {
            return self.noise;
        }
        let share = ((gap_s - EVEN_GAP_S) / (UNSEEN_GAP_S - EVEN_GAP_S)).min(1.0);
        let root = share * gap_s.sqrt();
        ImuNoise {
            accel_density_mps2_rthz: self
                .noise
                .accel_density_mps2_rthz
                .hypot(UNSEEN_ACCEL_MPS2 * root),
            gyro_density_radps_rthz: self
                .noise
                .gyro_density_radps_rthz
                .hypot(UNSEEN_RATE_RADPS * root),
            ..self.noise
        }
    }

    /// The sample that covers the time just before entry `place`: the next one, else the last.
    fn in_force(&self, place: usize) -> Covered {
        let imu_of = |entry: &Entry| match &entry.input {
            Input::Imu(covered) => Some(*covered),
            _ => None,
        };
        let next = self.entries.range(place..).find_map(imu_of);
        next.or_else(|| self.entries.range(..place).rev().find_map(imu_of)).unwrap_or(Covered {
            // Not reached while the ring's first entry is an inertial sample; at rest is harmless.
            imu: ImuSample {
                at: self.newest().at,
                accel_mps2: Vector3::z() * crate::units::GRAVITY_MPS2,
                gyro_radps: Vector3::zeros(),
            },
            noise: self.noise,
        })
    }

    fn recompute_from(&mut self, first: usize) {
        for place in first..self.entries.len() {
            let (mut state, rate_radps) = self.before(place, self.entries[place].state.at);
            let entry = &mut self.entries[place];
            entry.gain = match &entry.input {
                Input::Imu(_) => None,
                Input::Fix(fix) => {
                    let innovation = state.innovation_of(&fix.outcome, &fix.by_place);
                    fused(&mut state, fix, &innovation)
                }
                Input::Frame(input) => judged_again(&mut state, &rate_radps, input),
                Input::Standstill(gyro_radps) => state.stand(gyro_radps).1.map(Box::new),
            };
            entry.state = state;
        }
    }
}

/// Fuses a frame of the ring once more: its points, or the fix that stands in for them.
fn judged_again(
    state: &mut FilterState,
    rate_radps: &Vector3<f64>,
    input: &FrameInput,
) -> Option<Box<Gain>> {
    let (_, gain) = tight_update::fuse(state, rate_radps, &input.frame);
    gain.map(Box::new).or_else(|| {
        let fix = input.fallback.as_ref()?;
        let innovation = state.innovation_of(&fix.outcome, &fix.by_place);
        fused(state, fix, &innovation)
    })
}

/// Fuses a fix within its gate.
fn fused(state: &mut FilterState, fix: &PlacedFix, innovation: &Innovation) -> Option<Box<Gain>> {
    let fuse = || state.fuse_placed(&fix.outcome, &fix.by_place, innovation).map(Box::new);
    innovation.is_within_gate().then(fuse).flatten()
}

#[cfg(test)]
mod tests;
