//! `ArduCopter`'s mode numbers, its commands and its reading of ODOMETRY.
//!
//! Source: `ArduCopter` `mode.h`, `AP_VisualOdom_MAV.cpp`; observed on 4.7.0-dev of July 2025.

use super::{ModeStream, WireCommand, arm_disarm, set_mode};
use crate::messages::{FlightMode, TAKE_OFF_HEIGHT_M, VehicleCommand};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavCmd, MavModeFlag};

const STABILIZE: u32 = 0;
const ACRO: u32 = 1;
const ALT_HOLD: u32 = 2;
const GUIDED: u32 = 4;
const LOITER: u32 = 5;
const RTL: u32 = 6;
const LAND: u32 = 9;
const DRIFT: u32 = 11;
const SPORT: u32 = 13;
const POSHOLD: u32 = 16;
const BRAKE: u32 = 17;
const SMART_RTL: u32 = 21;
const FLOWHOLD: u32 = 22;

/// Numbers that go into `MAV_CMD_DO_SET_MODE`.
const GUIDED_BYTE: u8 = 4;
const LAND_BYTE: u8 = 9;
const BRAKE_BYTE: u8 = 17;

/// Indices of the variances of place and attitude in the upper triangle.
const PLACE: [usize; 3] = [0, 6, 11];
const ATTITUDE: [usize; 3] = [15, 18, 20];
const YAW: usize = 20;

/// A change of mode: a heartbeat leaves at once, and more often for the one that is lost.
pub(super) const MODE_STREAM: ModeStream =
    ModeStream { message_id: HEARTBEAT_DATA::ID, rate_hz: 30.0, least_hz: 15.0 };

/// Who steers.
pub(super) fn flight_mode(heartbeat: &HEARTBEAT_DATA) -> FlightMode {
    if !heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) {
        return FlightMode::Other(heartbeat.custom_mode);
    }
    mode_numbered(heartbeat.custom_mode)
}

/// Who steers; LOITER is the pilot's here, since sticks move the vehicle in it.
pub(super) const fn mode_numbered(custom_mode: u32) -> FlightMode {
    match custom_mode {
        GUIDED => FlightMode::Companion,
        STABILIZE | ACRO | ALT_HOLD | LOITER | DRIFT | SPORT | POSHOLD | FLOWHOLD => {
            FlightMode::Pilot
        }
        RTL | SMART_RTL => FlightMode::Return,
        LAND => FlightMode::Land,
        BRAKE => FlightMode::Hold,
        other => FlightMode::Other(other),
    }
}

/// The message; every one is acknowledged once.
pub(super) fn wire_command(command: VehicleCommand) -> WireCommand {
    match command {
        VehicleCommand::Arm => arm_disarm(1.0),
        VehicleCommand::Disarm => arm_disarm(0.0),
        VehicleCommand::EnterCompanionMode => set_mode(GUIDED_BYTE, 0, None),
        VehicleCommand::EnterHold => set_mode(BRAKE_BYTE, 0, None),
        VehicleCommand::EnterLand => set_mode(LAND_BYTE, 0, None),
        VehicleCommand::TakeOff => take_off(),
    }
}

/// `MAV_CMD_NAV_TAKEOFF`; its seventh parameter is the height above home, where it was armed.
#[expect(clippy::cast_possible_truncation, reason = "a small constant")]
const fn take_off() -> WireCommand {
    WireCommand {
        command: MavCmd::MAV_CMD_NAV_TAKEOFF,
        params: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, TAKE_OFF_HEIGHT_M as f32],
        second_answer_within: None,
    }
}

/// The covariance that `ArduPilot` reads as it is meant.
///
/// ```text
/// it reads     σ_p = √(P₀ + P₆ + P₁₁),   σ_θ = √(P₁₅ + P₁₈ + P₂₀)
/// it is sent   P₀ = P₆ = P₁₁ = σ_p²/3 with σ_p the largest of the place,
///              P₁₅ = P₁₈ = P₂₀ = σ_θ²/3 with σ_θ that of the heading
/// ```
/// It takes the first for each axis of the place and the second for the heading, the only angle
/// that it fuses.
/// All numbers stay finite: it tests the first one only and takes a later NaN for a fault of its
/// own.
pub(super) fn collapsed(triangle: &[f32; 21]) -> [f32; 21] {
    let largest_m2 = PLACE.map(|index| triangle[index]).into_iter().fold(0.0, f32::max);
    let mut collapsed = [0.0; 21];
    for index in PLACE {
        collapsed[index] = largest_m2 / 3.0;
    }
    for index in ATTITUDE {
        collapsed[index] = triangle[YAW] / 3.0;
    }
    collapsed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_as_observed_on_the_running_autopilot() {
        for (base, custom_mode, mode) in [
            (0x51, 0, FlightMode::Pilot),
            (0xd9, 4, FlightMode::Companion),
            (0x59, 4, FlightMode::Companion),
            (0xd9, 5, FlightMode::Pilot),
            (0xd9, 6, FlightMode::Return),
            (0xd9, 9, FlightMode::Land),
            (0xd9, 17, FlightMode::Hold),
            (0xd9, 3, FlightMode::Other(3)),
            (0xd9, 20, FlightMode::Other(20)),
            (0x80, 4, FlightMode::Other(4)),
        ] {
            let heartbeat = HEARTBEAT_DATA {
                custom_mode,
                base_mode: MavModeFlag::from_bits_retain(base),
                ..Default::default()
            };
            assert_eq!(flight_mode(&heartbeat), mode, "{base:#x} {custom_mode}");
        }
    }

    #[test]
    fn the_collapsed_covariance_is_read_as_the_largest_sigma() {
        let mut triangle = [0.5; 21];
        for (index, variance) in PLACE.into_iter().zip([0.01, 0.09, 0.04]) {
            triangle[index] = variance;
        }
        for (index, variance) in ATTITUDE.into_iter().zip([0.2, 0.3, 0.0004]) {
            triangle[index] = variance;
        }
        let sent = collapsed(&triangle);
        let read = |indices: [usize; 3]| indices.map(|i| sent[i]).iter().sum::<f32>().sqrt();
        assert!((read(PLACE) - 0.3).abs() < 1e-6, "the largest of 0.1, 0.3 and 0.2 m");
        assert!((read(ATTITUDE) - 0.02).abs() < 1e-6, "the heading's σ");
        assert!(sent.iter().all(|value| value.is_finite()));
    }

    #[test]
    fn the_take_off_is_a_command_with_a_height_above_home() {
        let wire = wire_command(VehicleCommand::TakeOff);
        assert_eq!(wire.command, MavCmd::MAV_CMD_NAV_TAKEOFF);
        assert!((wire.params[6] - 1.0).abs() < 1e-6);
        assert_eq!(wire.second_answer_within, None);
    }
}
