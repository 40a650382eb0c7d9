//! How long a sample takes.

use crate::lidar::Packet;
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// Device time over which the sample period is measured, s: its millisecond steps are 0.1 % of it.
const DEVICE_WINDOW_S: f64 = 1.0;
/// Arrivals over which it is measured without such a clock, s: they are good to a millisecond.
const ARRIVAL_WINDOW_S: f64 = 10.0;
/// An arrival that lies this far beside the others was counted wrongly, s.
const BREAK_S: f64 = 0.005;
/// So many arrivals tell where the next one lies.
const ESTABLISHED: usize = 3;
/// The sample period may differ this much from the stated one.
const TOLERANCE_RATIO: f64 = 0.05;

/// Measures the sample period: a crystal is off by little, but sensors sample some per cent slower or
/// faster than their makers state (an A1 by 0.7 %).
#[derive(Debug, Clone, Default)]
pub(super) struct Pace {
    stated_s: f64,
    stated: Duration,
    period_s: f64,
    has_device_time: bool,
    /// Device time and samples of the running window.
    window_s: f64,
    window_samples: f64,
    /// Early arrivals: samples so far, and when they had been sent.
    arrivals: VecDeque<(f64, Stamp<Mono>)>,
}

impl Pace {
    /// Time between two samples, s.
    pub(super) const fn period_s(&self) -> f64 {
        self.period_s
    }

    /// The sensor states its period; true if that is news.
    pub(super) fn state(&mut self, period: Duration) -> bool {
        if period == self.stated {
            return false;
        }
        let stated_s = period.as_secs_f64();
        *self = Self { stated: period, stated_s, period_s: stated_s, ..Self::default() };
        true
    }

    /// Takes in the device time of a packet that stands for `n_steps` samples.
    pub(super) fn note_device_time(&mut self, packet: &Packet, n_steps: f64) {
        self.has_device_time |= packet.device_elapsed_s.is_some();
        let Some(elapsed_s) = packet.device_elapsed_s.filter(|_| packet.n_lost == 0) else {
            (self.window_s, self.window_samples) = (0.0, 0.0);
            return;
        };
        self.window_s += elapsed_s;
        self.window_samples += n_steps;
        if self.window_s >= DEVICE_WINDOW_S {
            self.set(self.window_s / self.window_samples);
            (self.window_s, self.window_samples) = (0.0, 0.0);
        }
    }

    /// Takes in an early arrival after so many samples; false if it lies beside those before, because
    /// samples in between were counted wrongly.
    pub(super) fn note_arrival(&mut self, n_samples: f64, sent_at: Stamp<Mono>) -> bool {
        let is_broken = self.arrivals.back().is_some_and(|(n_before, before_at)| {
            let expected_s = (n_samples - n_before) * self.period_s;
            self.arrivals.len() >= ESTABLISHED
                && (sent_at.seconds_since(*before_at) - expected_s).abs() > BREAK_S
        });
        if is_broken {
            self.arrivals.clear();
        }
        self.arrivals.push_back((n_samples, sent_at));
        while self.arrivals.len() > 2 && self.span_s() > ARRIVAL_WINDOW_S {
            self.arrivals.pop_front();
        }
        if let (Some((first, first_at)), false) = (self.arrivals.front(), self.has_device_time)
            && n_samples > *first
        {
            self.set(sent_at.seconds_since(*first_at) / (n_samples - first));
        }
        !is_broken
    }

    /// The clock was begun anew; the period is kept.
    pub(super) fn forget_arrivals(&mut self) {
        self.arrivals.clear();
    }

    fn span_s(&self) -> f64 {
        match (self.arrivals.front(), self.arrivals.back()) {
            (Some((_, first_at)), Some((_, last_at))) => last_at.seconds_since(*first_at),
            _ => 0.0,
        }
    }

    fn set(&mut self, period_s: f64) {
        let (lo, hi) = (1.0 - TOLERANCE_RATIO, 1.0 + TOLERANCE_RATIO);
        self.period_s = period_s.clamp(lo * self.stated_s, hi * self.stated_s);
    }
}
