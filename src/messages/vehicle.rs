//! What the autopilot says, and what it is asked to do.

use crate::geometry::{Body, Direction, Hall, Point, Rotation};
use crate::time::{Mono, Stamp};

/// The flight mode shown by the autopilot, as far as the mission cares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FlightMode {
    /// Follows this companion's setpoints (PX4 OFFBOARD, ArduPilot GUIDED).
    Companion,
    /// Keeps its place by itself (PX4 AUTO.LOITER, ArduPilot LOITER or BRAKE).
    Hold,
    /// Lands where it is.
    Land,
    /// Climbs to its own take-off height.
    TakeOff,
    /// Flies home by itself.
    Return,
    /// A person steers (manual, stabilised, altitude, position).
    Pilot,
    /// Anything else; carries the autopilot's own number.
    Other(u32),
}

/// Where the vehicle is between ground and air, in the autopilot's judgement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LandedState {
    /// Not said.
    Unknown,
    /// On the ground.
    OnGround,
    /// Taking off.
    TakingOff,
    /// Flying.
    InAir,
    /// Landing.
    Landing,
}

/// How the autopilot comes off the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TakeOff {
    /// The companion's setpoints lift it (PX4).
    BySetpoints,
    /// A command lifts it to [`TAKE_OFF_HEIGHT_M`]; a setpoint on the ground would call the take-off
    /// off (ArduPilot).
    ByCommand,
}

/// Height over the ground to which [`VehicleCommand::TakeOff`] climbs, m.
pub const TAKE_OFF_HEIGHT_M: f64 = 1.0;

/// The autopilot's heartbeat and landed state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of one heartbeat")]
pub struct VehicleState {
    /// When it arrived.
    pub at: Stamp<Mono>,
    /// Motors may turn.
    pub is_armed: bool,
    /// Who steers.
    pub mode: FlightMode,
    /// Ground or air.
    pub landed: LandedState,
    /// The autopilot reports that a failsafe is active.
    pub in_failsafe: bool,
    /// The autopilot has started up; before that, ArduPilot says yes to a mode and forgets it.
    pub is_ready: bool,
    /// Another autopilot was heard on the link within the last ten seconds.
    pub is_contested: bool,
    /// A change of mode is told at once. Otherwise the heartbeat tells it, up to a second late.
    pub is_mode_prompt: bool,
    /// How it comes off the ground.
    pub takes_off: TakeOff,
}

/// The flight battery.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatterySample {
    /// When it arrived.
    pub at: Stamp<Mono>,
    /// Pack voltage, V.
    pub voltage_v: f64,
    /// Current drawn, A.
    pub current_a: f64,
    /// State of charge, 0 to 1.
    pub remaining_ratio: f64,
}

/// Position and velocity as the autopilot's own estimator sees them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AutopilotPose {
    /// When it was valid.
    pub at: Stamp<Mono>,
    /// Body origin in the hall.
    pub position: Point<Hall>,
    /// Velocity in hall axes, m/s.
    pub velocity_mps: Direction<Hall>,
    /// Attitude, where the autopilot sent it.
    pub hall_from_body_rot: Option<Rotation<Hall, Body>>,
}

/// What the companion asks of the autopilot; each is acknowledged by a [`CommandOutcome`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum VehicleCommand {
    /// Let the motors turn.
    Arm,
    /// Stop the motors; refused in the air.
    Disarm,
    /// Follow this companion's setpoints.
    EnterCompanionMode,
    /// Climb to [`TAKE_OFF_HEIGHT_M`] by itself, where [`TakeOff::ByCommand`] holds.
    TakeOff,
    /// Keep the place without the companion.
    EnterHold,
    /// Land where it is, without the companion.
    EnterLand,
}

/// The autopilot's answer to a [`VehicleCommand`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CommandOutcome {
    /// When the answer arrived or was given up on.
    pub at: Stamp<Mono>,
    /// What was asked.
    pub command: VehicleCommand,
    /// True if accepted; false if refused, or unanswered after all retries.
    pub is_accepted: bool,
}
