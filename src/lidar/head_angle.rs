//! How many samples lie between two packets, judged by the head's angle.

/// An advance of the head this much beyond the usual one is a loss: healthy streams stay within
/// 1.02, and a head that changes its speed within 1.2.
const LOSS_RATIO: f64 = 1.5;
/// Share of the newest step in the usual one.
const LEARNING: f64 = 0.05;
/// So many losses in a row are none but a new speed of the head.
const LOSSES_IN_A_ROW: u32 = 3;
/// No sensor measures more densely, °.
const LEAST_STEP_DEG: f64 = 0.02;
/// A larger advance is a step back: jitter of the encoder, °.
const LARGEST_ADVANCE_DEG: f64 = 350.0;

/// Follows the head from packet to packet, for sensors that do not tell their own time.
///
/// Whole turns that are lost show no gap in the angle, so they go unseen here; arrivals do not
/// show them either, because a reader that stalls finds what waited in the kernel's queue.
#[derive(Debug, Clone, Default)]
pub(super) struct HeadAngle {
    previous: Option<(f64, u32)>,
    /// Angle per sample, °.
    step_deg: Option<f64>,
    losses_in_a_row: u32,
}

impl HeadAngle {
    /// Forgets the head's place, as after a pause; its speed is kept.
    pub(super) const fn forget(&mut self) {
        self.previous = None;
    }

    /// Samples lost before a packet of `n_samples` whose head begins at `start_deg`.
    ///
    /// ```text
    /// n = Δα / s − N
    /// ```
    /// - `Δα`: angle from the beginning of the packet before, °, in [0, 360)
    /// - `s`: usual angle of one sample, °; `N`: samples of the packet before
    pub(super) fn n_lost(&mut self, start_deg: f64, n_samples: u32) -> u32 {
        let Some((previous_deg, n_before)) = self.previous.replace((start_deg, n_samples)) else {
            return 0;
        };
        let advance_deg = (start_deg - previous_deg).rem_euclid(360.0);
        if advance_deg > LARGEST_ADVANCE_DEG {
            return 0;
        }
        let n_before = f64::from(n_before.max(1));
        let newest_deg = (advance_deg / n_before).max(LEAST_STEP_DEG);
        let step_deg = *self.step_deg.get_or_insert(newest_deg);
        let n_steps = advance_deg / step_deg;
        if n_steps < LOSS_RATIO * n_before || n_steps < n_before + 2.0 {
            self.step_deg = Some(step_deg + LEARNING * (newest_deg - step_deg));
            self.losses_in_a_row = 0;
            return 0;
        }
        self.losses_in_a_row += 1;
        if self.losses_in_a_row >= LOSSES_IN_A_ROW {
            (self.step_deg, self.losses_in_a_row) = (Some(newest_deg), 0);
            return 0;
        }
        whole(n_steps - n_before)
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

    /// Packets of 40 samples of 0.36°, 25 to a turn; those of `lost` never come.
    fn lost_of(n_packets: u32, lost: std::ops::Range<u32>) -> u32 {
        let mut head = HeadAngle::default();
        let packets = (0..n_packets).filter(|k| !lost.contains(k));
        packets
            .map(|k| head.n_lost((f64::from(k) * 40.0 * 0.36 + 100.0).rem_euclid(360.0), 40))
            .sum()
    }

    #[test]
    fn nothing_is_lost_on_a_whole_stream_and_losses_within_a_turn_are_counted() {
        assert_eq!(lost_of(200, 0..0), 0);
        for n in [1, 3, 22] {
            assert_eq!(lost_of(200, 50..50 + n), n * 40, "{n} packets");
        }
        // One turn and one packet look like one packet.
        assert_eq!(lost_of(200, 50..76), 40);
    }

    #[test]
    fn a_head_that_starts_slowly_loses_nothing() {
        let mut head = HeadAngle::default();
        let mut angle_deg = 0.0_f64;
        let mut n_lost = 0;
        for k in 0..2000_u32 {
            let speed = 1.0 - (-f64::from(k) / 300.0).exp();
            angle_deg = (angle_deg + 14.4 * speed).rem_euclid(360.0);
            n_lost += head.n_lost(angle_deg, 40);
        }
        // The head begins at rest, so its very first steps are taken for losses of some packets.
        assert!(n_lost < 2000, "{n_lost}");
        let settled: u32 = (0..500_u32)
            .map(|k| head.n_lost((angle_deg + 14.4 * f64::from(k + 1)).rem_euclid(360.0), 40))
            .sum();
        assert_eq!(settled, 0);
    }
}
