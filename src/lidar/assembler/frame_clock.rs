//! When the samples of a packet were taken.

use super::pace::Pace;
use crate::lidar::Packet;
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// How much faster than the period the estimate may fall behind: room for what is left in the measured
/// period, 0.1 % with a clock of milliseconds.
const DRIFT_RATIO: f64 = 0.01;
/// An arrival this much later than expected is a pause of the sensor, not of the reader: the
/// kernel's queue rarely holds that much.
const PAUSE: Duration = Duration::from_millis(250);
/// If every packet of that much sample time came later than expected, the expectation is wrong. A
/// reader that stalls is late for less than [`PAUSE`].
const BLOCK_S: f64 = 0.5;
/// A gap may have been counted wrongly: behind it an arrival that is later than this and did not wait
/// in a queue is believed at once, s.
const GAP_SLACK_S: f64 = 0.005;
/// A chunk that took longer on the line may have waited in the kernel's queue.
const LONGEST_FRESH: Duration = Duration::from_millis(25);

/// Follows the earliest arrivals.
///
/// ```text
/// expected = before + 1.01 · (samples + lost + idle) · T
/// ```
/// What comes early counts at once: nothing arrives before it was sent. What comes later than expected
/// counts only if all of half a second does, because single packets wait for the reader. `T` is measured by the
/// sensor's own clock where it tells it, else by the arrivals.
#[derive(Debug, Clone)]
pub(super) struct FrameClock {
    pace: Pace,
    previous_at: Option<Stamp<Mono>>,
    block: Block,
    /// Samples since the clock began.
    n_samples: f64,
    restarts: u64,
}

/// Packets of half a second.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    span_s: f64,
    earliest: Option<Arrival>,
}

/// How late a packet came, and its place.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    late_s: f64,
    n_samples: f64,
    sent_at: Stamp<Mono>,
}

impl FrameClock {
    pub(super) fn new() -> Self {
        Self {
            pace: Pace::default(),
            previous_at: None,
            block: Block::default(),
            n_samples: 0.0,
            restarts: 0,
        }
    }

    /// Time between two samples, by the device's own clock where it has one.
    pub(super) fn sample_period(&self) -> Duration {
        Duration::from_secs_f64(self.pace.period_s())
    }

    pub(super) const fn restarts(&self) -> u64 {
        self.restarts
    }

    /// When the last sample of `packet` was taken, if it left the sensor at `sent_at` at the latest;
    /// `on_line` is what its chunk took on the line.
    pub(super) fn last_sample_at(
        &mut self,
        packet: &Packet,
        sent_at: Stamp<Mono>,
        on_line: Duration,
    ) -> Stamp<Mono> {
        if self.pace.state(packet.sample_period) {
            self.block = Block::default();
        }
        let n_samples = u32::try_from(packet.samples.len()).unwrap_or(u32::MAX);
        let n_steps = f64::from(n_samples) + f64::from(packet.n_lost) + f64::from(packet.n_idle);
        self.pace.note_device_time(packet, n_steps);
        self.n_samples += n_steps;
        let step_s = n_steps * self.pace.period_s() * (1.0 + DRIFT_RATIO);
        let at = match self.previous_at {
            None => sent_at,
            Some(previous_at) => {
                let expected = previous_at.plus(Duration::from_secs_f64(step_s));
                let is_fresh_behind_gap = packet.n_lost > 0
                    && packet.device_elapsed_s.is_none()
                    && on_line < LONGEST_FRESH;
                self.judge(expected, sent_at, step_s, is_fresh_behind_gap)
            }
        };
        self.previous_at = Some(at);
        at
    }

    fn judge(
        &mut self,
        expected: Stamp<Mono>,
        sent_at: Stamp<Mono>,
        step_s: f64,
        is_fresh_behind_gap: bool,
    ) -> Stamp<Mono> {
        let late_s = sent_at.seconds_since(expected);
        if late_s > PAUSE.as_secs_f64() || (is_fresh_behind_gap && late_s > GAP_SLACK_S) {
            self.begin_anew();
            return sent_at;
        }
        let arrival = Arrival { late_s: late_s.max(0.0), n_samples: self.n_samples, sent_at };
        self.block.span_s += step_s;
        if self.block.earliest.is_none_or(|earliest| late_s < earliest.late_s) {
            self.block.earliest = Some(arrival);
        }
        let at = sent_at.min(expected);
        if self.block.span_s < BLOCK_S {
            return at;
        }
        let earliest = std::mem::take(&mut self.block).earliest.unwrap_or(arrival);
        if !self.pace.note_arrival(earliest.n_samples, earliest.sent_at) {
            self.restarts += 1;
        }
        at.plus(Duration::from_secs_f64(earliest.late_s))
    }

    fn begin_anew(&mut self) {
        self.restarts += 1;
        self.block = Block::default();
        self.pace.forget_arrivals();
    }
}
