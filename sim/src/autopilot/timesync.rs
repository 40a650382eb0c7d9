//! The autopilot's side of TIMESYNC: its filter of the companion's clock.
//!
//! Until 500 samples are in, stamps of the companion are not believed and replaced by the time of
//! arrival. Source: `Timesync.hpp` of PX4 v1.16.

use super::frames::whole;
use std::time::Duration;
use stockpilot::time::{Boot, Stamp};

const CONVERGED_AFTER: u32 = 500;
const MAX_ROUND_TRIP: Duration = Duration::from_millis(10);
const MAX_DEVIATION_NS: f64 = 100e6;
const MAX_DEVIATIONS: u32 = 10;
const ALPHA: (f64, f64) = (0.05, 0.003);
const BETA: (f64, f64) = (0.05, 0.003);

/// Offset between the autopilot's clock and the companion's.
#[derive(Debug, Clone, Default)]
pub(super) struct TimeSync {
    /// Boot minus companion, ns.
    offset_ns: f64,
    skew_ns: f64,
    n_samples: u32,
    n_deviations: u32,
}

impl TimeSync {
    /// Takes in an answer: our request left at `sent`, the companion's clock stood at `remote_ns`.
    pub(super) fn on_answer(&mut self, now: Stamp<Boot>, sent: Stamp<Boot>, remote_ns: i64) {
        if now < sent || now.since(sent) > MAX_ROUND_TRIP {
            return;
        }
        let middle_ns = sent.nanos() + now.nanos_since(sent) / 2;
        #[expect(clippy::cast_precision_loss, reason = "2^53 ns are a hundred days")]
        let offset_ns = middle_ns.saturating_sub(remote_ns) as f64;
        let is_far = (offset_ns - self.offset_ns).abs() > MAX_DEVIATION_NS;
        if self.is_converged() && is_far {
            self.n_deviations += 1;
            if self.n_deviations > MAX_DEVIATIONS {
                *self = Self::default();
            }
            return;
        }
        self.n_deviations = 0;
        self.filter(offset_ns);
    }

    fn filter(&mut self, offset_ns: f64) {
        if self.n_samples == 0 {
            self.offset_ns = offset_ns;
        } else {
            let (alpha, beta) = (self.gain(ALPHA), self.gain(BETA));
            let before = self.offset_ns;
            self.offset_ns = alpha * offset_ns + (1.0 - alpha) * (before + self.skew_ns);
            self.skew_ns = beta * (self.offset_ns - before) + (1.0 - beta) * self.skew_ns;
        }
        self.n_samples = (self.n_samples + 1).min(CONVERGED_AFTER);
    }

    /// From the first gain to the last along a sigmoid over the convergence window.
    fn gain(&self, (first, last): (f64, f64)) -> f64 {
        if self.is_converged() {
            return last;
        }
        let progress = f64::from(self.n_samples) / f64::from(CONVERGED_AFTER);
        let share = 1.0 - (0.5 * (1.0 - 1.0 / (1.0 - progress))).exp();
        share * last + (1.0 - share) * first
    }

    pub(super) const fn is_converged(&self) -> bool {
        self.n_samples >= CONVERGED_AFTER
    }

    /// When something the companion stamped `remote_us` was measured, on the autopilot's clock.
    pub(super) fn stamp(&self, now: Stamp<Boot>, remote_us: u64) -> Stamp<Boot> {
        if !self.is_converged() {
            return now;
        }
        let remote_ns = i64::try_from(remote_us).unwrap_or(i64::MAX).saturating_mul(1000);
        Stamp::from_nanos(remote_ns.saturating_add(whole(self.offset_ns)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn converges_after_five_hundred_answers_and_then_believes_stamps() {
        let mut sync = TimeSync::default();
        let lead_ns = 12_345_000_000;
        let mut now = Stamp::<Boot>::from_nanos(lead_ns);
        for _ in 0..500 {
            assert!(!sync.is_converged());
            assert_eq!(sync.stamp(now, 77), now);
            let sent = now.minus(Duration::from_millis(2));
            // The companion's zero lies 12.345 s after the boot; it looks in the middle.
            sync.on_answer(now, sent, now.nanos() - 1_000_000 - lead_ns);
            now = now.plus(Duration::from_millis(100));
        }
        assert!(sync.is_converged());
        assert!(
            sync.stamp(now, 1_000_000).nanos_since(Stamp::from_nanos(13_345_000_000)).abs() < 1000
        );
    }

    #[test]
    fn a_jump_of_the_companion_clock_starts_the_filter_anew() {
        let mut sync = TimeSync { n_samples: 500, ..TimeSync::default() };
        let now = Stamp::from_nanos(1_000_000_000);
        for n in 0..11 {
            assert!(sync.is_converged(), "after {n} answers that are off by more than 100 ms");
            sync.on_answer(now, now, 0);
        }
        assert!(!sync.is_converged());
    }

    #[test]
    fn slow_answers_do_not_count() {
        let mut sync = TimeSync::default();
        for _ in 0..600 {
            sync.on_answer(Stamp::from_nanos(20_000_000), Stamp::ZERO, 5);
        }
        assert!(!sync.is_converged());
    }
}
