//! When the samples of a frame were taken.

use super::gap::elapsed_s;
use crate::lidar::ldrobot::{FRAME_SAMPLES, Frame};
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// How much faster than the period the estimate may fall behind: room for the drift between the
/// sensor's clock and this computer's.
const DRIFT_RATIO: f64 = 0.01;
/// An arrival this much later than expected is a pause of the sensor, not of the reader: the
/// kernel's queue never holds that much.
const PAUSE: Duration = Duration::from_millis(250);
/// Device time over which the sample period is measured, s: its millisecond steps are 0.1 % of it.
const PERIOD_WINDOW_S: f64 = 1.0;
/// The sample period may differ this much from the data sheet.
const PERIOD_TOLERANCE_RATIO: f64 = 0.05;

/// Follows the earliest arrivals: what comes early counts at once, what comes late only slowly.
#[derive(Debug, Clone)]
pub(super) struct FrameClock {
    nominal_period_s: f64,
    period_s: f64,
    previous: Option<(Frame, Stamp<Mono>)>,
    window_s: f64,
    window_samples: f64,
    restarts: u64,
}

impl FrameClock {
    pub(super) fn new(nominal_period: Duration) -> Self {
        let nominal_period_s = nominal_period.as_secs_f64();
        Self {
            nominal_period_s,
            period_s: nominal_period_s,
            previous: None,
            window_s: 0.0,
            window_samples: 0.0,
            restarts: 0,
        }
    }

    /// Time between two samples, by the device's own clock.
    pub(super) fn sample_period(&self) -> Duration {
        Duration::from_secs_f64(self.period_s)
    }

    pub(super) const fn restarts(&self) -> u64 {
        self.restarts
    }

    /// When the last sample of `frame` was taken, if the frame left the sensor at `sent_at` at the
    /// latest and `n_frames` frames after the previous one.
    pub(super) fn last_sample_at(
        &mut self,
        frame: &Frame,
        sent_at: Stamp<Mono>,
        n_frames: u32,
    ) -> Stamp<Mono> {
        let at = match self.previous {
            None => sent_at,
            Some((previous, previous_at)) => {
                self.measure_period(&previous, frame, n_frames);
                let step_s = f64::from(n_frames) * FRAME_SAMPLES as f64 * self.period_s;
                let latest =
                    previous_at.plus(Duration::from_secs_f64(step_s * (1.0 + DRIFT_RATIO)));
                if sent_at.since(latest) > PAUSE {
                    self.restarts += 1;
                    sent_at
                } else {
                    sent_at.min(latest)
                }
            }
        };
        self.previous = Some((*frame, at));
        at
    }

    fn measure_period(&mut self, previous: &Frame, frame: &Frame, n_frames: u32) {
        if n_frames != 1 {
            (self.window_s, self.window_samples) = (0.0, 0.0);
            return;
        }
        self.window_s += elapsed_s(previous, frame);
        self.window_samples += FRAME_SAMPLES as f64;
        if self.window_s >= PERIOD_WINDOW_S {
            let nominal = self.nominal_period_s;
            let (lo, hi) = (1.0 - PERIOD_TOLERANCE_RATIO, 1.0 + PERIOD_TOLERANCE_RATIO);
            self.period_s = (self.window_s / self.window_samples).clamp(lo * nominal, hi * nominal);
            (self.window_s, self.window_samples) = (0.0, 0.0);
        }
    }
}
