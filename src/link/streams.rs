//! Asks the autopilot for the messages that are needed, and again when they stay away.

use super::dialect::Dialect;
use super::stats::LinkStats;
use super::{AUTOPILOT_COMPONENT, Address, Settings};
use crate::time::{Mono, Stamp};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    ATTITUDE_QUATERNION_DATA, BATTERY_STATUS_DATA, COMMAND_LONG_DATA, EXTENDED_SYS_STATE_DATA,
    HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA, MavCmd, MavMessage, RAW_IMU_DATA,
};
use std::time::Duration;

/// How long arrivals are counted before they are judged.
const WATCH_WINDOW: Duration = Duration::from_secs(2);
/// A stream slower than this share of what was asked for is asked for again. PX4 delivers its
/// inertial samples at 160 to 182 Hz when 200 are asked for.
const ENOUGH_RATIO: f64 = 0.5;
/// PX4 slows every stream down alike on a line that it holds for full. Below this share of the
/// inertial samples it does: by itself it leaves a fifth out.
const THIN_RATIO: f64 = 0.75;
/// Windows of thin samples in a row that are no coincidence.
const THIN_WINDOWS: u8 = 2;
/// Windows without a single inertial sample after which the other message for them is tried.
const SILENT_WINDOWS: u8 = 2;
/// The interval that switches a stream off, µs.
const OFF_US: f64 = -1.0;

/// The streams and how they flow.
#[derive(Debug, Clone)]
pub(crate) struct Streams {
    streams: Vec<Stream>,
    /// The line is the autopilot's and nobody else's, and not endless.
    is_own_line: bool,
    judged_at: Option<Stamp<Mono>>,
    /// Windows in a row without any inertial sample.
    imu_silent: u8,
    /// Windows in a row with fewer inertial samples than were asked for.
    imu_thin: u8,
}

#[derive(Debug, Clone)]
struct Stream {
    message_id: u32,
    /// What is asked for: the time between two messages, µs, or [`OFF_US`].
    interval_us: f64,
    /// As many must come, 1/s; of a stream that is off, none.
    least_hz: f64,
    arrivals: u32,
}

impl Streams {
    pub(crate) fn new(settings: &Settings) -> Self {
        let streams = vec![
            Stream::at(HIGHRES_IMU_DATA::ID, settings.imu_rate_hz),
            Stream::at(LOCAL_POSITION_NED_DATA::ID, settings.autopilot_pose_rate_hz),
            Stream::at(ATTITUDE_QUATERNION_DATA::ID, settings.autopilot_pose_rate_hz),
            Stream::at(EXTENDED_SYS_STATE_DATA::ID, 5.0),
            Stream::at(BATTERY_STATUS_DATA::ID, 1.0),
        ];
        let is_own_line = matches!(settings.address, Address::Serial { .. });
        Self { streams, is_own_line, judged_at: None, imu_silent: 0, imu_thin: 0 }
    }

    /// The family is known now: asks for its mode in its way and, on a line of its own, calls off
    /// what it sends without being asked. Behind a network a ground station may live on that.
    pub(crate) fn speak(&mut self, dialect: Dialect) {
        let mode = dialect.mode_stream();
        self.streams
            .push(Stream { least_hz: mode.least_hz, ..Stream::at(mode.message_id, mode.rate_hz) });
        if self.is_own_line {
            self.streams.extend(dialect.unwanted_streams().iter().map(|id| Stream::off(*id)));
        }
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
        if let Some(window_s) = window_s {
            self.watch_rate(window_s, stats);
        }
        for stream in &mut self.streams {
            if window_s.is_none_or(|window_s| !stream.flows(window_s)) {
                stats.stream_requests += 1;
                messages.push(stream.request(target_system));
            }
            stream.arrivals = 0;
        }
    }

    /// Counts the looks that find too few inertial samples on a line of the autopilot's own.
    fn watch_rate(&mut self, window_s: f64, stats: &mut LinkStats) {
        let Some(imu) = self.streams.iter().find(|stream| stream.is_imu()) else { return };
        let wanted = imu.wanted_hz() * window_s;
        let arrived = f64::from(imu.arrivals);
        let is_thin = self.is_own_line && arrived > 0.0 && arrived < THIN_RATIO * wanted;
        self.imu_thin = if is_thin { self.imu_thin.saturating_add(1) } else { 0 };
        stats.thin_imu_windows += u64::from(self.imu_thin >= THIN_WINDOWS);
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
    fn at(message_id: u32, rate_hz: f64) -> Self {
        let interval_us = (1e6 / rate_hz).round();
        Self { message_id, interval_us, least_hz: ENOUGH_RATIO * rate_hz, arrivals: 0 }
    }

    const fn off(message_id: u32) -> Self {
        Self { message_id, interval_us: OFF_US, least_hz: 0.0, arrivals: 0 }
    }

    const fn is_imu(&self) -> bool {
        matches!(self.message_id, HIGHRES_IMU_DATA::ID | RAW_IMU_DATA::ID)
    }

    fn wanted_hz(&self) -> f64 {
        1e6 / self.interval_us
    }

    /// It is as was asked for.
    fn flows(&self, window_s: f64) -> bool {
        if self.interval_us < 0.0 {
            return self.arrivals == 0;
        }
        f64::from(self.arrivals) >= self.least_hz * window_s
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "message ids lie below 2^24 and MAVLink carries both as f32"
    )]
    fn request(&self, target_system: u8) -> MavMessage {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: self.message_id as f32,
            param2: self.interval_us as f32,
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            target_system,
            target_component: AUTOPILOT_COMPONENT,
            ..Default::default()
        })
    }
}
