//! When the samples of a packet were taken.

use crate::lidar::Packet;
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// How much faster than the period the estimate may fall behind: room for the drift between the
/// sensor's clock and this computer's.
const DRIFT_RATIO: f64 = 0.01;
/// An arrival this much later than expected is a pause of the sensor, not of the reader: the
/// kernel's queue rarely holds that much.
const PAUSE: Duration = Duration::from_millis(250);
/// Device time over which the sample period is measured, s: its millisecond steps are 0.1 % of it.
const PERIOD_WINDOW_S: f64 = 1.0;
/// The sample period may differ this much from the stated one.
const PERIOD_TOLERANCE_RATIO: f64 = 0.05;

/// Follows the earliest arrivals: what comes early counts at once, what comes late only slowly.
#[derive(Debug, Clone)]
pub(super) struct FrameClock {
    stated_period: Duration,
    period_s: f64,
    previous_at: Option<Stamp<Mono>>,
    window_s: f64,
    window_samples: f64,
    restarts: u64,
}

impl FrameClock {
    pub(super) const fn new() -> Self {
        Self {
            stated_period: Duration::ZERO,
            period_s: 0.0,
            previous_at: None,
            window_s: 0.0,
            window_samples: 0.0,
            restarts: 0,
        }
    }

    /// Time between two samples, by the device's own clock where it has one.
    pub(super) fn sample_period(&self) -> Duration {
        Duration::from_secs_f64(self.period_s)
    }

    pub(super) const fn restarts(&self) -> u64 {
        self.restarts
    }

    /// When the last sample of `packet` was taken, if it left the sensor at `sent_at` at the latest.
    pub(super) fn last_sample_at(&mut self, packet: &Packet, sent_at: Stamp<Mono>) -> Stamp<Mono> {
        if packet.sample_period != self.stated_period {
            self.stated_period = packet.sample_period;
            self.period_s = packet.sample_period.as_secs_f64();
        }
        let n_samples = u32::try_from(packet.samples.len()).unwrap_or(u32::MAX);
        let n_steps = f64::from(n_samples) + f64::from(packet.n_lost) + f64::from(packet.n_idle);
        self.measure_period(packet, n_steps);
        let at = self.previous_at.map_or(sent_at, |previous_at| {
            let step_s = n_steps * self.period_s * (1.0 + DRIFT_RATIO);
            let latest = previous_at.plus(Duration::from_secs_f64(step_s));
            if sent_at.since(latest) > PAUSE {
                self.restarts += 1;
                sent_at
            } else {
                sent_at.min(latest)
            }
        });
        self.previous_at = Some(at);
        at
    }

    fn measure_period(&mut self, packet: &Packet, n_steps: f64) {
        let Some(elapsed_s) = packet.device_elapsed_s.filter(|_| packet.n_lost == 0) else {
            (self.window_s, self.window_samples) = (0.0, 0.0);
            return;
        };
        self.window_s += elapsed_s;
        self.window_samples += n_steps;
        if self.window_s >= PERIOD_WINDOW_S {
            let stated = self.stated_period.as_secs_f64();
            let (lo, hi) = (1.0 - PERIOD_TOLERANCE_RATIO, 1.0 + PERIOD_TOLERANCE_RATIO);
            self.period_s = (self.window_s / self.window_samples).clamp(lo * stated, hi * stated);
            (self.window_s, self.window_samples) = (0.0, 0.0);
        }
    }
}
