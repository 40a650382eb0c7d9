//! Long work that runs beside the brain and returns at a recorded place in the event order.

use crate::mapping::{SolveError, SolveSurface, SolvedSurface};
use crate::planning::Waypoint;
use crate::planning::greedy::ChooseWaypoint;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Long work: a pure function of what it holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Job {
    /// Turn the cells into a surface and a volume.
    SolveSurface(SolveSurface),
    /// Choose the next waypoint.
    ChooseWaypoint(Box<ChooseWaypoint>),
}

/// What a [`Job`] found.
#[derive(Debug, Clone, PartialEq)]
pub enum JobOutput {
    /// The surface and its volume.
    SurfaceSolved(Result<SolvedSurface, SolveError>),
    /// The next waypoint; `None` if nothing feasible is in reach.
    WaypointChosen(Option<Waypoint>),
    /// The work broke off in a defect of the program.
    Died,
}

impl Job {
    /// Does the work. The same job gives the same bits on the same build.
    ///
    /// A panic inside becomes [`JobOutput::Died`]: the brain must learn that nothing will come.
    #[must_use]
    pub fn run(&self) -> JobOutput {
        catch_unwind(AssertUnwindSafe(|| self.work())).unwrap_or(JobOutput::Died)
    }

    fn work(&self) -> JobOutput {
        match self {
            Self::SolveSurface(work) => JobOutput::SurfaceSolved(work.run()),
            Self::ChooseWaypoint(work) => JobOutput::WaypointChosen(work.run()),
        }
    }
}
