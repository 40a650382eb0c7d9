//! One grid: its matrices, sweeps, and the transfer to the next coarser one.

use super::Ahead;
use crate::mapping::matern_field::information::Information;
use crate::mapping::matern_field::lattice::{EAST, Lattice, NORTH};
use crate::mapping::matern_field::prior::Operator;
use std::sync::Arc;

/// x and y of a node.
pub(super) type Pair = [f64; 2];

/// What the prior alone puts into one grid, with a ring of empty nodes around it so that no node lacks
/// a neighbour.
#[derive(Debug)]
pub(in crate::mapping::matern_field) struct Frame {
    pub(super) n_cols: usize,
    pub(super) n_rows: usize,
    /// √s K.
    pub(super) k: Vec<Ahead>,
    /// What I becomes on coarse grids; empty on the finest, where it is I.
    pub(super) m: Vec<Ahead>,
}

/// One grid: its frame and what the data put into it.
#[derive(Debug)]
pub(super) struct Grid {
    pub(super) frame: Arc<Frame>,
    /// W.
    pub(super) w: Vec<Ahead>,
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

/// One row of a grid with its right-hand sides.
struct Line<'a, const FINEST: bool> {
    entries: Rows<'a, FINEST>,
    rhs: &'a [Pair],
    inverse: &'a [[f64; 3]],
}

/// How far the second of two rows stays behind in a sweep: its node i − 2 needs node i − 1 of the first,
/// which was finished a step before.
const LAG: usize = 2;

impl Frame {
    pub(super) fn empty(n_cols: usize, n_rows: usize, is_finest: bool) -> Self {
        let zeros = || vec![[0.0; 5]; (n_cols + 2) * (n_rows + 2)];
        Self { n_cols, n_rows, k: zeros(), m: if is_finest { Vec::new() } else { zeros() } }
    }

    pub(super) fn finest(lattice: &Lattice, operator: &Operator) -> Self {
        let (n_cols, n_rows) = lattice.size();
        let mut frame = Self::empty(n_cols, n_rows, true);
        let root = operator.scale.sqrt();
        for (node, links) in lattice.links().iter().enumerate() {
            let at = frame.at(node % n_cols, node / n_cols);
            let bond = |way: u8| if links & way == 0 { 0.0 } else { -root };
            frame.k[at] = [root * operator.diagonal[node], bond(EAST), 0.0, bond(NORTH), 0.0];
        }
        frame
    }

    const fn stride(&self) -> usize {
        self.n_cols + 2
    }

    pub(super) const fn at(&self, col: usize, row: usize) -> usize {
        (row + 1) * self.stride() + col + 1
    }

    pub(super) fn zeros(&self) -> Vec<Pair> {
        vec![[0.0; 2]; self.k.len()]
    }

    const fn is_finest(&self) -> bool {
        self.m.is_empty()
    }
}

impl Grid {
    pub(super) fn new(frame: &Arc<Frame>, w: Vec<Ahead>) -> Self {
        let mut own_inverse = vec![[0.0; 3]; w.len()];
        for row in 0..frame.n_rows {
            let from = frame.at(0, row);
            for at in from..from + frame.n_cols {
                let m = frame.m.get(at).map_or(1.0, |m| m[0]);
                let (w, k) = (w[at][0], frame.k[at][0]);
                let det = w * m + k * k;
                own_inverse[at] = [m / det, k / det, w / det];
            }
        }
        Self { frame: Arc::clone(frame), w, own_inverse }
    }

    pub(super) fn finest(frame: &Arc<Frame>, information: &Information) -> Self {
        let mut w = vec![[0.0; 5]; frame.k.len()];
        for row in 0..frame.n_rows {
            let from = frame.at(0, row);
            let of_row = &mut w[from..from + frame.n_cols];
            for (node, w) in (row * frame.n_cols..).zip(of_row) {
                *w = information.entries(node);
            }
        }
        Self::new(frame, w)
    }

    /// A forward sweep of Gauss and Seidel from zero.
    pub(super) fn sweep_from_zero(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        // What lies ahead counts as zero, whatever an earlier cycle left there.
        if self.frame.is_finest() {
            self.sweep::<true, false>(unknown, rhs);
        } else {
            self.sweep::<false, false>(unknown, rhs);
        }
    }

    pub(super) fn sweep_forwards(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        if self.frame.is_finest() {
            self.sweep::<true, true>(unknown, rhs);
        } else {
            self.sweep::<false, true>(unknown, rhs);
        }
    }

    fn rows<const FINEST: bool>(&self, row: usize) -> Rows<'_, FINEST> {
        let n = self.frame.stride();
        let (here, south) = ((row + 1) * n..(row + 2) * n, row * n..(row + 1) * n);
        let m = |range: std::ops::Range<usize>| {
            if FINEST { &[][..] } else { &self.frame.m[range][..n] }
        };
        Rows {
            w: &self.w[here.clone()][..n],
            k: &self.frame.k[here.clone()][..n],
            m: m(here),
            w_south: &self.w[south.clone()][..n],
            k_south: &self.frame.k[south.clone()][..n],
            m_south: m(south),
        }
    }

    fn line<'a, const FINEST: bool>(&'a self, row: usize, rhs: &'a [Pair]) -> Line<'a, FINEST> {
        let n = self.frame.stride();
        let here = (row + 1) * n..(row + 2) * n;
        Line {
            entries: self.rows(row),
            rhs: &rhs[here.clone()][..n],
            inverse: &self.own_inverse[here][..n],
        }
    }

    /// Solves for both unknowns of each node in turn, forwards.
    ///
    /// Each node waits for its neighbour in the west, so a core would mostly wait. Two rows go side by
    /// side, the northern one [`LAG`] nodes behind: what either meets is what it would meet row by row.
    fn sweep<const FINEST: bool, const LOOKS_AHEAD: bool>(
        &self,
        unknown: &mut [Pair],
        rhs: &[Pair],
    ) {
        let n = self.frame.stride();
        for row in (0..self.frame.n_rows).step_by(2) {
            let lower = self.line::<FINEST>(row, rhs);
            if row + 1 == self.frame.n_rows {
                let [south, here, north] = rows_of(unknown, row, n);
                for i in 1..n - 1 {
                    here[i] = lower.solved::<LOOKS_AHEAD>(i, south, here, north);
                }
                return;
            }
            let upper = self.line::<FINEST>(row + 1, rhs);
            let [south, here, next, north] = rows_of(unknown, row, n);
            for i in 1..n - 1 + LAG {
                if i < n - 1 {
                    here[i] = lower.solved::<LOOKS_AHEAD>(i, south, here, next);
                }
                if i > LAG {
                    let i = i - LAG;
                    next[i] = upper.solved::<LOOKS_AHEAD>(i, here, next, north);
                }
            }
        }
    }

    /// Solves for both unknowns of each node in turn, backwards.
    pub(super) fn sweep_backwards(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        if self.frame.is_finest() {
            self.sweep_back::<true>(unknown, rhs);
        } else {
            self.sweep_back::<false>(unknown, rhs);
        }
    }

    /// The same in the opposite order: of two rows, the southern one lags.
    fn sweep_back<const FINEST: bool>(&self, unknown: &mut [Pair], rhs: &[Pair]) {
        let n = self.frame.stride();
        let mut n_left = self.frame.n_rows;
        while n_left > 1 {
            let row = n_left - 2;
            let (lower, upper) = (self.line::<FINEST>(row, rhs), self.line::<FINEST>(row + 1, rhs));
            let [south, here, next, north] = rows_of(unknown, row, n);
            for back in 1..n - 1 + LAG {
                if back < n - 1 {
                    let i = n - 1 - back;
                    next[i] = upper.solved_back(i, here, next, north);
                }
                if back > LAG {
                    let i = n - 1 - (back - LAG);
                    here[i] = lower.solved_back(i, south, here, next);
                }
            }
            n_left -= 2;
        }
        if n_left == 1 {
            let line = self.line::<FINEST>(0, rhs);
            let [south, here, north] = rows_of(unknown, 0, n);
            for i in (1..n - 1).rev() {
                here[i] = line.solved_back(i, south, here, north);
            }
        }
    }

    /// The residual after a sweep from zero, on the coarse grid: Pᵀ (b − A u).
    ///
    /// Such a sweep leaves at each node exactly what lies ahead of it: −Σ A u over those.
    pub(super) fn restrict_residual(&self, unknown: &[Pair], coarse: &Self, below: &mut [Pair]) {
        if self.frame.is_finest() {
            self.restrict::<true>(unknown, coarse, below);
        } else {
            self.restrict::<false>(unknown, coarse, below);
        }
    }

    fn restrict<const FINEST: bool>(&self, unknown: &[Pair], coarse: &Self, below: &mut [Pair]) {
        let (n, n_coarse) = (self.frame.stride(), coarse.frame.stride());
        below.fill([0.0; 2]);
        // The residual of a row, with a zero on either side: node `col` is at `col + 1`.
        let mut residual = vec![[0.0; 2]; 2 * n_coarse];
        for row in 0..self.frame.n_rows {
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
                let from = coarse.frame.at(0, coarse_row);
                let target = &mut below[from..from + coarse.frame.n_cols];
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
        let n = self.frame.stride();
        let mut between = vec![[0.0; 2]; coarse.frame.n_cols + 1];
        for row in 0..self.frame.n_rows {
            let [(first, a), (second, b)] = parents(row);
            let (first, second) =
                (&below[coarse.frame.at(0, first)..], &below[coarse.frame.at(0, second)..]);
            let both = first.iter().zip(second);
            for (value, (first, second)) in between.iter_mut().zip(both).take(coarse.frame.n_cols) {
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

/// The unknowns of row − 1, row, and so on.
fn rows_of<const N: usize>(unknown: &mut [Pair], row: usize, n: usize) -> [&mut [Pair]; N] {
    let mut rest = unknown[row * n..].chunks_exact_mut(n);
    std::array::from_fn(|_| rest.next().unwrap_or_default())
}

/// Solves a node's own two equations w x + k y = r₀, k x − m y = r₁.
#[inline(always)]
fn own(inverse: &[f64; 3], r: Pair) -> Pair {
    [inverse[0] * r[0] + inverse[1] * r[1], inverse[1] * r[0] - inverse[2] * r[1]]
}

/// r −= A u for one neighbour.
#[inline(always)]
fn take(r: &mut Pair, w: f64, k: f64, m: f64, u: Pair) {
    r[0] -= w * u[0] + k * u[1];
    r[1] -= k * u[0] - m * u[1];
}

impl<const FINEST: bool> Line<'_, FINEST> {
    /// Both unknowns of node i from its neighbours' of the moment.
    #[inline(always)]
    fn solved<const LOOKS_AHEAD: bool>(
        &self,
        i: usize,
        south: &[Pair],
        here: &[Pair],
        north: &[Pair],
    ) -> Pair {
        let mut r = self.rhs[i];
        if LOOKS_AHEAD {
            self.entries.take_ahead(&mut r, i, here, north);
        }
        self.entries.take_behind(&mut r, i, south, here);
        own(&self.inverse[i], r)
    }

    /// The same where the neighbour in the east comes last.
    #[inline(always)]
    fn solved_back(&self, i: usize, south: &[Pair], here: &[Pair], north: &[Pair]) -> Pair {
        let mut r = self.rhs[i];
        self.entries.take_behind(&mut r, i, south, here);
        self.entries.take_ahead(&mut r, i, here, north);
        own(&self.inverse[i], r)
    }
}

impl<const FINEST: bool> Rows<'_, FINEST> {
    /// Takes the neighbours E, NW, N, NE of node i from its right-hand side; E comes last, so
    /// that a backward sweep waits for it as late as possible.
    #[inline(always)]
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
    #[inline(always)]
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
