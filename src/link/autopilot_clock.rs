//! What the autopilot's clock reads, by MAVLink's TIMESYNC.
//!
//! ```text
//!   Mono  ──sent──────────────────arrived──▶      rtt    = arrived − sent
//!              ╲                 ╱                  offset = (sent + arrived)/2 − boot
//!   Boot  ──────────────boot──────────────▶      Mono   = Boot + offset
//! ```
//! The offset's error is half the difference of the two ways. The delay e beyond the shortest one
//! seen lately bounds most of it, and that shortest one itself lies about `rtt_max/n` above what is
//! possible, so each sample weighs as much as its delay allows. Offset o (ns) and drift d (ns/s)
//! follow a Kalman filter, random walks in both.
//!
//! ```text
//! o ← o + d Δt          P ← F P Fᵀ + Q          F = [1 Δt; 0 1]
//! R = σ₀² + (e + rtt_max/n)²                    σ₀ = 50 µs, n ≤ 100 samples
//! ```
//! Checked: `jitter_leaves_a_fifth_of_a_millisecond`.

use crate::time::{Boot, Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// Slower round trips say too little. PX4 and MAVROS use the same bound.
const MAX_ROUND_TRIP: Duration = Duration::from_millis(10);
/// Samples whose round trips are remembered: 10 s at 10 Hz.
const N_ROUND_TRIPS: usize = 100;
/// Samples before the offset is trusted.
const MIN_SAMPLES: u32 = 5;
/// A sample further away than this is an outlier. MAVROS's bound.
const MAX_DEVIATION_NS: f64 = 10e6;
/// Outliers in a row after which the clock is believed to have jumped.
const MAX_OUTLIERS: u32 = 5;
/// Error of a sample without excess delay, ns.
const BASE_SIGMA_NS: f64 = 50e3;
/// Crystals are off by some 50 µs/s; this is the σ of the first guess 0.
const FIRST_DRIFT_SIGMA_NSPS: f64 = 50e3;
/// Walk of the drift, ns/s per √s: a warming crystal.
const DRIFT_WALK_NSPS: f64 = 200.0;
/// Walk of the offset, ns per √s.
const OFFSET_WALK_NS: f64 = 2e3;
const NANOS_PER_MS: i64 = 1_000_000;
/// A boot time that falls by more than this is a reboot, not a late message.
const REBOOT_STEP: Duration = Duration::from_secs(1);
/// Requests that wait for an answer.
const N_OUTSTANDING: usize = 20;

/// What became of an answer to a clock request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ClockSample {
    Fused,
    /// Not asked for, or too slow.
    Refused,
    /// Too far from the estimate.
    Outlier,
    /// The outliers agree to disagree: the estimate begins anew.
    Reset,
}

/// Offset and drift of the autopilot's clock, and its requests under way.
#[derive(Debug, Clone, Default)]
pub(crate) struct AutopilotClock {
    estimate: Option<Estimate>,
    round_trips_ns: VecDeque<i64>,
    outstanding: VecDeque<Stamp<Mono>>,
    outliers: u32,
    latest_boot: Option<Stamp<Boot>>,
}

#[derive(Debug, Clone, Copy)]
struct Estimate {
    at: Stamp<Mono>,
    /// The first sample's offset; the filter works on the difference, which f64 holds exactly.
    base_ns: i64,
    /// Offset against `base_ns` (ns) and drift (ns/s).
    x: [f64; 2],
    /// Covariance: P₀₀, P₀₁, P₁₁.
    p: [f64; 3],
    samples: u32,
}

impl AutopilotClock {
    /// Remembers that a request left at `now`.
    pub(crate) fn on_request(&mut self, now: Stamp<Mono>) {
        if self.outstanding.len() == N_OUTSTANDING {
            self.outstanding.pop_front();
        }
        self.outstanding.push_back(now);
    }

    /// Takes in an answer: the request that left at `sent` met the autopilot at `boot`.
    pub(crate) fn on_answer(
        &mut self,
        sent: Stamp<Mono>,
        boot: Stamp<Boot>,
        arrived: Stamp<Mono>,
    ) -> ClockSample {
        let Some(index) = self.outstanding.iter().position(|&request| request == sent) else {
            return ClockSample::Refused;
        };
        self.outstanding.remove(index);
        let rtt_ns = arrived.nanos_since(sent);
        let is_quick = rtt_ns >= 0 && arrived.since(sent) <= MAX_ROUND_TRIP;
        let middle_ns = sent.nanos().saturating_add(rtt_ns / 2);
        match middle_ns.checked_sub(boot.nanos()) {
            Some(offset_ns) if is_quick => self.on_offset(offset_ns, rtt_ns, arrived),
            _ => ClockSample::Refused,
        }
    }

    fn on_offset(&mut self, offset_ns: i64, rtt_ns: i64, at: Stamp<Mono>) -> ClockSample {
        let sigma_ns = self.sample_sigma_ns(rtt_ns);
        let Some(estimate) = &mut self.estimate else {
            self.estimate = Some(Estimate::new(offset_ns, sigma_ns, at));
            return ClockSample::Fused;
        };
        estimate.predict(at);
        let innov_ns = difference_ns(offset_ns, estimate.base_ns) - estimate.x[0];
        if innov_ns.abs() > MAX_DEVIATION_NS {
            self.outliers += 1;
            if self.outliers < MAX_OUTLIERS {
                return ClockSample::Outlier;
            }
            self.restart();
            return ClockSample::Reset;
        }
        self.outliers = 0;
        estimate.update(innov_ns, sigma_ns);
        ClockSample::Fused
    }

    /// Standard deviation of a sample with this delay, ns.
    fn sample_sigma_ns(&mut self, rtt_ns: i64) -> f64 {
        if self.round_trips_ns.len() == N_ROUND_TRIPS {
            self.round_trips_ns.pop_front();
        }
        self.round_trips_ns.push_back(rtt_ns);
        let shortest_ns = self.round_trips_ns.iter().copied().min().unwrap_or(rtt_ns);
        let longest_ns = self.round_trips_ns.iter().copied().max().unwrap_or(rtt_ns);
        let excess_ns = difference_ns(rtt_ns, shortest_ns);
        let n = u32::try_from(self.round_trips_ns.len()).map_or(1.0, f64::from);
        BASE_SIGMA_NS.hypot(excess_ns + difference_ns(longest_ns, 0) / n)
    }

    /// Watches a boot time from any message; true if it says that the autopilot rebooted.
    pub(crate) fn rebooted(&mut self, boot: Stamp<Boot>) -> bool {
        match self.latest_boot {
            Some(latest) if latest.since(boot) > REBOOT_STEP => {
                self.restart();
                self.latest_boot = Some(boot);
                true
            }
            latest => {
                self.latest_boot = Some(latest.map_or(boot, |latest| latest.max(boot)));
                false
            }
        }
    }

    /// The time since boot behind a count of milliseconds that begins again every 49.7 days: the one
    /// nearest to what was heard last.
    pub(crate) fn boot_from_millis(&self, millis: u32) -> Stamp<Boot> {
        let Some(latest) = self.latest_boot else {
            return Stamp::from_nanos(i64::from(millis) * NANOS_PER_MS);
        };
        let latest_ms = latest.nanos() / NANOS_PER_MS;
        let low_ms = u32::try_from(latest_ms.rem_euclid(1 << 32)).unwrap_or(0);
        let ahead_ms = i64::from(millis.wrapping_sub(low_ms).cast_signed());
        Stamp::from_nanos((latest_ms + ahead_ms).saturating_mul(NANOS_PER_MS))
    }

    /// Forgets the estimate and every request under way.
    fn restart(&mut self) {
        *self = Self { latest_boot: self.latest_boot, ..Self::default() };
    }

    /// The same instant on this computer's clock; `None` until enough samples agree.
    pub(crate) fn mono_from_boot(&self, boot: Stamp<Boot>) -> Option<Stamp<Mono>> {
        let estimate = self.estimate.filter(|estimate| estimate.samples >= MIN_SAMPLES)?;
        Some(Stamp::from_nanos(boot.nanos().saturating_add(estimate.offset_ns())))
    }
}

impl Estimate {
    fn new(offset_ns: i64, sigma_ns: f64, at: Stamp<Mono>) -> Self {
        let p = [sigma_ns * sigma_ns, 0.0, FIRST_DRIFT_SIGMA_NSPS * FIRST_DRIFT_SIGMA_NSPS];
        Self { at, base_ns: offset_ns, x: [0.0, 0.0], p, samples: 1 }
    }

    fn predict(&mut self, at: Stamp<Mono>) {
        let dt_s = at.seconds_since(self.at).max(0.0);
        self.at = self.at.max(at);
        let [p00, p01, p11] = self.p;
        self.x[0] += self.x[1] * dt_s;
        self.p = [
            p00 + 2.0 * dt_s * p01 + dt_s * dt_s * p11 + OFFSET_WALK_NS * OFFSET_WALK_NS * dt_s,
            p01 + dt_s * p11,
            p11 + DRIFT_WALK_NSPS * DRIFT_WALK_NSPS * dt_s,
        ];
    }

    /// K = P Hᵀ / S with H = [1 0]; P ← (I − K H) P.
    fn update(&mut self, innov_ns: f64, sigma_ns: f64) {
        let [p00, p01, p11] = self.p;
        let s = p00 + sigma_ns * sigma_ns;
        let (k0, k1) = (p00 / s, p01 / s);
        self.x[0] += k0 * innov_ns;
        self.x[1] += k1 * innov_ns;
        self.p = [p00 * (1.0 - k0), p01 * (1.0 - k0), p11 - k1 * p01];
        self.samples = self.samples.saturating_add(1);
    }

    #[expect(clippy::cast_possible_truncation, reason = "bounded by the gate around the base")]
    fn offset_ns(&self) -> i64 {
        self.base_ns.saturating_add(self.x[0].round() as i64)
    }
}

#[expect(clippy::cast_precision_loss, reason = "differences of offsets stay below 2^53 ns")]
fn difference_ns(a: i64, b: i64) -> f64 {
    a.saturating_sub(b) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    const TRUE_OFFSET_NS: i64 = 7_123_456_789_012;

    fn at_ms(ms: i64) -> Stamp<Mono> {
        Stamp::from_nanos(TRUE_OFFSET_NS + ms * 1_000_000)
    }

    /// Asks at `sent`; the request takes `there_ns`, the answer `back_ns`.
    fn exchange(
        clock: &mut AutopilotClock,
        sent: Stamp<Mono>,
        there_ns: i64,
        back_ns: i64,
        offset_ns: i64,
    ) -> ClockSample {
        clock.on_request(sent);
        let boot = Stamp::from_nanos(sent.nanos() + there_ns - offset_ns);
        clock.on_answer(sent, boot, Stamp::from_nanos(sent.nanos() + there_ns + back_ns))
    }

    fn offset_error_ns(clock: &AutopilotClock, boot_ns: i64, offset_ns: i64) -> i64 {
        let mono = clock.mono_from_boot(Stamp::from_nanos(boot_ns)).unwrap();
        mono.nanos() - boot_ns - offset_ns
    }

    /// The largest error after the first 10 s of one minute, ns.
    fn worst_error_ns(seed: u64) -> i64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut clock = AutopilotClock::default();
        let mut worst_ns = 0;
        for step in 0..600_i64 {
            let offset_ns = TRUE_OFFSET_NS + step * 4_000; // 100 ms at 40 ppm
            let back_ns = 200_000 + i64::from(rng.random_range(0..2_000_000_u32));
            let sample = exchange(&mut clock, at_ms(step * 100), 200_000, back_ns, offset_ns);
            assert_eq!(sample, ClockSample::Fused);
            if step >= 100 {
                let boot_ns = at_ms(step * 100).nanos() - offset_ns;
                worst_ns = worst_ns.max(offset_error_ns(&clock, boot_ns, offset_ns).abs());
            }
        }
        worst_ns
    }

    #[test]
    fn jitter_leaves_a_fifth_of_a_millisecond() {
        // 0.2 ms there and 0.2 to 2.2 ms back, one way only: the worst asymmetry that a busy
        // receiver makes; the mean of the samples is off by 0.5 ms.
        for seed in 0..10 {
            let worst_ns = worst_error_ns(seed);
            assert!(worst_ns < 200_000, "seed {seed}: {worst_ns} ns");
        }
    }

    /// The largest error after the first 10 s of one minute in which one answer in ten waits for 3
    /// to 9 ms on its way back and one in fifty carries a stamp that is 15 to 80 ms off, ns.
    fn worst_error_with_outliers_ns(seed: u64) -> i64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut clock = AutopilotClock::default();
        let (mut worst_ns, mut n_outliers) = (0, 0);
        for step in 0..600_i64 {
            let offset_ns = TRUE_OFFSET_NS + step * 4_000; // 100 ms at 40 ppm
            let waits = rng.random_range(0..10) == 0;
            let most_ns = if waits { 9_000_000 } else { 400_000_u32 };
            let back_ns = 200_000 + i64::from(rng.random_range(most_ns / 3..most_ns));
            // The first answer decides where the outliers are; it is a good one.
            let is_wrong = step > 0 && rng.random_range(0..50) == 0;
            let wrong_ns = i64::from(rng.random_range(15_000_000..80_000_000_u32));
            let stamped_ns = offset_ns + if is_wrong { wrong_ns } else { 0 };
            let sample = exchange(&mut clock, at_ms(step * 100), 200_000, back_ns, stamped_ns);
            assert_eq!(sample == ClockSample::Outlier, is_wrong, "seed {seed}, step {step}");
            n_outliers += i32::from(is_wrong);
            if step >= 100 {
                let boot_ns = at_ms(step * 100).nanos() - offset_ns;
                worst_ns = worst_ns.max(offset_error_ns(&clock, boot_ns, offset_ns).abs());
            }
        }
        assert!(n_outliers > 2, "seed {seed}: {n_outliers} outliers");
        worst_ns
    }

    #[test]
    fn a_busy_link_and_wrong_stamps_leave_a_quarter_of_a_millisecond() {
        // The usual answers come back 0.13 to 0.4 ms late, so their offset is off by 0.13 ms in the
        // mean; the waiting ones, up to 4.5 ms off, must hardly count, the wrong ones not at all.
        for seed in 0..10 {
            let worst_ns = worst_error_with_outliers_ns(seed);
            assert!(worst_ns < 250_000, "seed {seed}: {worst_ns} ns");
        }
    }

    #[test]
    fn slow_and_unasked_answers_are_refused() {
        let mut clock = AutopilotClock::default();
        let slow = exchange(&mut clock, at_ms(0), 5_000_000, 5_000_001, TRUE_OFFSET_NS);
        assert_eq!(slow, ClockSample::Refused);
        let unasked = clock.on_answer(at_ms(100), Stamp::from_nanos(1), at_ms(101));
        assert_eq!(unasked, ClockSample::Refused);
        // The same answer twice counts once.
        assert_eq!(exchange(&mut clock, at_ms(200), 1, 1, TRUE_OFFSET_NS), ClockSample::Fused);
        let again = clock.on_answer(at_ms(200), Stamp::from_nanos(1), at_ms(201));
        assert_eq!(again, ClockSample::Refused);
    }

    #[test]
    fn no_offset_before_enough_samples() {
        let mut clock = AutopilotClock::default();
        for step in 0..5 {
            assert!(clock.mono_from_boot(Stamp::from_nanos(0)).is_none(), "step {step}");
            let _sample = exchange(&mut clock, at_ms(step * 100), 100, 100, TRUE_OFFSET_NS);
        }
        assert_eq!(offset_error_ns(&clock, 400_000_000, TRUE_OFFSET_NS), 0);
    }

    #[test]
    fn single_outliers_are_ignored_and_a_row_of_them_resets() {
        let mut clock = AutopilotClock::default();
        for step in 0..20 {
            let _sample = exchange(&mut clock, at_ms(step * 100), 100, 100, TRUE_OFFSET_NS);
        }
        let jumped_ns = TRUE_OFFSET_NS + 50_000_000;
        for step in 20..24 {
            let sample = exchange(&mut clock, at_ms(step * 100), 100, 100, jumped_ns);
            assert_eq!(sample, ClockSample::Outlier);
        }
        assert!(offset_error_ns(&clock, 2_400_000_000, TRUE_OFFSET_NS).abs() < 1_000);
        let sample = exchange(&mut clock, at_ms(2_400), 100, 100, jumped_ns);
        assert_eq!(sample, ClockSample::Reset);
        assert!(clock.mono_from_boot(Stamp::from_nanos(0)).is_none());
        for step in 25..30 {
            let _sample = exchange(&mut clock, at_ms(step * 100), 100, 100, jumped_ns);
        }
        assert!(offset_error_ns(&clock, 3_000_000_000, jumped_ns).abs() < 1_000);
    }

    #[test]
    fn milliseconds_go_on_over_their_wrap() {
        let mut clock = AutopilotClock::default();
        assert_eq!(clock.boot_from_millis(17), Stamp::from_nanos(17 * NANOS_PER_MS));
        let wrap_ms = 1_i64 << 32;
        for (latest_ms, millis, expected_ms) in [
            (wrap_ms - 100, u32::MAX - 89, wrap_ms - 90),
            (wrap_ms - 100, 20, wrap_ms + 20),
            (wrap_ms + 30, u32::MAX - 9, wrap_ms - 10),
            (3 * wrap_ms + 5_000, 5_010, 3 * wrap_ms + 5_010),
        ] {
            clock.latest_boot = Some(Stamp::from_nanos(latest_ms * NANOS_PER_MS));
            let boot = clock.boot_from_millis(millis);
            assert_eq!(boot, Stamp::from_nanos(expected_ms * NANOS_PER_MS), "{millis}");
        }
    }

    #[test]
    fn a_falling_boot_time_is_a_reboot_but_a_late_message_is_not() {
        let mut clock = AutopilotClock::default();
        let boot_s = |s: i64| Stamp::<Boot>::from_nanos(s * 1_000_000_000);
        assert!(!clock.rebooted(boot_s(100)));
        assert!(!clock.rebooted(boot_s(99)));
        assert!(clock.rebooted(boot_s(5)));
        assert!(!clock.rebooted(boot_s(6)));
    }
}
