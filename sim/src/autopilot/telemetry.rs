//! The messages of the streams.

use super::frames::{single, whole, wire_quaternion};
use super::modes::Px4Mode;
use super::streams::id;
use super::stub::StubPx4;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;

/// Metres per degree of latitude on the WGS 84 ellipsoid, near enough for a hall.
const M_PER_DEG: f64 = 111_319.49;

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
            id::ATTITUDE => self.attitude(),
            id::ATTITUDE_QUATERNION => self.attitude_quaternion(),
            id::LOCAL_POSITION_NED => self.local_position(),
            id::GLOBAL_POSITION_INT => self.global_position()?,
            id::GPS_GLOBAL_ORIGIN => self.origin_message()?,
            id::POSITION_TARGET_LOCAL_NED => self.position_target()?,
            id::HIGHRES_IMU => self.highres_imu(),
            id::TIMESYNC => MavMessage::TIMESYNC(m::TIMESYNC_DATA {
                tc1: 0,
                ts1: self.now.nanos(),
                ..m::TIMESYNC_DATA::DEFAULT
            }),
            id::BATTERY_STATUS => self.battery_status(),
            id::AUTOPILOT_VERSION => autopilot_version(),
            id::ESTIMATOR_STATUS => self.estimator_status(),
            id::HOME_POSITION => self.home_position()?,
            id::EXTENDED_SYS_STATE => self.extended_sys_state(),
            id::ODOMETRY => self.odometry(),
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

    fn sys_status(&self) -> MavMessage {
        let battery = &self.sensors;
        MavMessage::SYS_STATUS(m::SYS_STATUS_DATA {
            load: 300,
            voltage_battery: u16::try_from(whole(battery.battery_voltage_v * 1e3)).unwrap_or(0),
            current_battery: i16::try_from(whole(battery.battery_current_a * 1e2)).unwrap_or(-1),
            battery_remaining: percent(battery.battery_charge_ratio),
            ..m::SYS_STATUS_DATA::DEFAULT
        })
    }

    fn attitude(&self) -> MavMessage {
        let (roll, pitch, yaw) = self.belief.attitude.euler_angles();
        let rate = &self.belief.rate_radps;
        MavMessage::ATTITUDE(m::ATTITUDE_DATA {
            time_boot_ms: self.boot_ms(),
            roll: single(roll),
            pitch: single(pitch),
            yaw: single(yaw),
            rollspeed: single(rate.x),
            pitchspeed: single(rate.y),
            yawspeed: single(rate.z),
        })
    }

    fn attitude_quaternion(&self) -> MavMessage {
        let [q1, q2, q3, q4] = wire_quaternion(&self.belief.attitude);
        let rate = &self.belief.rate_radps;
        MavMessage::ATTITUDE_QUATERNION(m::ATTITUDE_QUATERNION_DATA {
            time_boot_ms: self.boot_ms(),
            q1,
            q2,
            q3,
            q4,
            rollspeed: single(rate.x),
            pitchspeed: single(rate.y),
            yawspeed: single(rate.z),
            repr_offset_q: [0.0; 4],
        })
    }

    fn local_position(&self) -> MavMessage {
        let [x, y, z] = <[f64; 3]>::from(self.belief.position_m).map(single);
        let [vx, vy, vz] = <[f64; 3]>::from(self.belief.velocity_mps).map(single);
        MavMessage::LOCAL_POSITION_NED(m::LOCAL_POSITION_NED_DATA {
            time_boot_ms: self.boot_ms(),
            x,
            y,
            z,
            vx,
            vy,
            vz,
        })
    }

    fn global_position(&self) -> Option<MavMessage> {
        let origin = self.origin.as_ref().filter(|_| self.facts().is_global_valid)?;
        let p = &self.belief.position_m;
        let latitude_deg = f64::from(origin.latitude) * 1e-7;
        let per_deg_east = M_PER_DEG * latitude_deg.to_radians().cos().max(1e-3);
        let alt_mm = f64::from(origin.altitude) - p.z * 1e3;
        let cmps = |v: f64| i16::try_from(whole(v * 1e2)).unwrap_or(0);
        let v = &self.belief.velocity_mps;
        let heading_cdeg = self.belief.yaw_rad.to_degrees().rem_euclid(360.0) * 1e2;
        Some(MavMessage::GLOBAL_POSITION_INT(m::GLOBAL_POSITION_INT_DATA {
            time_boot_ms: self.boot_ms(),
            lat: origin.latitude.saturating_add(small_int(p.x / M_PER_DEG * 1e7)),
            lon: origin.longitude.saturating_add(small_int(p.y / per_deg_east * 1e7)),
            alt: small_int(alt_mm),
            relative_alt: small_int((self.guidance.home_m().z - p.z) * 1e3),
            vx: cmps(v.x),
            vy: cmps(v.y),
            vz: cmps(v.z),
            hdg: u16::try_from(whole(heading_cdeg)).unwrap_or(u16::MAX),
        }))
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

    fn highres_imu(&self) -> MavMessage {
        let [xacc, yacc, zacc] = <[f64; 3]>::from(self.accel_frd_mps2).map(single);
        let [xgyro, ygyro, zgyro] = <[f64; 3]>::from(self.gyro_frd_radps).map(single);
        MavMessage::HIGHRES_IMU(m::HIGHRES_IMU_DATA {
            time_usec: self.boot_us(),
            xacc,
            yacc,
            zacc,
            xgyro,
            ygyro,
            zgyro,
            pressure_alt: single(self.sensors.pressure_height_m),
            abs_pressure: single(1013.25 - 0.12 * self.sensors.pressure_height_m),
            temperature: 35.0,
            // Accelerometer, gyroscope, absolute pressure, pressure altitude, temperature.
            fields_updated: m::HighresImuUpdatedFlags::from_bits_retain(0x1A3F),
            ..m::HIGHRES_IMU_DATA::DEFAULT
        })
    }

    fn battery_status(&self) -> MavMessage {
        let sensors = &self.sensors;
        let cell_mv = u16::try_from(whole(sensors.battery_voltage_v * 250.0)).unwrap_or(u16::MAX);
        let mut voltages = [u16::MAX; 10];
        voltages[..4].fill(cell_mv);
        MavMessage::BATTERY_STATUS(m::BATTERY_STATUS_DATA {
            current_consumed: -1,
            energy_consumed: -1,
            temperature: i16::MAX,
            voltages,
            current_battery: i16::try_from(whole(sensors.battery_current_a * 1e2)).unwrap_or(-1),
            battery_function: m::MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL,
            mavtype: m::MavBatteryType::MAV_BATTERY_TYPE_LIPO,
            battery_remaining: percent(sensors.battery_charge_ratio),
            charge_state: self.charge_state(),
            ..m::BATTERY_STATUS_DATA::DEFAULT
        })
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

    fn boot_ms(&self) -> u32 {
        // Wraps after 49.7 days, as on the wire.
        u32::try_from((self.now.nanos() / 1_000_000).rem_euclid(1 << 32)).unwrap_or(0)
    }

    fn boot_us(&self) -> u64 {
        u64::try_from(self.now.nanos() / 1_000).unwrap_or(0)
    }
}

fn small_int(value: f64) -> i32 {
    i32::try_from(whole(value)).unwrap_or(i32::MAX)
}

fn percent(ratio: f64) -> i8 {
    i8::try_from(whole((ratio * 100.0).clamp(0.0, 100.0))).unwrap_or(-1)
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
