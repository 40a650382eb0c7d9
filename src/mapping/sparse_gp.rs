//! The paper's sparse Gaussian process over the height grid.
//!
//! ```text
//! k(s) = σ_f² M_ν(√(2ν) s/l),   k = 0 for s > γ l         (M_ν: see `matern_kernel`)
//! M* = h₀ + K_*X [K_XX + Σ²]⁻¹ (Z − h₀),   Σ* = K_** − K_*X [K_XX + Σ²]⁻¹ K_X*
//! ```
//! - `X`: centres of the cells, which are the inducing points and the points of prediction
//! - `Z`, `Σ²`: means and variances of the cells
//!
//! At the cells themselves, with S = K + Σ²: M* = Z − Σ² S⁻¹ (Z − h₀) and Σ* = Σ² − Σ² S⁻¹ Σ²,
//! so one factorisation of S serves mean, marginal variances and the variance of any sum.
//!
//! Source: Balula et al. 2023, section 4, whose kernel is printed with unit variance and zero
//! mean; cut at γ l it is not positive definite in general, hence [`Cut::Taper`] (Wendland 1995).
//! Checked: `prediction_matches_the_dense_formulas`.

use super::matern_kernel::matern;
use super::sparse_cholesky::{CholeskyError, SparseCholesky};
use crate::messages::GridGeometry;

/// How the kernel ends at γ l.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cut {
    /// Multiplied by Wendland's C² function, which keeps it positive definite.
    #[default]
    Taper,
    /// Set to zero, as printed.
    Literal,
}

/// The prior of the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Smoothness ν > 0.
    pub smoothness_nu: f64,
    /// Length scale l, m.
    pub length_scale_m: f64,
    /// Reach γ in length scales.
    pub reach: f64,
    /// Standard deviation `σ_f`, m.
    pub sigma_m: f64,
    /// Mean h₀, m.
    pub mean_m: f64,
    /// How the kernel ends.
    pub cut: Cut,
}

impl Settings {
    /// Covariance of two points `s_m` apart, m².
    #[must_use]
    pub fn kernel_m2(&self, s_m: f64) -> f64 {
        let reach_m = self.reach * self.length_scale_m;
        if s_m > reach_m {
            return 0.0;
        }
        let matern = matern(self.smoothness_nu, s_m / self.length_scale_m);
        let taper = match self.cut {
            Cut::Literal => 1.0,
            Cut::Taper => wendland_c2(s_m / reach_m),
        };
        self.sigma_m.powi(2) * matern * taper
    }
}

/// (1 − t)₊⁴ (4t + 1): positive definite in up to three dimensions (Wendland 1995).
fn wendland_c2(t: f64) -> f64 {
    (1.0 - t).max(0.0).powi(4) * (4.0 * t + 1.0)
}

/// No prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum GpError {
    /// The kernel cut at γ l is not positive definite.
    #[error(
        "the covariance is not positive definite: a kernel cut at its reach need not be; \
         use the taper"
    )]
    NotPositiveDefinite,
    /// The grid is too large for this machine.
    #[error("the grid of {n_cells} cells does not fit into memory")]
    TooLarge {
        /// Number of cells.
        n_cells: usize,
    },
}

/// The posterior of the field at the cells, ready for questions.
#[derive(Debug)]
pub struct Posterior {
    grid: GridGeometry,
    settings: Settings,
    /// S = K + Σ².
    factor: SparseCholesky,
    cell_var_m2: Vec<f64>,
    mean_m: Vec<f64>,
    /// S⁻¹ (Z − h₀), 1/m.
    weights: Vec<f64>,
}

impl Posterior {
    /// Conditions the field on the cells' means and variances.
    ///
    /// # Errors
    /// A covariance that is not positive definite, or a grid too large.
    pub fn new(
        grid: &GridGeometry,
        cell_mean_m: &[f64],
        cell_var_m2: &[f64],
        settings: &Settings,
    ) -> Result<Self, GpError> {
        let lower = covariance_lower(grid, cell_var_m2, settings);
        let factor = SparseCholesky::new(grid.n_cells(), &lower).map_err(|error| match error {
            CholeskyError::NotPositiveDefinite => GpError::NotPositiveDefinite,
            CholeskyError::TooLarge { size } => GpError::TooLarge { n_cells: size },
        })?;
        let centred: Vec<f64> = cell_mean_m.iter().map(|z| z - settings.mean_m).collect();
        let weights = factor.solve(&centred);
        let mean_m = std::iter::zip(cell_mean_m, std::iter::zip(cell_var_m2, &weights))
            .map(|(z, (var, weight))| z - var * weight)
            .collect();
        let cell_var_m2 = cell_var_m2.to_vec();
        Ok(Self { grid: *grid, settings: *settings, factor, cell_var_m2, mean_m, weights })
    }

    /// Mean and variance of the surface at any place, m and m²; far from the grid the prior's.
    ///
    /// Cost: one solve with the factor.
    #[must_use]
    pub fn predict(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        let covariance = |cell| {
            let (cell_x, cell_y) = self.grid.centre_m(cell);
            self.settings.kernel_m2((cell_x - x_m).hypot(cell_y - y_m))
        };
        let covariances: Vec<f64> = (0..self.grid.n_cells()).map(covariance).collect();
        let product = |other: &[f64]| -> f64 {
            std::iter::zip(&covariances, other).map(|(k, value)| k * value).sum()
        };
        let explained_m2 = product(&self.factor.solve(&covariances));
        let mean_m = self.settings.mean_m + product(&self.weights);
        (mean_m, (self.settings.kernel_m2(0.0) - explained_m2).max(0.0))
    }

    /// M*, the mean at every cell, m.
    #[must_use]
    pub fn mean_m(&self) -> &[f64] {
        &self.mean_m
    }

    /// The diagonal of Σ*, m².
    #[must_use]
    pub fn marginal_var_m2(&self) -> Vec<f64> {
        std::iter::zip(&self.cell_var_m2, self.factor.inverse_diagonal())
            .map(|(var, inverse)| (var - var * var * inverse).max(0.0))
            .collect()
    }

    /// The variance wᵀ Σ* w of a weighted sum of the cells.
    #[must_use]
    pub fn sum_var(&self, weights: &[f64]) -> f64 {
        let scaled: Vec<f64> =
            std::iter::zip(weights, &self.cell_var_m2).map(|(w, var)| w * var).collect();
        let solved = self.factor.solve(&scaled);
        let prior: f64 = std::iter::zip(weights, &scaled).map(|(w, s)| w * s).sum();
        let explained: f64 = std::iter::zip(&scaled, &solved).map(|(a, b)| a * b).sum();
        (prior - explained).max(0.0)
    }
}

/// The lower triangle of `K_XX` + Σ².
fn covariance_lower(
    grid: &GridGeometry,
    cell_var_m2: &[f64],
    settings: &Settings,
) -> Vec<(usize, usize, f64)> {
    let stencil = stencil(grid.cell_m, settings);
    let mut lower = Vec::with_capacity(grid.n_cells() * stencil.len());
    for (cell, var_m2) in cell_var_m2.iter().enumerate() {
        let (row, col) = (cell / grid.n_cols, cell % grid.n_cols);
        for &(d_row, d_col, covariance) in &stencil {
            let Some(other_col) = col.checked_add_signed(d_col).filter(|&c| c < grid.n_cols) else {
                continue;
            };
            if row + d_row < grid.n_rows {
                let other = grid.index(other_col, row + d_row);
                let noise = if other == cell { *var_m2 } else { 0.0 };
                lower.push((other, cell, covariance + noise));
            }
        }
    }
    lower
}

/// Covariances of a cell with itself and with the cells after it in the grid's order.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "the reach is a few cells"
)]
fn stencil(cell_m: f64, settings: &Settings) -> Vec<(usize, isize, f64)> {
    let reach = (settings.reach * settings.length_scale_m / cell_m).floor() as isize;
    let mut stencil = Vec::new();
    for d_row in 0..=reach {
        for d_col in -reach..=reach {
            let is_after = d_row > 0 || d_col >= 0;
            let s_m = (d_row as f64).hypot(d_col as f64) * cell_m;
            let covariance = settings.kernel_m2(s_m);
            if is_after && covariance != 0.0 {
                stencil.push((d_row as usize, d_col, covariance));
            }
        }
    }
    stencil
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;
    use nalgebra::{DMatrix, DVector};

    fn settings() -> Settings {
        Settings {
            smoothness_nu: 1.5,
            length_scale_m: 0.6,
            reach: 2.0,
            sigma_m: 1.3,
            mean_m: 0.7,
            cut: Cut::Taper,
        }
    }

    #[test]
    fn prediction_matches_the_dense_formulas() {
        let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.3, n_cols: 9, n_rows: 7 };
        let n = grid.n_cells();
        let mut noise = SeedBook::new(2).stream("cells");
        let z: Vec<f64> = (0..n).map(|_| noise.normal()).collect();
        let var: Vec<f64> = (0..n).map(|_| noise.between(0.001, 0.5)).collect();
        let posterior = Posterior::new(&grid, &z, &var, &settings()).expect("positive definite");

        let kernel = DMatrix::from_fn(n, n, |i, j| {
            let ((xi, yi), (xj, yj)) = (grid.centre_m(i), grid.centre_m(j));
            settings().kernel_m2((xi - xj).hypot(yi - yj))
        });
        let s = &kernel + DMatrix::from_diagonal(&DVector::from_column_slice(&var));
        let gain = &kernel * s.try_inverse().expect("regular");
        let h0 = DVector::from_element(n, 0.7);
        let mean = &h0 + &gain * (DVector::from_column_slice(&z) - &h0);
        let cov = &kernel - &gain * &kernel;

        let marginal = posterior.marginal_var_m2();
        for cell in 0..n {
            assert!((posterior.mean_m()[cell] - mean[cell]).abs() < 1e-9);
            assert!((marginal[cell] - cov[(cell, cell)]).abs() < 1e-9);
        }
        let weights: Vec<f64> = (0..n).map(|_| noise.between(0.0, 0.1)).collect();
        let w = DVector::from_column_slice(&weights);
        let dense_var = (w.transpose() * &cov * &w)[(0, 0)];
        assert!((posterior.sum_var(&weights) - dense_var).abs() < 1e-9);
    }

    #[test]
    fn prediction_between_cells_matches_the_dense_formulas() {
        let grid = GridGeometry { x_min_m: -1.0, y_min_m: 3.0, cell_m: 0.4, n_cols: 6, n_rows: 5 };
        let n = grid.n_cells();
        let settings = Settings { smoothness_nu: 0.8, ..settings() };
        let mut noise = SeedBook::new(4).stream("cells");
        let z: Vec<f64> = (0..n).map(|_| noise.normal()).collect();
        let var: Vec<f64> = (0..n).map(|_| noise.between(0.001, 0.5)).collect();
        let posterior = Posterior::new(&grid, &z, &var, &settings).expect("positive definite");
        let kernel = |(xi, yi): (f64, f64), (xj, yj): (f64, f64)| {
            settings.kernel_m2((xi - xj).hypot(yi - yj))
        };
        let s = DMatrix::from_fn(n, n, |i, j| {
            kernel(grid.centre_m(i), grid.centre_m(j)) + if i == j { var[i] } else { 0.0 }
        });
        let inverse = s.try_inverse().expect("regular");
        let centred = DVector::from_iterator(n, z.iter().map(|z| z - 0.7));
        for place in [(0.13, 3.71), (-0.95, 4.99), (2.0, 2.5)] {
            let k = DVector::from_fn(n, |i, _| kernel(place, grid.centre_m(i)));
            let (mean_m, var_m2) = posterior.predict(place.0, place.1);
            assert!((mean_m - 0.7 - k.dot(&(&inverse * &centred))).abs() < 1e-9);
            assert!((var_m2 - 1.69 + k.dot(&(&inverse * &k))).abs() < 1e-9);
        }
        let (mean_m, var_m2) = posterior.predict(90.0, 90.0);
        assert!((mean_m - 0.7).abs() < 1e-12 && (var_m2 - 1.69).abs() < 1e-12, "the prior");
        let (at_cell, _) = posterior.predict(grid.centre_m(7).0, grid.centre_m(7).1);
        assert!((at_cell - posterior.mean_m()[7]).abs() < 1e-9);
    }

    #[test]
    fn kernel_meets_hand_computed_values() {
        let literal = Settings { cut: Cut::Literal, sigma_m: 1.0, ..settings() };
        // ν = 3/2 at s = l: (1 + √3) e^{−√3} = 0.48336
        assert!((literal.kernel_m2(0.6) - 0.483_36).abs() < 1e-5);
        // ν = 1/2 at s = l: 1/e; ν = 5/2 at s = l: (1 + √5 + 5/3) e^{−√5} = 0.52399
        let half = Settings { smoothness_nu: 0.5, ..literal };
        assert!((half.kernel_m2(0.6) - 0.367_88).abs() < 1e-5);
        let five = Settings { smoothness_nu: 2.5, ..literal };
        assert!((five.kernel_m2(0.6) - 0.523_99).abs() < 1e-5);
        assert!(literal.kernel_m2(1.21).abs() < 1e-15);
    }

    #[test]
    fn the_literal_cut_fails_with_a_clear_error() {
        // A smooth kernel chopped early has negative eigenvalues; nearly exact cells expose them.
        let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.2, n_cols: 20, n_rows: 20 };
        let literal = Settings {
            cut: Cut::Literal,
            smoothness_nu: 2.5,
            length_scale_m: 1.0,
            reach: 0.5,
            ..settings()
        };
        let n = grid.n_cells();
        let error = Posterior::new(&grid, &vec![0.0; n], &vec![1e-6; n], &literal).unwrap_err();
        assert_eq!(error, GpError::NotPositiveDefinite);
    }
}
