//! The factor of matrices that share a pattern: the pattern is analysed once, each matrix is then
//! factorised by blocks of columns (supernodes).

use super::CholeskyError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::prelude::MatMut;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLltRef, SymbolicSupernodalCholesky};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, Par, Side, Spec};
use std::sync::Arc;

/// Order of elimination and pattern of the factor.
#[derive(Debug)]
pub struct Analysis {
    pattern: SymbolicSparseColMat<u32>,
    symbolic: SymbolicCholesky<u32>,
}

impl Analysis {
    /// Analyses the pattern of a lower triangle: column j has the rows
    /// `rows[starts[j]..starts[j + 1]]`, ascending, the diagonal first.
    ///
    /// # Errors
    /// The pattern is not of this kind, or the factor does not fit into memory.
    pub fn new(size: usize, starts: &[u32], rows: &[u32]) -> Result<Self, CholeskyError> {
        let too_large = || CholeskyError::TooLarge { size };
        let is_sound = starts.len() == size + 1
            && starts.last().is_some_and(|end| *end as usize == rows.len())
            && starts.windows(2).all(|pair| pair[0] < pair[1])
            && starts.windows(2).all(|pair| {
                let column = &rows[pair[0] as usize..pair[1] as usize];
                column.windows(2).all(|pair| pair[0] < pair[1])
            })
            && rows.iter().all(|row| (*row as usize) < size);
        if !is_sound {
            return Err(too_large());
        }
        let pattern = SymbolicSparseColMat::<u32>::new_checked(
            size,
            size,
            starts.to_vec(),
            None,
            rows.to_vec(),
        );
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let symbolic = factorize_symbolic_cholesky(
            pattern.as_ref(),
            Side::Lower,
            SymmetricOrdering::Amd,
            params,
        )
        .map_err(|_| too_large())?;
        Ok(Self { pattern, symbolic })
    }

    /// Rows of the matrix.
    #[must_use]
    pub fn size(&self) -> usize {
        self.symbolic.nrows()
    }

    /// Factorises the matrix with these entries of the lower triangle, in the pattern's order.
    ///
    /// # Errors
    /// Not positive definite, or too large.
    pub fn factorize(self: &Arc<Self>, lower: &[f64]) -> Result<Factor, CholeskyError> {
        let too_large = || CholeskyError::TooLarge { size: self.size() };
        if lower.len() != self.pattern.row_idx().len() {
            return Err(too_large());
        }
        let mut values = vec![0.0; self.symbolic.len_val()];
        let scratch = self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| too_large())?;
        self.symbolic
            .factorize_numeric_llt(
                &mut values,
                SparseColMatRef::new(self.pattern.as_ref(), lower),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Spec::default(),
            )
            .map_err(|_| CholeskyError::NotPositiveDefinite)?;
        Ok(Factor { analysis: Arc::clone(self), values })
    }

    /// The blocks of columns; None never happens, they were asked for.
    pub(super) fn supernodes(&self) -> Option<&SymbolicSupernodalCholesky<u32>> {
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(blocks) => Some(blocks),
            SymbolicCholeskyRaw::Simplicial(_) => None,
        }
    }

    /// Values in the order of elimination → values in the matrix's order.
    pub(super) fn restore_order(&self, eliminated: Vec<f64>) -> Vec<f64> {
        let Some(perm) = self.symbolic.perm() else { return eliminated };
        let mut restored = vec![0.0; eliminated.len()];
        for (value, &place) in eliminated.iter().zip(perm.arrays().0) {
            restored[place as usize] = *value;
        }
        restored
    }
}

/// The factor L of S = L Lᵀ, rows and columns in the order of elimination.
#[derive(Debug)]
pub struct Factor {
    pub(super) analysis: Arc<Analysis>,
    pub(super) values: Vec<f64>,
}

impl Factor {
    /// S⁻¹ b.
    #[must_use]
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let [x] = self.solve_each([b]);
        x
    }

    /// S⁻¹ b for several b: the factor is gone through once.
    #[must_use]
    pub fn solve_each<const N: usize>(&self, of: [&[f64]; N]) -> [Vec<f64>; N] {
        let symbolic = &self.analysis.symbolic;
        let scratch = symbolic.solve_in_place_scratch::<f64>(N, Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        let n = self.analysis.size();
        let mut x = of.concat();
        LltRef::new(symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut x, n, N),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        std::array::from_fn(|k| x[k * n..(k + 1) * n].to_vec())
    }

    /// ln det S.
    #[must_use]
    pub fn log_det(&self) -> f64 {
        let Some(blocks) = self.analysis.supernodes() else { return f64::NAN };
        let factor = SupernodalLltRef::new(blocks, &self.values);
        let of_block = |s: usize| {
            let block = factor.supernode(s).val();
            (0..block.ncols()).map(|j| 2.0 * block[(j, j)].ln()).sum::<f64>()
        };
        (0..blocks.n_supernodes()).map(of_block).sum()
    }

    /// L⁻ᵀ z in the matrix's order: a draw of N(0, S⁻¹) if z is white noise of variance 1.
    #[must_use]
    pub fn colour(&self, white: &[f64]) -> Vec<f64> {
        let mut x = white.to_vec();
        let Some(blocks) = self.analysis.supernodes() else { return x };
        let factor = SupernodalLltRef::new(blocks, &self.values);
        for s in (0..blocks.n_supernodes()).rev() {
            let block = factor.supernode(s);
            let (start, pattern, l) = (block.start(), block.pattern(), block.val());
            let n_own = l.ncols();
            for j in (0..n_own).rev() {
                let mut sum = x[start + j];
                for i in j + 1..n_own {
                    sum -= l[(i, j)] * x[start + i];
                }
                for (i, row) in pattern.iter().enumerate() {
                    sum -= l[(n_own + i, j)] * x[*row as usize];
                }
                x[start + j] = sum / l[(j, j)];
            }
        }
        self.analysis.restore_order(x)
    }
}
