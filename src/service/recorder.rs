//! What the brain's task needs of a recorder.

use crate::messages::Declaration;
use crate::pilot::{Action, Event};
use crate::record;
use crate::time::{Mono, Stamp};

/// Keeps what the brain is told and what it wants. No call but the last may block.
pub trait Recorder: Send + 'static {
    /// Keeps what the brain is told at `at`, before the actions that follow from it.
    fn event(&mut self, at: Stamp<Mono>, event: &Event);

    /// Keeps what the brain wants.
    fn action(&mut self, at: Stamp<Mono>, action: &Action);

    /// Keeps what a person said at `at`, before the motors turned.
    fn declared(&mut self, at: Stamp<Mono>, said: &Declaration);

    /// Entries that could not be kept so far.
    fn lost(&self) -> u64;

    /// Writes out what waits and ends; gives [`Self::lost`] after that. May block.
    fn close(self: Box<Self>) -> u64;
}

/// Keeps nothing, and counts it: there is no log.
#[derive(Debug, Default)]
pub(super) struct NoLog {
    lost: u64,
}

impl Recorder for NoLog {
    fn event(&mut self, _at: Stamp<Mono>, _event: &Event) {
        self.lost += 1;
    }

    fn action(&mut self, _at: Stamp<Mono>, _action: &Action) {
        self.lost += 1;
    }

    fn declared(&mut self, _at: Stamp<Mono>, _said: &Declaration) {
        self.lost += 1;
    }

    fn lost(&self) -> u64 {
        self.lost
    }

    fn close(self: Box<Self>) -> u64 {
        self.lost
    }
}

impl Recorder for record::Recorder {
    fn event(&mut self, at: Stamp<Mono>, event: &Event) {
        Self::event(self, at, event);
    }

    fn action(&mut self, at: Stamp<Mono>, action: &Action) {
        Self::result(self, at, action);
    }

    fn declared(&mut self, at: Stamp<Mono>, said: &Declaration) {
        Self::declared(self, at, said);
    }

    fn lost(&self) -> u64 {
        let stats = self.stats();
        stats.lost_in_queue + stats.lost_on_disk
    }

    fn close(self: Box<Self>) -> u64 {
        let stats = Self::close(*self);
        stats.lost_in_queue + stats.lost_on_disk
    }
}
