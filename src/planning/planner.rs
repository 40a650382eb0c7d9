//! What every planner is asked, and what it answers.
//!
//! A planner is a pure function of its request, so a plan can be made beside the brain and again in
//! a replay. It is asked anew while the flight goes on; what is decided already ([`PlanRequest::pending`])
//! stands, and the answer takes the place of everything behind it.

use super::free_space::FreeSpace;
use super::greedy::Greedy;
use super::horizon::Horizon;
use super::square_wave::SquareWave;
use super::{PlannerKind, Settings, Waypoint};
use crate::geometry::{Hall, Point};
use crate::mapping::SolveSurface;
use crate::mapping::belief::CoarseField;
use crate::mapping::kalman_grid::KalmanGrid;
use crate::mapping::projection::LidarMount;
use crate::messages::VolumeEstimate;
use std::sync::Arc;

/// Chooses waypoints.
pub trait Planner {
    /// The waypoints behind the pending ones. The same request gives the same plan, bit for bit.
    fn plan(&self, request: &PlanRequest) -> Plan;
}

/// What is known of the surface when a plan is asked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Belief {
    /// The paper's cells.
    Grid {
        /// The cells.
        cells: Box<KalmanGrid>,
        /// Area of each that counts, m².
        areas_m2: Arc<[f64]>,
    },
    /// The map as it is, to be weighed on a coarse lattice.
    Field {
        /// The lattice.
        field: Arc<CoarseField>,
        /// The map.
        surface: Box<SolveSurface>,
    },
}

/// The work of making a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanRequest {
    /// What the planning knows before a flight.
    pub settings: Settings,
    /// The vehicle's place, then the waypoints that are decided; the plan goes on from the last.
    pub pending: Vec<Waypoint>,
    /// The rest of the present plan, behind the pending waypoints.
    pub current: Vec<Waypoint>,
    /// Most waypoints that may follow the pending ones.
    pub n_waypoints: usize,
    /// Most metres that may follow the last pending waypoint, the way home included; as many as there are
    /// if nothing limits them.
    pub longest_m: Option<f64>,
    /// Where the way home ends.
    pub over_home: Option<Point<Hall>>,
    /// Where a fix is good enough.
    pub free_space: Arc<FreeSpace>,
    /// The LiDAR.
    pub lidar: LidarMount,
    /// What is known of the surface.
    pub belief: Belief,
    /// The volume that σ^V is judged against, m³.
    pub volume_m3: f64,
    /// Variance of the volume that no flight changes, m⁶.
    pub constant_var_m6: f64,
    /// The newest account, which the coarse lattice's σ^V is held against.
    pub accounted: Option<VolumeEstimate>,
}

/// Why a plan ends where it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PlanEnd {
    /// It goes on: the planner will be asked again.
    Open,
    /// Everything that was wished for is in it.
    Complete,
    /// The target is reached at its end.
    Target,
    /// More metres would hardly make the volume surer.
    SmallGain,
    /// The battery, or the number of waypoints, allows no more.
    Budget,
    /// There is nowhere to go.
    NothingFree,
}

impl PlanEnd {
    /// For logs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Complete => "complete",
            Self::Target => "target",
            Self::SmallGain => "small_gain",
            Self::Budget => "budget",
            Self::NothingFree => "nothing_free",
        }
    }
}

/// What a plan is expected to lead to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// σ^V now, the pending waypoints not flown yet, m³.
    pub sigma_now_m3: f64,
    /// σ^V at the end of the plan, m³.
    pub sigma_end_m3: f64,
    /// Length of the plan behind the pending waypoints, m.
    pub length_m: f64,
}

/// Waypoints behind the pending ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Where to go, in order.
    pub waypoints: Vec<Waypoint>,
    /// Why it ends there.
    pub end: PlanEnd,
    /// What it is expected to lead to, from planners that know.
    pub prediction: Option<Prediction>,
}

impl Plan {
    /// Nothing to fly to.
    #[must_use]
    pub const fn nothing(end: PlanEnd) -> Self {
        Self { waypoints: Vec::new(), end, prediction: None }
    }
}

impl PlanRequest {
    /// Makes the plan by the configured planner; nothing if that is a program outside.
    #[must_use]
    pub fn run(&self) -> Plan {
        let planner = self.settings.planner.planner();
        planner.map_or(Plan::nothing(PlanEnd::NothingFree), |planner| planner.plan(self))
    }
}

impl PlannerKind {
    /// The planner of this kind; `None` for a program outside.
    #[must_use]
    pub fn planner(self) -> Option<&'static dyn Planner> {
        match self {
            Self::SquareWave => Some(&SquareWave),
            Self::Greedy => Some(&Greedy),
            Self::Horizon => Some(&Horizon),
            Self::External => None,
        }
    }
}
