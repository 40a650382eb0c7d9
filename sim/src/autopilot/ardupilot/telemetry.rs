//! The messages of the streams; all but two come on request only.

use super::modes::ApMode;
use super::stub::StubArduPilot;
use crate::autopilot::frames::single;
use crate::autopilot::reports::{self, Felt, Health};
use crate::autopilot::streams::{Streams, id};
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;

/// Default rate of each stream, mHz.
const MILLIHZ: [(u32, u64); N_STREAMS] = [
    (id::HEARTBEAT, 1_000),
    (id::TIMESYNC, 100),
    (id::SYS_STATUS, 0),
    (id::SYSTEM_TIME, 0),
    (id::SCALED_IMU, 0),
    (id::RAW_IMU, 0),
    (id::ATTITUDE, 0),
    (id::ATTITUDE_QUATERNION, 0),
    (id::LOCAL_POSITION_NED, 0),
    (id::GLOBAL_POSITION_INT, 0),
    (id::GPS_GLOBAL_ORIGIN, 0),
    (id::POSITION_TARGET_LOCAL_NED, 0),
    (id::HIGHRES_IMU, 0),
    (id::BATTERY_STATUS, 0),
    (id::AUTOPILOT_VERSION, 0),
    (id::EKF_STATUS_REPORT, 0),
    (id::HOME_POSITION, 0),
    (id::EXTENDED_SYS_STATE, 0),
    (id::SIM_STATE, 0),
];

/// Number of streams.
pub(super) const N_STREAMS: usize = 19;

/// The streams of one link after a boot.
pub(super) fn streams() -> Streams {
    Streams::with(&MILLIHZ)
}

/// True for a message that the firmware can send.
pub(super) fn is_known(message_id: u32) -> bool {
    MILLIHZ.iter().any(|(id, _)| *id == message_id)
}

impl StubArduPilot {
    /// The message with this id as of now; `None` if there is nothing to say.
    pub(super) fn message(&self, message_id: u32) -> Option<MavMessage> {
        let boot_ms = reports::boot_ms(self.now);
        let boot_us = reports::boot_us(self.now);
        Some(match message_id {
            id::HEARTBEAT => self.heartbeat(),
            id::SYS_STATUS => self.sys_status(),
            id::SYSTEM_TIME => MavMessage::SYSTEM_TIME(m::SYSTEM_TIME_DATA {
                time_unix_usec: 0,
                time_boot_ms: boot_ms,
            }),
            id::ATTITUDE => reports::attitude(&self.belief, boot_ms),
            id::ATTITUDE_QUATERNION => reports::attitude_quaternion(&self.belief, boot_ms),
            // Not before the estimator has a place.
            id::LOCAL_POSITION_NED if self.belief.is_position_valid => {
                reports::local_position(&self.belief, boot_ms)
            }
            id::GLOBAL_POSITION_INT => self.global_position(boot_ms),
            id::GPS_GLOBAL_ORIGIN => MavMessage::GPS_GLOBAL_ORIGIN(self.origin.clone()?),
            id::POSITION_TARGET_LOCAL_NED if self.mode == ApMode::Guided => {
                self.position_target(boot_ms)
            }
            id::HIGHRES_IMU => self.felt().highres_imu(boot_us),
            id::RAW_IMU => self.felt().raw_imu(boot_us),
            id::TIMESYNC => MavMessage::TIMESYNC(m::TIMESYNC_DATA {
                tc1: 0,
                ts1: self.now.nanos(),
                ..m::TIMESYNC_DATA::DEFAULT
            }),
            id::BATTERY_STATUS => {
                let unknown = m::MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK;
                reports::battery_status(&self.sensors, unknown)
            }
            id::AUTOPILOT_VERSION => autopilot_version(),
            id::EKF_STATUS_REPORT => self.ekf_status(),
            id::HOME_POSITION => self.home_position()?,
            id::EXTENDED_SYS_STATE => self.extended_sys_state(),
            id::SIM_STATE => self.truth.clone()?,
            _ => return None,
        })
    }

    /// Bit 0x08 says that the position controller flies, 0x80 that the motors may turn.
    pub(super) fn heartbeat(&self) -> MavMessage {
        let guided = if self.mode.is_guided_bit() { 0x08 } else { 0 };
        let armed = if self.is_armed { 0x80 } else { 0 };
        let system_status = if !self.is_ready() {
            m::MavState::MAV_STATE_BOOT
        } else if self.is_in_failsafe {
            m::MavState::MAV_STATE_CRITICAL
        } else if self.is_armed && !self.landing.is_landed() {
            m::MavState::MAV_STATE_ACTIVE
        } else {
            m::MavState::MAV_STATE_STANDBY
        };
        MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
            custom_mode: self.mode.custom_mode(),
            mavtype: m::MavType::MAV_TYPE_QUADROTOR,
            autopilot: m::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode: m::MavModeFlag::from_bits_retain(0x51 | guided | armed),
            system_status,
            mavlink_version: 3,
        })
    }

    fn felt(&self) -> Felt {
        Felt {
            accel_frd_mps2: self.accel_frd_mps2,
            gyro_frd_radps: self.gyro_frd_radps,
            pressure_height_m: self.sensors.pressure_height_m,
        }
    }

    fn sys_status(&self) -> MavMessage {
        let health = Health {
            has_position: self.belief.is_position_valid,
            has_charge: true,
            is_armable: self.failing_checks(false).is_empty(),
        };
        reports::sys_status(&self.sensors, health)
    }

    /// Latitude and longitude are 0 before there is an origin.
    fn global_position(&self, boot_ms: u32) -> MavMessage {
        let nowhere = m::GPS_GLOBAL_ORIGIN_DATA::DEFAULT;
        match &self.origin {
            Some(origin) => reports::global_position(&self.belief, origin, &self.home_m, boot_ms),
            None => {
                let still =
                    crate::autopilot::estimator::Belief { position_m: self.home_m, ..self.belief };
                reports::global_position(&still, &nowhere, &self.home_m, boot_ms)
            }
        }
    }

    fn position_target(&self, time_boot_ms: u32) -> MavMessage {
        let (place, velocity, accel) = self.guided.flown();
        let [x, y, z] = <[f64; 3]>::from(*place).map(single);
        let [vx, vy, vz] = <[f64; 3]>::from(*velocity).map(single);
        let [afx, afy, afz] = <[f64; 3]>::from(*accel).map(single);
        MavMessage::POSITION_TARGET_LOCAL_NED(m::POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms,
            x,
            y,
            z,
            vx,
            vy,
            vz,
            afx,
            afy,
            afz,
            yaw: 0.0,
            yaw_rate: 0.0,
            type_mask: m::PositionTargetTypemask::from_bits_retain(3576),
            coordinate_frame: m::MavFrame::MAV_FRAME_LOCAL_NED,
        })
    }

    fn ekf_status(&self) -> MavMessage {
        let flags = m::EkfStatusFlags::from_bits_retain(self.ekf.status_flags());
        let variance = if self.ekf.has_lost_position() { 1.2 } else { 0.05 };
        MavMessage::EKF_STATUS_REPORT(m::EKF_STATUS_REPORT_DATA {
            velocity_variance: variance,
            pos_horiz_variance: variance,
            pos_vert_variance: 0.05,
            compass_variance: 0.0,
            terrain_alt_variance: 0.0,
            flags,
            ..m::EKF_STATUS_REPORT_DATA::DEFAULT
        })
    }

    fn home_position(&self) -> Option<MavMessage> {
        let origin = self.origin.as_ref().filter(|_| self.home_is_set)?;
        let [x, y, z] = <[f64; 3]>::from(self.home_m).map(single);
        Some(MavMessage::HOME_POSITION(m::HOME_POSITION_DATA {
            latitude: origin.latitude,
            longitude: origin.longitude,
            altitude: origin.altitude,
            x,
            y,
            z,
            q: [1.0, 0.0, 0.0, 0.0],
            ..m::HOME_POSITION_DATA::DEFAULT
        }))
    }

    fn extended_sys_state(&self) -> MavMessage {
        let is_taking_off = self.mode == ApMode::Guided && self.guided.is_taking_off(&self.belief);
        let landed_state = if self.landing.is_landed() {
            m::MavLandedState::MAV_LANDED_STATE_ON_GROUND
        } else if self.mode == ApMode::Land {
            m::MavLandedState::MAV_LANDED_STATE_LANDING
        } else if is_taking_off {
            m::MavLandedState::MAV_LANDED_STATE_TAKEOFF
        } else {
            m::MavLandedState::MAV_LANDED_STATE_IN_AIR
        };
        MavMessage::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
            vtol_state: m::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
            landed_state,
        })
    }
}

/// Capabilities 64495 hold the numeric parameters; version 4.7.0, for development.
fn autopilot_version() -> MavMessage {
    MavMessage::AUTOPILOT_VERSION(m::AUTOPILOT_VERSION_DATA {
        capabilities: m::MavProtocolCapability::from_bits_retain(64_495),
        uid: 0x4150_4d34,
        flight_sw_version: 0x0407_0000,
        ..m::AUTOPILOT_VERSION_DATA::DEFAULT
    })
}
