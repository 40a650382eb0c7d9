//! A brain that takes in the events of a log again.

use super::entry::RecordedEvent;
use crate::pilot::{Action, Event, Job, JobId, Pilot};
use std::collections::BTreeMap;

/// The brain and the jobs that it has begun.
pub(super) struct Refly {
    pilot: Pilot,
    jobs: BTreeMap<JobId, Box<Job>>,
}

impl Refly {
    pub(super) const fn new(pilot: Pilot) -> Self {
        Self { pilot, jobs: BTreeMap::new() }
    }

    /// What the brain was told; `None` for the end of a job that this build has not begun: another
    /// build's log.
    pub(super) fn event(&mut self, recorded: RecordedEvent) -> Option<Event> {
        recorded.for_brain(|id| self.jobs.remove(&id))
    }

    pub(super) fn step(&mut self, event: Event) {
        let mut actions = Vec::new();
        self.pilot.step(event, &mut actions);
        for action in actions {
            if let Action::Start { id, job } = action {
                self.jobs.insert(id, job);
            }
        }
    }

    pub(super) const fn pilot(&self) -> &Pilot {
        &self.pilot
    }
}
