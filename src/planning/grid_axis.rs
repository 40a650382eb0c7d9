//! Evenly spaced values along one coordinate.

use std::f64::consts::TAU;

/// Values `first + k step`, k from 0 to before n.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// The first value.
    pub first: f64,
    /// Distance of neighbours.
    pub step: f64,
    /// How many there are, at least 1.
    pub n: usize,
}

/// Where a value lies between two nodes of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    low: usize,
    high: usize,
    /// 0 at the lower node, 1 at the upper one.
    of_high: f64,
}

impl Share {
    /// The node on one side and its weight.
    #[must_use]
    pub fn side(&self, is_high: bool) -> (usize, f64) {
        if is_high { (self.high, self.of_high) } else { (self.low, 1.0 - self.of_high) }
    }
}

/// A value this close to a node is the node, in steps.
const ROUNDING: f64 = 1e-9;

impl Axis {
    /// Nodes at `anchor + k step` for whole k, as many as lie in `low` to `high`; the anchor is
    /// always one.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a float cast to an integer saturates, and settings bound the numbers"
    )]
    pub fn through(anchor: f64, step: f64, (low, high): (f64, f64)) -> Self {
        let before = ((anchor - low) / step + ROUNDING).floor().max(0.0);
        let after = ((high - anchor) / step + ROUNDING).floor().max(0.0);
        Self { first: anchor - before * step, step, n: (before + after) as usize + 1 }
    }

    /// `n` headings evenly around from 0, rad.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "few headings")]
    pub fn turn(n: usize) -> Self {
        Self { first: 0.0, step: TAU / n.max(1) as f64, n: n.max(1) }
    }

    /// The value at a node.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "node counts stay far below 2^53")]
    pub fn at(&self, node: usize) -> f64 {
        self.first + node as f64 * self.step
    }

    /// The last value.
    #[must_use]
    pub fn last(&self) -> f64 {
        self.at(self.n - 1)
    }

    /// The node nearest to a value.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "clamped to the axis before the cast"
    )]
    pub fn nearest(&self, value: f64) -> usize {
        ((value - self.first) / self.step).round().clamp(0.0, (self.n - 1) as f64) as usize
    }

    /// Between which nodes a value lies; up to one step beyond the outermost, it lies on them.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "node counts stay far below 2^53")]
    pub fn locate(&self, value: f64) -> Option<Share> {
        let steps = (value - self.first) / self.step;
        let last = (self.n - 1) as f64;
        if !(-1.0 - ROUNDING..=last + 1.0 + ROUNDING).contains(&steps) {
            return None;
        }
        Some(share(steps.clamp(0.0, last), |node| node.min(self.n - 1)))
    }

    /// Between which headings one lies, counting around.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "few headings")]
    pub fn locate_around(&self, angle_rad: f64) -> Share {
        let steps = (angle_rad / self.step).rem_euclid(self.n as f64);
        share(steps, |node| node % self.n)
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the caller keeps the number in the axis"
)]
fn share(steps: f64, bounded: impl Fn(usize) -> usize) -> Share {
    let nearest = steps.round();
    let steps = if (steps - nearest).abs() < ROUNDING { nearest } else { steps };
    let low = steps.floor();
    Share { low: bounded(low as usize), high: bounded(low as usize + 1), of_high: steps - low }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_go_through_the_anchor_and_stay_inside() {
        let axis = Axis::through(7.0, 2.0, (2.5, 9.0));
        assert_eq!((axis.first, axis.n, axis.last()), (3.0, 4, 9.0));
        assert_eq!(Axis::through(7.0, 1.0, (8.0, 6.0)), Axis { first: 7.0, step: 1.0, n: 1 });
    }

    #[test]
    fn weights_are_linear_and_end_one_step_beyond() {
        let axis = Axis { first: 1.0, step: 0.5, n: 3 };
        let share = axis.locate(1.2).expect("inside");
        assert_eq!((share.side(false).0, share.side(true).0), (0, 1));
        assert!((share.side(true).1 - 0.4).abs() < 1e-12);
        assert_eq!(axis.locate(2.4).expect("beyond the end").side(false), (2, 1.0));
        assert!(axis.locate(2.6).is_none() && axis.locate(0.4).is_none());
    }

    #[test]
    fn headings_wrap() {
        let turn = Axis::turn(8);
        for angle_deg in [350.0_f64, -10.0, 710.0, -370.0] {
            let share = turn.locate_around(angle_deg.to_radians());
            assert_eq!((share.side(false).0, share.side(true).0), (7, 0), "{angle_deg}");
            assert!((share.side(true).1 - 35.0 / 45.0).abs() < 1e-9);
        }
        let share = turn.locate_around(TAU - 1e-13);
        assert_eq!((share.side(false).0, share.side(false).1), (0, 1.0));
    }
}
