//! Long work that runs beside the brain and returns at a recorded place in the event order.

use crate::mapping::{SolveError, SolveSurface, SolvedSurface};
use crate::planning::PlannerKind;
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
    /// What a program outside chose, admitted, or why nothing of it is flown. It cannot be computed
    /// again: a log holds it as it is.
    PlannedOutside(Result<Plan, String>),
    /// The work broke off in a defect of the program.
    Died,
}

impl JobOutput {
    /// What a program outside found, if one was asked.
    #[must_use]
    pub const fn outside(&self) -> Option<&Result<Plan, String>> {
        match self {
            Self::PlannedOutside(found) => Some(found),
            Self::SurfaceSolved(_) | Self::Planned(_) | Self::Died => None,
        }
    }
}

impl Job {
    /// Does the work. The same job gives the same bits on the same build.
    ///
    /// What only a program outside can do ([`Self::outside`]) is not done here, and says so.
    ///
    /// A panic inside becomes [`JobOutput::Died`]: the brain must learn that nothing will come.
    #[must_use]
    pub fn run(&self) -> JobOutput {
        catch_unwind(AssertUnwindSafe(|| self.work())).unwrap_or(JobOutput::Died)
    }

    /// The plan that a program outside is to make, if this is one.
    #[must_use]
    pub fn outside(&self) -> Option<&PlanRequest> {
        match self {
            Self::Plan(work) if work.settings.planner == PlannerKind::External => Some(work),
            Self::Plan(_) | Self::SolveSurface(_) => None,
        }
    }

    fn work(&self) -> JobOutput {
        if self.outside().is_some() {
            return JobOutput::PlannedOutside(Err("no program can be asked here".to_owned()));
        }
        match self {
            Self::SolveSurface(work) => JobOutput::SurfaceSolved(work.run()),
            Self::Plan(work) => JobOutput::Planned(work.run()),
        }
    }
}
