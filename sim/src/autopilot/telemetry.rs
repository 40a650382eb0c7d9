//! The messages of the streams.

use super::frames::{single, wire_quaternion};
use super::modes::Px4Mode;
use super::reports::{self, Health};
use super::streams::id;
use super::stub::StubPx4;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;

impl StubPx4 {
    /// The message with this id as of now; `None` if there is nothing to say.
    pub(super) fn message(&self, message_id: u32) -> Option<MavMessage> {
        Some(match message_id {
            id::HEARTBEAT => self.heartbeat(),
            id::SYS_STATUS => self.sys_status(),
            id::SYSTEM_TIME => MavMessage::SYSTEM_TIME(m::SYSTEM_TIME_DATA {
                time_unix_usec: 0,
                time_boot_ms: self.boot_ms(),
            }),
            id::ATTITUDE => reports::attitude(&self.belief, self.boot_ms()),
            id::ATTITUDE_QUATERNION => reports::attitude_quaternion(&self.belief, self.boot_ms()),
            id::LOCAL_POSITION_NED => reports::local_position(&self.belief, self.boot_ms()),
            id::GLOBAL_POSITION_INT => self.global_position()?,
            id::GPS_GLOBAL_ORIGIN => self.origin_message()?,
            id::POSITION_TARGET_LOCAL_NED => self.position_target()?,
            id::HIGHRES_IMU => self.felt().highres_imu(self.boot_us()),
            id::TIMESYNC => MavMessage::TIMESYNC(m::TIMESYNC_DATA {
                tc1: 0,
                ts1: self.now.nanos(),
                ..m::TIMESYNC_DATA::DEFAULT
            }),
            id::BATTERY_STATUS => reports::battery_status(&self.sensors, self.charge_state()),
            id::AUTOPILOT_VERSION => autopilot_version(),
            id::ESTIMATOR_STATUS => self.estimator_status(),
            id::HOME_POSITION => self.home_position()?,
            id::EXTENDED_SYS_STATE => self.extended_sys_state(),
            id::ODOMETRY => self.odometry(),
            id::CURRENT_MODE => self.current_mode(),
            id::HIL_STATE_QUATERNION => self.truth.clone()?,
            _ => return None,
        })
    }

    fn heartbeat(&self) -> MavMessage {
        let facts = self.facts();
        MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
            custom_mode: self.commander.active().custom_mode(),
            mavtype: m::MavType::MAV_TYPE_QUADROTOR,
            autopilot: m::MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode: self.commander.base_mode(&facts),
            system_status: self.commander.system_status(&facts),
            mavlink_version: 3,
        })
    }

    fn current_mode(&self) -> MavMessage {
        MavMessage::CURRENT_MODE(m::CURRENT_MODE_DATA {
            custom_mode: self.commander.active().custom_mode(),
            intended_custom_mode: self.commander.intended().custom_mode(),
            standard_mode: m::MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD,
        })
    }

    fn sys_status(&self) -> MavMessage {
        let facts = self.facts();
        let health = Health {
            has_position: facts.is_position_valid,
            has_charge: self.sensors.battery_charge_ratio >= self.params.real("BAT_CRIT_THR"),
            is_armable: facts.allow(self.commander.active()),
        };
        reports::sys_status(&self.sensors, health)
    }

    fn global_position(&self) -> Option<MavMessage> {
        let origin = self.origin.as_ref().filter(|_| self.facts().is_global_valid)?;
        Some(reports::global_position(&self.belief, origin, self.guidance.home_m(), self.boot_ms()))
    }

    fn origin_message(&self) -> Option<MavMessage> {
        self.origin.clone().map(MavMessage::GPS_GLOBAL_ORIGIN)
    }

    fn home_position(&self) -> Option<MavMessage> {
        let origin = self.origin.as_ref().filter(|_| self.facts().is_global_valid)?;
        let [x, y, z] = <[f64; 3]>::from(*self.guidance.home_m()).map(single);
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

    fn position_target(&self) -> Option<MavMessage> {
        let (target, _) = self.setpoint.filter(|_| {
            self.commander.is_armed() && self.commander.active() == Px4Mode::Offboard
        })?;
        let wire = |axis: Option<f64>| axis.map_or(f32::NAN, single);
        let [x, y, z] = target.position_m.map(wire);
        let [vx, vy, vz] = target.velocity_mps.map(wire);
        let [afx, afy, afz] = target.accel_mps2.map(wire);
        Some(MavMessage::POSITION_TARGET_LOCAL_NED(m::POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: self.boot_ms(),
            x,
            y,
            z,
            vx,
            vy,
            vz,
            afx,
            afy,
            afz,
            yaw: wire(target.yaw_rad),
            yaw_rate: wire(target.yaw_rate_radps),
            type_mask: m::PositionTargetTypemask::from_bits_retain(0),
            coordinate_frame: m::MavFrame::MAV_FRAME_LOCAL_NED,
        }))
    }

    fn charge_state(&self) -> m::MavBatteryChargeState {
        let charge = self.sensors.battery_charge_ratio;
        if charge < self.params.real("BAT_CRIT_THR") {
            m::MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_CRITICAL
        } else if charge < self.params.real("BAT_LOW_THR") {
            m::MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_LOW
        } else {
            m::MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK
        }
    }

    fn estimator_status(&self) -> MavMessage {
        let (horizontal_m, vertical_m) = self.estimator.position_sigma_m();
        MavMessage::ESTIMATOR_STATUS(m::ESTIMATOR_STATUS_DATA {
            time_usec: self.boot_us(),
            pos_horiz_accuracy: single(horizontal_m),
            pos_vert_accuracy: single(vertical_m),
            flags: m::EstimatorStatusFlags::from_bits_retain(self.estimator.status_flags()),
            ..m::ESTIMATOR_STATUS_DATA::DEFAULT
        })
    }

    fn extended_sys_state(&self) -> MavMessage {
        let landed_state = if self.landing.is_landed() {
            m::MavLandedState::MAV_LANDED_STATE_ON_GROUND
        } else if self.commander.active() == Px4Mode::Land {
            m::MavLandedState::MAV_LANDED_STATE_LANDING
        } else if self.commander.active() == Px4Mode::TakeOff && !self.guidance.is_climb_done() {
            m::MavLandedState::MAV_LANDED_STATE_TAKEOFF
        } else {
            m::MavLandedState::MAV_LANDED_STATE_IN_AIR
        };
        MavMessage::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
            vtol_state: m::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
            landed_state,
        })
    }

    fn odometry(&self) -> MavMessage {
        let belief = &self.belief;
        let [x, y, z] = <[f64; 3]>::from(belief.position_m).map(single);
        let [vx, vy, vz] = <[f64; 3]>::from(belief.velocity_mps).map(single);
        let mut pose_covariance = [f32::NAN; 21];
        let (horizontal_m, vertical_m) = self.estimator.position_sigma_m();
        pose_covariance[0] = single(0.5 * horizontal_m.powi(2));
        pose_covariance[6] = pose_covariance[0];
        pose_covariance[11] = single(vertical_m.powi(2));
        MavMessage::ODOMETRY(m::ODOMETRY_DATA {
            time_usec: self.boot_us(),
            x,
            y,
            z,
            q: wire_quaternion(&belief.attitude),
            vx,
            vy,
            vz,
            rollspeed: single(belief.rate_radps.x),
            pitchspeed: single(belief.rate_radps.y),
            yawspeed: single(belief.rate_radps.z),
            pose_covariance,
            velocity_covariance: [f32::NAN; 21],
            frame_id: m::MavFrame::MAV_FRAME_LOCAL_NED,
            child_frame_id: m::MavFrame::MAV_FRAME_LOCAL_NED,
            reset_counter: self.estimator.reset_counter(),
            estimator_type: m::MavEstimatorType::MAV_ESTIMATOR_TYPE_AUTOPILOT,
            quality: 0,
        })
    }

    fn felt(&self) -> reports::Felt {
        reports::Felt {
            accel_frd_mps2: self.accel_frd_mps2,
            gyro_frd_radps: self.gyro_frd_radps,
            pressure_height_m: self.sensors.pressure_height_m,
        }
    }

    fn boot_ms(&self) -> u32 {
        reports::boot_ms(self.now)
    }

    fn boot_us(&self) -> u64 {
        reports::boot_us(self.now)
    }
}

/// PX4 v1.16.1: capabilities 59647 hold the bytewise parameters.
fn autopilot_version() -> MavMessage {
    MavMessage::AUTOPILOT_VERSION(m::AUTOPILOT_VERSION_DATA {
        capabilities: m::MavProtocolCapability::from_bits_retain(59_647),
        uid: 0x5050_4958,
        flight_sw_version: 0x0110_01FF,
        ..m::AUTOPILOT_VERSION_DATA::DEFAULT
    })
}
