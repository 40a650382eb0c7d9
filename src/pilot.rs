//! The brain: wires localisation, mapping, planning and mission, and owns their state.
//!
//! It does no I/O and never asks for the time: one [`Event`] goes in, [`Action`]s come out.

mod event;
mod job;

pub use event::{Action, Event, FlightSummary, JobId, PhaseChange, VolumeReport};
pub use job::{Job, JobOutput};

/// How often the brain wants [`Event::Ticked`], Hz. Odd ticks steer, even ones publish odometry.
pub const TICK_RATE_HZ: u32 = 60;

/// What the brain needs to know before a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {}

/// The brain.
#[derive(Debug)]
pub struct Pilot {}

impl Pilot {
    /// A brain on the ground, at rest.
    #[must_use]
    pub fn new(_settings: Settings) -> Self {
        Self {}
    }

    /// Takes in one event and appends what is to be done, in order, to `actions`.
    pub fn step(&mut self, _event: Event, _actions: &mut Vec<Action>) {}
}
