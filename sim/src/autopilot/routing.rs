//! Messages in: which are for the autopilot, and which it passes from link to link.

#![expect(deprecated, reason = "PX4 v1.16 speaks SET_MODE and SET_GPS_GLOBAL_ORIGIN")]

use super::commands::Command;
use super::estimator::VisionSample;
use super::frames::quaternion_from_wire;
use super::outbox::Link;
use super::setpoint;
use super::stub::StubPx4;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, MavType};
use mavlink::types::CharArray;
use mavlink::{MavHeader, Message};
use nalgebra::{UnitQuaternion, Vector3};
use stockpilot::time::Stamp;

impl StubPx4 {
    /// Takes a message that came in on a link: passes it on and, if it is ours, obeys it.
    pub(super) fn receive(&mut self, link: Link, header: MavHeader, message: &MavMessage) {
        let system = message.target_system_id().unwrap_or(0);
        let component = message.target_component_id().unwrap_or(0);
        let is_for_us = system == 0 || (system == 1 && (component == 0 || component == 1));
        let is_only_for_us = system == 1 && component == 1;
        if !is_only_for_us && is_forwarded(message) {
            let other = if link == Link::Companion { Link::Ground } else { Link::Companion };
            self.outbox.pass_on(other, header, message.clone());
        }
        if is_for_us {
            self.obey(link, header, message);
        }
    }

    fn obey(&mut self, link: Link, header: MavHeader, message: &MavMessage) {
        match message {
            MavMessage::HEARTBEAT(data) => self.on_heartbeat(data),
            MavMessage::TIMESYNC(data) => self.on_timesync(link, data),
            MavMessage::ODOMETRY(data) => self.on_odometry(data),
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(data) => self.on_setpoint(data),
            MavMessage::COMMAND_LONG(data) => {
                self.on_command(&Command::long(header, link, data));
            }
            MavMessage::COMMAND_INT(data) => {
                self.on_command(&Command::int(header, link, data));
            }
            MavMessage::SET_MODE(data) => {
                self.on_command(&Command::set_mode(header, link, data.custom_mode));
            }
            MavMessage::SET_GPS_GLOBAL_ORIGIN(data) => self.on_origin(link, data),
            MavMessage::PARAM_REQUEST_READ(data) => self.on_param_read(link, data),
            MavMessage::PARAM_REQUEST_LIST(_) => self.param_list = Some((link, 0)),
            MavMessage::PARAM_SET(data) => self.on_param_set(link, data),
            _ => {}
        }
    }

    fn on_heartbeat(&mut self, data: &m::HEARTBEAT_DATA) {
        if data.mavtype == MavType::MAV_TYPE_ONBOARD_CONTROLLER {
            if self.is_companion_lost {
                let text = "Onboard controller regained";
                self.outbox.text(MavSeverity::MAV_SEVERITY_INFO, text);
            }
            self.companion_heard_at = Some(self.now);
            self.is_companion_lost = false;
        }
    }

    fn on_timesync(&mut self, link: Link, data: &m::TIMESYNC_DATA) {
        if data.tc1 == 0 {
            let answer = m::TIMESYNC_DATA {
                tc1: self.now.nanos(),
                ts1: data.ts1,
                ..m::TIMESYNC_DATA::DEFAULT
            };
            self.outbox.send(link, MavMessage::TIMESYNC(answer));
        } else if link == Link::Companion {
            self.timesync.on_answer(self.now, Stamp::from_nanos(data.ts1), data.tc1);
        }
    }

    fn on_setpoint(&mut self, data: &m::SET_POSITION_TARGET_LOCAL_NED_DATA) {
        match setpoint::from_message(data, &self.belief) {
            Ok(target) => self.setpoint = Some((target, self.now)),
            Err(text) => self.outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, &text),
        }
    }

    fn on_origin(&mut self, link: Link, data: &m::SET_GPS_GLOBAL_ORIGIN_DATA) {
        let origin = m::GPS_GLOBAL_ORIGIN_DATA {
            latitude: data.latitude,
            longitude: data.longitude,
            altitude: data.altitude,
            time_usec: 0,
        };
        self.origin = Some(origin.clone());
        self.outbox.send(link, MavMessage::GPS_GLOBAL_ORIGIN(origin));
    }

    fn on_odometry(&mut self, data: &m::ODOMETRY_DATA) {
        if !is_external_estimator(data.estimator_type) {
            let number = data.estimator_type as u32;
            let text = format!("ODOMETRY: estimator_type {number} unsupported");
            self.outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, &text);
            return;
        }
        let is_frame_known = matches!(
            data.frame_id,
            m::MavFrame::MAV_FRAME_LOCAL_NED | m::MavFrame::MAV_FRAME_LOCAL_FRD
        );
        let position_m = Vector3::new(data.x, data.y, data.z).map(f64::from);
        let Some(attitude) = quaternion_from_wire(&data.q) else { return };
        if !is_frame_known || !position_m.iter().all(|p| p.is_finite()) {
            return;
        }
        let variance = |index: usize| f64::from(data.pose_covariance[index]);
        let sample = VisionSample {
            at: self.timesync.stamp(self.now, data.time_usec),
            position_m,
            position_var_m2: Vector3::new(variance(0), variance(6), variance(11)),
            yaw_rad: attitude.euler_angles().2,
            yaw_var_rad2: variance(20),
            velocity: vision_velocity(data, &attitude),
            reset_counter: data.reset_counter,
            quality: data.quality,
            is_north_aligned: data.frame_id == m::MavFrame::MAV_FRAME_LOCAL_NED,
        };
        let altitude_m =
            self.origin.as_ref().map_or(0.0, |origin| f64::from(origin.altitude) * 1e-3);
        self.estimator.on_vision(&sample, &self.params, altitude_m);
    }

    fn on_param_read(&mut self, link: Link, data: &m::PARAM_REQUEST_READ_DATA) {
        let index = usize::try_from(data.param_index)
            .ok()
            .or_else(|| self.params.index_of(data.param_id.to_str().unwrap_or("")));
        if let Some(index) = index {
            self.send_param(link, index);
        }
    }

    /// A wrong type or an unknown name gets no answer at all.
    fn on_param_set(&mut self, link: Link, data: &m::PARAM_SET_DATA) {
        let name = data.param_id.to_str().unwrap_or("");
        let Some(old) = self.params.get(name) else { return };
        if old.wire_type() != data.param_type
            || !self.params.set(name, old.with_wire(data.param_value))
        {
            return;
        }
        if let Some(index) = self.params.index_of(name) {
            self.send_param(link, index);
        }
    }

    /// Sends the next of a list: every parameter, then PX4's `_HASH_CHECK`.
    pub(super) fn send_param_list(&mut self) {
        let Some((link, index)) = self.param_list else { return };
        if index < self.params.len() {
            self.send_param(link, index);
            self.param_list = Some((link, index + 1));
        } else {
            let check = m::PARAM_VALUE_DATA {
                param_value: f32::from_bits(0x5354_5542),
                param_count: self.param_count(),
                param_index: u16::MAX,
                param_id: CharArray::from("_HASH_CHECK"),
                param_type: m::MavParamType::MAV_PARAM_TYPE_UINT32,
            };
            self.outbox.send(link, MavMessage::PARAM_VALUE(check));
            self.param_list = None;
        }
    }

    fn send_param(&mut self, link: Link, index: usize) {
        let Some((name, value)) = self.params.at(index) else { return };
        let data = m::PARAM_VALUE_DATA {
            param_value: value.to_wire(),
            param_count: self.param_count(),
            param_index: u16::try_from(index).unwrap_or(u16::MAX),
            param_id: CharArray::from(name),
            param_type: value.wire_type(),
        };
        self.outbox.send(link, MavMessage::PARAM_VALUE(data));
    }

    fn param_count(&self) -> u16 {
        u16::try_from(self.params.len()).unwrap_or(u16::MAX)
    }
}

/// Messages of the link itself stay on it; a key in the clear goes nowhere.
pub(super) const fn is_forwarded(message: &MavMessage) -> bool {
    !matches!(
        message,
        MavMessage::TIMESYNC(_)
            | MavMessage::ODOMETRY(_)
            | MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)
            | MavMessage::SET_GPS_GLOBAL_ORIGIN(_)
            | MavMessage::SET_MODE(_)
            | MavMessage::SETUP_SIGNING(_)
    )
}

const fn is_external_estimator(estimator: m::MavEstimatorType) -> bool {
    matches!(
        estimator,
        m::MavEstimatorType::MAV_ESTIMATOR_TYPE_UNKNOWN
            | m::MavEstimatorType::MAV_ESTIMATOR_TYPE_NAIVE
            | m::MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION
            | m::MavEstimatorType::MAV_ESTIMATOR_TYPE_VIO
    )
}

/// Velocity and its variance in NED; given in FRD unless the child frame is a local one.
fn vision_velocity(
    data: &m::ODOMETRY_DATA,
    attitude: &UnitQuaternion<f64>,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let velocity = Vector3::new(data.vx, data.vy, data.vz).map(f64::from);
    let cov = &data.velocity_covariance;
    let var = Vector3::new(cov[0], cov[6], cov[11]).map(f64::from);
    if !velocity.iter().all(|v| v.is_finite()) {
        return None;
    }
    match data.child_frame_id {
        m::MavFrame::MAV_FRAME_BODY_FRD => {
            let turned = attitude.to_rotation_matrix().into_inner();
            let shares = turned.component_mul(&turned);
            Some((turned * velocity, shares * var))
        }
        m::MavFrame::MAV_FRAME_LOCAL_NED | m::MavFrame::MAV_FRAME_LOCAL_FRD => {
            Some((velocity, var))
        }
        _ => None,
    }
}
