//! The clock of the companion, by the shortest way that its messages have taken.

use std::time::Duration;
use stockpilot::time::{Boot, Stamp};

/// A way longer than the shortest by more than this belongs to another clock.
const LARGEST_LAG: Duration = Duration::from_millis(500);
/// The shortest way is forgotten at this pace, ns per message.
const LEAK_NS: i64 = 1_000;

/// `ArduPilot`'s correction of jitter: no exchange of clocks, only the smallest lag seen.
#[derive(Debug, Clone, Default)]
pub(super) struct JitterCorrection {
    /// Own clock minus the companion's, with the shortest way in it, ns.
    offset_ns: Option<i64>,
}

impl JitterCorrection {
    /// When something stamped `remote_us` was measured, on the own clock.
    pub(super) fn stamp(&mut self, now: Stamp<Boot>, remote_us: u64) -> Stamp<Boot> {
        let remote_ns = i64::try_from(remote_us).unwrap_or(i64::MAX / 2).saturating_mul(1_000);
        let seen_ns = now.nanos().saturating_sub(remote_ns);
        let bound_ns = i64::try_from(LARGEST_LAG.as_nanos()).unwrap_or(i64::MAX);
        let offset_ns = match self.offset_ns {
            Some(offset_ns) if seen_ns.abs_diff(offset_ns) < bound_ns.unsigned_abs() => {
                seen_ns.min(offset_ns + LEAK_NS)
            }
            _ => seen_ns,
        };
        self.offset_ns = Some(offset_ns);
        Stamp::from_nanos(remote_ns.saturating_add(offset_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_way_counts() {
        let mut correction = JitterCorrection::default();
        // Measured at 1.000 s of a clock that is 7 s behind, arrived 20 ms later, then after 3 ms.
        let first = correction.stamp(Stamp::from_nanos(8_020_000_000), 1_000_000);
        assert_eq!(first, Stamp::from_nanos(8_020_000_000));
        let second = correction.stamp(Stamp::from_nanos(8_103_000_000), 1_100_000);
        assert_eq!(second, Stamp::from_nanos(8_103_000_000));
        let third = correction.stamp(Stamp::from_nanos(8_230_000_000), 1_200_000);
        // 3 ms of way remain, and the leak.
        assert_eq!(third, Stamp::from_nanos(8_203_001_000));
    }
}
