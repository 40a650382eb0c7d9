//! From cubic metres to tonnes.

use crate::messages::{BudgetRow, BudgetSource, Mass};

/// Bulk density of a material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Density {
    /// Expected density ρ, t/m³.
    pub mean_t_per_m3: f64,
    /// Its standard deviation, t/m³.
    pub sigma_t_per_m3: f64,
}

impl Density {
    /// The mass of a volume, or of a change of volume, whose error is independent of the density.
    ///
    /// ```text
    /// m = ρ V,    u²(m) = (ρ u(V))² + (V u(ρ))² + (u(V) u(ρ))²
    /// ```
    /// - `V`, `u(V)`: volume and its standard deviation, m³
    ///
    /// The last term is the exact variance of a product beyond the first order (JCGM 100:2008,
    /// note to 5.1.2); it counts where both are uncertain, as in an almost empty bay.
    /// Checked: `mass_meets_drawn_products`.
    #[must_use]
    pub fn mass(&self, volume_m3: f64, sigma_m3: f64) -> Mass {
        let Self { mean_t_per_m3: rho, sigma_t_per_m3: u_rho } = *self;
        let terms = [rho * sigma_m3, volume_m3 * u_rho, sigma_m3 * u_rho];
        let var_t2: f64 = terms.iter().map(|term| term * term).sum();
        Mass { mass_t: rho * volume_m3, sigma_t: var_t2.sqrt() }
    }

    /// The density's line in the budget of a volume, m⁶: the variance of mass that it adds,
    /// divided by ρ².
    #[must_use]
    pub fn budget_row(&self, volume_m3: f64, sigma_m3: f64) -> BudgetRow {
        let ratio = self.sigma_t_per_m3 / self.mean_t_per_m3;
        let var_m6 = (ratio * volume_m3).powi(2) + (ratio * sigma_m3).powi(2);
        BudgetRow { source: BudgetSource::Density, var_m6 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;

    #[test]
    fn mass_meets_drawn_products() {
        let mut noise = SeedBook::new(8).stream("products");
        let density = Density { mean_t_per_m3: 1.6, sigma_t_per_m3: 0.4 };
        let (volume_m3, sigma_m3) = (3.0, 1.5);
        let mass = density.mass(volume_m3, sigma_m3);
        let n = 200_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let m = (1.6 + 0.4 * noise.normal()) * (volume_m3 + sigma_m3 * noise.normal());
            sum += m;
            squares += m * m;
        }
        let mean = sum / f64::from(n);
        let sigma = (squares / f64::from(n) - mean * mean).sqrt();
        // The standard errors are σ/√n = 0.006 and about 0.005; 4 of them.
        assert!((mean - mass.mass_t).abs() < 0.025, "{mean} {mass:?}");
        // Without the product term it would be 2.683 instead of 2.750.
        assert!((sigma - mass.sigma_t).abs() < 0.02, "{sigma} {mass:?}");
    }

    #[test]
    fn the_budget_row_explains_the_mass() {
        let density = Density { mean_t_per_m3: 0.8, sigma_t_per_m3: 0.05 };
        let row = density.budget_row(120.0, 2.0);
        let mass = density.mass(120.0, 2.0);
        let from_rows = 0.8 * (2.0_f64.powi(2) + row.var_m6).sqrt();
        assert!((mass.sigma_t - from_rows).abs() < 1e-12);
    }
}
