//! χ² gates for innovations.

/// The 99 % quantile of χ² with 1 to 10 degrees of freedom.
///
/// Source: Abramowitz and Stegun 1964, table 26.8.
pub const CHI2_99: [f64; 10] =
    [6.6349, 9.2103, 11.3449, 13.2767, 15.0863, 16.8119, 18.4753, 20.0902, 21.6660, 23.2093];

/// The bound that a squared Mahalanobis distance with `dof` degrees of freedom passes in 99 of
/// 100 draws; from ten degrees upwards by the cube-root normal approximation.
///
/// Source: Wilson and Hilferty 1931.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "degrees of freedom are small")]
pub fn chi2_gate_99(dof: usize) -> f64 {
    const Z_99: f64 = 2.326_347_874;
    match dof {
        0 => 0.0,
        1..=10 => CHI2_99[dof - 1],
        _ => {
            let n = dof as f64;
            let c = 2.0 / (9.0 * n);
            n * (1.0 - c + Z_99 * c.sqrt()).powi(3)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn approximation_meets_the_published_table() {
        // Abramowitz and Stegun, table 26.8: 30.5779 for 15, 50.8922 for 30 degrees of freedom.
        assert!((chi2_gate_99(15) - 30.5779).abs() < 0.05);
        assert!((chi2_gate_99(30) - 50.8922).abs() < 0.05);
    }
}
