//! What differs between families of autopilots.

mod px4;

pub(crate) use px4::Px4;

use crate::messages::{FlightMode, VehicleCommand};
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavCmd};
use std::time::Duration;

/// A command as MAVLink carries it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WireCommand {
    pub(crate) command: MavCmd,
    /// The first three parameters; the other four are 0.
    pub(crate) params: [f32; 3],
    /// How long to wait for a second answer after a good first one; the second one counts.
    pub(crate) second_answer_within: Option<Duration>,
}

/// How one family of autopilots speaks.
pub(crate) trait Dialect {
    /// What its heartbeat carries.
    const AUTOPILOT: MavAutopilot;

    /// Who steers, by its heartbeat.
    fn flight_mode(heartbeat: &HEARTBEAT_DATA) -> FlightMode;

    /// True if its heartbeat tells of an active failsafe.
    fn is_in_failsafe(heartbeat: &HEARTBEAT_DATA) -> bool;

    /// The message for a command.
    fn wire_command(command: VehicleCommand) -> WireCommand;
}
