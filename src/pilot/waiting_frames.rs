//! Frames that wait for the inertial samples of their instant.
//!
//! A camera on this computer's own bus can be faster than samples from an autopilot on a slow line. A frame
//! that is ahead of the samples cannot be fused yet; thrown away, every later one would be too, and
//! the place be lost although the tags are in sight.

use crate::localization::Localizer;
use crate::messages::TagDetections;
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// Later than this samples say too little of now to be worth the wait.
pub(super) const PATIENCE: Duration = Duration::from_millis(300);
/// One second of a fast camera: more come only from a clock that is wrong.
const MOST_WAITING: usize = 120;

/// Frames in the order of their arrival.
#[derive(Debug, Clone, Default)]
pub(super) struct WaitingFrames(VecDeque<TagDetections>);

impl WaitingFrames {
    /// Takes in a frame.
    pub(super) fn push(&mut self, frame: TagDetections) {
        self.0.push_back(frame);
    }

    /// A frame whose samples are there or will not come, whatever other cameras wait for.
    pub(super) fn pop(&mut self, now: Stamp<Mono>, localizer: &Localizer) -> Option<TagDetections> {
        if self.0.len() > MOST_WAITING {
            return self.0.pop_front();
        }
        let is_due = |frame: &TagDetections| {
            localizer.can_take(frame.captured_at)
                || now.since(frame.captured_at) > PATIENCE
                || frame.captured_at > now.plus(PATIENCE)
        };
        let due = self.0.iter().position(is_due)?;
        self.0.remove(due)
    }
}
