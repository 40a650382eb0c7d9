//! Long work that runs beside the brain and returns at a recorded place in the event order.

use crate::mapping::{SolveError, SolveSurface, SolvedSurface};
use crate::planning::planner::{Plan, PlanRequest};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Long work: a pure function of what it holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Job {
    /// Turn the cells into a surface and a volume.
    SolveSurface(SolveSurface),
    /// Choose waypoints.
    Plan(Box<PlanRequest>),
}

/// What a [`Job`] found.
#[derive(Debug, Clone, PartialEq)]
pub enum JobOutput {
    /// The surface and its volume.
    SurfaceSolved(Result<SolvedSurface, SolveError>),
    /// Waypoints.
    Planned(Plan),
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
            Self::Plan(work) => JobOutput::Planned(work.run()),
        }
    }
}
