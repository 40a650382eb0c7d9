//! How many samples lie between two packets, judged by the head's angle and by the bytes between.

/// An advance of the head this much beyond the usual one is a loss: healthy streams stay within
/// 1.02, and a head that changes its speed within 1.2.
const LOSS_RATIO: f64 = 1.5;
/// Share of the newest step in the usual one.
const LEARNING: f64 = 0.05;
/// So many too long steps between packets without a byte between them are a new speed of the head.
const NEW_STEPS: u32 = 3;
/// Those steps agree if they differ by no more than this ratio.
const AGREEMENT_RATIO: f64 = 1.2;
/// No sensor measures more densely, °.
const LEAST_STEP_DEG: f64 = 0.02;
/// A larger advance is a step back: jitter of the encoder, °.
const LARGEST_ADVANCE_DEG: f64 = 350.0;

/// Where a packet stands: in the head's turn and in the stream of bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Angle of the head where the packet begins, °, in [0, 360).
    pub(super) start_deg: f64,
    /// Samples of the packet.
    pub(super) n_samples: u32,
    /// Bytes of the stream before the packet.
    pub(super) at_byte: u64,
    /// Bytes of the packet alone.
    pub(super) n_bytes: u64,
    /// A checksum guards the angle.
    pub(super) is_guarded: bool,
}

/// Follows the head from packet to packet, for sensors that do not tell their own time.
///
/// Damaged packets leave their bytes behind, so those are counted to the byte. Bytes that never came,
/// such as those that the kernel had no room for, show in the angle only, and there whole turns do
/// not show: the clock finds those by the arrivals.
#[derive(Debug, Clone, Default)]
pub(super) struct HeadAngle {
    previous: Option<Place>,
    /// Usual angle per sample, °.
    step_deg: Option<f64>,
    /// The newest of the too long steps without a byte between, °, and how many agree with it.
    new_step: Option<(f64, u32)>,
    /// Bytes of a sample in the fullest packet so far.
    sample_bytes: Option<f64>,
}

impl HeadAngle {
    /// Forgets the head's place, as after a pause; its speed is kept.
    pub(super) const fn forget(&mut self) {
        self.previous = None;
    }

    /// Samples lost before a packet at this place.
    ///
    /// ```text
    /// n = max( Δα / s − N,  Δb / b )
    /// ```
    /// - `Δα`: angle from the beginning of the packet before, °, in [0, 360)
    /// - `s`: usual angle of one sample, °; `N`: samples of the packet before
    /// - `Δb`: bytes between the packets; `b`: bytes of a sample
    ///
    /// The greater, because a count that is too small moves stamps back for long, and one that is
    /// too great does nothing but allow for a late arrival.
    pub(super) fn n_lost(&mut self, place: Place) -> u32 {
        #[expect(clippy::cast_precision_loss, reason = "a packet has less than 2^10 bytes")]
        let own_bytes = place.n_bytes as f64 / f64::from(place.n_samples.max(1));
        let sample_bytes = self.sample_bytes.map_or(own_bytes, |least| least.min(own_bytes));
        self.sample_bytes = Some(sample_bytes);
        let Some(before) = self.previous.replace(place) else { return 0 };
        let n_between = place.at_byte.saturating_sub(before.at_byte + before.n_bytes);
        #[expect(clippy::cast_precision_loss, reason = "less than 2^32 bytes")]
        let n_damaged = n_between as f64 / sample_bytes;
        let advance_deg = (place.start_deg - before.start_deg).rem_euclid(360.0);
        if advance_deg > LARGEST_ADVANCE_DEG {
            return whole(n_damaged);
        }
        let n_before = f64::from(before.n_samples.max(1));
        let n_beyond = self.n_beyond(advance_deg, n_before, n_between == 0);
        // A wrong bit in an angle without a checksum is likelier than a loss of whole packets.
        let is_trusted = n_between > 0 || place.is_guarded;
        whole(n_damaged.max(if is_trusted { n_beyond } else { 0.0 }))
    }

    /// Samples by which the head has gone further than the `n_before` of the packet before.
    fn n_beyond(&mut self, advance_deg: f64, n_before: f64, is_adjoining: bool) -> f64 {
        let newest_deg = (advance_deg / n_before).max(LEAST_STEP_DEG);
        let Some(step_deg) = self.step_deg else {
            self.step_deg = is_adjoining.then_some(newest_deg);
            return 0.0;
        };
        let n_steps = advance_deg / step_deg;
        let is_usual = n_steps < LOSS_RATIO * n_before || n_steps < n_before + 2.0;
        if is_usual && is_adjoining {
            self.step_deg = Some(step_deg + LEARNING * (newest_deg - step_deg));
            self.new_step = None;
        }
        if is_usual || (is_adjoining && self.is_new_speed(newest_deg)) {
            return 0.0;
        }
        n_steps - n_before
    }

    /// True if this step and those before it are a new speed; it is the usual one then.
    ///
    /// Steps over damaged bytes say nothing: scattered losses are too long as well, and one taken for
    /// a speed would hide those that follow.
    fn is_new_speed(&mut self, newest_deg: f64) -> bool {
        let agrees = |(before_deg, _): &(f64, u32)| {
            newest_deg < AGREEMENT_RATIO * before_deg && *before_deg < AGREEMENT_RATIO * newest_deg
        };
        let n_before = self.new_step.filter(agrees).map_or(0, |(_, n)| n);
        self.new_step = Some((newest_deg, n_before + 1));
        let is_new = n_before + 1 >= NEW_STEPS;
        if is_new {
            (self.step_deg, self.new_step) = (Some(newest_deg), None);
        }
        is_new
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a turn holds less than 2^17 samples"
)]
fn whole(n: f64) -> u32 {
    n.round().max(0.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packet number `k` of 40 samples and 90 bytes, `step_deg` further on each, with so many bytes
    /// missing before it.
    fn place(k: u32, step_deg: f64, n_missing: u32) -> Place {
        let start_deg = (f64::from(k) * 40.0 * step_deg + 100.0).rem_euclid(360.0);
        let at_byte = u64::from(k * 90 - n_missing);
        Place { start_deg, n_samples: 40, at_byte, n_bytes: 90, is_guarded: true }
    }

    /// Packets of 40 samples of 0.36°, 25 to a turn; those of `lost` never come.
    fn lost_of(n_packets: u32, lost: std::ops::Range<u32>, are_damaged: bool) -> u32 {
        let mut head = HeadAngle::default();
        let packets = (0..n_packets).filter(|k| !lost.contains(k));
        let n_bytes = if are_damaged { 0 } else { 90 * lost.len().try_into().unwrap_or(0) };
        let missing = |k: u32| if k >= lost.end { n_bytes } else { 0 };
        packets.map(|k| head.n_lost(place(k, 0.36, missing(k)))).sum()
    }

    #[test]
    fn nothing_is_lost_on_a_whole_stream_and_losses_within_a_turn_are_counted() {
        assert_eq!(lost_of(200, 0..0, false), 0);
        for n in [1, 3, 22] {
            assert_eq!(lost_of(200, 50..50 + n, false), n * 40, "{n} packets");
            assert_eq!(lost_of(200, 50..50 + n, true), n * 40, "{n} packets");
        }
        // One turn and one packet look like one packet, unless their bytes are there.
        assert_eq!(lost_of(200, 50..76, false), 40);
        assert_eq!(lost_of(200, 50..76, true), 26 * 40);
    }

    #[test]
    fn scattered_losses_in_a_row_are_no_new_speed() {
        // Every second packet is damaged for a while, then one in ten.
        let is_damaged = |k: u32| if (50..90).contains(&k) { k % 2 == 1 } else { k % 10 == 5 };
        let mut head = HeadAngle::default();
        let kept = (0..400).filter(|k| !is_damaged(*k));
        let n_lost: u32 = kept.map(|k| head.n_lost(place(k, 0.36, 0))).sum();
        let n_damaged = (0..400).filter(|k| is_damaged(*k)).count();
        assert_eq!(n_lost as usize, n_damaged * 40);
    }

    #[test]
    fn an_angle_without_a_checksum_is_no_loss_while_bytes_are_whole() {
        let mut head = HeadAngle::default();
        let wrong = |k: u32| if k % 10 == 5 { 16.0 } else { 0.0 };
        let n_lost = |k: u32| {
            let place = Place { is_guarded: false, ..place(k, 0.36, 0) };
            head.n_lost(Place {
                start_deg: (place.start_deg + wrong(k)).rem_euclid(360.0),
                ..place
            })
        };
        assert_eq!((0..100).map(n_lost).sum::<u32>(), 0);
        // Three packets whose bytes are there.
        let place = Place { is_guarded: false, ..place(103, 0.36, 0) };
        assert_eq!(head.n_lost(place), 120);
    }

    #[test]
    fn three_long_steps_without_a_byte_between_are_a_new_speed() {
        let mut head = HeadAngle::default();
        (0..50).for_each(|k| assert_eq!(head.n_lost(place(k, 0.3, 0)), 0));
        let n_lost: Vec<u32> = (50..60).map(|k| head.n_lost(place(k, 0.6, 0))).collect();
        // The first step here is the jump of the angle itself.
        assert!(n_lost[4..].iter().all(|n| *n == 0), "{n_lost:?}");
    }

    #[test]
    fn a_head_that_starts_slowly_loses_nothing() {
        let mut head = HeadAngle::default();
        let mut angle_deg = 0.0_f64;
        let mut n_lost = 0;
        for k in 0..2000_u32 {
            let speed = 1.0 - (-f64::from(k) / 300.0).exp();
            angle_deg = (angle_deg + 14.4 * speed).rem_euclid(360.0);
            n_lost += head.n_lost(Place { start_deg: angle_deg, ..place(k, 0.36, 0) });
        }
        // The head begins at rest, so its very first steps are taken for losses of some packets.
        assert!(n_lost < 2000, "{n_lost}");
        let settled: u32 = (0..500_u32)
            .map(|k| {
                let start_deg = (angle_deg + 14.4 * f64::from(k + 1)).rem_euclid(360.0);
                head.n_lost(Place { start_deg, ..place(2000 + k, 0.36, 0) })
            })
            .sum();
        assert_eq!(settled, 0);
    }
}
