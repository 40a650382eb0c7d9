//! The nodes of the field, and how a point on the ground is tied to them.

use super::prepared_prior::PreparedPrior;
use super::prior::Prior;
use crate::mapping::sparse_cholesky::{Analysis, CholeskyError};
use crate::messages::GridGeometry;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// A direction on the lattice as a bit of [`Lattice::links`].
pub(super) const EAST: u8 = 1;
pub(super) const NORTH: u8 = 2;
pub(super) const WEST: u8 = 4;
pub(super) const SOUTH: u8 = 8;

/// Parts per edge into which a square with a wall is cut to see which nodes a point sees.
const PARTS: usize = 8;

/// Nodes of the field: the cell centres of a map's grid, and padding all round.
///
/// ```text
///   y ▲   · · · · · ·     · padding node, outside of the map's grid
///     │   · o o o o ·     o node at the centre of a cell of the grid
///     │   · o o o o ·
///     │   · · · · · ·     node 0 is the corner of smallest x and y; rows run along x
///     └──────────────▶ x
/// ```
/// Walls cut links: between two nodes with a wall in between the field has no direct bond, and
/// an observation gives no weight to nodes behind a wall.
#[derive(Debug)]
pub struct Lattice {
    grid: GridGeometry,
    n_pad: usize,
    n_cols: usize,
    n_rows: usize,
    /// For each node, which of its four neighbours it is bound to.
    links: Vec<u8>,
    /// Squares that a wall cuts, by their lower left node: for each of their parts, which of the
    /// corners are seen from it (bit 0 south-west, 1 south-east, 2 north-west, 3 north-east).
    cut_squares: BTreeMap<usize, [u8; PARTS * PARTS]>,
    /// The factor's pattern, found at the first exact solve: it depends on the extent alone.
    analysis: OnceLock<Arc<Analysis>>,
    /// The newest prior that was solved for: it changes little by little in a flight.
    prepared: Mutex<Option<Arc<PreparedPrior>>>,
}

impl Clone for Lattice {
    fn clone(&self) -> Self {
        Self {
            links: self.links.clone(),
            cut_squares: self.cut_squares.clone(),
            analysis: self.analysis.clone(),
            prepared: Mutex::new(self.newest_prepared().clone()),
            ..*self
        }
    }
}

impl PartialEq for Lattice {
    fn eq(&self, other: &Self) -> bool {
        self.grid == other.grid
            && self.n_pad == other.n_pad
            && self.links == other.links
            && self.cut_squares == other.cut_squares
    }
}

/// How a point observes the field: four nodes of one square and their weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// South-west, south-east, north-west, north-east node of the square around the point.
    pub nodes: [u32; 4],
    /// Their weights, not negative, 1 in sum.
    pub weights: [f64; 4],
}

impl Row {
    /// The value of the field (or of anything else given at the nodes) at the point.
    #[must_use]
    pub fn value(&self, at_nodes: &[f64]) -> f64 {
        std::iter::zip(self.nodes, self.weights).map(|(n, a)| a * at_nodes[n as usize]).sum()
    }

    /// True if the point has to do with a marked node.
    #[must_use]
    pub fn touches(&self, marked: &[bool]) -> bool {
        std::iter::zip(self.nodes, self.weights).any(|(n, a)| a > 0.0 && marked[n as usize])
    }
}

impl Lattice {
    /// The lattice over a grid with `padding_m` around it, one node at least.
    ///
    /// `separates` says whether a wall stands between two points (x, y), m. It is asked for each
    /// link, and in squares with a wall also for each eighth of the edges.
    #[must_use]
    pub fn covering(
        grid: &GridGeometry,
        padding_m: f64,
        separates: impl Fn((f64, f64), (f64, f64)) -> bool,
    ) -> Self {
        Self::covering_beside_walls(grid, padding_m, |place| place, separates)
    }

    /// The same where walls have a thickness: `stand_in` gives the point that is asked for a node,
    /// itself or one beside the wall that it lies in, so that the ground in front of the wall has a
    /// node to rest on.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a float cast to an integer saturates"
    )]
    pub fn covering_beside_walls(
        grid: &GridGeometry,
        padding_m: f64,
        stand_in: impl Fn((f64, f64)) -> (f64, f64),
        separates: impl Fn((f64, f64), (f64, f64)) -> bool,
    ) -> Self {
        let n_pad = (padding_m / grid.cell_m).ceil().max(1.0) as usize;
        let (n_cols, n_rows) = (grid.n_cols + 2 * n_pad, grid.n_rows + 2 * n_pad);
        let mut lattice = Self {
            grid: *grid,
            n_pad,
            n_cols,
            n_rows,
            links: vec![0; n_cols * n_rows],
            cut_squares: BTreeMap::new(),
            analysis: OnceLock::new(),
            prepared: Mutex::new(None),
        };
        for node in 0..lattice.n_nodes() {
            lattice.tie(node, &stand_in, &separates);
        }
        lattice
    }

    /// Binds a node to its neighbours east and north, and looks for walls in its square.
    fn tie(
        &mut self,
        node: usize,
        stand_in: &impl Fn((f64, f64)) -> (f64, f64),
        separates: &impl Fn((f64, f64), (f64, f64)) -> bool,
    ) {
        let (col, row) = (node % self.n_cols, node / self.n_cols);
        let (has_east, has_north) = (col + 1 < self.n_cols, row + 1 < self.n_rows);
        let at = |lattice: &Self, node| stand_in(lattice.place_m(node));
        let here = at(self, node);
        let (east, north) = (node + 1, node + self.n_cols);
        if has_east && !separates(here, at(self, east)) {
            self.links[node] |= EAST;
            self.links[east] |= WEST;
        }
        if has_north && !separates(here, at(self, north)) {
            self.links[node] |= NORTH;
            self.links[north] |= SOUTH;
        }
        if has_east && has_north {
            let corners = [node, east, north, north + 1].map(|n| at(self, n));
            let pairs = [(0, 1), (0, 2), (1, 3), (2, 3), (0, 3), (1, 2)];
            let here_m = self.place_m(node);
            if pairs.iter().any(|&(a, b)| separates(corners[a], corners[b])) {
                let seen = seen_corners(here_m, self.grid.cell_m, &corners, separates);
                self.cut_squares.insert(node, seen);
            }
        }
    }

    /// Number of nodes.
    #[must_use]
    pub const fn n_nodes(&self) -> usize {
        self.n_cols * self.n_rows
    }

    /// Nodes along x and along y.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        (self.n_cols, self.n_rows)
    }

    /// The map's grid.
    #[must_use]
    pub const fn grid(&self) -> &GridGeometry {
        &self.grid
    }

    /// Distance between neighbours, m.
    #[must_use]
    pub const fn spacing_m(&self) -> f64 {
        self.grid.cell_m
    }

    /// The node at the centre of a cell of the grid.
    #[must_use]
    pub const fn node_of_cell(&self, cell: usize) -> usize {
        let (row, col) = (cell / self.grid.n_cols, cell % self.grid.n_cols);
        (row + self.n_pad) * self.n_cols + col + self.n_pad
    }

    /// The nodes at most so many steps from a node along x and along y, itself among them; walls do not
    /// count.
    pub fn within(&self, node: usize, n_steps: usize) -> impl Iterator<Item = usize> + use<> {
        let (n_cols, n_rows) = self.size();
        let (col, row) = (node % n_cols, node / n_cols);
        let rows = row.saturating_sub(n_steps)..=(row + n_steps).min(n_rows - 1);
        let cols = col.saturating_sub(n_steps)..=(col + n_steps).min(n_cols - 1);
        rows.flat_map(move |row| cols.clone().map(move |col| row * n_cols + col))
    }

    /// True if a node is the centre of a cell of the grid, not of the padding around it.
    #[must_use]
    pub const fn is_of_grid(&self, node: usize) -> bool {
        let (row, col) = (node / self.n_cols, node % self.n_cols);
        let is_in_rows = row >= self.n_pad && row < self.n_pad + self.grid.n_rows;
        is_in_rows && col >= self.n_pad && col < self.n_pad + self.grid.n_cols
    }

    /// Values at the nodes → values of the grid's cells.
    #[must_use]
    pub fn on_cells(&self, at_nodes: &[f64]) -> Vec<f64> {
        (0..self.grid.n_cells()).map(|cell| at_nodes[self.node_of_cell(cell)]).collect()
    }

    /// Values of the grid's cells → values at the nodes, zero in the padding. For weights such as
    /// the areas whose heights add up to a volume.
    #[must_use]
    pub fn from_cells(&self, of_cells: &[f64]) -> Vec<f64> {
        let mut at_nodes = vec![0.0; self.n_nodes()];
        for (cell, value) in of_cells.iter().enumerate() {
            at_nodes[self.node_of_cell(cell)] = *value;
        }
        at_nodes
    }

    /// Areas of cells, given at their nodes → the areas that the nodes stand for when each cell counts
    /// with the mean of the bilinear surface over it, not with the height in its middle.
    ///
    /// ```text
    /// along x and then along y:   mean = (h₋ + 6 h + h₊)/8
    /// ```
    /// In the midst of the nodes both give the same volume. At a wall they differ: the nodes fit the
    /// ground between them, which bulges over a hilltop's chords, and where the hill is cut off by a
    /// wall no foot makes up for that. A node without a neighbour on either side is its own mean,
    /// which is linear extrapolation.
    #[must_use]
    pub fn spread_over_cells(&self, of_cells: &[f64]) -> Vec<f64> {
        let along = |values: &[f64], (back, ahead): (u8, u8), step: usize| {
            let mut spread = values.to_vec();
            for (node, value) in values.iter().enumerate() {
                if self.links[node] & (back | ahead) == back | ahead {
                    spread[node] -= 0.25 * value;
                    spread[node - step] += 0.125 * value;
                    spread[node + step] += 0.125 * value;
                }
            }
            spread
        };
        along(&along(of_cells, (WEST, EAST), 1), (SOUTH, NORTH), self.n_cols)
    }

    /// A node and its neighbours, diagonal ones too, walls or not.
    pub fn around(&self, node: usize) -> impl Iterator<Item = usize> + use<> {
        self.within(node, 1)
    }

    /// The neighbours that a node has a bond with: no diagonal ones, none behind a wall.
    pub fn joined(&self, node: usize) -> impl Iterator<Item = usize> + use<> {
        let (links, n_cols) = (self.links[node], self.n_cols);
        let beside = |way: u8, to: Option<usize>| to.filter(|_| links & way != 0);
        [
            beside(EAST, Some(node + 1)),
            beside(NORTH, Some(node + n_cols)),
            beside(WEST, node.checked_sub(1)),
            beside(SOUTH, node.checked_sub(n_cols)),
        ]
        .into_iter()
        .flatten()
    }

    /// Nodes that are not marked, and none of whose neighbours is.
    #[must_use]
    pub fn far_from(&self, marked: &[bool]) -> Vec<bool> {
        let is_far = |node: usize| !self.around(node).any(|near| marked[near]);
        (0..self.n_nodes()).map(is_far).collect()
    }

    /// The node that is nearest to a point; one on the border for points outside.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a float cast to an integer saturates"
    )]
    pub fn nearest_node(&self, x_m: f64, y_m: f64) -> usize {
        let (x0, y0) = self.place_m(0);
        let index = |at_m: f64, n: usize| ((at_m / self.grid.cell_m).round() as usize).min(n - 1);
        index(y_m - y0, self.n_rows) * self.n_cols + index(x_m - x0, self.n_cols)
    }

    /// Where a node lies in the hall, x and y, m.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "node counts stay far below 2^53")]
    pub fn place_m(&self, node: usize) -> (f64, f64) {
        let (row, col) = (node / self.n_cols, node % self.n_cols);
        let along = |min_m: f64, index: usize| {
            min_m + (index as f64 - self.n_pad as f64 + 0.5) * self.grid.cell_m
        };
        (along(self.grid.x_min_m, col), along(self.grid.y_min_m, row))
    }

    /// Bilinear weights of a point; nodes behind a wall get none, and the others share theirs.
    /// None outside of the nodes' hull, for what is not finite, and where no node is seen.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "both coordinates are checked to lie on the lattice, which has < 2^32 nodes"
    )]
    #[inline]
    pub fn row_at(&self, x_m: f64, y_m: f64) -> Option<Row> {
        let (x0, y0) = self.place_m(0);
        let u = (x_m - x0) / self.grid.cell_m;
        let v = (y_m - y0) / self.grid.cell_m;
        let is_inside =
            u >= 0.0 && v >= 0.0 && u <= (self.n_cols - 1) as f64 && v <= (self.n_rows - 1) as f64;
        if !is_inside {
            return None;
        }
        let (col, row) = ((u as usize).min(self.n_cols - 2), (v as usize).min(self.n_rows - 2));
        let (fx, fy) = (u - col as f64, v - row as f64);
        let node = row * self.n_cols + col;
        let nodes = [node, node + 1, node + self.n_cols, node + self.n_cols + 1].map(|n| n as u32);
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        if self.cut_squares.is_empty() {
            return Some(Row { nodes, weights });
        }
        let part = |f: f64| ((f * PARTS as f64) as usize).min(PARTS - 1);
        let weights = match self.cut_squares.get(&node) {
            Some(seen) => share_among(seen[part(fy) * PARTS + part(fx)], weights)?,
            None => weights,
        };
        Some(Row { nodes, weights })
    }

    pub(super) fn links(&self) -> &[u8] {
        &self.links
    }

    /// What follows from the prior, kept for the newest one that was asked for.
    pub(super) fn prepared(&self, prior: &Prior) -> Arc<PreparedPrior> {
        let newest = self.newest_prepared().clone();
        if let Some(newest) = newest.filter(|newest| newest.prior == *prior) {
            return newest;
        }
        let prepared = Arc::new(PreparedPrior::new(self, prior));
        *self.newest_prepared() = Some(Arc::clone(&prepared));
        prepared
    }

    fn newest_prepared(&self) -> MutexGuard<'_, Option<Arc<PreparedPrior>>> {
        // It is only ever replaced as a whole.
        self.prepared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The factor's pattern, found once and kept.
    ///
    /// # Errors
    /// The factor does not fit into memory.
    pub(super) fn analysis(&self) -> Result<Arc<Analysis>, CholeskyError> {
        if let Some(known) = self.analysis.get() {
            return Ok(Arc::clone(known));
        }
        let (starts, rows) = super::stencil::lower_pattern(self.n_cols, self.n_rows);
        let found = Arc::new(Analysis::new(self.n_nodes(), &starts, &rows)?);
        Ok(Arc::clone(self.analysis.get_or_init(|| found)))
    }
}

/// For each part of a square, which corners no wall hides from its middle.
#[expect(clippy::cast_precision_loss, reason = "parts of an edge")]
fn seen_corners(
    south_west_m: (f64, f64),
    edge_m: f64,
    corners: &[(f64, f64); 4],
    separates: &impl Fn((f64, f64), (f64, f64)) -> bool,
) -> [u8; PARTS * PARTS] {
    let step_m = edge_m / PARTS as f64;
    let middle = |part: usize| (part as f64 + 0.5) * step_m;
    let mut seen = [0; PARTS * PARTS];
    for (part, mask) in seen.iter_mut().enumerate() {
        let place = (south_west_m.0 + middle(part % PARTS), south_west_m.1 + middle(part / PARTS));
        for (bit, corner) in corners.iter().enumerate() {
            *mask |= u8::from(!separates(place, *corner)) << bit;
        }
    }
    seen
}

/// Takes the weight from the corners that are not seen; None if nothing is left.
fn share_among(seen: u8, mut weights: [f64; 4]) -> Option<[f64; 4]> {
    for (bit, weight) in weights.iter_mut().enumerate() {
        if seen & (1 << bit) == 0 {
            *weight = 0.0;
        }
    }
    let sum: f64 = weights.iter().sum();
    // Less than this is the weight of a corner across the square, if not rounding.
    (sum > 1e-3).then(|| weights.map(|weight| weight / sum))
}
