//! How much one sender may say.
//!
//! Each sender has a bucket of tokens that fills at a steady rate; a message takes one. So a burst
//! passes, a flood does not, and nobody's flood costs another his turn.

use crate::link::AUTOPILOT_COMPONENT;
use crate::time::{Mono, Stamp};
use std::collections::BTreeMap;

/// Twice what an autopilot sends with all streams at their fastest.
const AUTOPILOT_HZ: f64 = 2_000.0;
/// A ground station that loads parameters or a mission sends some tens.
const OTHERS_HZ: f64 = 200.0;
/// Seconds of its rate that a sender may send at once.
const BURST_S: f64 = 1.0;
/// Senders with a bucket of their own; all further ones share one.
const MAX_SENDERS: usize = 32;
/// Stands for those without a bucket of their own; MAVLink has no system 0.
const THE_REST: (u32, u8) = (0, 0);
/// Autopilots beyond those with a bucket of their own share one too, as wide as one needs.
const OTHER_AUTOPILOTS: (u32, u8) = (0, AUTOPILOT_COMPONENT);

/// The buckets.
#[derive(Debug, Default)]
pub(super) struct FloodLimit {
    buckets: BTreeMap<(u32, u8), Bucket>,
}

#[derive(Debug, Clone, Copy)]
struct Bucket {
    tokens: f64,
    filled_at: Stamp<Mono>,
}

impl FloodLimit {
    /// True if the message counts as heard.
    pub(super) fn takes(&mut self, system: u32, component: u8, now: Stamp<Mono>) -> bool {
        let mut sender = (system, component);
        if !self.buckets.contains_key(&sender) && self.buckets.len() >= MAX_SENDERS {
            self.forget_the_quiet(now);
        }
        if !self.buckets.contains_key(&sender) && self.buckets.len() >= MAX_SENDERS {
            let is_autopilot = component == AUTOPILOT_COMPONENT;
            sender = if is_autopilot { OTHER_AUTOPILOTS } else { THE_REST };
        }
        let rate_hz = if sender.1 == AUTOPILOT_COMPONENT { AUTOPILOT_HZ } else { OTHERS_HZ };
        let full = rate_hz * BURST_S;
        let bucket = self.buckets.entry(sender).or_insert(Bucket { tokens: full, filled_at: now });
        let elapsed_s = now.seconds_since(bucket.filled_at).max(0.0);
        bucket.tokens = (bucket.tokens + rate_hz * elapsed_s).min(full);
        bucket.filled_at = bucket.filled_at.max(now);
        let is_taken = bucket.tokens >= 1.0;
        if is_taken {
            bucket.tokens -= 1.0;
        }
        is_taken
    }

    /// Who has been silent until his bucket was full again is as good as new: names that came once do
    /// not keep the room of those that speak.
    fn forget_the_quiet(&mut self, now: Stamp<Mono>) {
        self.buckets.retain(|_, bucket| now.seconds_since(bucket.filled_at) < BURST_S);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_cut_and_takes_nothing_from_others() {
        let mut limit = FloodLimit::default();
        let (mut from_autopilot, mut from_station, mut from_flood) = (0, 0, 0);
        // Ten seconds: 10,000 messages a second of one sender, 400 of the autopilot, 5 of a person.
        for k in 0..100_000_i64 {
            let now = Stamp::from_nanos(k * 100_000);
            from_flood += i64::from(limit.takes(66, 66, now));
            if k % 25 == 0 {
                from_autopilot += i64::from(limit.takes(1, 1, now));
            }
            if k % 2_000 == 0 {
                from_station += i64::from(limit.takes(255, 190, now));
            }
        }
        assert_eq!((from_autopilot, from_station), (4_000, 50));
        // A second's worth at once, then the rate: 200 + 10 × 200.
        assert!((2_190..=2_201).contains(&from_flood), "{from_flood}");
    }

    #[test]
    fn many_names_share_one_bucket_and_no_memory() {
        let mut limit = FloodLimit::default();
        let mut taken = 0;
        for system in 1..=10_000 {
            taken += u32::from(limit.takes(system, 9, Stamp::ZERO));
        }
        // The first ones have a bucket each; the rest share 200 tokens.
        assert!(taken < 250, "{taken}");
        assert!(limit.buckets.len() <= MAX_SENDERS + 2);
    }

    #[test]
    fn names_that_spoke_once_do_not_lock_the_autopilot_out() {
        let mut limit = FloodLimit::default();
        for system in 100..140 {
            limit.takes(system, AUTOPILOT_COMPONENT, Stamp::ZERO);
        }
        // All its streams from the very instant on, while the strangers go on twice a second.
        let mut n_refused = 0;
        for k in 0..40_000_u32 {
            let now = Stamp::from_nanos(i64::from(k) * 1_000_000);
            n_refused += u32::from(!limit.takes(1, AUTOPILOT_COMPONENT, now));
            if k % 500 == 0 {
                (100..140).for_each(|system| {
                    limit.takes(system, AUTOPILOT_COMPONENT, now);
                });
            }
        }
        assert_eq!(n_refused, 0);
        assert!(limit.buckets.len() <= MAX_SENDERS + 2);
    }

    #[test]
    fn a_clock_that_stands_or_runs_back_fills_nothing() {
        let mut limit = FloodLimit::default();
        let now = Stamp::from_nanos(5_000_000_000);
        let taken = (0..1_000).filter(|_| limit.takes(7, 7, now)).count();
        assert_eq!(taken, 200);
        assert!(!limit.takes(7, 7, Stamp::ZERO));
        assert!(!limit.takes(7, 7, now));
    }
}
