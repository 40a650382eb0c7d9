//! When the next tick is due.

use crate::pilot::TICK_RATE_HZ;
use crate::time::{Mono, Stamp};

/// Later than this, ticks are left out rather than made up for.
const MAX_BEHIND_TICKS: i64 = 6;
const NANOS_PER_S: i64 = 1_000_000_000;

/// Ticks at exact multiples of 1/60 s after its start, without drift.
#[derive(Debug)]
pub(super) struct Ticker {
    start: Stamp<Mono>,
    next: i64,
}

impl Ticker {
    /// The first tick is due one period after `start`.
    pub(super) const fn new(start: Stamp<Mono>) -> Self {
        Self { start, next: 1 }
    }

    /// When the next tick is due.
    pub(super) fn due(&self) -> Stamp<Mono> {
        let nanos = self.next.saturating_mul(NANOS_PER_S) / i64::from(TICK_RATE_HZ);
        Stamp::from_nanos(self.start.nanos().saturating_add(nanos))
    }

    /// The due tick strikes at `now`; gives the number of ticks left out after it.
    pub(super) fn strike(&mut self, now: Stamp<Mono>) -> u64 {
        self.next += 1;
        let behind = now.nanos_since(self.due()) * i64::from(TICK_RATE_HZ) / NANOS_PER_S;
        if behind < MAX_BEHIND_TICKS {
            return 0;
        }
        self.next += behind;
        u64::try_from(behind).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixty_ticks_are_one_second() {
        let start = Stamp::from_nanos(1_234_567);
        let mut ticker = Ticker::new(start);
        for _ in 0..60 {
            assert_eq!(ticker.strike(ticker.due()), 0);
        }
        // Tick 61 is due 61/60 s after the start.
        assert_eq!(ticker.due().nanos_since(start), 1_016_666_666);
    }

    #[test]
    fn small_delays_are_made_up_for_and_long_ones_left_out() {
        let mut ticker = Ticker::new(Stamp::ZERO);
        assert_eq!(ticker.strike(Stamp::from_nanos(90_000_000)), 0);
        assert_eq!(ticker.due(), Stamp::from_nanos(33_333_333));
        // Five seconds asleep: the ticks up to now are gone, the next one lies ahead.
        let now = Stamp::from_nanos(5_000_000_000);
        assert!(ticker.strike(now) > 290);
        assert!(now.nanos_since(ticker.due()) < NANOS_PER_S / 60);
    }
}
