//! What beams say about the field, added up.

use super::FieldError;
use super::lattice::{Lattice, Row};
use super::stencil::{E, HERE, N, NE, NW, Stencil};

/// Data of the field: W = Σ a aᵀ/R and Σ a z/R.
///
/// A row a touches one square of nodes, so W has a nine-point stencil. Sums only: the order of the
/// rows does not matter beyond rounding, and maps merge by addition.
#[derive(Debug, Clone, PartialEq)]
pub struct Information {
    n_cols: usize,
    nodes: Vec<NodeSums>,
}

/// The sums of one node; one line of cache.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct NodeSums {
    /// Entries of W towards the node itself and those ahead of it, 1/m².
    here: f64,
    east: f64,
    north_west: f64,
    north: f64,
    north_east: f64,
    /// Σ a z/R, 1/m.
    heights: f64,
    /// Σ a/R, 1/m²: the row sum of W, because the weights of a row add up to 1.
    total: f64,
    /// Σ a: how many hits.
    hits: f64,
}

impl Information {
    /// No data.
    #[must_use]
    pub fn new(lattice: &Lattice) -> Self {
        let nodes = vec![NodeSums::default(); lattice.n_nodes()];
        Self { n_cols: lattice.size().0, nodes }
    }

    /// Adds a datum: a height of `height_m` over the hall floor where `row` is, with the
    /// information 1/R. False, and nothing is added, if either is not finite or 1/R not positive.
    #[inline]
    pub fn add(&mut self, row: &Row, height_m: f64, info_per_m2: f64) -> bool {
        let is_sound = height_m.is_finite() && info_per_m2.is_finite() && info_per_m2 > 0.0;
        let south_west = row.nodes[0] as usize;
        let north_west = south_west + self.n_cols;
        if !is_sound || north_west + 1 >= self.nodes.len() {
            return false;
        }
        let a = row.weights;
        let w = a.map(|a| a * info_per_m2);
        let (lower, upper) = self.nodes.split_at_mut(north_west);
        let [sw, se] = &mut lower[south_west..south_west + 2] else { return false };
        let [nw, ne] = &mut upper[..2] else { return false };
        sw.here += w[0] * a[0];
        sw.east += w[0] * a[1];
        sw.north += w[0] * a[2];
        sw.north_east += w[0] * a[3];
        se.here += w[1] * a[1];
        se.north_west += w[1] * a[2];
        se.north += w[1] * a[3];
        nw.here += w[2] * a[2];
        nw.east += w[2] * a[3];
        ne.here += w[3] * a[3];
        for (node, (w, a)) in [sw, se, nw, ne].into_iter().zip(w.into_iter().zip(a)) {
            node.heights += w * height_m;
            node.total += w;
            node.hits += a;
        }
        true
    }

    /// Adds what is known of the height at a node itself without a hit: its information, 1/m², and
    /// that times the height, 1/m. It counts as no hit.
    pub fn add_condition(&mut self, node: usize, info_per_m2: f64, info_height_per_m: f64) {
        if let Some(sums) = self.nodes.get_mut(node)
            && info_per_m2.is_finite()
            && info_height_per_m.is_finite()
        {
            sums.here += info_per_m2;
            sums.total += info_per_m2;
            sums.heights += info_height_per_m;
        }
    }

    /// Adds the data of another map of the same lattice.
    ///
    /// # Errors
    /// [`FieldError::Size`] if the lattices have different extents.
    pub fn merge(&mut self, other: &Self) -> Result<(), FieldError> {
        if self.n_cols != other.n_cols || self.nodes.len() != other.nodes.len() {
            return Err(FieldError::Size { got: other.nodes.len(), expected: self.nodes.len() });
        }
        for (mine, theirs) in self.nodes.iter_mut().zip(&other.nodes) {
            mine.here += theirs.here;
            mine.east += theirs.east;
            mine.north_west += theirs.north_west;
            mine.north += theirs.north;
            mine.north_east += theirs.north_east;
            mine.heights += theirs.heights;
            mine.total += theirs.total;
            mine.hits += theirs.hits;
        }
        Ok(())
    }

    /// Number of nodes.
    #[must_use]
    pub const fn n_nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Information that the data give about the height at a node, Σ a/R, 1/m²; 0 where nothing
    /// was seen.
    #[must_use]
    pub fn info_per_m2(&self, node: usize) -> f64 {
        self.nodes[node].total
    }

    /// How many hits a node has, those between nodes shared by their weights.
    #[must_use]
    pub fn n_hits(&self, node: usize) -> f64 {
        self.nodes[node].hits
    }

    /// Adds W to a stencil.
    pub(super) fn add_to(&self, q: &mut Stencil) {
        for (i, node) in self.nodes.iter().enumerate() {
            q.parts[HERE][i] += node.here;
            q.parts[E][i] += node.east;
            q.parts[NW][i] += node.north_west;
            q.parts[N][i] += node.north;
            q.parts[NE][i] += node.north_east;
        }
    }

    /// Entries of W towards the node itself, E, NW, N, NE.
    pub(super) fn entries(&self, node: usize) -> super::multigrid::Ahead {
        let node = &self.nodes[node];
        [node.here, node.east, node.north_west, node.north, node.north_east]
    }

    /// Σ a (z − mean)/R at the nodes, 1/m.
    pub(super) fn innovations(&self, mean_m: f64) -> Vec<f64> {
        self.nodes.iter().map(|node| node.heights - mean_m * node.total).collect()
    }
}
