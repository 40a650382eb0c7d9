//! A symmetric matrix on a lattice whose rows reach thirteen nodes, stored by diagonals.
//!
//! ```text
//!            NN
//!        NW  N  NE         stored for every node: the entries towards HERE, E, EE, NW, N, NE, NN
//!    ww  w  HERE E  EE     the others are those of the nodes over there
//!        sw  s  se
//!            ss
//! ```

pub(super) const HERE: usize = 0;
pub(super) const E: usize = 1;
pub(super) const EE: usize = 2;
pub(super) const NW: usize = 3;
pub(super) const N: usize = 4;
pub(super) const NE: usize = 5;
pub(super) const NN: usize = 6;

/// The matrix; `parts[p][i]` is the entry of node i and the node in direction p from it, zero
/// where there is none.
#[derive(Debug, Clone)]
pub(super) struct Stencil {
    pub(super) parts: [Vec<f64>; 7],
    n_cols: usize,
}

impl Stencil {
    pub(super) fn zeros((n_cols, n_rows): (usize, usize)) -> Self {
        Self { parts: std::array::from_fn(|_| vec![0.0; n_cols * n_rows]), n_cols }
    }

    pub(super) fn n_nodes(&self) -> usize {
        self.parts[HERE].len()
    }

    /// How far the node in each direction lies ahead in the numbering.
    const fn offsets(n_cols: usize) -> [usize; 7] {
        [0, 1, 2, n_cols - 1, n_cols, n_cols + 1, 2 * n_cols]
    }

    /// y = S x.
    ///
    /// Entries that would reach around the end of a row are zero, so rows need no care.
    pub(super) fn apply(&self, x: &[f64], y: &mut [f64]) {
        let n = x.len();
        for (y, (s, x)) in y.iter_mut().zip(self.parts[HERE].iter().zip(x)) {
            *y = s * x;
        }
        // In blocks that stay in the nearest cache, both triangles at once.
        const BLOCK: usize = 1024;
        let offsets = Self::offsets(self.n_cols);
        for from in (0..n).step_by(BLOCK) {
            let to = (from + BLOCK).min(n);
            for (part, offset) in self.parts.iter().zip(offsets).skip(1) {
                let ahead = to.min(n.saturating_sub(offset));
                if from < ahead {
                    add_product(&mut y[from..ahead], &part[from..ahead], &x[from + offset..]);
                }
                let first = from.max(offset);
                if first < to {
                    let behind = first - offset;
                    add_product(&mut y[first..to], &part[behind..], &x[behind..]);
                }
            }
        }
    }

    /// The entries of the lower triangle, column by column, as [`lower_pattern`] orders them.
    pub(super) fn lower_values(&self) -> Vec<f64> {
        let n_rows = self.n_nodes() / self.n_cols;
        let mut values = Vec::with_capacity(7 * self.n_nodes());
        for row in 0..n_rows {
            for col in 0..self.n_cols {
                let node = row * self.n_cols + col;
                let is_there = reach(col, row, self.n_cols, n_rows);
                let parts = self.parts.iter().zip(is_there);
                values.extend(parts.filter(|(_, there)| *there).map(|(part, _)| part[node]));
            }
        }
        values
    }
}

fn add_product(y: &mut [f64], a: &[f64], b: &[f64]) {
    for (y, (a, b)) in y.iter_mut().zip(a.iter().zip(b)) {
        *y += a * b;
    }
}

/// Which of the seven directions lead to a node.
const fn reach(col: usize, row: usize, n_cols: usize, n_rows: usize) -> [bool; 7] {
    let (e, n) = (col + 1 < n_cols, row + 1 < n_rows);
    [true, e, col + 2 < n_cols, n && col > 0, n, n && e, row + 2 < n_rows]
}

/// Column starts and row indices of the lower triangle. All lattices of one extent share it,
/// whatever their walls.
#[expect(clippy::cast_possible_truncation, reason = "lattices have fewer than 2^32/7 nodes")]
pub(super) fn lower_pattern(n_cols: usize, n_rows: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0];
    let mut rows = Vec::with_capacity(7 * n_cols * n_rows);
    let offsets = Stencil::offsets(n_cols);
    for row in 0..n_rows {
        for col in 0..n_cols {
            let node = row * n_cols + col;
            let is_there = reach(col, row, n_cols, n_rows);
            let ahead = offsets.iter().zip(is_there).filter(|(_, there)| *there);
            rows.extend(ahead.map(|(offset, _)| (node + offset) as u32));
            starts.push(rows.len() as u32);
        }
    }
    (starts, rows)
}
