//! What the brain is told, and what it wants done.

use super::job::{Job, JobOutput};
use crate::messages::{
    AutopilotPose, BatterySample, CommandOutcome, FixRecord, HeightMap, HitCounts, ImuSample,
    NavEstimate, OperatorAnswer, OperatorCommand, Scan, Setpoint, StatusText, StorageState,
    TagDetections, VehicleCommand, VehicleState, VolumeAccount, VolumeEstimate,
};
use crate::mission::Phase;
use crate::planning::Waypoint;
use crate::planning::planner::{PlanEnd, Prediction};
use crate::time::{Mono, Stamp};

/// Everything the brain learns. Numbers inside are finite: the edges refuse the rest.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The clock struck; comes at [`super::TICK_RATE_HZ`].
    Ticked(Stamp<Mono>),
    /// An inertial sample.
    Imu(ImuSample),
    /// Beams of the LiDAR.
    Scanned(Scan),
    /// Tags in a camera frame.
    TagsSeen(TagDetections),
    /// The autopilot's heartbeat or landed state.
    Vehicle(VehicleState),
    /// The flight battery.
    Battery(BatterySample),
    /// Where the autopilot believes to be.
    AutopilotPose(AutopilotPose),
    /// The autopilot answered a command.
    CommandAnswered(CommandOutcome),
    /// A person at the ground station asked for something.
    Operator(OperatorCommand),
    /// The autopilot has not been heard for too long.
    AutopilotLost(Stamp<Mono>),
    /// The autopilot has started anew: its clock fell back.
    AutopilotRebooted(Stamp<Mono>),
    /// The disk with the log was looked at and is not as before.
    StorageLooked(StorageState),
    /// A job that an earlier [`Action::Start`] began is done.
    Finished {
        /// When its result reached the brain.
        at: Stamp<Mono>,
        /// The job's number.
        id: JobId,
        /// What it found.
        output: Box<JobOutput>,
    },
}

/// Numbers the jobs since the brain's start from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct JobId(pub u64);

/// Everything the brain wants done or known, in order.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Send a setpoint to the autopilot.
    Steer(Setpoint),
    /// Send the own pose to the autopilot (ODOMETRY).
    PublishOdometry(Box<NavEstimate>),
    /// Send what frames show by themselves to the autopilot (ODOMETRY), while the own pose is not known.
    PublishSight(Box<NavEstimate>),
    /// Ask something of the autopilot.
    Command(VehicleCommand),
    /// Begin long work beside the brain; it comes back as [`Event::Finished`].
    Start {
        /// The job's number.
        id: JobId,
        /// What to compute.
        job: Box<Job>,
    },
    /// Tell the ground station and the log how much there is.
    ReportVolume(VolumeReport),
    /// Tell the people something.
    Say(StatusText),
    /// Answer a person's command.
    Answer(OperatorAnswer),
    /// The mission went to another phase (for the log and the heartbeat).
    PhaseChanged(PhaseChange),
    /// How a frame of tags was treated (for the log).
    FixTreated(Box<FixRecord>),
    /// A new surface (for the log).
    SurfaceSolved(Box<HeightMap>),
    /// The volumes of a new surface with the accounts of their uncertainty (for the log).
    VolumesAccounted(Vec<VolumeAccount>),
    /// The waypoints ahead are others than before (for the log and the displays).
    PlanChosen(Box<PlanChoice>),
    /// The flight is over: landed and disarmed with its final result, or aborted on the ground.
    Ended(Box<FlightSummary>),
}

/// The volume with what belongs beside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeReport {
    /// Volume, sigma, coverage.
    pub estimate: VolumeEstimate,
    /// Where the beams went so far.
    pub hits: HitCounts,
    /// Current mission phase.
    pub phase: Phase,
    /// Waypoints reached so far.
    pub steps_done: usize,
    /// State of charge, 0 to 1; `None` before the first battery message.
    pub battery_ratio: Option<f64>,
    /// Position-only quality of the fix: the largest position σ, m; `None` before the first fix.
    pub position_sigma_m: Option<f64>,
    /// This is the result after landing.
    pub is_final: bool,
}

/// A plan that was taken in.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanChoice {
    /// When.
    pub at: Stamp<Mono>,
    /// The waypoints that are flown to, the decided ones first.
    pub ahead: Vec<Waypoint>,
    /// Why it ends where it does.
    pub end: PlanEnd,
    /// What it is expected to lead to, from planners that know.
    pub prediction: Option<Prediction>,
}

/// One step of the mission machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhaseChange {
    /// When.
    pub at: Stamp<Mono>,
    /// Before.
    pub from: Phase,
    /// After.
    pub to: Phase,
    /// Why, for a person.
    pub reason: String,
}

/// What one flight came to.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightSummary {
    /// When it ended.
    pub at: Stamp<Mono>,
    /// The volume of the whole region after the last solve.
    pub volume: VolumeEstimate,
    /// The account of that volume, then those of the bays.
    pub accounts: Vec<VolumeAccount>,
    /// Where the beams went.
    pub hits: HitCounts,
    /// Waypoints whose time on the trajectory has passed.
    pub steps_done: usize,
    /// Length of the commanded path from take-off until the landing begins, m.
    pub path_length_m: f64,
    /// The survey ran to its end; false if it was cut short.
    pub is_complete: bool,
    /// The volume is that of the solve after landing. False if that failed: then it is an earlier one, or a
    /// bare sum over the cells, and its σ says nothing.
    pub is_final: bool,
}
