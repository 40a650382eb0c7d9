//! Numbers beside axes.

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
pub(super) fn log_label(value: &f64) -> String {
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
