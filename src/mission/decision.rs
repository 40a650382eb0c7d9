//! What a decision of the mission rests on, and what it leads to.

use super::Phase;
use crate::messages::{Severity, StorageState, VehicleCommand, VehicleState};
use crate::time::{Mono, Stamp};

/// Everything a decision rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of one instant")]
pub struct Inputs {
    /// The instant of the decision.
    pub now: Stamp<Mono>,
    /// The autopilot's last word on mode and arming.
    pub vehicle: Option<VehicleState>,
    /// The autopilot has been silent for too long.
    pub is_autopilot_lost: bool,
    /// The own pose can be flown on.
    pub has_position: bool,
    /// The autopilot's samples come late, and so does every ODOMETRY that it gets: it soon flies by
    /// dead reckoning.
    pub is_late: bool,
    /// The autopilot's inertial samples arrive, and their time is known.
    pub has_samples: bool,
    /// Beams arrive that measure something.
    pub has_lidar: bool,
    /// State of charge, 0 to 1.
    pub battery_ratio: Option<f64>,
    /// When the battery was heard of last.
    pub battery_heard_at: Option<Stamp<Mono>>,
    /// There is somewhere to fly.
    pub has_plan: bool,
    /// No waypoint is left.
    pub is_plan_done: bool,
    /// Every waypoint that was wished for is flown.
    pub is_plan_complete: bool,
    /// The last flight has left gaps in its map that can be flown to.
    pub has_gaps: bool,
    /// Heading of the body against that of the survey, rad; `None` without a pose.
    pub heading_error_rad: Option<f64>,
    /// Largest 1-σ of the own position, m.
    pub position_sigma_m: Option<f64>,
    /// Distance between where the autopilot and where the companion believes to be, m; `None`
    /// while one of them does not know.
    pub disagreement_m: Option<f64>,
    /// The autopilot's heading minus the own one, rad; `None` while one of them does not know.
    pub heading_disagreement_rad: Option<f64>,
    /// By how much the vehicle is nearer to walls, ceiling, obstacles, fence or material than its
    /// trajectory, beyond what is demanded there, m; 0 while it is not.
    pub intrusion_m: f64,
    /// How far the vehicle is from where its trajectory has it, m; `None` while one of them is not
    /// known as of now.
    pub off_track_m: Option<f64>,
    /// A vehicle that is held was so far, m, from where it was held that it is held where it is from
    /// now on.
    pub strayed_m: Option<f64>,
    /// Charge that the way home and the landing there will take, 0 to 1; `None` while unknown.
    pub way_home_ratio: Option<f64>,
    /// Height of the body over where the flight began, m; `None` without a pose.
    pub height_over_home_m: Option<f64>,
    /// The present trajectory has come to its end, wherever the vehicle is.
    pub is_trajectory_over: bool,
    /// The end of the present trajectory is reached.
    pub is_at_target: bool,
    /// The disk with the log; `None` where nobody looks at it.
    pub storage: Option<StorageState>,
}

/// What a decision leads to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Effect {
    /// Ask something of the autopilot.
    Command(VehicleCommand),
    /// The phase changed.
    Enter {
        /// Before.
        from: Phase,
        /// After.
        to: Phase,
        /// Why, for a person.
        reason: String,
    },
    /// The take-off by command is done: steer from where the vehicle is.
    Lifted,
    /// Tell the people.
    Say(Severity, String),
    /// The vehicle is on the ground and disarmed after a flight.
    Ended {
        /// The survey ran to its end.
        is_complete: bool,
    },
}
