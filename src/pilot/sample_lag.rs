//! Whether the autopilot's samples come while they still say where the vehicle is.
//!
//! The belief ends with the newest inertial sample. On a line that is too slow this lies further
//! and further back, and whoever steers by it steers a vehicle that has long been elsewhere.

use crate::time::{Mono, Stamp};
use std::time::Duration;

/// At 2 m/s a vehicle goes 0.3 m meanwhile.
const LATE_AFTER: Duration = Duration::from_millis(150);
/// One hiccup of a computer is no slow line.
const LATE_FOR: Duration = Duration::from_millis(250);

/// How the samples have kept up so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SampleLag {
    newest: Option<Stamp<Mono>>,
    on_time_at: Option<Stamp<Mono>>,
    is_late: bool,
}

impl SampleLag {
    /// Looks at the newest sample's stamp, once per tick. Says how old it is when the samples have
    /// just become late.
    ///
    /// Only a sample that arrives can be late: without any, other rules know that the place is lost.
    pub(super) fn look(
        &mut self,
        now: Stamp<Mono>,
        newest: Option<Stamp<Mono>>,
    ) -> Option<Duration> {
        let has_arrived = newest != self.newest;
        self.newest = newest;
        let age = now.since(newest?);
        if age <= LATE_AFTER {
            self.on_time_at = Some(now);
            self.is_late = false;
            return None;
        }
        // Those that were never on time are late from the first one on.
        let on_time_at = *self.on_time_at.get_or_insert(now);
        let is_lasting = now.since(on_time_at) > LATE_FOR;
        let becomes_late = has_arrived && is_lasting && !self.is_late;
        self.is_late |= becomes_late;
        becomes_late.then_some(age)
    }

    /// True while nothing may be flown by them.
    pub(super) const fn is_late(&self) -> bool {
        self.is_late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// When the lag is told, ms, for samples of these ages, one per tick of 20 ms.
    fn told_at(age_ms: impl Fn(u64) -> u64) -> (Vec<u64>, bool) {
        let mut lag = SampleLag::default();
        let at = |ms: u64| Stamp::ZERO.plus(Duration::from_millis(ms));
        let told = (1_000..3_000)
            .step_by(20)
            .filter(|ms| lag.look(at(*ms), Some(at(*ms - age_ms(*ms)))).is_some())
            .collect();
        (told, lag.is_late())
    }

    #[test]
    fn lasting_lateness_is_told_once_and_ends_with_the_first_sample_in_time() {
        assert_eq!(told_at(|_| 100), (Vec::new(), false));
        let slow_from = |ms: u64| if ms < 1_500 { 20 } else { 180 };
        assert_eq!(told_at(slow_from), (vec![1_740], true));
        let for_a_while = |ms: u64| if (1_500..2_500).contains(&ms) { 180 } else { 20 };
        assert_eq!(told_at(for_a_while), (vec![1_740], false));
        assert_eq!(told_at(|_| 180), (vec![1_260], true));
    }

    #[test]
    fn bridged_gaps_hiccups_and_silence_are_no_lateness() {
        assert_eq!(told_at(|ms| ms % 100), (Vec::new(), false));
        let silent_from = |ms: u64| if ms < 1_500 { 20 } else { ms - 1_480 };
        assert_eq!(told_at(silent_from), (Vec::new(), false));
        let hiccup = |ms: u64| if (1_500..1_700).contains(&ms) { ms - 1_480 } else { 20 };
        assert_eq!(told_at(hiccup), (Vec::new(), false));
    }
}
