//! Beams without an echo, which passed over ground as well.
//!
//! ```text
//!   LiDAR ●──────┐ reach
//!         ╲ ╲ no echo
//!          ╲   ╲________________   the ground here is below the lowest silent ray,
//!     ______╲        ?             or it would have answered
//!       seen
//! ```
//! Ground behind a crest or far away is often seen by no ray that ends on something behind it. What lies high there would
//! have answered; so what stays silent is low, and a field that does not know that takes it to be too high: by 0.1 to 0.8 m
//! in the far corners of the simulated alps.
//!
//! Silence can have other causes, so it counts only
//! - up to the [`Reach`] that this material has shown in this flight,
//! - where neighbouring beams are silent too: single ones get lost everywhere,
//! - where the ray ends above the floor: one that would have met the floor within reach is lost, not free.
//!
//! A dark spot far away that never answers, amid ground that does, is taken for lower than it is, by at most what silent
//! rays pass below it. Checked: `reach_is_what_one_echo_in_two_thousand_exceeds`, `only_runs_of_silent_beams_count`,
//! and `silent_beams_pass_over_what_lies_low` of the mapper.

use crate::messages::{Beam, Scan};

/// How far away material has answered.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reach {
    /// Echoes of material by range, in steps of [`STEP_M`].
    n_echoes: Vec<u64>,
    n_all: u64,
}

/// Steps in which ranges are counted, m.
const STEP_M: f64 = 0.1;
/// Beyond the reach comes one echo of so many.
const ECHOES_WITHIN: u64 = 2000;
/// A beam counts as silent if it stands in the middle of so many silent ones.
const RUN: usize = 5;

impl Reach {
    /// Takes in an echo of material from this range, m.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "ranges that are trusted are some metres"
    )]
    pub fn take(&mut self, range_m: f64) {
        let step = (range_m / STEP_M) as usize;
        if self.n_echoes.len() <= step {
            self.n_echoes.resize(step + 1, 0);
        }
        self.n_echoes[step] += 1;
        self.n_all += 1;
    }

    /// The range beyond which came one echo in two thousand, m; `None` before there are that many.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "some hundred steps")]
    pub fn range_m(&self) -> Option<f64> {
        let mut n_beyond = self.n_all / ECHOES_WITHIN;
        if n_beyond == 0 {
            return None;
        }
        for (step, n_echoes) in self.n_echoes.iter().enumerate().rev() {
            let Some(left) = n_beyond.checked_sub(*n_echoes) else {
                return Some(step as f64 * STEP_M);
            };
            n_beyond = left;
        }
        None
    }

    /// No echo yet.
    pub fn restart(&mut self) {
        *self = Self::default();
    }
}

/// The beams in the middle of silent ones, in their order.
pub fn silent_beams(scan: &Scan) -> impl Iterator<Item = &Beam> {
    let is_silent = |beam: &Beam| beam.range_m <= 0.0;
    let runs = scan.beams.windows(RUN);
    runs.filter(move |run| run.iter().all(is_silent)).map(|run| &run[RUN / 2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Stamp;

    #[test]
    fn reach_is_what_one_echo_in_two_thousand_exceeds() {
        let mut reach = Reach::default();
        (0..1999).for_each(|_| reach.take(3.04));
        assert_eq!(reach.range_m(), None);
        reach.take(9.97);
        // One of two thousand may be a stray one.
        assert!((reach.range_m().expect("a reach") - 3.0).abs() < 1e-9);
        reach.take(9.93);
        assert!((reach.range_m().expect("a reach") - 9.9).abs() < 1e-9);
        reach.restart();
        assert_eq!(reach.range_m(), None);
    }

    #[test]
    fn only_runs_of_silent_beams_count() {
        let silent = [2, 5, 6, 7, 8, 9, 10, 13, 14, 15, 16];
        let beam = |k: u16| Beam {
            offset_ns: u32::from(k),
            angle_rad: 0.01 * f32::from(k),
            range_m: if silent.contains(&k) { 0.0 } else { 4.0 },
            intensity: 9,
        };
        let scan = |beams: std::ops::Range<u16>| Scan {
            start: Stamp::ZERO,
            beams: beams.map(beam).collect(),
        };
        let found =
            |scan: &Scan| -> Vec<u32> { silent_beams(scan).map(|beam| beam.offset_ns).collect() };
        assert_eq!(found(&scan(0..18)), [7, 8]);
        assert!(found(&scan(6..10)).is_empty(), "a part of a turn with fewer than a run");
    }
}
