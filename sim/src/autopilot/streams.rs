//! Which message leaves how often.

use std::time::Duration;
use stockpilot::time::{Boot, Stamp};

/// MAVLink ids of the messages that the stub can send.
pub(super) mod id {
    pub(in crate::autopilot) const HEARTBEAT: u32 = 0;
    pub(in crate::autopilot) const SYS_STATUS: u32 = 1;
    pub(in crate::autopilot) const SYSTEM_TIME: u32 = 2;
    pub(in crate::autopilot) const ATTITUDE: u32 = 30;
    pub(in crate::autopilot) const ATTITUDE_QUATERNION: u32 = 31;
    pub(in crate::autopilot) const LOCAL_POSITION_NED: u32 = 32;
    pub(in crate::autopilot) const GLOBAL_POSITION_INT: u32 = 33;
    pub(in crate::autopilot) const GPS_GLOBAL_ORIGIN: u32 = 49;
    pub(in crate::autopilot) const POSITION_TARGET_LOCAL_NED: u32 = 85;
    pub(in crate::autopilot) const HIGHRES_IMU: u32 = 105;
    pub(in crate::autopilot) const SIM_STATE: u32 = 108;
    pub(in crate::autopilot) const TIMESYNC: u32 = 111;
    pub(in crate::autopilot) const HIL_STATE_QUATERNION: u32 = 115;
    pub(in crate::autopilot) const BATTERY_STATUS: u32 = 147;
    pub(in crate::autopilot) const AUTOPILOT_VERSION: u32 = 148;
    pub(in crate::autopilot) const ESTIMATOR_STATUS: u32 = 230;
    pub(in crate::autopilot) const HOME_POSITION: u32 = 242;
    pub(in crate::autopilot) const EXTENDED_SYS_STATE: u32 = 245;
    pub(in crate::autopilot) const ODOMETRY: u32 = 331;
    pub(in crate::autopilot) const RAW_IMU: u32 = 27;
    pub(in crate::autopilot) const SCALED_IMU: u32 = 26;
    pub(in crate::autopilot) const EKF_STATUS_REPORT: u32 = 193;
    pub(in crate::autopilot) const CURRENT_MODE: u32 = 436;
}

/// Default rate of each stream on the companion's link, mHz; 0 for those on request only. What PX4 sends
/// beside these is counted by [`BESIDE_BYTES_PER_S`].
const DEFAULT_MILLIHZ: [(u32, u64); 19] = [
    (id::HEARTBEAT, 1_000),
    (id::SYS_STATUS, 1_000),
    (id::SYSTEM_TIME, 1_000),
    (id::ATTITUDE, 100_000),
    (id::ATTITUDE_QUATERNION, 50_000),
    (id::LOCAL_POSITION_NED, 30_000),
    (id::GLOBAL_POSITION_INT, 50_000),
    (id::GPS_GLOBAL_ORIGIN, 0),
    (id::POSITION_TARGET_LOCAL_NED, 10_000),
    (id::HIGHRES_IMU, 50_000),
    (id::TIMESYNC, 10_000),
    (id::BATTERY_STATUS, 500),
    (id::AUTOPILOT_VERSION, 0),
    (id::ESTIMATOR_STATUS, 1_000),
    (id::HOME_POSITION, 500),
    (id::EXTENDED_SYS_STATE, 5_000),
    (id::ODOMETRY, 30_000),
    (id::CURRENT_MODE, 500),
    (id::HIL_STATE_QUATERNION, 0),
];

/// What leaves on the ground station's link, mHz: enough for a display.
const GROUND_MILLIHZ: [(u32, u64); 6] = [
    (id::HEARTBEAT, 1_000),
    (id::SYS_STATUS, 1_000),
    (id::ATTITUDE, 10_000),
    (id::LOCAL_POSITION_NED, 10_000),
    (id::BATTERY_STATUS, 500),
    (id::EXTENDED_SYS_STATE, 1_000),
];

/// Full frames of MAVLink 2, unsigned, bytes.
const FRAME_BYTES: [(u32, f64); 16] = [
    (id::SYS_STATUS, 55.0),
    (id::SYSTEM_TIME, 24.0),
    (id::ATTITUDE, 40.0),
    (id::ATTITUDE_QUATERNION, 60.0),
    (id::LOCAL_POSITION_NED, 40.0),
    (id::GLOBAL_POSITION_INT, 40.0),
    (id::GPS_GLOBAL_ORIGIN, 32.0),
    (id::POSITION_TARGET_LOCAL_NED, 63.0),
    (id::HIGHRES_IMU, 75.0),
    (id::TIMESYNC, 30.0),
    (id::BATTERY_STATUS, 66.0),
    (id::ESTIMATOR_STATUS, 54.0),
    (id::HOME_POSITION, 72.0),
    (id::EXTENDED_SYS_STATE, 14.0),
    (id::ODOMETRY, 245.0),
    (id::CURRENT_MODE, 21.0),
];
/// What PX4 sends beside the streams of the stub, and nobody switches off.
const BESIDE_BYTES_PER_S: f64 = 1_500.0;
/// PX4 slows its streams down to no less than this.
const LEAST_RATE_RATIO: f64 = 0.05;

#[derive(Debug, Clone, Copy)]
struct Stream {
    id: u32,
    default: Option<Duration>,
    interval: Option<Duration>,
    due: Stamp<Boot>,
}

/// The streams of one link.
#[derive(Debug, Clone, Default)]
pub(super) struct Streams {
    streams: Vec<Stream>,
    /// What may leave, bytes/s; `None` where nothing bounds it.
    pub(super) most_bytes_per_s: Option<f64>,
}

impl Streams {
    pub(super) fn companion() -> Self {
        Self::with(&DEFAULT_MILLIHZ)
    }

    pub(super) fn ground() -> Self {
        Self::with(&GROUND_MILLIHZ)
    }

    /// Streams with these rates, mHz; 0 for those on request only.
    pub(super) fn with(rates: &[(u32, u64)]) -> Self {
        let stream = |&(id, millihz): &(u32, u64)| {
            let default = 1_000_000_000_000_u64.checked_div(millihz).map(Duration::from_nanos);
            Stream { id, default, interval: default, due: Stamp::ZERO }
        };
        Self { streams: rates.iter().map(stream).collect(), most_bytes_per_s: None }
    }

    /// Sets an interval in µs: 0 for the default, negative for off. False for an unknown id.
    pub(super) fn set_interval(&mut self, id: u32, interval_us: i64) -> bool {
        let Some(stream) = self.streams.iter_mut().find(|stream| stream.id == id) else {
            return false;
        };
        stream.interval = match u64::try_from(interval_us) {
            Ok(0) => stream.default,
            Ok(us) => Some(Duration::from_micros(us)),
            Err(_) => None,
        };
        true
    }

    /// The firmware does not know this message.
    pub(super) fn forget(&mut self, id: u32) {
        self.streams.retain(|stream| stream.id != id);
    }

    /// Sets every stream to an interval, or switches all off.
    pub(super) fn set_all(&mut self, interval: Option<Duration>) {
        for stream in &mut self.streams {
            stream.interval = interval;
        }
    }

    /// By how much PX4 slows every stream but the heartbeat down: by what all would take if each had
    /// something to say (`Mavlink::update_rate_mult`).
    fn rate_ratio(&self) -> f64 {
        let Some(most_bytes_per_s) = self.most_bytes_per_s else { return 1.0 };
        let taken = |stream: &Stream| {
            let frame = FRAME_BYTES.iter().find(|(id, _)| *id == stream.id);
            let interval_s = stream.interval.map(|interval| interval.as_secs_f64());
            frame.zip(interval_s).map_or(0.0, |((_, bytes), interval_s)| bytes / interval_s)
        };
        let wanted = BESIDE_BYTES_PER_S + self.streams.iter().map(taken).sum::<f64>();
        (most_bytes_per_s / wanted).clamp(LEAST_RATE_RATIO, 1.0)
    }

    /// Calls `send` with each id that is due; one for which it has nothing to send stays due.
    pub(super) fn poll(&mut self, now: Stamp<Boot>, mut send: impl FnMut(u32) -> bool) {
        let rate_ratio = self.rate_ratio();
        for stream in &mut self.streams {
            let Some(interval) = stream.interval else { continue };
            let is_constant = stream.id == id::HEARTBEAT;
            let interval = if is_constant { interval } else { interval.div_f64(rate_ratio) };
            if now < stream.due || !send(stream.id) {
                continue;
            }
            // Keep the rhythm, but do not catch up after a pause.
            let next = stream.due.plus(interval);
            stream.due = if next <= now { now.plus(interval) } else { next };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(streams: &mut Streams, id: u32, seconds: i64) -> usize {
        let mut n = 0;
        for tick in 0..seconds * 200 {
            let now = Stamp::from_nanos(1_000_000_000 + tick * 5_000_000);
            streams.poll(now, |sent| {
                n += usize::from(sent == id);
                true
            });
        }
        n
    }

    #[test]
    fn rates_are_those_of_the_onboard_link() {
        for (id, hz) in [(id::HEARTBEAT, 1), (id::HIGHRES_IMU, 50), (id::ODOMETRY, 30)] {
            let n = count(&mut Streams::companion(), id, 20);
            assert!(n.abs_diff(20 * hz) <= 1, "{id}: {n} in 20 s");
        }
    }

    #[test]
    fn a_port_with_too_few_bytes_slows_everything_but_the_heartbeat_down() {
        let of = |most_bytes_per_s| {
            let mut streams = Streams::companion();
            streams.set_interval(id::HIGHRES_IMU, 5_000);
            streams.most_bytes_per_s = Some(most_bytes_per_s);
            streams
        };
        // 15000 of HIGHRES_IMU, 7350 of ODOMETRY, 4000 of ATTITUDE, 3000 of ATTITUDE_QUATERNION, 2000 of
        // GLOBAL_POSITION_INT, 1200 of LOCAL_POSITION_NED, 630 of the target, 300 of TIMESYNC, 1500 of
        // others and some 280 of the slow ones make 35.3 kB/s: of 115200 baud PX4 uses 5760.
        let n = count(&mut of(5_760.0), id::HIGHRES_IMU, 20);
        assert!((580..690).contains(&n), "{n} in 20 s: 200 Hz · 5760 / 35300 = 32.6 Hz");
        assert_eq!(count(&mut of(5_760.0), id::HEARTBEAT, 20), 20);
        assert!(count(&mut of(46_080.0), id::HIGHRES_IMU, 20).abs_diff(4_000) <= 1);
        // Nothing is slowed down to less than a twentieth.
        let n = count(&mut of(10.0), id::HIGHRES_IMU, 20);
        assert!(n.abs_diff(200) <= 2, "{n}");
    }

    #[test]
    fn intervals_can_be_changed_and_put_back() {
        let mut streams = Streams::companion();
        assert!(streams.set_interval(id::HIGHRES_IMU, 5_000));
        assert!(count(&mut streams, id::HIGHRES_IMU, 10).abs_diff(2000) <= 1);
        let mut streams = Streams::companion();
        assert!(streams.set_interval(id::HIGHRES_IMU, -1));
        assert_eq!(count(&mut streams, id::HIGHRES_IMU, 10), 0);
        assert!(!streams.set_interval(9999, 5_000));
    }
}
