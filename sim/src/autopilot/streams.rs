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
}

/// Default rate of each stream on the companion's link, mHz; 0 for those on request only.
const DEFAULT_MILLIHZ: [(u32, u64); 18] = [
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

#[derive(Debug, Clone, Copy)]
struct Stream {
    id: u32,
    default: Option<Duration>,
    interval: Option<Duration>,
    due: Stamp<Boot>,
}

/// The streams of one link.
#[derive(Debug, Clone)]
pub(super) struct Streams {
    streams: Vec<Stream>,
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
        Self { streams: rates.iter().map(stream).collect() }
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

    /// Sets every stream to an interval, or switches all off.
    pub(super) fn set_all(&mut self, interval: Option<Duration>) {
        for stream in &mut self.streams {
            stream.interval = interval;
        }
    }

    /// Calls `send` with each id that is due.
    pub(super) fn poll(&mut self, now: Stamp<Boot>, mut send: impl FnMut(u32)) {
        for stream in &mut self.streams {
            let Some(interval) = stream.interval else { continue };
            if now < stream.due {
                continue;
            }
            send(stream.id);
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
            streams.poll(now, |sent| n += usize::from(sent == id));
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
