//! How far away ground answers the LiDAR, learned where the ground is known.
//!
//! A data sheet's range holds for white surfaces, square on. What counts is from how far *this* material
//! answers: wet or dark ground, slopes that beams graze. The reach ends
//! - where more than three of a hundred beams that met ground were lost among silent neighbours (if each were
//!   lost by itself, that would be half of them),
//! - or at the range beyond which only one echo in two thousand came from, whichever is nearer.

/// Echoes and lost beams by their range.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reach {
    /// In steps of [`STEP_M`].
    steps: Vec<Answers>,
    n_echoes: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Answers {
    n_echoes: f64,
    n_lost: f64,
}

/// Steps in which ranges are counted, m.
const STEP_M: f64 = 0.1;
/// Losses are judged over so many steps together: half a metre.
const STEPS_TOGETHER: usize = 5;
/// Beyond the reach comes one echo of so many: a stray one says nothing.
const ECHOES_WITHIN: f64 = 2000.0;
/// Most beams that may get lost within the reach. A ceiling is the lowest of many rays, so a few wrong
/// ones among them are too many; with a third of it surveys of fading ground come out higher.
const MOST_LOST: f64 = 0.03;
/// So many may be lost beside, where there are few echoes to compare with.
const LEAST_LOST: f64 = 20.0;

impl Reach {
    /// Takes in so many echoes of ground from this range, m.
    pub fn take_echoes(&mut self, range_m: f64, n: f64) {
        self.step_mut(range_m).n_echoes += n;
        self.n_echoes += n;
    }

    /// Takes in so many beams without an echo that must have met ground at this range, m.
    pub fn take_lost(&mut self, range_m: f64, n: f64) {
        self.step_mut(range_m).n_lost += n;
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "ranges that are trusted are some metres"
    )]
    fn step_mut(&mut self, range_m: f64) -> &mut Answers {
        let step = (range_m / STEP_M) as usize;
        if self.steps.len() <= step {
            self.steps.resize(step + 1, Answers::default());
        }
        &mut self.steps[step]
    }

    /// The range up to which ground answers, m; `None` before there are enough echoes.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "some hundred steps")]
    pub fn range_m(&self) -> Option<f64> {
        let farthest = self.farthest_step()?;
        let is_lossy = |steps: &[Answers]| {
            let n_lost: f64 = steps.iter().map(|step| step.n_lost).sum();
            let n_echoes: f64 = steps.iter().map(|step| step.n_echoes).sum();
            n_lost > LEAST_LOST + MOST_LOST * (n_lost + n_echoes)
        };
        let first_lossy = self.steps.chunks(STEPS_TOGETHER).position(is_lossy);
        let step = first_lossy.map_or(farthest, |chunk| farthest.min(chunk * STEPS_TOGETHER));
        Some(step as f64 * STEP_M)
    }

    /// Of the one echo in two thousand.
    fn farthest_step(&self) -> Option<usize> {
        let mut n_beyond = (self.n_echoes / ECHOES_WITHIN).floor();
        if n_beyond < 1.0 {
            return None;
        }
        self.steps.iter().rposition(|step| {
            n_beyond -= step.n_echoes;
            n_beyond < 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_is_what_one_echo_in_two_thousand_exceeds() {
        let mut reach = Reach::default();
        reach.take_echoes(3.04, 1999.0);
        assert_eq!(reach.range_m(), None);
        reach.take_echoes(9.97, 1.0);
        // One of two thousand may be a stray one.
        assert!((reach.range_m().expect("a reach") - 3.0).abs() < 1e-9);
        reach.take_echoes(9.93, 1.0);
        assert!((reach.range_m().expect("a reach") - 9.9).abs() < 1e-9);
    }

    #[test]
    fn reach_ends_where_three_beams_of_a_hundred_are_lost() {
        let mut reach = Reach::default();
        (0..100).for_each(|k| reach.take_echoes(0.1 * f64::from(k) + 0.05, 97.0));
        assert!((reach.range_m().expect("a reach") - 9.9).abs() < 1e-9);
        // Five steps together have 485 echoes: three of a hundred are 15.6 with 35 lost, and 20 may be.
        reach.take_lost(6.31, 35.0);
        assert!((reach.range_m().expect("a reach") - 9.9).abs() < 1e-9);
        reach.take_lost(6.44, 2.0);
        assert!((reach.range_m().expect("a reach") - 6.0).abs() < 1e-9);
        // Beyond all echoes nothing answers anyway.
        reach.take_lost(11.0, 100.0);
        assert!((reach.range_m().expect("a reach") - 6.0).abs() < 1e-9);
    }
}
