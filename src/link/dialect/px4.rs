//! PX4's mode numbers and its way to acknowledge.
//!
//! Source: PX4 v1.16 `px4_custom_mode.h`; observed on v1.16.1.

use super::{ModeStream, WireCommand, arm_disarm, set_mode};
use crate::messages::{FlightMode, VehicleCommand};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega as wire;
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavModeFlag};
use std::time::Duration;

const MAIN_MANUAL: u8 = 1;
const MAIN_ALTCTL: u8 = 2;
const MAIN_POSCTL: u8 = 3;
const MAIN_AUTO: u8 = 4;
const MAIN_ACRO: u8 = 5;
const MAIN_OFFBOARD: u8 = 6;
const MAIN_STABILIZED: u8 = 7;
const AUTO_TAKEOFF: u8 = 2;
const AUTO_LOITER: u8 = 3;
const AUTO_RTL: u8 = 5;
const AUTO_LAND: u8 = 6;

/// The link's answer comes at once, the commander's within a cycle; a slow serial line adds some
/// tens of milliseconds.
const SECOND_ANSWER_WITHIN: Duration = Duration::from_millis(300);

/// A change of mode.
///
/// `MavlinkReceiver::set_message_interval` refuses every other rate for HEARTBEAT than its 1 Hz.
/// `CURRENT_MODE` (from v1.15 on) leaves with each update of `vehicle_status`, which the commander
/// publishes at every change and otherwise twice a second; what is asked for bounds it from above.
/// The default of 0.5 Hz would let it come once in two seconds.
pub(super) const MODE_STREAM: ModeStream =
    ModeStream { message_id: wire::CURRENT_MODE_DATA::ID, rate_hz: 50.0, least_hz: 1.0 };

/// Streams of the Onboard mode, by what they take: `ATTITUDE` alone 4 kB/s.
///
/// Source: PX4 v1.16 `Mavlink::configure_streams_to_default`.
pub(super) const UNWANTED: [u32; 13] = [
    wire::ATTITUDE_DATA::ID,
    wire::ODOMETRY_DATA::ID,
    wire::GLOBAL_POSITION_INT_DATA::ID,
    wire::ATTITUDE_TARGET_DATA::ID,
    wire::POSITION_TARGET_LOCAL_NED_DATA::ID,
    wire::POSITION_TARGET_GLOBAL_INT_DATA::ID,
    wire::RC_CHANNELS_DATA::ID,
    wire::SERVO_OUTPUT_RAW_DATA::ID,
    wire::ALTITUDE_DATA::ID,
    wire::VFR_HUD_DATA::ID,
    wire::DISTANCE_SENSOR_DATA::ID,
    wire::NAV_CONTROLLER_OUTPUT_DATA::ID,
    wire::OPTICAL_FLOW_RAD_DATA::ID,
];

/// Who steers.
pub(super) fn flight_mode(heartbeat: &HEARTBEAT_DATA) -> FlightMode {
    if !heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) {
        return FlightMode::Other(heartbeat.custom_mode);
    }
    mode_numbered(heartbeat.custom_mode)
}

/// Who steers; `custom_mode` = main mode << 16 | sub mode << 24.
pub(super) const fn mode_numbered(custom_mode: u32) -> FlightMode {
    let [_, _, main, sub] = custom_mode.to_le_bytes();
    match (main, sub) {
        (MAIN_MANUAL | MAIN_ALTCTL | MAIN_POSCTL | MAIN_ACRO | MAIN_STABILIZED, _) => {
            FlightMode::Pilot
        }
        (MAIN_OFFBOARD, _) => FlightMode::Companion,
        (MAIN_AUTO, AUTO_TAKEOFF) => FlightMode::TakeOff,
        (MAIN_AUTO, AUTO_LOITER) => FlightMode::Hold,
        (MAIN_AUTO, AUTO_RTL) => FlightMode::Return,
        (MAIN_AUTO, AUTO_LAND) => FlightMode::Land,
        _ => FlightMode::Other(custom_mode),
    }
}

/// The message; `None` for the take-off, which setpoints do.
///
/// A mode is acknowledged twice: by the link, always well, and by the commander.
pub(super) fn wire_command(command: VehicleCommand) -> Option<WireCommand> {
    let mode = |main, sub| Some(set_mode(main, sub, Some(SECOND_ANSWER_WITHIN)));
    match command {
        VehicleCommand::Arm => Some(arm_disarm(1.0)),
        VehicleCommand::Disarm => Some(arm_disarm(0.0)),
        VehicleCommand::EnterCompanionMode => mode(MAIN_OFFBOARD, 0),
        VehicleCommand::EnterHold => mode(MAIN_AUTO, AUTO_LOITER),
        VehicleCommand::EnterLand => mode(MAIN_AUTO, AUTO_LAND),
        VehicleCommand::TakeOff => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heartbeat(base_mode: u8, custom_mode: u32) -> HEARTBEAT_DATA {
        HEARTBEAT_DATA {
            custom_mode,
            base_mode: MavModeFlag::from_bits_retain(base_mode),
            ..Default::default()
        }
    }

    #[test]
    fn modes_as_observed_on_the_running_autopilot() {
        for (base, custom, mode) in [
            (0x91, 0x0006_0000, FlightMode::Companion),
            (0x9d, 0x0304_0000, FlightMode::Hold),
            (0x9d, 0x0604_0000, FlightMode::Land),
            (0x1d, 0x0204_0000, FlightMode::TakeOff),
            (0x9d, 0x0504_0000, FlightMode::Return),
            (0xd1, 0x0003_0000, FlightMode::Pilot),
            (0x9d, 0x0404_0000, FlightMode::Other(0x0404_0000)),
            (0x91, 0x000a_0000, FlightMode::Other(0x000a_0000)),
            (0x90, 0x0006_0000, FlightMode::Other(0x0006_0000)),
        ] {
            assert_eq!(flight_mode(&heartbeat(base, custom)), mode, "{base:#x} {custom:#x}");
        }
    }
}
