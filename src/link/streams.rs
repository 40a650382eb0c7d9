//! Asks the autopilot for the messages that are needed, and again when they stay away.

use super::dialect::Dialect;
use super::stats::LinkStats;
use super::{AUTOPILOT_COMPONENT, Settings};
use crate::time::{Mono, Stamp};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    ATTITUDE_QUATERNION_DATA, BATTERY_STATUS_DATA, COMMAND_LONG_DATA, EXTENDED_SYS_STATE_DATA,
    HEARTBEAT_DATA, HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA, MavCmd, MavMessage, RAW_IMU_DATA,
};
use std::time::Duration;

/// How long arrivals are counted before they are judged.
const WATCH_WINDOW: Duration = Duration::from_secs(2);
/// A stream slower than this share of what was asked for is asked for again. PX4 delivers its
/// inertial samples at 160 to 182 Hz when 200 are asked for.
const ENOUGH_RATIO: f64 = 0.5;
/// Windows without a single inertial sample after which the other message for them is tried.
const SILENT_WINDOWS: u8 = 2;
/// The mode comes with the heartbeat: at the usual 1 Hz, setpoints would outlive the pilot's mode
/// switch by up to a second.
const MODE_RATE_HZ: f64 = 30.0;

/// The streams and how they flow.
#[derive(Debug, Clone)]
pub(crate) struct Streams {
    streams: Vec<Stream>,
    judged_at: Option<Stamp<Mono>>,
    /// Windows in a row without any inertial sample.
    imu_silent: u8,
}

#[derive(Debug, Clone)]
struct Stream {
    message_id: u32,
    rate_hz: f64,
    arrivals: u32,
}

impl Streams {
    pub(crate) fn new(settings: &Settings) -> Self {
        let stream = |message_id, rate_hz| Stream { message_id, rate_hz, arrivals: 0 };
        let streams = vec![
            stream(HIGHRES_IMU_DATA::ID, settings.imu_rate_hz),
            stream(LOCAL_POSITION_NED_DATA::ID, settings.autopilot_pose_rate_hz),
            stream(ATTITUDE_QUATERNION_DATA::ID, settings.autopilot_pose_rate_hz),
            stream(HEARTBEAT_DATA::ID, MODE_RATE_HZ),
            stream(EXTENDED_SYS_STATE_DATA::ID, 5.0),
            stream(BATTERY_STATUS_DATA::ID, 1.0),
        ];
        Self { streams, judged_at: None, imu_silent: 0 }
    }

    /// True if the autopilot has no inertial samples in SI units.
    pub(crate) fn wants_raw_imu(&self) -> bool {
        self.streams.iter().any(|stream| stream.message_id == RAW_IMU_DATA::ID)
    }

    /// Counts a message.
    pub(crate) fn on_arrival(&mut self, message_id: u32) {
        if let Some(stream) = self.streams.iter_mut().find(|s| s.message_id == message_id) {
            stream.arrivals = stream.arrivals.saturating_add(1);
        }
    }

    /// Everything must be asked for again: the autopilot has rebooted or come back.
    pub(crate) fn forget(&mut self) {
        self.judged_at = None;
    }

    /// Asks for what does not flow, every [`WATCH_WINDOW`].
    pub(crate) fn on_time(
        &mut self,
        target_system: u8,
        dialect: Dialect,
        now: Stamp<Mono>,
        stats: &mut LinkStats,
        messages: &mut Vec<MavMessage>,
    ) {
        let window_s = match self.judged_at {
            Some(judged_at) if now.since(judged_at) < WATCH_WINDOW => return,
            Some(judged_at) => Some(now.seconds_since(judged_at)),
            None => None,
        };
        self.judged_at = Some(now);
        if window_s.is_some() && dialect.may_lack_highres_imu() {
            self.watch_imu();
        }
        for stream in &mut self.streams {
            if window_s.is_none_or(|window_s| !stream.flows(window_s)) {
                stats.stream_requests += 1;
                messages.push(stream.request(target_system));
            }
            stream.arrivals = 0;
        }
    }

    /// Older firmware knows only the one of the two messages with whole numbers.
    fn watch_imu(&mut self) {
        let Some(imu) = self.streams.iter_mut().find(|stream| stream.is_imu()) else { return };
        self.imu_silent = if imu.arrivals == 0 { self.imu_silent + 1 } else { 0 };
        if self.imu_silent >= SILENT_WINDOWS {
            self.imu_silent = 0;
            let is_highres = imu.message_id == HIGHRES_IMU_DATA::ID;
            imu.message_id = if is_highres { RAW_IMU_DATA::ID } else { HIGHRES_IMU_DATA::ID };
        }
    }
}

impl Stream {
    const fn is_imu(&self) -> bool {
        matches!(self.message_id, HIGHRES_IMU_DATA::ID | RAW_IMU_DATA::ID)
    }

    fn flows(&self, window_s: f64) -> bool {
        f64::from(self.arrivals) >= ENOUGH_RATIO * self.rate_hz * window_s
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "message ids lie below 2^24 and MAVLink carries both as f32"
    )]
    fn request(&self, target_system: u8) -> MavMessage {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: self.message_id as f32,
            param2: (1e6 / self.rate_hz).round() as f32,
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            target_system,
            target_component: AUTOPILOT_COMPONENT,
            ..Default::default()
        })
    }
}
