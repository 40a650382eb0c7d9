//! One grid: its matrices, sweeps, and the transfer to the next coarser one.

use super::Ahead;
use crate::mapping::matern_field::information::Information;
use crate::mapping::matern_field::lattice::{EAST, Lattice, NORTH};
use crate::mapping::matern_field::prior::Operator;

/// x and y of a node.
pub(super) type Pair = [f64; 2];

/// The entries of one grid, with a ring of empty nodes around it so that no node lacks a neighbour.
#[derive(Debug)]
pub(super) struct Grid {
    pub(super) n_cols: usize,
    pub(super) n_rows: usize,
    /// W.
    pub(super) w: Vec<Ahead>,
    /// √s K.
    pub(super) k: Vec<Ahead>,
    /// What I becomes on coarse grids; empty on the finest, where it is I.
    pub(super) m: Vec<Ahead>,
    /// (m, k, w)/(w m + k²) of the diagonals: the inverse of a node's own two equations.
    own_inverse: Vec<[f64; 3]>,
}

/// One row of a grid, and the rows below and above of what it meets.
struct Rows<'a, const FINEST: bool> {
    w: &'a [Ahead],
    k: &'a [Ahead],
    m: &'a [Ahead],
    w_south: &'a [Ahead],
    k_south: &'a [Ahead],
    m_south: &'a [Ahead],
}

impl Grid {
    pub(super) fn empty(n_cols: usize, n_rows: usize, is_finest: bool) -> Self {
        let n = (n_cols + 2) * (n_rows + 2);
        let zeros = || vec![[0.0; 5]; n];
        let m = if is_finest { Vec::new() } else { zeros() };
        Self { n_cols, n_rows, w: zeros(), k: zeros(), m, own_inverse: vec![[0.0; 3]; n] }
    }

    pub(super) fn finest(
        lattice: &Lattice,
        operator: &Operator,
        information: &Information,
    ) -> Self {
        let (n_cols, n_rows) = lattice.size();
        let mut grid = Self::empty(n_cols, n_rows, true);
        let root = operator.scale.sqrt();
        for (node, links) in lattice.links().iter().enumerate() {
            let at = grid.at(node % n_cols, node / n_cols);
            let bond = |way: u8| if links & way == 0 { 0.0 } else { -root };
            grid.w[at] = information.entries(node);
            grid.k[at] = [root * operator.diagonal[node], bond(EAST), 0.0, bond(NORTH), 0.0];
        }
        grid.invert_diagonals();
        grid
    }

    pub(super) fn invert_diagonals(&mut self) {
        for row in 0..self.n_rows {
            for col in 0..self.n_cols {
                let at = self.at(col, row);
                let m = self.m.get(at).map_or(1.0, |m| m[0]);
                let (w, k) = (self.w[at][0], self.k[at][0]);
                let det = w * m + k * k;
                self.own_inverse[at] = [m / det, k / det, w / det];
            }
        }
    }

    const fn stride(&self) -> usize {
        self.n_cols + 2
    }

    pub(super) const fn at(&self, col: usize, row: usize) -> usize {
        (row + 1) * self.stride() + col + 1
    }

    pub(super) fn zeros(&self) -> Vec<Pair> {
        vec![[0.0; 2]; self.w.len()]
    }

    const fn is_finest(&self) -> bool {
        self.m.is_empty()
    }

    /// A forward sweep of Gauss and Seidel from zero.
    pub(super) fn sweep_from_zero(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        unknown.fill([0.0; 2]);
        // What lies ahead is zero still.
        if self.is_finest() {
            self.sweep::<true, false>(unknown, rhs, 0..self.n_rows);
        } else {
            self.sweep::<false, false>(unknown, rhs, 0..self.n_rows);
        }
    }

    pub(super) fn sweep_forwards(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        if self.is_finest() {
            self.sweep::<true, true>(unknown, rhs, 0..self.n_rows);
        } else {
            self.sweep::<false, true>(unknown, rhs, 0..self.n_rows);
        }
    }

    fn rows<const FINEST: bool>(&self, row: usize) -> Rows<'_, FINEST> {
        let n = self.stride();
        let (here, south) = ((row + 1) * n..(row + 2) * n, row * n..(row + 1) * n);
        let m = |range: std::ops::Range<usize>| if FINEST { &[][..] } else { &self.m[range][..n] };
        Rows {
            w: &self.w[here.clone()][..n],
            k: &self.k[here.clone()][..n],
            m: m(here),
            w_south: &self.w[south.clone()][..n],
            k_south: &self.k[south.clone()][..n],
            m_south: m(south),
        }
    }

    /// Solves for both unknowns of each node in turn, forwards.
    fn sweep<const FINEST: bool, const LOOKS_AHEAD: bool>(
        &self,
        unknown: &mut [Pair],
        rhs: &[Pair],
        rows: std::ops::Range<usize>,
    ) {
        let n = self.stride();
        for row in rows {
            let entries = self.rows::<FINEST>(row);
            let (south, here, north) = three_rows(unknown, row, n);
            let rhs = &rhs[(row + 1) * n..][..n];
            let inverse = &self.own_inverse[(row + 1) * n..][..n];
            for i in 1..n - 1 {
                let mut r = rhs[i];
                if LOOKS_AHEAD {
                    entries.take_ahead(&mut r, i, here, north);
                }
                entries.take_behind(&mut r, i, south, here);
                here[i] = own(&inverse[i], r);
            }
        }
    }

    /// Solves for both unknowns of each node in turn, backwards.
    pub(super) fn sweep_backwards(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        if self.is_finest() {
            self.sweep_back::<true>(unknown, rhs);
        } else {
            self.sweep_back::<false>(unknown, rhs);
        }
    }

    fn sweep_back<const FINEST: bool>(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        let n = self.stride();
        for row in (0..self.n_rows).rev() {
            let entries = self.rows::<FINEST>(row);
            let (south, here, north) = three_rows(unknown, row, n);
            let rhs = &rhs[(row + 1) * n..][..n];
            let inverse = &self.own_inverse[(row + 1) * n..][..n];
            for i in (1..n - 1).rev() {
                let mut r = rhs[i];
                entries.take_behind(&mut r, i, south, here);
                entries.take_ahead(&mut r, i, here, north);
                here[i] = own(&inverse[i], r);
            }
        }
    }

    /// The residual after a sweep from zero, on the coarse grid: Pᵀ (b − A u).
    ///
    /// Such a sweep leaves at each node exactly what lies ahead of it: −Σ A u over those.
    pub(super) fn restrict_residual(&self, unknown: &[Pair], coarse: &Self, below: &mut [Pair]) {
        if self.is_finest() {
            self.restrict::<true>(unknown, coarse, below);
        } else {
            self.restrict::<false>(unknown, coarse, below);
        }
    }

    fn restrict<const FINEST: bool>(&self, unknown: &[Pair], coarse: &Self, below: &mut [Pair]) {
        let (n, n_coarse) = (self.stride(), coarse.stride());
        below.fill([0.0; 2]);
        // The residual of a row, with a zero on either side: node `col` is at `col + 1`.
        let mut residual = vec![[0.0; 2]; 2 * n_coarse];
        for row in 0..self.n_rows {
            let entries = self.rows::<FINEST>(row);
            let (here, north) = (&unknown[(row + 1) * n..][..n], &unknown[(row + 2) * n..][..n]);
            for (i, left) in residual.iter_mut().enumerate().take(n - 1).skip(1) {
                *left = [0.0; 2];
                entries.take_ahead(left, i, here, north);
            }
            for (coarse_row, share) in parents(row) {
                if share == 0.0 {
                    continue;
                }
                let from = coarse.at(0, coarse_row);
                let target = &mut below[from..from + coarse.n_cols];
                for (col, target) in target.iter_mut().enumerate() {
                    for xy in 0..2 {
                        let sides = residual[2 * col][xy] + residual[2 * col + 2][xy];
                        target[xy] += share * (residual[2 * col + 1][xy] + 0.5 * sides);
                    }
                }
            }
        }
    }

    /// Adds the coarse grid's unknowns, interpolated.
    pub(super) fn add_correction(&self, unknown: &mut [Pair], coarse: &Self, below: &[Pair]) {
        let n = self.stride();
        let mut between = vec![[0.0; 2]; coarse.n_cols + 1];
        for row in 0..self.n_rows {
            let [(first, a), (second, b)] = parents(row);
            let (first, second) = (&below[coarse.at(0, first)..], &below[coarse.at(0, second)..]);
            let both = first.iter().zip(second);
            for (value, (first, second)) in between.iter_mut().zip(both).take(coarse.n_cols) {
                *value = [a * first[0] + b * second[0], a * first[1] + b * second[1]];
            }
            let here = &mut unknown[(row + 1) * n + 1..(row + 2) * n - 1];
            for (pair, side) in here.chunks_mut(2).zip(between.windows(2)) {
                for xy in 0..2 {
                    pair[0][xy] += side[0][xy];
                    if let Some(odd) = pair.get_mut(1) {
                        odd[xy] += 0.5 * (side[0][xy] + side[1][xy]);
                    }
                }
            }
        }
    }
}

/// The coarse nodes that a fine column (or row) hangs on, with their weights; the second is
/// the first again with no weight where the fine one lies on a coarse one.
const fn parents(index: usize) -> [(usize, f64); 2] {
    if index.is_multiple_of(2) {
        [(index / 2, 1.0), (index / 2, 0.0)]
    } else {
        [(index / 2, 0.5), (index / 2 + 1, 0.5)]
    }
}

/// The unknowns of row − 1, row and row + 1.
fn three_rows(unknown: &mut [Pair], row: usize, n: usize) -> (&[Pair], &mut [Pair], &[Pair]) {
    let (south, rest) = unknown.split_at_mut((row + 1) * n);
    let (here, north) = rest.split_at_mut(n);
    (&south[row * n..][..n], &mut here[..n], &north[..n])
}

/// Solves a node's own two equations w x + k y = r₀, k x − m y = r₁.
#[inline]
fn own(inverse: &[f64; 3], r: Pair) -> Pair {
    [inverse[0] * r[0] + inverse[1] * r[1], inverse[1] * r[0] - inverse[2] * r[1]]
}

/// r −= A u for one neighbour.
#[inline]
fn take(r: &mut Pair, w: f64, k: f64, m: f64, u: Pair) {
    r[0] -= w * u[0] + k * u[1];
    r[1] -= k * u[0] - m * u[1];
}

impl<const FINEST: bool> Rows<'_, FINEST> {
    /// Takes the neighbours E, NW, N, NE of node i from its right-hand side; E comes last, so
    /// that a backward sweep waits for it as late as possible.
    #[inline]
    fn take_ahead(&self, r: &mut Pair, i: usize, here: &[Pair], north: &[Pair]) {
        let (w, k) = (&self.w[i], &self.k[i]);
        if FINEST {
            r[0] -= w[2] * north[i - 1][0] + w[4] * north[i + 1][0];
            take(r, w[3], k[3], 0.0, north[i]);
            take(r, w[1], k[1], 0.0, here[i + 1]);
        } else {
            let m = &self.m[i];
            take(r, w[2], k[2], m[2], north[i - 1]);
            take(r, w[3], k[3], m[3], north[i]);
            take(r, w[4], k[4], m[4], north[i + 1]);
            take(r, w[1], k[1], m[1], here[i + 1]);
        }
    }

    /// Takes the neighbours SW, S, SE, W of node i from its right-hand side, W last.
    #[inline]
    fn take_behind(&self, r: &mut Pair, i: usize, south: &[Pair], here: &[Pair]) {
        let (w, k) = (self.w_south, self.k_south);
        if FINEST {
            r[0] -= w[i + 1][2] * south[i + 1][0] + w[i - 1][4] * south[i - 1][0];
            take(r, w[i][3], k[i][3], 0.0, south[i]);
            take(r, self.w[i - 1][1], self.k[i - 1][1], 0.0, here[i - 1]);
        } else {
            let (m, m_here) = (self.m_south, &self.m[i - 1]);
            take(r, w[i + 1][2], k[i + 1][2], m[i + 1][2], south[i + 1]);
            take(r, w[i][3], k[i][3], m[i][3], south[i]);
            take(r, w[i - 1][4], k[i - 1][4], m[i - 1][4], south[i - 1]);
            take(r, self.w[i - 1][1], self.k[i - 1][1], m_here[1], here[i - 1]);
        }
    }
}
