//! The recent past of the motion, for sensors that look back.

use super::rigid_body::MotionState;
use std::collections::VecDeque;
use stockpilot::time::{Mono, Stamp};

/// Entries kept: 0.64 s at one per 5 ms.
const N_KEPT: usize = 128;

/// Motion states in the order of time.
#[derive(Debug, Clone)]
pub(super) struct History {
    states: VecDeque<(Stamp<Mono>, MotionState)>,
}

impl History {
    pub(super) fn new() -> Self {
        Self { states: VecDeque::with_capacity(N_KEPT + 1) }
    }

    pub(super) fn push(&mut self, at: Stamp<Mono>, state: MotionState) {
        if self.states.len() == N_KEPT {
            self.states.pop_front();
        }
        self.states.push_back((at, state));
    }

    /// The state at `at`, interpolated towards `latest` after the last entry; `None` outside.
    pub(super) fn at(
        &self,
        at: Stamp<Mono>,
        latest: (Stamp<Mono>, &MotionState),
    ) -> Option<MotionState> {
        let next = self.states.partition_point(|(stamp, _)| *stamp <= at);
        let (before_at, before) = self.states.get(next.checked_sub(1)?)?;
        let (after_at, after) = self.states.get(next).map_or(latest, |(stamp, s)| (*stamp, s));
        if at > after_at {
            return None;
        }
        let span_s = after_at.seconds_since(*before_at);
        let share = if span_s > 0.0 { at.seconds_since(*before_at) / span_s } else { 0.0 };
        Some(between(before, after, share))
    }
}

/// Linear between two states that are 5 ms apart: at 10 m/s² that is 31 µm off at most.
fn between(before: &MotionState, after: &MotionState, share: f64) -> MotionState {
    MotionState {
        position_m: before.position_m.lerp(&after.position_m, share),
        attitude: before.attitude.nlerp(&after.attitude, share),
        velocity_mps: before.velocity_mps.lerp(&after.velocity_mps, share),
        rate_radps: before.rate_radps.lerp(&after.rate_radps, share),
    }
}
