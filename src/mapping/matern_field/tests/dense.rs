//! The field once more, slowly: dense matrices from the definition, and the covariance form of the
//! Gaussian process.

use crate::mapping::matern_field::{Prior, Row};
use crate::messages::GridGeometry;
use nalgebra::{DMatrix, DVector};

pub(super) struct Dense {
    /// Covariance of the heights before any data, m².
    cov_m2: DMatrix<f64>,
    mean_m: f64,
    /// Row, height, variance.
    pub(super) rows: Vec<(Row, f64, f64)>,
}

impl Dense {
    /// `n_pad` nodes around the grid.
    pub(super) fn new(
        grid: &GridGeometry,
        n_pad: usize,
        prior: &Prior,
        separates: impl Fn((f64, f64), (f64, f64)) -> bool,
    ) -> Self {
        let (n_cols, n_rows) = (grid.n_cols + 2 * n_pad, grid.n_rows + 2 * n_pad);
        let n = n_cols * n_rows;
        #[expect(clippy::cast_precision_loss, reason = "a few nodes")]
        let place = |col: usize, row: usize| {
            let along = |index: usize| (index as f64 - n_pad as f64 + 0.5) * grid.cell_m;
            (grid.x_min_m + along(col), grid.y_min_m + along(row))
        };
        let step = 8.0_f64.sqrt() / prior.range_m * grid.cell_m;
        // K = κ² C + G: a mass on the diagonal, −1 and +1 for each link, and the boundary's term
        // where one is missing.
        let mut k = DMatrix::from_diagonal_element(n, n, step * step + 4.0 * step / 1.42);
        let mut tie = |a: usize, b: usize| {
            for node in [a, b] {
                k[(node, node)] += 1.0 - step / 1.42;
            }
            k[(a, b)] = -1.0;
            k[(b, a)] = -1.0;
        };
        for row in 0..n_rows {
            for col in 0..n_cols {
                let node = row * n_cols + col;
                if col + 1 < n_cols && !separates(place(col, row), place(col + 1, row)) {
                    tie(node, node + 1);
                }
                if row + 1 < n_rows && !separates(place(col, row), place(col, row + 1)) {
                    tie(node, node + n_cols);
                }
            }
        }
        let scale = endless_variance(step * step) / (prior.sigma_m * prior.sigma_m);
        let q0 = k.tr_mul(&k) * scale;
        let level_var_m2 = prior.mean_sigma_m * prior.mean_sigma_m;
        let cov_m2 = q0.try_inverse().expect("regular").add_scalar(level_var_m2);
        Self { cov_m2, mean_m: prior.mean_m, rows: Vec::new() }
    }

    pub(super) fn observe(&mut self, row: &Row, z: f64, var_m2: f64) {
        self.rows.push((*row, z, var_m2));
    }

    /// `M* = K_*X (K_XX + R)⁻¹ (z − mean), Σ* = K_** − K_*X (K_XX + R)⁻¹ K_X*`.
    pub(super) fn posterior(&self) -> (DVector<f64>, DMatrix<f64>) {
        let (cross, k_xx, innovation) = self.observed();
        let inverse = k_xx.cholesky().expect("positive definite");
        let mean = (&cross * inverse.solve(&innovation)).add_scalar(self.mean_m);
        let cov = &self.cov_m2 - &cross * inverse.solve(&cross.transpose());
        (mean, cov)
    }

    /// `ln det (K_XX + R) + (z − mean)ᵀ (K_XX + R)⁻¹ (z − mean)`.
    pub(super) fn minus_two_log_likelihood(&self) -> f64 {
        let (_, k_xx, innovation) = self.observed();
        let factor = k_xx.cholesky().expect("positive definite");
        let log_det: f64 = factor.l().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        log_det + innovation.dot(&factor.solve(&innovation))
    }

    /// `K_*X`, `K_XX + R`, `z − mean`.
    fn observed(&self) -> (DMatrix<f64>, DMatrix<f64>, DVector<f64>) {
        let (n, n_rows) = (self.cov_m2.nrows(), self.rows.len());
        let mut a = DMatrix::zeros(n_rows, n);
        let mut innovation = DVector::zeros(n_rows);
        let mut noise = DVector::zeros(n_rows);
        for (i, (row, z, var_m2)) in self.rows.iter().enumerate() {
            for (node, weight) in row.nodes.iter().zip(row.weights) {
                a[(i, *node as usize)] += weight;
            }
            innovation[i] = z - self.mean_m;
            noise[i] = *var_m2;
        }
        let cross = &self.cov_m2 * a.transpose();
        let k_xx = &a * &cross + DMatrix::from_diagonal(&noise);
        (cross, k_xx, innovation)
    }
}

/// Variance of the endless lattice field with precision K K, by the midpoint sum of its spectrum,
/// which converges exponentially.
fn endless_variance(mass: f64) -> f64 {
    let n = 300;
    let angle = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * std::f64::consts::TAU;
    let symbol = |i, j| mass + 4.0 - 2.0 * f64::cos(angle(i)) - 2.0 * f64::cos(angle(j));
    let sum: f64 = (0..n).flat_map(|i| (0..n).map(move |j| symbol(i, j).powi(-2))).sum();
    sum / f64::from(n * n)
}
