//! Which inertial samples follow each other.
//!
//! Between two samples the vehicle can be anywhere that its motion allows, so a filter bridges
//! only a short gap. A stamp that jumps further, or back, is either nonsense of one sample or a
//! clock that was set: the samples after it tell.

use crate::time::{Mono, Stamp};

/// The longest gap that is bridged, s.
pub(super) const MAX_GAP_S: f64 = 0.1;
/// A refused clock is believed once this many samples followed each other on it,
const BELIEVED_AFTER: u32 = 5;
/// over at least this time, s.
const BELIEVED_AFTER_S: f64 = 0.1;

/// The stamps so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ImuClock {
    last: Option<Stamp<Mono>>,
    other: Option<OtherClock>,
}

/// Samples that follow each other, but not the last one that was believed.
#[derive(Debug, Clone, Copy)]
struct OtherClock {
    first: Stamp<Mono>,
    last: Stamp<Mono>,
    n_samples: u32,
}

/// What a sample's stamp is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Tick {
    /// It follows the one before.
    Next,
    /// It jumps: not to be used.
    Refused,
    /// The time has jumped for good, by this much against the last believed sample, s; below zero
    /// if backwards.
    Jumped(f64),
}

impl ImuClock {
    /// Judges the stamp of the next sample.
    pub(super) fn judge(&mut self, at: Stamp<Mono>) -> Tick {
        let follows = |last: Stamp<Mono>| {
            let gap_s = at.seconds_since(last);
            gap_s > 0.0 && gap_s <= MAX_GAP_S
        };
        let Some(last) = self.last.filter(|last| !follows(*last)) else {
            (self.last, self.other) = (Some(at), None);
            return Tick::Next;
        };
        let other = match self.other {
            Some(other) if follows(other.last) => {
                OtherClock { last: at, n_samples: other.n_samples + 1, ..other }
            }
            _ => OtherClock { first: at, last: at, n_samples: 1 },
        };
        let is_believed = other.n_samples >= BELIEVED_AFTER
            && other.last.seconds_since(other.first) >= BELIEVED_AFTER_S;
        if is_believed {
            (self.last, self.other) = (Some(at), None);
            Tick::Jumped(at.seconds_since(last))
        } else {
            self.other = Some(other);
            Tick::Refused
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_ms(ms: i64) -> Stamp<Mono> {
        Stamp::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn one_wild_stamp_is_refused_and_the_stream_goes_on() {
        let mut clock = ImuClock::default();
        for ms in [0, 5, 10, 105, 110] {
            assert_eq!(clock.judge(at_ms(ms)), Tick::Next, "{ms}");
        }
        for ms in [110, 100, 5_000, -3] {
            assert_eq!(clock.judge(at_ms(ms)), Tick::Refused, "{ms}");
        }
        assert_eq!(clock.judge(at_ms(115)), Tick::Next);
    }

    #[test]
    fn a_clock_that_stays_away_is_believed_after_a_tenth_of_a_second() {
        for jump_ms in [400, -400] {
            let mut clock = ImuClock::default();
            assert_eq!(clock.judge(at_ms(1_000)), Tick::Next);
            let ticks: Vec<_> =
                (0..=20).map(|k| clock.judge(at_ms(1_000 + jump_ms + 5 * k))).collect();
            assert!(ticks[..20].iter().all(|tick| *tick == Tick::Refused));
            let Tick::Jumped(by_s) = ticks[20] else { unreachable!("{:?}", ticks[20]) };
            #[expect(clippy::cast_precision_loss, reason = "small")]
            let expected_s = (jump_ms + 100) as f64 * 1e-3;
            assert!((by_s - expected_s).abs() < 1e-9);
            assert_eq!(clock.judge(at_ms(1_000 + jump_ms + 105)), Tick::Next);
        }
    }
}
