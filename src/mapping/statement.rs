//! A result with its expanded uncertainty, as the GUM wants it said.
//!
//! ```text
//! Y = y ± U,   U = k u(y),   k = 2: an interval of about 95 %
//! ```
//! U is rounded to two significant digits and y to the place of U's last digit. Both are rounded
//! once, from their exact binary values.
//!
//! Source: JCGM 100:2008, 7.2.2 to 7.2.6.
//! Checked: `published_examples_come_out_as_printed`.

use std::fmt;

/// Why there is nothing to state.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum StatementError {
    /// The value is infinite or no number.
    #[error("the value {value} cannot be stated")]
    BadValue {
        /// The value.
        value: f64,
    },
    /// The uncertainty is negative, infinite, no number, or so small or large that numbers end.
    #[error("the standard uncertainty {sigma} cannot be stated")]
    BadSigma {
        /// The standard uncertainty.
        sigma: f64,
    },
}

/// The coverage factor k of every statement of this project.
pub const COVERAGE_FACTOR: f64 = 2.0;

/// y ± U with its unit, rounded.
#[derive(Debug, Clone, PartialEq)]
pub struct Statement {
    /// y, rounded.
    pub value: f64,
    /// U = k u, rounded to two significant digits; 0 only if u is.
    pub expanded: f64,
    /// k.
    pub coverage_factor: f64,
    /// Unit of both, such as `m³`.
    pub unit: &'static str,
    value_digits: String,
    expanded_digits: String,
}

impl Statement {
    /// A volume and its standard deviation, both m³, with k = 2.
    ///
    /// # Errors
    /// Numbers that cannot be stated.
    pub fn of_volume(volume_m3: f64, sigma_m3: f64) -> Result<Self, StatementError> {
        Self::new(volume_m3, sigma_m3, COVERAGE_FACTOR, "m³")
    }

    /// A mass and its standard deviation, both t, with k = 2.
    ///
    /// # Errors
    /// Numbers that cannot be stated.
    pub fn of_mass(mass_t: f64, sigma_t: f64) -> Result<Self, StatementError> {
        Self::new(mass_t, sigma_t, COVERAGE_FACTOR, "t")
    }

    /// A value and its standard uncertainty `sigma`, with the factor k > 0 between that and U.
    ///
    /// Without any uncertainty the value is stated with all its digits.
    ///
    /// # Errors
    /// Numbers that cannot be stated.
    pub fn new(
        value: f64,
        sigma: f64,
        coverage_factor: f64,
        unit: &'static str,
    ) -> Result<Self, StatementError> {
        if !value.is_finite() {
            return Err(StatementError::BadValue { value });
        }
        let expanded = coverage_factor * sigma;
        // A number of 300 digits is a defect somewhere else.
        let is_good = sigma == 0.0 || (sigma > 0.0 && (1e-100..1e100).contains(&expanded));
        if !is_good || value.abs() >= 1e100 {
            return Err(StatementError::BadSigma { sigma });
        }
        let (value_digits, expanded_digits) = if expanded == 0.0 {
            (value.to_string(), "0".to_owned())
        } else {
            let place = last_place(expanded);
            (rounded(value, place), rounded(expanded, place))
        };
        let value_digits = without_negative_zero(value_digits);
        let parse = |digits: &str, exact: f64| digits.parse().unwrap_or(exact);
        Ok(Self {
            value: parse(&value_digits, value),
            expanded: parse(&expanded_digits, expanded),
            coverage_factor,
            unit,
            value_digits,
            expanded_digits,
        })
    }

    /// The digits of y as stated, with zeros that mean something.
    #[must_use]
    pub fn value_digits(&self) -> &str {
        &self.value_digits
    }

    /// The digits of U as stated, with zeros that mean something.
    #[must_use]
    pub fn expanded_digits(&self) -> &str {
        &self.expanded_digits
    }
}

impl fmt::Display for Statement {
    /// `(1204 ± 14) m³ (k = 2)`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { value_digits, expanded_digits, unit, coverage_factor, .. } = self;
        write!(f, "({value_digits} ± {expanded_digits}) {unit} (k = {coverage_factor})")
    }
}

/// The power of ten of the second significant digit, after rounding to two: 0.0996 gives −2,
/// because it becomes 0.10.
fn last_place(value: f64) -> i32 {
    // The formatter rounds the exact binary value and carries into the exponent.
    exponent_of(&format!("{value:.1e}")) - 1
}

fn exponent_of(scientific: &str) -> i32 {
    scientific.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0)
}

/// A number rounded to a multiple of 10^`place`, in plain digits.
fn rounded(value: f64, place: i32) -> String {
    if let Ok(n_decimals) = usize::try_from(-place) {
        return format!("{value:.n_decimals$}");
    }
    // Before the point: as many significant digits as lie above the place, then zeros.
    let digits_above = exponent_of(&format!("{value:e}")) - place;
    match usize::try_from(digits_above) {
        Ok(n) => {
            let scientific = format!("{value:.n$e}");
            let mantissa = scientific.split('e').next().unwrap_or_default().replace('.', "");
            // A carry, 9996 to 1.00e4, has moved the exponent and needs one zero more.
            let n_zeros = exponent_of(&scientific) - digits_above;
            format!("{mantissa}{}", zeros(n_zeros))
        }
        // Smaller than the place: to one of it, or to nothing.
        Err(_) if value.abs() > 0.5 * 10_f64.powi(place) => {
            format!("{}1{}", if value < 0.0 { "-" } else { "" }, zeros(place))
        }
        Err(_) => "0".to_owned(),
    }
}

fn zeros(count: i32) -> String {
    "0".repeat(usize::try_from(count).unwrap_or(0))
}

/// −0.00 is 0.00.
fn without_negative_zero(digits: String) -> String {
    let is_zero = digits.chars().all(|c| matches!(c, '-' | '0' | '.'));
    if is_zero { digits.trim_start_matches('-').to_owned() } else { digits }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;

    fn digits(value: f64, sigma: f64, k: f64) -> (String, String) {
        let statement = Statement::new(value, sigma, k, "").expect("can be stated");
        (statement.value_digits, statement.expanded_digits)
    }

    #[test]
    fn published_examples_come_out_as_printed() {
        let is = |case: (String, String), value: &str, expanded: &str| {
            assert_eq!(case, (value.to_owned(), expanded.to_owned()));
        };
        // JCGM 100:2008, 7.2.4: m_S = (100,021 47 ± 0,000 79) g with u = 0,35 mg, k = 2,26.
        is(digits(100.021_47, 0.000_35, 2.26), "100.02147", "0.00079");
        // 7.2.6: y = 10,057 62 Ω with u = 27 mΩ becomes 10,058 Ω.
        is(digits(10.057_62, 0.027, 1.0), "10.058", "0.027");
        // 7.2.6: u = 28,05 kHz is rounded down to 28 kHz.
        is(digits(0.0, 28.05, 1.0), "0", "28");
        // H.1.7: l = (50,000 838 ± 0,000 093) mm with u = 32 nm, k = 2,92.
        is(digits(50.000_838, 32e-6, 2.92), "50.000838", "0.000093");
    }

    #[test]
    fn carries_move_the_place() {
        assert_eq!(digits(7.248_15, 0.0996, 1.0), ("7.25".into(), "0.10".into()));
        assert_eq!(digits(7.248_15, 0.0994, 1.0), ("7.248".into(), "0.099".into()));
        assert_eq!(digits(9.996, 0.0498, 2.0), ("10.00".into(), "0.10".into()));
        assert_eq!(digits(99_960.0, 997.0, 1.0), ("100000".into(), "1000".into()));
    }

    #[test]
    fn large_numbers_are_rounded_before_the_point() {
        assert_eq!(digits(123_456.7, 617.0, 2.0), ("123500".into(), "1200".into()));
        assert_eq!(digits(-123_456.7, 617.0, 2.0), ("-123500".into(), "1200".into()));
        assert_eq!(digits(1e15, 4.4e12, 1.0), ("1000000000000000".into(), "4400000000000".into()));
        // Far below the place of U it is nothing; above half of it, one.
        assert_eq!(digits(12.0, 4_400.0, 1.0), ("0".into(), "4400".into()));
        assert_eq!(digits(-70.0, 4_400.0, 1.0), ("-100".into(), "4400".into()));
        assert_eq!(digits(0.0, 4_400.0, 1.0), ("0".into(), "4400".into()));
        assert_eq!(digits(99.7, 44.0, 1.0), ("100".into(), "44".into()));
    }

    #[test]
    fn uncertain_and_negative_values_are_stated_as_they_are() {
        assert_eq!(digits(0.31, 0.6, 2.0), ("0.3".into(), "1.2".into()));
        assert_eq!(digits(-0.31, 0.06, 2.0), ("-0.31".into(), "0.12".into()));
        assert_eq!(digits(-0.004, 0.06, 2.0), ("0.00".into(), "0.12".into()), "no −0.00");
        assert_eq!(digits(1204.5, 0.0, 2.0), ("1204.5".into(), "0".into()));
    }

    #[test]
    fn what_cannot_be_stated_is_refused() {
        assert!(Statement::of_volume(f64::NAN, 1.0).is_err());
        assert!(Statement::of_volume(f64::INFINITY, 1.0).is_err());
        for sigma in [f64::NAN, f64::INFINITY, -0.1, 1e200, 1e-200] {
            let error = Statement::of_mass(1.0, sigma).unwrap_err();
            assert!(matches!(error, StatementError::BadSigma { .. }), "{sigma}");
        }
    }

    #[test]
    fn the_text_names_unit_and_factor() {
        let statement = Statement::of_volume(1203.8, 7.04).expect("can be stated");
        assert_eq!(statement.to_string(), "(1204 ± 14) m³ (k = 2)");
        assert!((statement.value - 1204.0).abs() < 1e-12);
        assert_eq!(
            Statement::of_mass(77.0, 0.1).expect("ok").to_string(),
            "(77.00 ± 0.20) t (k = 2)"
        );
    }

    #[test]
    fn nothing_moves_by_more_than_half_its_last_place() {
        let mut noise = SeedBook::new(12).stream("numbers");
        for _ in 0..5_000 {
            let sigma = 10_f64.powf(noise.between(-6.0, 8.0));
            let value = noise.normal() * 10_f64.powf(noise.between(-6.0, 9.0));
            let statement = Statement::of_volume(value, sigma).expect("can be stated");
            let ratio = statement.expanded / (2.0 * sigma);
            // Two digits: at worst 10.5 becomes 10 or 11.
            assert!((ratio - 1.0).abs() < 0.05, "{sigma}: {statement}");
            // The place is a tenth of U's leading digit, so at least U/100 and at most U/10.
            assert!((statement.value - value).abs() <= 0.0501 * statement.expanded, "{statement}");
            let n_significant = statement
                .expanded_digits()
                .replace('.', "")
                .trim_start_matches('0')
                .trim_end_matches('0')
                .len();
            assert!(n_significant <= 2, "{statement}");
        }
    }
}
