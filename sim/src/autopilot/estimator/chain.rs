//! Kalman filter of the error of a chain of integrators.

use nalgebra::{SMatrix, SVector};

/// Covariance of an error x with ẋ₀ = x₁, ẋ₁ = x₂, …, each driven by white noise.
#[derive(Debug, Clone)]
pub(super) struct ChainFilter<const N: usize> {
    cov: SMatrix<f64, N, N>,
    /// Density of the noise that drives each state, unit²/s.
    noise: SVector<f64, N>,
}

impl<const N: usize> ChainFilter<N> {
    /// A filter with these standard deviations and root noise densities.
    pub(super) fn new(sigma: [f64; N], density: [f64; N]) -> Self {
        let square = |values: [f64; N]| SVector::from(values.map(|v| v * v));
        Self { cov: SMatrix::from_diagonal(&square(sigma)), noise: square(density) }
    }

    /// P ← F P Fᵀ + Q dt with F = I + dt · upper shift.
    pub(super) fn predict(&mut self, dt_s: f64) {
        for row in 0..N - 1 {
            let below = self.cov.row(row + 1) * dt_s;
            self.cov.set_row(row, &(self.cov.row(row) + below));
        }
        for column in 0..N - 1 {
            let right = self.cov.column(column + 1) * dt_s;
            self.cov.set_column(column, &(self.cov.column(column) + right));
        }
        for state in 0..N {
            self.cov[(state, state)] += self.noise[state] * dt_s;
        }
    }

    /// Variance of the innovation of a measurement of state `index` with variance `var`.
    pub(super) fn innovation_var(&self, index: usize, var: f64) -> f64 {
        self.cov[(index, index)] + var
    }

    /// Fuses a measurement of state `index`; returns what to add to each state.
    pub(super) fn fuse(&mut self, index: usize, innovation: f64, var: f64) -> SVector<f64, N> {
        let gain = self.cov.column(index) / self.innovation_var(index, var);
        let measured_row = self.cov.row(index).into_owned();
        self.cov -= gain * measured_row;
        self.cov = (self.cov + self.cov.transpose()) * 0.5;
        gain * innovation
    }

    /// Forgets what was known of state `index` and gives it this variance.
    pub(super) fn reset(&mut self, index: usize, var: f64) {
        self.cov.row_mut(index).fill(0.0);
        self.cov.column_mut(index).fill(0.0);
        self.cov[(index, index)] = var;
    }

    /// Variance of state `index`.
    pub(super) fn var(&self, index: usize) -> f64 {
        self.cov[(index, index)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prediction_matches_the_matrix_product() {
        let mut filter = ChainFilter::<3>::new([1.0, 2.0, 0.5], [0.1, 0.2, 0.3]);
        filter.fuse(0, 0.0, 0.5);
        let before = filter.cov;
        filter.predict(0.1);
        let f = SMatrix::<f64, 3, 3>::new(1.0, 0.1, 0.0, 0.0, 1.0, 0.1, 0.0, 0.0, 1.0);
        let q = SMatrix::<f64, 3, 3>::from_diagonal(&SVector::from([0.001, 0.004, 0.009]));
        assert!((filter.cov - (f * before * f.transpose() + q)).norm() < 1e-12);
    }

    #[test]
    fn information_adds() {
        // 1/4 + 1/1 = 1.25, so the variance is 0.8 and the gain on an innovation of 1 is 0.8.
        let mut filter = ChainFilter::<2>::new([2.0, 1.0], [0.0, 0.0]);
        let step = filter.fuse(0, 1.0, 1.0);
        assert!((step[0] - 0.8).abs() < 1e-12 && (filter.var(0) - 0.8).abs() < 1e-12);
    }
}
