//! Messages in: which are for the autopilot, and which it passes from link to link.

#![expect(deprecated, reason = "the firmware speaks SET_MODE and SET_GPS_GLOBAL_ORIGIN")]

use super::commands::Command;
use super::setpoint;
use super::stub::StubArduPilot;
use super::telemetry;
use crate::autopilot::estimator::NavSample;
use crate::autopilot::frames::quaternion_from_wire;
use crate::autopilot::outbox::Link;
use crate::autopilot::routing::is_forwarded;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::types::CharArray;
use mavlink::{MavHeader, Message};
use nalgebra::Vector3;
use std::time::Duration;

impl StubArduPilot {
    /// Takes a message that came in on a link.
    ///
    /// A command to a component of the own system that was never heard is obeyed by the autopilot
    /// itself: it knows nobody to pass it to.
    pub(super) fn receive(&mut self, link: Link, header: MavHeader, message: &MavMessage) {
        let system = message.target_system_id().unwrap_or(0);
        let component = message.target_component_id().unwrap_or(0);
        self.seen.insert((header.system_id, header.component_id));
        let is_seen = self.seen.contains(&(u32::from(system), component));
        let is_for_us =
            system == 0 || (system == 1 && (component == 0 || component == 1 || !is_seen));
        let is_only_for_us = system == 1 && (component == 1 || (component != 0 && !is_seen));
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
            MavMessage::TIMESYNC(data) if data.tc1 == 0 => {
                let answer = m::TIMESYNC_DATA {
                    tc1: self.now.nanos(),
                    ts1: data.ts1,
                    ..m::TIMESYNC_DATA::DEFAULT
                };
                self.outbox.send(link, MavMessage::TIMESYNC(answer));
            }
            MavMessage::ODOMETRY(data) => self.on_odometry(data),
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(data)
                if self.mode == super::ApMode::Guided =>
            {
                let wish = setpoint::wish(data, &self.belief);
                let belief = self.belief;
                self.guided.take(self.now, &wish, &belief);
            }
            MavMessage::COMMAND_LONG(data) => self.on_command(&Command::long(header, link, data)),
            MavMessage::COMMAND_INT(data) => self.on_command(&Command::int(header, link, data)),
            MavMessage::SET_MODE(data) => {
                self.switch_to_number(data.custom_mode);
            }
            MavMessage::REQUEST_DATA_STREAM(data) => self.on_data_stream(link, data),
            MavMessage::SET_GPS_GLOBAL_ORIGIN(data) => {
                let origin = m::GPS_GLOBAL_ORIGIN_DATA {
                    latitude: data.latitude,
                    longitude: data.longitude,
                    altitude: data.altitude,
                    time_usec: 0,
                };
                self.set_origin(link, origin);
            }
            MavMessage::PARAM_REQUEST_READ(data) => self.on_param_read(link, data),
            MavMessage::PARAM_REQUEST_LIST(_) => self.param_list = Some((link, 0)),
            MavMessage::PARAM_SET(data) => self.on_param_set(link, data),
            _ => {}
        }
    }

    /// Stream 0 is all of them, and overrides what was asked for one by one.
    fn on_data_stream(&mut self, link: Link, data: &m::REQUEST_DATA_STREAM_DATA) {
        let streams = match link {
            Link::Companion => &mut self.companion_streams,
            Link::Ground => &mut self.ground_streams,
        };
        if data.req_stream_id == m::MavDataStream::MAV_DATA_STREAM_ALL {
            let is_on = data.start_stop == 1 && data.req_message_rate > 0;
            let every = Duration::from_secs(1).checked_div(u32::from(data.req_message_rate));
            streams.set_all(every.filter(|_| is_on));
            streams.set_interval(crate::autopilot::streams::id::HEARTBEAT, 1_000_000);
        }
    }

    /// Only `LOCAL_FRD` with `BODY_FRD` counts; everything else is dropped without a word.
    fn on_odometry(&mut self, data: &m::ODOMETRY_DATA) {
        let is_read = data.frame_id == m::MavFrame::MAV_FRAME_LOCAL_FRD
            && data.child_frame_id == m::MavFrame::MAV_FRAME_BODY_FRD
            && self.params.is("VISO_TYPE", 1);
        let quality = f64::from(data.quality);
        let is_good = data.quality != -1 && quality >= self.params.real("VISO_QUAL_MIN");
        let position_m = Vector3::new(data.x, data.y, data.z).map(f64::from);
        let Some(attitude) = quaternion_from_wire(&data.q) else { return };
        if !is_read || !is_good || !position_m.iter().all(|p| p.is_finite()) {
            return;
        }
        let sum = |indices: [usize; 3]| -> f64 {
            indices.iter().map(|&index| f64::from(data.pose_covariance[index])).sum()
        };
        // Only the first variance is looked at; a NaN behind it leaves the middle of the bounds.
        let has_covariance = !data.pose_covariance[0].is_nan();
        let sigma = |indices, low: f64, high: f64| {
            let sigma = if has_covariance { sum(indices).sqrt() } else { 0.0 };
            if sigma.is_nan() { f64::midpoint(low, high) } else { sigma.clamp(low, high) }
        };
        let velocity = Vector3::new(data.vx, data.vy, data.vz).map(f64::from);
        let delay = Duration::from_secs_f64(self.params.real("VISO_DELAY_MS").max(0.0) * 1e-3);
        let sample = NavSample {
            at: self.jitter.stamp(self.now, data.time_usec).minus(delay),
            position_m,
            position_sigma_m: sigma([0, 6, 11], self.params.real("VISO_POS_M_NSE"), 100.0),
            yaw_rad: attitude.euler_angles().2,
            yaw_sigma_rad: sigma([15, 18, 20], self.params.real("VISO_YAW_M_NSE"), 1.5),
            velocity_mps: velocity.iter().all(|v| v.is_finite()).then(|| attitude * velocity),
            reset_counter: data.reset_counter,
        };
        self.ekf.on_odometry(&sample, &self.params);
    }

    /// By name the answer carries no index.
    fn on_param_read(&mut self, link: Link, data: &m::PARAM_REQUEST_READ_DATA) {
        if let Ok(index) = usize::try_from(data.param_index) {
            self.send_param(link, index, u16::try_from(index).unwrap_or(u16::MAX));
        } else if let Some(index) = self.params.index_of(data.param_id.to_str().unwrap_or("")) {
            self.send_param(link, index, u16::MAX);
        }
    }

    /// An unknown name gets no answer at all; the type that the message names is not looked at.
    fn on_param_set(&mut self, link: Link, data: &m::PARAM_SET_DATA) {
        let name = data.param_id.to_str().unwrap_or("");
        let Some(index) = self.params.index_of(name) else { return };
        if self.params.set(name, data.param_value) {
            self.send_param(link, index, u16::MAX);
        }
    }

    /// Sends the next of a list.
    pub(super) fn send_param_list(&mut self) {
        let Some((link, index)) = self.param_list else { return };
        self.send_param(link, index, u16::try_from(index).unwrap_or(u16::MAX));
        self.param_list = (index + 1 < self.params.len()).then_some((link, index + 1));
    }

    fn send_param(&mut self, link: Link, index: usize, param_index: u16) {
        let Some((name, kind, value)) = self.params.at(index) else { return };
        let data = m::PARAM_VALUE_DATA {
            param_value: value,
            param_count: u16::try_from(self.params.len()).unwrap_or(u16::MAX),
            param_index,
            param_id: CharArray::from(name),
            param_type: kind.wire_type(),
        };
        self.outbox.send(link, MavMessage::PARAM_VALUE(data));
    }

    /// Sends what is due on each link.
    pub(super) fn send_streams(&mut self) {
        for link in [Link::Companion, Link::Ground] {
            if self.heartbeat_is_due {
                let heartbeat = self.heartbeat();
                self.outbox.send(link, heartbeat);
            }
            let streams = match link {
                Link::Companion => &mut self.companion_streams,
                Link::Ground => &mut self.ground_streams,
            };
            let mut due = Vec::with_capacity(telemetry::N_STREAMS);
            streams.poll(self.now, |id| {
                due.push(id);
                true
            });
            for message in due.into_iter().filter_map(|id| self.message(id)).collect::<Vec<_>>() {
                self.outbox.send(link, message);
            }
        }
        self.heartbeat_is_due = false;
    }
}
