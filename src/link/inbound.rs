//! Numbers of the autopilot, checked and turned to SI units, Hall and Body axes.
//!
//! Nothing here trusts the sender: a NaN, an infinity or a value that no such vehicle can have
//! makes the whole sample void.

use super::frames::{half_turned, hall_from_body_rot};
use crate::geometry::{Body, Direction, Hall, Point, Rotation};
use crate::messages::{BatterySample, LandedState, OperatorVerb};
use crate::time::{Boot, Mono, Stamp};
use crate::units::GRAVITY_MPS2;
use mavlink::dialects::ardupilotmega::{
    ATTITUDE_QUATERNION_DATA, BATTERY_STATUS_DATA, HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA,
    MavCmd, MavLandedState, RAW_IMU_DATA, SYS_STATUS_DATA,
};
use nalgebra::Vector3;

/// Twice the widest range of the inertial sensors in use (16 g and 2000 °/s).
const MAX_ACCEL_MPS2: f64 = 320.0;
const MAX_GYRO_RADPS: f64 = 70.0;
/// No hall is longer.
const MAX_POSITION_M: f64 = 10_000.0;
const MAX_SPEED_MPS: f64 = 100.0;
const MAX_VOLTAGE_V: f64 = 100.0;
/// Longer ago than any autopilot has been running: 10 years.
const MAX_BOOT_NS: i64 = 315_360_000 * 1_000_000_000;

/// The vector, unless a component is NaN or larger than `bound`.
fn bounded(x: f32, y: f32, z: f32, bound: f64) -> Option<Vector3<f64>> {
    let v = Vector3::new(f64::from(x), f64::from(y), f64::from(z));
    v.iter().all(|c| c.abs() <= bound).then_some(v)
}

/// The instant `micros` after the autopilot's boot.
pub(crate) fn boot_from_micros(micros: u64) -> Option<Stamp<Boot>> {
    let nanos = i64::try_from(micros).ok()?.checked_mul(1_000)?;
    (nanos <= MAX_BOOT_NS).then(|| Stamp::from_nanos(nanos))
}

/// The instant `nanos` after the autopilot's boot.
pub(crate) fn boot_from_nanos(nanos: i64) -> Option<Stamp<Boot>> {
    (0 < nanos && nanos <= MAX_BOOT_NS).then(|| Stamp::from_nanos(nanos))
}

/// Specific force (m/s²) and angular velocity (rad/s) in Body axes.
pub(crate) fn inertial(data: &HIGHRES_IMU_DATA) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let accel_frd = bounded(data.xacc, data.yacc, data.zacc, MAX_ACCEL_MPS2)?;
    let gyro_frd = bounded(data.xgyro, data.ygyro, data.zgyro, MAX_GYRO_RADPS)?;
    Some((half_turned(&accel_frd), half_turned(&gyro_frd)))
}

/// The same from whole numbers: thousandths of g and of rad/s, as `ArduPilot` sends them.
pub(crate) fn raw_inertial(data: &RAW_IMU_DATA) -> (Vector3<f64>, Vector3<f64>) {
    let accel = Vector3::new(data.xacc, data.yacc, data.zacc).map(f64::from);
    let gyro = Vector3::new(data.xgyro, data.ygyro, data.zgyro).map(f64::from);
    (half_turned(&(accel * (1e-3 * GRAVITY_MPS2))), half_turned(&(gyro * 1e-3)))
}

/// Position (m) and velocity (m/s) in the hall.
pub(crate) fn local_position(
    data: &LOCAL_POSITION_NED_DATA,
) -> Option<(Point<Hall>, Direction<Hall>)> {
    let position_ned = bounded(data.x, data.y, data.z, MAX_POSITION_M)?;
    let velocity_ned = bounded(data.vx, data.vy, data.vz, MAX_SPEED_MPS)?;
    Some((
        Point::from_coords(half_turned(&position_ned)),
        Direction::from_coords(half_turned(&velocity_ned)),
    ))
}

/// The attitude and its angular velocity in Body axes, rad/s; `None` if the quaternion is not finite
/// or not of unit length, or if the vehicle would spin.
pub(crate) fn attitude(
    data: &ATTITUDE_QUATERNION_DATA,
) -> Option<(Rotation<Hall, Body>, Vector3<f64>)> {
    let rate_frd = bounded(data.rollspeed, data.pitchspeed, data.yawspeed, MAX_GYRO_RADPS)?;
    let wxyz = [data.q1, data.q2, data.q3, data.q4].map(f64::from);
    let length = wxyz.iter().map(|c| c * c).sum::<f64>().sqrt();
    // Single precision leaves 1e-7; a sender that forgot to normalise is off by far more.
    let rotation = ((length - 1.0).abs() < 1e-2).then(|| hall_from_body_rot(wxyz))??;
    Some((rotation, half_turned(&rate_frd)))
}

/// The first battery; `None` if it says nothing or nothing credible.
///
/// MAVLink marks unknown cells and voltages by 65535, unknown current and charge by −1.
pub(crate) fn battery_status(data: &BATTERY_STATUS_DATA, at: Stamp<Mono>) -> Option<BatterySample> {
    let cells = data.voltages.iter().filter(|mv| **mv != u16::MAX);
    let ext_cells = data.voltages_ext.iter().filter(|mv| **mv != 0 && **mv != u16::MAX);
    let millivolts: u32 = cells.chain(ext_cells).map(|mv| u32::from(*mv)).sum();
    battery(millivolts, data.current_battery, data.battery_remaining, at)
}

/// The battery as `SYS_STATUS` sums it up.
pub(crate) fn sys_status_battery(data: &SYS_STATUS_DATA, at: Stamp<Mono>) -> Option<BatterySample> {
    let is_known = data.voltage_battery != u16::MAX;
    let millivolts = if is_known { u32::from(data.voltage_battery) } else { 0 };
    battery(millivolts, data.current_battery, data.battery_remaining, at)
}

fn battery(millivolts: u32, centiamps: i16, percent: i8, at: Stamp<Mono>) -> Option<BatterySample> {
    let voltage_v = f64::from(millivolts) * 1e-3;
    let is_credible = (0..=100).contains(&percent) && 0.0 < voltage_v && voltage_v < MAX_VOLTAGE_V;
    is_credible.then(|| BatterySample {
        at,
        voltage_v,
        current_a: f64::from(centiamps.max(0)) * 1e-2,
        remaining_ratio: f64::from(percent) * 1e-2,
    })
}

/// Ground or air.
pub(crate) const fn landed_state(state: MavLandedState) -> LandedState {
    match state {
        MavLandedState::MAV_LANDED_STATE_UNDEFINED => LandedState::Unknown,
        MavLandedState::MAV_LANDED_STATE_ON_GROUND => LandedState::OnGround,
        MavLandedState::MAV_LANDED_STATE_IN_AIR => LandedState::InAir,
        MavLandedState::MAV_LANDED_STATE_TAKEOFF => LandedState::TakingOff,
        MavLandedState::MAV_LANDED_STATE_LANDING => LandedState::Landing,
    }
}

/// What a person asks for, in the order of `MAV_CMD_USER_1` to `5`; a start with a 1 as its first
/// parameter flies into the gaps.
const VERBS: [(MavCmd, OperatorVerb); 5] = [
    (MavCmd::MAV_CMD_USER_1, OperatorVerb::Start),
    (MavCmd::MAV_CMD_USER_2, OperatorVerb::Hold),
    (MavCmd::MAV_CMD_USER_3, OperatorVerb::Resume),
    (MavCmd::MAV_CMD_USER_4, OperatorVerb::Return),
    (MavCmd::MAV_CMD_USER_5, OperatorVerb::Land),
];

/// A start with this as its first parameter flies into the gaps of the last survey.
const INTO_GAPS: f32 = 1.0;

/// The verb of a command with its first parameter; `None` if it is none of an operator's, or a start of
/// no known kind.
pub(crate) fn operator_verb(command: MavCmd, param1: f32) -> Option<OperatorVerb> {
    let verb = VERBS.iter().find(|(known, _)| *known == command).map(|(_, verb)| *verb)?;
    match verb {
        OperatorVerb::Start if (param1 - INTO_GAPS).abs() < f32::EPSILON => {
            Some(OperatorVerb::FlyGaps)
        }
        // Stations fill what is not used with zeros or NaN.
        OperatorVerb::Start if param1 != 0.0 && !param1.is_nan() => None,
        verb => Some(verb),
    }
}

/// The command of a verb.
pub(crate) fn operator_command(verb: OperatorVerb) -> MavCmd {
    let verb = if verb.is_start() { OperatorVerb::Start } else { verb };
    VERBS
        .iter()
        .find(|(_, known)| *known == verb)
        .map_or(MavCmd::MAV_CMD_USER_1, |(command, _)| *command)
}
