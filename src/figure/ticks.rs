//! Axes: where a number lies on them, and which ones are written beside them.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use std::ops::Range;

/// A linear or a logarithmic axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scale {
    pub(super) range: Range<f64>,
    pub(super) is_log: bool,
}

impl Scale {
    fn linear(&self) -> RangedCoordf64 {
        let Range { start, end } = self.range;
        if self.is_log { (start.log10()..end.log10()).into() } else { (start..end).into() }
    }

    /// 1, 2 and 5 times powers of ten, or the powers alone where there are many.
    fn log_marks(&self, n_max: usize) -> Vec<f64> {
        let Range { start, end } = self.range;
        let first = start.log10().floor();
        let n_decades = (end.log10().ceil() - first).max(1.0);
        let steps = [[1.0, 2.0, 5.0].as_slice(), &[1.0]]
            .into_iter()
            .find(|steps| {
                let n_marks = n_decades * f64::from(u8::try_from(steps.len()).unwrap_or(1));
                n_marks <= f64::from(u16::try_from(n_max).unwrap_or(u16::MAX)) + 4.0
            })
            .unwrap_or(&[1.0]);
        let decades = std::iter::successors(Some(first), |d| Some(d + 1.0));
        decades
            .take_while(|d| *d < first + n_decades + 0.5)
            .flat_map(|d| steps.iter().map(move |step| step * 10_f64.powf(d)))
            .filter(|mark| (start..=end).contains(mark))
            .collect()
    }

    /// The texts beside it.
    pub(super) fn texts(&self) -> Box<dyn Fn(&f64) -> String> {
        if self.is_log {
            Box::new(log_label)
        } else {
            Box::new(label(self.range.end - self.range.start))
        }
    }
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.linear().map(&if self.is_log { value.log10() } else { *value }, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if self.is_log {
            self.log_marks(hint.max_num_points())
        } else {
            self.linear().key_points(hint)
        }
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

/// Formats the labels of an axis that spans `span`: as many decimals as neighbouring labels need
/// to differ, no more.
pub(super) fn label(span: f64) -> impl Fn(&f64) -> String {
    // About ten labels stand on an axis.
    let step = (span / 10.0).abs().max(1e-9);
    let decimals = decimals(step);
    let is_large = span.abs() >= 1e6;
    move |value| {
        if is_large {
            return minus(&format!("{value:e}"));
        }
        let text = format!("{value:.decimals$}");
        let is_zero = text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.'));
        if is_zero { text.trim_start_matches('-').to_owned() } else { minus(&text) }
    }
}

fn decimals(step: f64) -> usize {
    [1.0, 0.1, 0.01, 0.001, 1e-4, 1e-5]
        .iter()
        .position(|unit| step >= unit * (1.0 - 1e-9))
        .unwrap_or(6)
}

/// A label on a logarithmic axis: 0.01, 1, 100, and 1e6 beyond.
fn log_label(value: &f64) -> String {
    if (1e-4..1e6).contains(value) {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        minus(&format!("{value:e}"))
    }
}

fn minus(text: &str) -> String {
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_have_the_decimals_that_tell_them_apart() {
        assert_eq!([0.0, -2.0, 10.0].map(|v| label(20.0)(&v)), ["0", "−2", "10"]);
        assert_eq!([-0.0, 0.25].map(|v| label(1.0)(&v)), ["0.0", "0.2"]);
        assert_eq!(label(0.05)(&0.015), "0.015");
        assert_eq!([0.01, 1.0, 2000.0, 1e6].map(|v| log_label(&v)), ["0.01", "1", "2000", "1e6"]);
    }

    #[test]
    fn logarithmic_marks_are_round_and_inside() {
        let marks = |range: Range<f64>| Scale { range, is_log: true }.log_marks(8);
        let near = |a: &[f64], b: &[f64]| {
            a.len() == b.len() && std::iter::zip(a, b).all(|(a, b)| (a / b - 1.0).abs() < 1e-12)
        };
        assert!(near(&marks(1.5..120.0), &[2.0, 5.0, 10.0, 20.0, 50.0, 100.0]));
        assert!(near(&marks(0.03..0.4), &[0.05, 0.1, 0.2]));
        assert!(near(&marks(0.9..2e6), &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6]));
    }

    #[test]
    fn equal_ratios_are_equal_distances() {
        let scale = Scale { range: 1.0..10_000.0, is_log: true };
        assert_eq!([1.0, 100.0, 10_000.0].map(|v| scale.map(&v, (0, 400))), [0, 200, 400]);
    }
}
