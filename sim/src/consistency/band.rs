//! Bands that a mean of χ² draws keeps in 95 of 100 cases.

/// The 97.5 % quantile of the normal distribution.
const Z_975: f64 = 1.959_963_985;

/// Where a mean should lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Band {
    /// True inside.
    #[must_use]
    pub fn contains(&self, mean: f64) -> bool {
        (self.low..=self.high).contains(&mean)
    }
}

/// The two-sided 95 % band for the mean of `n` independent χ² draws with `dof` degrees each.
///
/// ```text
/// χ²_{n dof}(2.5 %)/n … χ²_{n dof}(97.5 %)/n
/// ```
/// Quantiles by the cube-root normal approximation, below 1 % off from 10 degrees in all.
/// Source: Wilson and Hilferty 1931.
#[must_use]
pub fn mean_band(dof: f64, n: f64) -> Band {
    let total = dof * n;
    let quantile = |z: f64| {
        let c = 2.0 / (9.0 * total);
        total * (1.0 - c + z * c.sqrt()).max(0.0).powi(3)
    };
    Band { low: quantile(-Z_975) / n, high: quantile(Z_975) / n }
}

/// How far looks at the same flight repeat each other: 1/K if not at all, 1 if one look says
/// everything.
///
/// ```text
/// D = var(flight means) / var(looks)
/// ```
/// Both variances are about the mean over all looks. With fewer than two flights nothing is known
/// and D is 1.
#[must_use]
pub fn design_effect(flights: &[Vec<f64>]) -> f64 {
    let flights: Vec<&[f64]> =
        flights.iter().map(Vec::as_slice).filter(|looks| !looks.is_empty()).collect();
    let n_looks: f64 = flights.iter().map(|looks| count(looks)).sum();
    let n = f64::from(u32::try_from(flights.len()).unwrap_or(u32::MAX));
    if n < 2.0 {
        return 1.0;
    }
    let mean = mean_of_flights(&flights);
    let squared = |x: f64| (x - mean).powi(2);
    let of_looks = flights.iter().copied().flatten().map(|&x| squared(x)).sum::<f64>() / n_looks;
    let of_means = flights.iter().map(|looks| squared(average(looks))).sum::<f64>() / (n - 1.0);
    let effect = of_means / of_looks;
    if effect.is_finite() { effect.clamp(n / n_looks, 1.0) } else { 1.0 }
}

/// The mean of the flights' means: each flight counts once.
pub(super) fn mean_of_flights(flights: &[&[f64]]) -> f64 {
    let means: Vec<f64> =
        flights.iter().filter(|looks| !looks.is_empty()).map(|looks| average(looks)).collect();
    average(&means)
}

fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / count(values)
}

#[expect(clippy::cast_precision_loss, reason = "few looks")]
fn count(values: &[f64]) -> f64 {
    values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use stockpilot::stats::{Noise, SeedBook};

    #[test]
    fn bands_meet_the_published_table() {
        // Abramowitz and Stegun, table 26.8: χ²_30 is 16.7908 and 46.9792 at 2.5 and 97.5 %,
        // χ²_100 is 74.2219 and 129.561.
        let ten = mean_band(3.0, 10.0);
        assert!((ten.low - 1.679_08).abs() < 0.005 && (ten.high - 4.697_92).abs() < 0.005);
        let hundred = mean_band(1.0, 100.0);
        assert!((hundred.low - 0.742_219).abs() < 5e-4);
        assert!((hundred.high - 1.295_61).abs() < 5e-4);
    }

    /// One flight: χ² with three degrees from three processes that forget by `keep` per look.
    fn flight(noise: &mut Noise, keep: f64, n_looks: usize, sigma: f64) -> Vec<f64> {
        let mut x = noise.normal3() * sigma;
        let mut look = || {
            x = x * keep + noise.normal3() * (sigma * (1.0 - keep * keep).sqrt());
            x.norm_squared()
        };
        (0..n_looks).map(|_| look()).collect()
    }

    /// Share of campaigns of 50 flights whose mean lies inside its own band.
    fn share_inside(keep: f64, sigma: f64) -> f64 {
        let mut noise = SeedBook::new(17).stream("looks");
        let n_trials = 400;
        let inside = (0..n_trials).filter(|_| {
            let flights: Vec<Vec<f64>> =
                (0..50).map(|_| flight(&mut noise, keep, 40, sigma)).collect();
            let slices: Vec<&[f64]> = flights.iter().map(Vec::as_slice).collect();
            let n_effective = 50.0 / design_effect(&flights);
            mean_band(3.0, n_effective).contains(mean_of_flights(&slices))
        });
        f64::from(u32::try_from(inside.count()).unwrap()) / f64::from(n_trials)
    }

    #[test]
    fn band_holds_in_95_of_100_trials_of_correlated_looks() {
        for keep in [0.0, 0.9, 0.99] {
            let share = share_inside(keep, 1.0);
            // 400 trials know a share of 0.95 to 0.011; three of them, and a little for a scatter
            // that is itself estimated from 50 flights.
            assert!((0.91..=0.985).contains(&share), "keep {keep}: {share}");
        }
    }

    #[test]
    fn a_filter_that_claims_a_third_too_little_falls_out() {
        // Errors of 1.15 σ: the mean is 3.97 instead of 3.
        let share = share_inside(0.9, 1.15);
        assert!(share < 0.05, "{share}");
    }
}
