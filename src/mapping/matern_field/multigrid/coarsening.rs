//! Galerkin's coarse matrices Pᵀ A P, with bilinear interpolation P.
//!
//! Along a line, coarse node J is fine node 2J, and the fine nodes beside it hang on it with ½. A
//! matrix that ties neighbours only, with diagonal T and U from j to j + 1, becomes
//!
//! ```text
//! T'_J = T_2J + ¼ (T_2J−1 + T_2J+1) + ½ (U + Uᵀ)_2J−1 + ½ (U + Uᵀ)_2J
//! U'_J = ½ U_2J + ¼ T_2J+1 + ½ U_2J+1
//! ```
//! P is the product of one along x and one along y, so this is done twice: first with numbers, then
//! with rows, whose T and U are matrices along x.

use super::Ahead;
use super::grid::{Frame, Grid};
use std::sync::Arc;

/// Entries by rows of equal length; what lies outside is zero.
struct Entries {
    n_cols: usize,
    values: Vec<Ahead>,
}

impl Frame {
    /// The frame of the next grid: every second node, and one beyond the last where it is needed.
    pub(super) fn coarsened(&self) -> Self {
        let mut coarse = Self::empty(self.n_cols / 2 + 1, self.n_rows / 2 + 1, false);
        coarse.k = Self::galerkin(&Entries::inside(self, &self.k), &coarse);
        let m = if self.m.is_empty() {
            let identity = vec![[1.0, 0.0, 0.0, 0.0, 0.0]; self.n_cols * self.n_rows];
            Entries { n_cols: self.n_cols, values: identity }
        } else {
            Entries::inside(self, &self.m)
        };
        coarse.m = Self::galerkin(&m, &coarse);
        coarse
    }

    /// A matrix of this grid on the next one, with its ring.
    fn galerkin(fine: &Entries, coarse: &Self) -> Vec<Ahead> {
        let next = fine.coarsened_along_x(coarse.n_cols).coarsened_along_y(coarse.n_rows);
        let mut values = vec![[0.0; 5]; coarse.k.len()];
        for row in 0..coarse.n_rows {
            let from = coarse.at(0, row);
            values[from..from + coarse.n_cols].copy_from_slice(next.row(row));
        }
        values
    }
}

impl Grid {
    /// The data on the next grid.
    pub(super) fn coarsened(&self, coarse: &Arc<Frame>) -> Self {
        Self::new(coarse, Frame::galerkin(&Entries::inside(&self.frame, &self.w), coarse))
    }
}

impl Entries {
    /// Those of a grid's nodes, without the ring.
    fn inside(frame: &Frame, values: &[Ahead]) -> Self {
        let rows = (0..frame.n_rows).flat_map(|row| {
            let from = frame.at(0, row);
            values[from..from + frame.n_cols].iter().copied()
        });
        Self { n_cols: frame.n_cols, values: rows.collect() }
    }

    fn row(&self, row: usize) -> &[Ahead] {
        self.values.get(row * self.n_cols..(row + 1) * self.n_cols).unwrap_or(&[])
    }

    fn coarsened_along_x(&self, n_cols: usize) -> Self {
        let mut values = Vec::with_capacity(self.values.len() / self.n_cols * n_cols);
        // Column c is at c + 1, with zeros on both sides.
        let mut line = vec![[0.0; 5]; 2 * n_cols + 2];
        for row in self.values.chunks_exact(self.n_cols) {
            line[1..=self.n_cols].copy_from_slice(row);
            values.extend((0..n_cols).map(|col| {
                let from = 2 * col;
                along_x(&line[from], &line[from + 1], &line[from + 2])
            }));
        }
        Self { n_cols, values }
    }

    fn coarsened_along_y(&self, n_rows: usize) -> Self {
        let n = self.n_cols;
        let zeros = vec![[0.0; 5]; n];
        let row = |index: usize| match self.row(index) {
            [] => &zeros[..],
            row => row,
        };
        let mut values = Vec::with_capacity(n * n_rows);
        for coarse_row in 0..n_rows {
            let [below, here, above] =
                [(2 * coarse_row).wrapping_sub(1), 2 * coarse_row, 2 * coarse_row + 1]
                    .map(|index| if index == usize::MAX { &zeros[..] } else { row(index) });
            values.extend((0..n).map(|i| {
                let sum = |p: usize| here[i][p] + 0.25 * (below[i][p] + above[i][p]);
                let next_nw = |row: &[Ahead]| row.get(i + 1).map_or(0.0, |next| next[2]);
                let eastwards = |row: &[Ahead]| row[i][4] + next_nw(row);
                let west = i.checked_sub(1).map_or(0.0, |west| above[west][1]);
                [
                    sum(0) + below[i][3] + here[i][3],
                    sum(1) + 0.5 * (eastwards(below) + eastwards(here)),
                    0.5 * (here[i][2] + above[i][2]) + 0.25 * west,
                    0.5 * (here[i][3] + above[i][3]) + 0.25 * above[i][0],
                    0.5 * (here[i][4] + above[i][4]) + 0.25 * above[i][1],
                ]
            }));
        }
        Self { n_cols: n, values }
    }
}

/// One coarse node of a row from the fine nodes 2J − 1, 2J and 2J + 1.
fn along_x(left: &Ahead, here: &Ahead, right: &Ahead) -> Ahead {
    // Within the row the entries are symmetric: the one westwards is the western node's E. The
    // entries to the next row are those of a general matrix: NW, N, NE.
    [
        here[0] + 0.25 * (left[0] + right[0]) + left[1] + here[1],
        0.5 * (here[1] + right[1]) + 0.25 * right[0],
        0.5 * (here[2] + left[2]) + 0.25 * left[3],
        here[3]
            + 0.25 * (left[3] + right[3])
            + 0.5 * (here[2] + here[4])
            + 0.5 * (left[4] + right[2]),
        0.5 * (here[4] + right[4]) + 0.25 * right[3],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;
    use nalgebra::DMatrix;

    /// The grid's W as a dense matrix.
    fn dense(grid: &Grid) -> DMatrix<f64> {
        let n = grid.frame.n_cols * grid.frame.n_rows;
        let mut a = DMatrix::zeros(n, n);
        for row in 0..grid.frame.n_rows {
            for col in 0..grid.frame.n_cols {
                let node = row * grid.frame.n_cols + col;
                let entries = grid.w[grid.frame.at(col, row)];
                let ahead = [0, 1, grid.frame.n_cols - 1, grid.frame.n_cols, grid.frame.n_cols + 1];
                for (entry, offset) in entries.iter().zip(ahead) {
                    if node + offset < n && *entry != 0.0 {
                        a[(node, node + offset)] = *entry;
                        a[(node + offset, node)] = *entry;
                    }
                }
            }
        }
        a
    }

    #[test]
    fn coarse_matrix_is_galerkins() {
        let mut noise = SeedBook::new(3).stream("coarsening");
        for (n_cols, n_rows) in [(7, 6), (6, 5), (8, 9)] {
            let frame = Arc::new(Frame::empty(n_cols, n_rows, false));
            let mut w = vec![[0.0; 5]; frame.k.len()];
            for row in 0..n_rows {
                for col in 0..n_cols {
                    let (e, n) = (col + 1 < n_cols, row + 1 < n_rows);
                    let at = frame.at(col, row);
                    let is_there = [true, e, n && col > 0, n, n && e];
                    w[at] = is_there.map(|there| if there { noise.normal() } else { 0.0 });
                }
            }
            let fine = Grid::new(&frame, w);
            let coarse = fine.coarsened(&Arc::new(frame.coarsened()));
            let (n_coarse_cols, n_coarse_rows) = (coarse.frame.n_cols, coarse.frame.n_rows);
            let mut p = DMatrix::<f64>::zeros(n_cols * n_rows, n_coarse_cols * n_coarse_rows);
            // Bilinear interpolation by its definition: hats of half-width 2.
            #[expect(clippy::cast_precision_loss, reason = "a few nodes")]
            let hat = |fine: usize, coarse: usize| {
                (1.0 - (fine as f64 - 2.0 * coarse as f64).abs() / 2.0).max(0.0)
            };
            for i in 0..p.nrows() {
                for j in 0..p.ncols() {
                    p[(i, j)] =
                        hat(i % n_cols, j % n_coarse_cols) * hat(i / n_cols, j / n_coarse_cols);
                }
            }
            let expected = p.transpose() * dense(&fine) * &p;
            assert!((dense(&coarse) - expected).amax() < 1e-12, "{n_cols} × {n_rows}");
        }
    }
}
