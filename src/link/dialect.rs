//! What differs between families of autopilots.
//!
//! | | PX4 | `ArduPilot` |
//! | --- | --- | --- |
//! | mode of the companion | OFFBOARD | GUIDED |
//! | setpoints before it | must stream | must not: on the ground they call the take-off off |
//! | a mode is acknowledged | twice, the second one counts | once |
//! | frame of ODOMETRY | `LOCAL_NED` | `LOCAL_FRD`, all others are dropped without a word |
//! | its pose covariance | one variance per axis | collapsed to one σ of place and one of attitude |
//! | a change of mode | `CURRENT_MODE` at once; HEARTBEAT stays at 1 Hz | HEARTBEAT at once, and at any rate |
//! | origin of the map | not needed; an altitude other than 0 makes it climb away | needed to arm |

mod ardupilot;
mod px4;

use crate::messages::{FlightMode, LandedState, TakeOff, VehicleCommand, VehicleState};
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavCmd, MavFrame, MavModeFlag, MavState, MavType,
};
use std::time::Duration;

/// A command as MAVLink carries it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WireCommand {
    pub(crate) command: MavCmd,
    /// Its seven parameters.
    pub(crate) params: [f32; 7],
    /// How long to wait for a second answer after a good first one; the second one counts.
    pub(crate) second_answer_within: Option<Duration>,
}

/// How a change of mode is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ModeStream {
    pub(crate) message_id: u32,
    /// What is asked for, Hz.
    pub(crate) rate_hz: f64,
    /// As many come at least while nothing changes, Hz.
    pub(crate) least_hz: f64,
}

/// How one family of autopilots speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dialect {
    /// PX4 flying a multicopter.
    Px4,
    /// `ArduPilot` flying a multicopter.
    ArduPilot,
}

impl Dialect {
    /// The family that a heartbeat shows; `None` if it is not spoken here.
    pub(crate) fn of(heartbeat: &HEARTBEAT_DATA) -> Option<Self> {
        match heartbeat.autopilot {
            // A plane or a rover would take what is meant for a copter; one of `ArduPilot` has the same
            // numbers for other modes.
            MavAutopilot::MAV_AUTOPILOT_PX4 if is_copter(heartbeat) => Some(Self::Px4),
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA if is_copter(heartbeat) => {
                Some(Self::ArduPilot)
            }
            _ => None,
        }
    }

    /// The state that a heartbeat tells; a rival on the link is the caller's to know.
    pub(crate) fn vehicle_state(
        self,
        heartbeat: &HEARTBEAT_DATA,
        landed: LandedState,
        at: Stamp<Mono>,
    ) -> VehicleState {
        VehicleState {
            at,
            is_armed: heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
            mode: self.flight_mode(heartbeat),
            landed,
            in_failsafe: is_in_failsafe(heartbeat),
            is_ready: self.is_ready(heartbeat),
            is_contested: false,
            is_mode_prompt: self.heartbeat_tells_mode(),
            takes_off: self.takes_off(),
        }
    }

    /// Who steers, by its heartbeat.
    pub(crate) fn flight_mode(self, heartbeat: &HEARTBEAT_DATA) -> FlightMode {
        match self {
            Self::Px4 => px4::flight_mode(heartbeat),
            Self::ArduPilot => ardupilot::flight_mode(heartbeat),
        }
    }

    /// The same by the number that `CURRENT_MODE` carries.
    pub(crate) const fn mode_numbered(self, custom_mode: u32) -> FlightMode {
        match self {
            Self::Px4 => px4::mode_numbered(custom_mode),
            Self::ArduPilot => ardupilot::mode_numbered(custom_mode),
        }
    }

    /// The stream that tells a change of mode soon.
    pub(crate) const fn mode_stream(self) -> ModeStream {
        match self {
            Self::Px4 => px4::MODE_STREAM,
            Self::ArduPilot => ardupilot::MODE_STREAM,
        }
    }

    /// A heartbeat leaves at once when the mode changes.
    pub(crate) const fn heartbeat_tells_mode(self) -> bool {
        matches!(self, Self::ArduPilot)
    }

    /// What to do where a serial line brings too few samples; for people.
    pub(crate) const fn thin_line_advice(self) -> &'static str {
        match self {
            Self::Px4 => {
                "too few inertial samples: raise baud or MAV_x_RATE of PX4's port (default: half the line)"
            }
            Self::ArduPilot => "too few inertial samples: raise the baud of the autopilot's port",
        }
    }

    /// Messages that come without being asked for and that nobody here reads.
    pub(crate) const fn unwanted_streams(self) -> &'static [u32] {
        match self {
            Self::Px4 => &px4::UNWANTED,
            // It sends nothing of the kind.
            Self::ArduPilot => &[],
        }
    }

    /// PX4 shows "not initialised" while the checks of its present mode fail, so only
    /// `ArduPilot`'s word counts.
    fn is_ready(self, heartbeat: &HEARTBEAT_DATA) -> bool {
        self == Self::Px4
            || !matches!(
                heartbeat.system_status,
                MavState::MAV_STATE_UNINIT
                    | MavState::MAV_STATE_BOOT
                    | MavState::MAV_STATE_CALIBRATING
            )
    }

    const fn takes_off(self) -> TakeOff {
        match self {
            Self::Px4 => TakeOff::BySetpoints,
            Self::ArduPilot => TakeOff::ByCommand,
        }
    }

    /// The message for a command; `None` if this family is not asked for it.
    pub(crate) fn wire_command(self, command: VehicleCommand) -> Option<WireCommand> {
        match self {
            Self::Px4 => px4::wire_command(command),
            Self::ArduPilot => Some(ardupilot::wire_command(command)),
        }
    }

    /// The frame in which ODOMETRY gives its pose; the numbers are the same in both.
    pub(crate) const fn odometry_frame(self) -> MavFrame {
        match self {
            Self::Px4 => MavFrame::MAV_FRAME_LOCAL_NED,
            Self::ArduPilot => MavFrame::MAV_FRAME_LOCAL_FRD,
        }
    }

    /// The upper triangle of ODOMETRY's pose covariance as this family reads it.
    pub(crate) fn pose_covariance(self, triangle: [f32; 21]) -> [f32; 21] {
        match self {
            Self::Px4 => triangle,
            Self::ArduPilot => ardupilot::collapsed(&triangle),
        }
    }

    /// True if it cannot arm without an origin of its map.
    pub(crate) const fn needs_origin(self) -> bool {
        matches!(self, Self::ArduPilot)
    }

    /// True if an origin above or below zero is dangerous and can be set again.
    ///
    /// PX4 v1.16.1 takes the origin's altitude for a height in its map when vision comes back after
    /// a gap, and climbs away.
    pub(crate) const fn needs_level_origin(self) -> bool {
        matches!(self, Self::Px4)
    }

    /// True if inertial samples may come as whole numbers only (`RAW_IMU`).
    pub(crate) const fn may_lack_highres_imu(self) -> bool {
        matches!(self, Self::ArduPilot)
    }
}

/// True for the kinds of vehicle that fly as a copter.
const fn is_copter(heartbeat: &HEARTBEAT_DATA) -> bool {
    matches!(
        heartbeat.mavtype,
        MavType::MAV_TYPE_QUADROTOR
            | MavType::MAV_TYPE_HEXAROTOR
            | MavType::MAV_TYPE_OCTOROTOR
            | MavType::MAV_TYPE_TRICOPTER
            | MavType::MAV_TYPE_DODECAROTOR
            | MavType::MAV_TYPE_DECAROTOR
            | MavType::MAV_TYPE_COAXIAL
            | MavType::MAV_TYPE_HELICOPTER
    )
}

fn is_in_failsafe(heartbeat: &HEARTBEAT_DATA) -> bool {
    matches!(
        heartbeat.system_status,
        MavState::MAV_STATE_CRITICAL
            | MavState::MAV_STATE_EMERGENCY
            | MavState::MAV_STATE_FLIGHT_TERMINATION
    )
}

/// Arms with 1, disarms with 0; the same for all.
const fn arm_disarm(param1: f32) -> WireCommand {
    WireCommand {
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        params: [param1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        second_answer_within: None,
    }
}

/// Changes the mode to a number of the family.
fn set_mode(main: u8, sub: u8, second_answer_within: Option<Duration>) -> WireCommand {
    let base = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
    WireCommand {
        command: MavCmd::MAV_CMD_DO_SET_MODE,
        params: [f32::from(base), f32::from(main), f32::from(sub), 0.0, 0.0, 0.0, 0.0],
        second_answer_within,
    }
}
