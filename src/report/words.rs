//! How numbers and names are said.

use crate::mapping::statement::Statement;
use crate::messages::BudgetSource;
use crate::survey::{Flight, Survey};
use jiff::Timestamp;

/// `621.40 ± 0.14 m³`, without breaks before the unit.
pub(super) fn statement(statement: &Statement) -> String {
    format!("{}\u{a0}{}", amounts(statement), statement.unit)
}

/// `621.40 ± 0.14`
pub(super) fn amounts(statement: &Statement) -> String {
    let value = statement.value_digits().replace('-', "−");
    format!("{value}\u{a0}±\u{a0}{}", statement.expanded_digits())
}

/// A number with two significant digits, without an exponent.
pub(super) fn two_digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return "0".to_owned();
    }
    // Rounded once, in decimal: 0.0996 becomes 0.10.
    let text = format!("{value:.1e}");
    let exponent: i32 = text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    let rounded: f64 = text.parse().unwrap_or(value);
    let n_decimals = usize::try_from(1 - exponent).unwrap_or(0);
    format!("{rounded:.n_decimals$}")
}

/// A share as a percentage with two significant digits.
pub(super) fn ratio(part: f64, whole: f64) -> String {
    if whole == 0.0 || !(part / whole).is_finite() {
        return "–".to_owned();
    }
    format!("{}\u{a0}%", two_digits(100.0 * (part / whole).abs()))
}

/// A number as somebody has written it down.
pub(super) fn plain(value: f64) -> String {
    format!("{value}").replace('-', "−")
}

/// Shares of measured, interpolated, unseen and disturbed ground in words.
pub(super) fn shares([measured, interpolated, unseen, disturbed]: &[f64; 4]) -> String {
    let percent = |share: f64| format!("{:.1}\u{a0}%", 100.0 * share);
    let mut said = format!(
        "{} measured, {} interpolated, {} unseen",
        percent(*measured),
        percent(*interpolated),
        percent(*unseen)
    );
    if *disturbed > 0.0 {
        said.push_str(&format!(", {} disturbed", percent(*disturbed)));
    }
    said
}

/// Whether a difference can be told from noise.
pub(super) fn significance(p_value: f64, risk: f64) -> String {
    let verdict = if p_value < risk { "significant" } else { "within noise" };
    verdict.to_owned()
}

/// When a flight was measured, and by which file.
pub(super) fn when(flight: &Flight) -> String {
    let file = flight.log.file_name().unwrap_or_default().to_string_lossy();
    let between = flight.measured_between().and_then(|(from, to)| {
        Some((flight.civil(from)?, flight.civil(to)?, to.seconds_since(from)))
    });
    match between {
        Some((from, to, span_s)) => format!(
            "Measured {}, {} to {} UTC ({:.0}\u{a0}s) · {file}",
            date(from),
            time(from),
            time(to),
            span_s
        ),
        None => format!("Time not recorded · {file}"),
    }
}

/// The log of an earlier survey, and which of several in it.
pub(super) fn log_of(survey: &Survey) -> String {
    let file = survey.path.file_name().unwrap_or_default().to_string_lossy();
    if survey.place.n_in_log > 1 {
        format!("{file}, number {} of {}", survey.place.number, survey.place.n_in_log)
    } else {
        file.into_owned()
    }
}

/// `4 March 2026`
pub(super) fn date(at: Timestamp) -> String {
    at.strftime("%-d %B %Y").to_string()
}

/// `05:06:07`
pub(super) fn time(at: Timestamp) -> String {
    at.strftime("%H:%M:%S").to_string()
}

/// With a capital letter at its beginning.
pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// A source of error as people call it.
pub(super) const fn source(source: BudgetSource) -> &'static str {
    match source {
        BudgetSource::Prior => "gaps",
        BudgetSource::BeamNoise => "beam noise",
        BudgetSource::Roughness => "roughness",
        BudgetSource::Occlusion => "hollows",
        BudgetSource::HiddenGround => "hidden ground",
        BudgetSource::Pose => "pose",
        BudgetSource::LidarMounting => "LiDAR mounting",
        BudgetSource::RangeBias => "range bias",
        BudgetSource::RangeScale => "range scale",
        BudgetSource::ClockOffset => "clock offset",
        BudgetSource::MarkerMap => "marker map",
        BudgetSource::Base => "base",
        BudgetSource::Density => "density",
    }
}

/// What a source of error is.
pub(super) const fn meaning(source: BudgetSource) -> &'static str {
    match source {
        BudgetSource::Prior => "surface that was thinly seen or not at all",
        BudgetSource::BeamNoise => "range and angle of single beams",
        BudgetSource::Roughness => "ground below the size of a cell",
        BudgetSource::Occlusion => "hollows below the size of a cell that grazing beams miss",
        BudgetSource::HiddenGround => {
            "ground that no beam reached: the rays over it, and that it is off as a whole"
        }
        BudgetSource::Pose => "place and attitude of the vehicle, correlated along the flight",
        BudgetSource::LidarMounting => "how the LiDAR is bolted on, constant",
        BudgetSource::RangeBias => "every range by the same length, constant",
        BudgetSource::RangeScale => "every range in proportion to it, constant",
        BudgetSource::ClockOffset => "the clocks of LiDAR and pose, constant",
        BudgetSource::MarkerMap => "the surveyed places of the markers",
        BudgetSource::Base => "what the material lies on",
        BudgetSource::Density => "bulk density; concerns tonnes only",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_two_digits_and_no_false_ones() {
        for (value, said) in [
            (0.0996, "0.10"),
            (0.1349, "0.13"),
            (12.6, "13"),
            (1234.0, "1200"),
            (0.0, "0"),
            (9.96, "10"),
        ] {
            assert_eq!(two_digits(value), said);
        }
        assert_eq!(ratio(0.14, 621.4), "0.023\u{a0}%");
        assert_eq!(ratio(1.0, 0.0), "–");
        assert_eq!(ratio(f64::NAN, 1.0), "–");
    }

    #[test]
    fn a_statement_keeps_its_unit_beside_it() {
        let stated = Statement::of_volume(-621.4, 0.07).expect("a statement");
        assert_eq!(statement(&stated), "−621.40\u{a0}±\u{a0}0.14\u{a0}m³");
    }
}
