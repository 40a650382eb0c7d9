//! The entries of the inverse on the factor's pattern, block by block.
//!
//! For a block of columns J whose rows below are B, with `Y = L_BJ L_JJ⁻¹`,
//!
//! ```text
//! Z_BJ = −Z_BB Y,     Z_JJ = (L_JJ L_JJᵀ)⁻¹ − Yᵀ Z_BJ
//! ```
//! from the last block to the first; every entry of `Z_BB` lies in the pattern already. This is
//! Takahashi's recursion (module page) in blocks; source [Lin, Yang, Meza, Lu, Ying, E 2011].

use super::analysis::{Analysis, Factor};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLltRef, SymbolicSupernodalCholesky};
use faer::{Accum, Mat, Par};

impl Factor {
    /// The diagonal of S⁻¹. Takes about as long as a few factorisations, and as much memory as
    /// the factor once more.
    #[must_use]
    pub fn inverse_diagonal(&self) -> Vec<f64> {
        let analysis: &Analysis = &self.analysis;
        let Some(blocks) = analysis.supernodes() else { return Vec::new() };
        let factor = SupernodalLltRef::new(blocks, &self.values);
        let mut inverse = Inverse::new(blocks, self.values.len());
        for s in (0..blocks.n_supernodes()).rev() {
            inverse.add_block(s, factor);
        }
        analysis.restore_order(inverse.diagonal)
    }
}

/// The entries found so far, stored as the factor is.
struct Inverse<'a> {
    blocks: &'a SymbolicSupernodalCholesky<u32>,
    /// Which block a column belongs to.
    block_of: Vec<u32>,
    values: Vec<f64>,
    diagonal: Vec<f64>,
}

impl<'a> Inverse<'a> {
    fn new(blocks: &'a SymbolicSupernodalCholesky<u32>, n_values: usize) -> Self {
        let mut block_of = vec![0; blocks.nrows()];
        let ends = blocks.supernode_begin().iter().zip(blocks.supernode_end());
        for (s, (begin, end)) in (0..).zip(ends) {
            block_of[*begin as usize..*end as usize].fill(s);
        }
        let diagonal = vec![0.0; blocks.nrows()];
        Self { blocks, block_of, values: vec![0.0; n_values], diagonal }
    }

    fn add_block(&mut self, s: usize, factor: SupernodalLltRef<'_, u32, f64>) {
        let block = factor.supernode(s);
        let (start, pattern, l) = (block.start(), block.pattern(), block.val());
        let (n_own, n_below) = (l.ncols(), pattern.len());
        let mut own_inverse = Mat::<f64>::zeros(n_own, n_own);
        invert_lower_triangular(own_inverse.as_mut(), l.subrows(0, n_own), Par::Seq);
        let product = |a: faer::MatRef<'_, f64>, b: faer::MatRef<'_, f64>, sign: f64| {
            let mut c = Mat::<f64>::zeros(a.nrows(), b.ncols());
            matmul(c.as_mut(), Accum::Replace, a, b, sign, Par::Seq);
            c
        };
        let mut z_own = product(own_inverse.transpose(), own_inverse.as_ref(), 1.0);
        let mut z_below = Mat::<f64>::zeros(0, n_own);
        if n_below > 0 {
            let y = product(l.subrows(n_own, n_below), own_inverse.as_ref(), 1.0);
            z_below = product(self.below(pattern).as_ref(), y.as_ref(), -1.0);
            matmul(z_own.as_mut(), Accum::Add, y.transpose(), z_below.as_ref(), -1.0, Par::Seq);
        }
        let at = self.blocks.col_ptr_for_val()[s] as usize;
        let height = n_own + n_below;
        for j in 0..n_own {
            self.diagonal[start + j] = z_own[(j, j)];
            let column = &mut self.values[at + j * height..at + (j + 1) * height];
            for (i, value) in column.iter_mut().enumerate() {
                *value = if i < n_own { z_own[(i, j)] } else { z_below[(i - n_own, j)] };
            }
        }
    }

    /// `Z_BB`, both triangles.
    fn below(&self, pattern: &[u32]) -> Mat<f64> {
        let mut z = Mat::<f64>::zeros(pattern.len(), pattern.len());
        for (j, column) in pattern.iter().enumerate() {
            let s = self.block_of[*column as usize] as usize;
            let (begin, end) = (self.blocks.supernode_begin()[s], self.blocks.supernode_end()[s]);
            let rows_below = self.blocks.supernode(s).pattern();
            let n_own = (end - begin) as usize;
            let height = n_own + rows_below.len();
            let at = self.blocks.col_ptr_for_val()[s] as usize + (column - begin) as usize * height;
            let stored = &self.values[at..at + height];
            let mut at_row = 0;
            for (i, row) in pattern.iter().enumerate().skip(j) {
                let value = if *row < end {
                    stored[(row - begin) as usize]
                } else {
                    while rows_below[at_row] < *row {
                        at_row += 1;
                    }
                    stored[n_own + at_row]
                };
                z[(i, j)] = value;
                z[(j, i)] = value;
            }
        }
        z
    }
}
