//! Cholesky factor of a sparse symmetric positive definite matrix, with solves and with the
//! entries of the inverse on the factor's pattern.
//!
//! The factor and the solves are `faer`'s. The entries of the inverse follow Takahashi, Fagan,
//! Chen 1973: with S = L Lᵀ and Z = S⁻¹,
//!
//! ```text
//! Z_ij = (δ_ij/L_jj − Σ_{k>j} L_kj Z_ki) / L_jj        i ≥ j, both in the pattern of column j
//! ```
//! and every `Z_ki` needed lies in the pattern already.

mod analysis;
mod selected_inverse;

pub use analysis::{Analysis, Factor};

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::prelude::MatMut;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, Par, Side, Spec};

/// The matrix cannot be factorised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CholeskyError {
    /// A pivot is not positive.
    #[error("the matrix is not positive definite")]
    NotPositiveDefinite,
    /// The factor does not fit into memory, or an index lies outside the matrix.
    #[error("the matrix of {size} rows cannot be set up")]
    TooLarge {
        /// Rows.
        size: usize,
    },
}

/// The factor of a sparse symmetric positive definite matrix.
#[derive(Debug)]
pub struct SparseCholesky {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
}

impl SparseCholesky {
    /// Factorises the matrix whose lower triangle is given as (row, column, value).
    ///
    /// # Errors
    /// Not positive definite, or too large.
    pub fn new(size: usize, lower: &[(usize, usize, f64)]) -> Result<Self, CholeskyError> {
        let too_large = || CholeskyError::TooLarge { size };
        let triplets: Vec<_> = lower.iter().map(|&(r, c, v)| Triplet::new(r, c, v)).collect();
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(size, size, &triplets)
            .map_err(|_| too_large())?;
        let params = CholeskySymbolicParams {
            // The simplicial factor has one column per row, which the inverse's entries need.
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        let symbolic = factorize_symbolic_cholesky(
            matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            params,
        )
        .map_err(|_| too_large())?;
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| too_large())?;
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Spec::default(),
            )
            .map_err(|_| CholeskyError::NotPositiveDefinite)?;
        Ok(Self { symbolic, values })
    }

    /// S⁻¹ b.
    #[must_use]
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x = b.to_vec();
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        let n = x.len();
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut x, n, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        x
    }

    /// The diagonal of S⁻¹.
    #[must_use]
    pub fn inverse_diagonal(&self) -> Vec<f64> {
        let SymbolicCholeskyRaw::Simplicial(simplicial) = self.symbolic.raw() else {
            // Not reached: the factor was asked to be simplicial.
            return Vec::new();
        };
        let factor = Columns {
            starts: simplicial.col_ptr(),
            rows: simplicial.row_idx(),
            values: &self.values,
        };
        let permuted = factor.inverse_diagonal();
        let mut diagonal = vec![0.0; permuted.len()];
        match self.symbolic.perm() {
            Some(perm) => {
                for (new, &old) in perm.arrays().0.iter().enumerate() {
                    diagonal[old] = permuted[new];
                }
                diagonal
            }
            None => permuted,
        }
    }
}

/// L by columns, the diagonal first, rows ascending.
struct Columns<'a> {
    starts: &'a [usize],
    rows: &'a [usize],
    values: &'a [f64],
}

impl Columns<'_> {
    /// Takahashi's recursion from the last column to the first; O(Σ |column|²) steps.
    fn inverse_diagonal(&self) -> Vec<f64> {
        let n = self.starts.len() - 1;
        let mut inverse = vec![0.0; self.values.len()];
        // Σ_k L_kj Z_ki for the rows i of the current column.
        let mut sums = vec![0.0; n];
        for j in (0..n).rev() {
            let column = self.starts[j]..self.starts[j + 1];
            let below = column.start + 1..column.end;
            for &i in &self.rows[below.clone()] {
                sums[i] = 0.0;
            }
            for at_k in below.clone() {
                self.add_products(&inverse, at_k, below.clone(), &mut sums);
            }
            let pivot = self.values[column.start];
            let mut of_diagonal = 1.0 / pivot;
            for at_i in below {
                inverse[at_i] = -sums[self.rows[at_i]] / pivot;
                of_diagonal -= self.values[at_i] * inverse[at_i];
            }
            inverse[column.start] = of_diagonal / pivot;
        }
        (0..n).map(|j| inverse[self.starts[j]]).collect()
    }

    /// Adds `L_kj` `Z_ki` to the sum of every row i of column j, using `Z_ki` = `Z_ik`.
    fn add_products(
        &self,
        inverse: &[f64],
        at_k: usize,
        below: std::ops::Range<usize>,
        sums: &mut [f64],
    ) {
        let k = self.rows[at_k];
        let factor = self.values[at_k];
        let mut at_z = self.starts[k];
        sums[k] += factor * inverse[at_z];
        for at_i in at_k + 1..below.end {
            let i = self.rows[at_i];
            while self.rows[at_z] < i {
                at_z += 1;
            }
            let z = inverse[at_z];
            sums[i] += factor * z;
            sums[k] += self.values[at_i] * z;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;
    use nalgebra::DMatrix;

    /// A random sparse positive definite matrix: diagonally dominant on a grid-like pattern.
    fn example(size: usize) -> (Vec<(usize, usize, f64)>, DMatrix<f64>) {
        let mut noise = SeedBook::new(9).stream("matrix");
        let mut dense = DMatrix::zeros(size, size);
        for row in 0..size {
            dense[(row, row)] = 5.0 + noise.uniform();
            for back in [1, 2, 7] {
                if row >= back {
                    let value = noise.between(-0.8, 0.8);
                    dense[(row, row - back)] = value;
                    dense[(row - back, row)] = value;
                }
            }
        }
        let mut lower = Vec::new();
        for col in 0..size {
            for row in col..size {
                if dense[(row, col)] != 0.0 {
                    lower.push((row, col, dense[(row, col)]));
                }
            }
        }
        (lower, dense)
    }

    #[test]
    fn solve_and_inverse_diagonal_match_the_dense_inverse() {
        let (lower, dense) = example(60);
        let factor = SparseCholesky::new(60, &lower).expect("positive definite");
        let inverse = dense.clone().try_inverse().expect("regular");
        for (i, z) in factor.inverse_diagonal().into_iter().enumerate() {
            assert!((z - inverse[(i, i)]).abs() < 1e-12, "row {i}");
        }
        let b: Vec<f64> = (0..60).map(|i| f64::from(i).sin()).collect();
        let x = &inverse * nalgebra::DVector::from_column_slice(&b);
        for (ours, dense) in factor.solve(&b).iter().zip(x.iter()) {
            assert!((ours - dense).abs() < 1e-12);
        }
    }

    #[test]
    fn an_indefinite_matrix_is_an_error() {
        let lower = [(0, 0, 1.0), (1, 0, 2.0), (1, 1, 1.0)];
        assert_eq!(SparseCholesky::new(2, &lower).unwrap_err(), CholeskyError::NotPositiveDefinite);
    }
}
