//! How well the field bridges gaps between known ground, tried on known ground: squares left out and
//! predicted.
//!
//! How uncertain a gap is follows from the σ of the field, which is that of hidden ground ([`super::relief`]).
//! So squares of known nodes, as near to gaps as can be, are left out; how far the prediction misses
//! them, in its own σ, says how far the configured σ misses the ground:
//!
//! ```text
//! a² = (n₀ + Σ z²)/(n₀ + n),   z = (h − h without the square)/√(V without − V)   in each square's middle
//! ```
//! - `h`, `V`: height and its variance with all data, m, m²; `n₀`: what the configured σ counts for
//!
//! This speaks for gaps of a few nodes. Ground that is hidden is not like the ground beside it: it lies
//! behind crests. There the σ of the field stays.
//! Checked: `squares_are_known_apart_and_beside_the_gaps`; in whole by
//! `smooth_ground_bridges_its_gaps_better` of `field_map`.

use super::matern_field::Lattice;
use std::collections::VecDeque;

/// Squares that are left out together.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// The middle node of each.
    pub middles: Vec<usize>,
    /// Nodes that are in one of them.
    pub contains: Vec<bool>,
}

/// Edge of a square, nodes.
const WIDTH: usize = 3;
/// Distance of neighbouring squares, nodes: far enough to disturb each other little.
const PITCH: usize = 2 * WIDTH;
/// As many squares are tried at most, in each layout.
const MOST_SQUARES: usize = 40;
/// Fewer say too little.
pub const LEAST_SQUARES: usize = 6;
/// `n₀`.
const CONFIGURED_COUNTS: f64 = 2.0;
/// Two layouts of squares, the one between the squares of the other.
pub const N_LAYOUTS: usize = 2;

/// The factor `a` from the squares' z.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "some dozens")]
pub fn amplitude(z: &[f64]) -> f64 {
    let sum: f64 = z.iter().map(|z| z * z).sum();
    ((CONFIGURED_COUNTS + sum) / (CONFIGURED_COUNTS + z.len() as f64)).sqrt()
}

impl LeftOut {
    /// The squares of a layout.
    ///
    /// `is_known`: nodes that rest on data; `counts`: those that belong to what is measured.
    #[must_use]
    pub fn new(lattice: &Lattice, is_known: &[bool], counts: &[bool], layout: usize) -> Self {
        let to_gap = steps(lattice, |node| counts[node] && !is_known[node]);
        let mut squares: Vec<(u32, Vec<usize>)> = Self::grid(lattice, layout)
            .filter(|nodes| nodes.iter().all(|node| counts[*node] && is_known[*node]))
            .map(|nodes| (to_gap[nodes[nodes.len() / 2]], nodes))
            .collect();
        squares.sort_by_key(|(steps, nodes)| (*steps, nodes[0]));
        squares.truncate(MOST_SQUARES);
        let mut contains = vec![false; lattice.n_nodes()];
        squares.iter().flat_map(|(_, nodes)| nodes).for_each(|node| contains[*node] = true);
        let middles = squares.iter().map(|(_, nodes)| nodes[nodes.len() / 2]).collect();
        Self { middles, contains }
    }

    /// Squares all over the lattice, each with its nodes row by row.
    fn grid(lattice: &Lattice, layout: usize) -> impl Iterator<Item = Vec<usize>> {
        let (n_cols, n_rows) = lattice.size();
        let offset = layout * PITCH / N_LAYOUTS;
        let starts = move |n: usize| (offset..(n + 1).saturating_sub(WIDTH)).step_by(PITCH);
        starts(n_rows).flat_map(move |row| {
            starts(n_cols).map(move |col| {
                let nodes = (row..row + WIDTH)
                    .flat_map(|row| (col..col + WIDTH).map(move |col| row * n_cols + col));
                nodes.collect()
            })
        })
    }
}

/// Steps from every node to the nearest marked one, diagonal ones too; `u32::MAX` without one.
fn steps(lattice: &Lattice, is_marked: impl Fn(usize) -> bool) -> Vec<u32> {
    let mut steps = vec![u32::MAX; lattice.n_nodes()];
    let mut queue = VecDeque::new();
    for (node, steps) in steps.iter_mut().enumerate().filter(|(node, _)| is_marked(*node)) {
        *steps = 0;
        queue.push_back(node);
    }
    while let Some(node) = queue.pop_front() {
        for neighbour in lattice.around(node) {
            if steps[neighbour] == u32::MAX {
                steps[neighbour] = steps[node] + 1;
                queue.push_back(neighbour);
            }
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::GridGeometry;

    fn lattice() -> Lattice {
        let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 40, n_rows: 30 };
        Lattice::covering(&grid, 0.5, |_, _| false)
    }

    #[test]
    fn squares_are_known_apart_and_beside_the_gaps() {
        let lattice = lattice();
        let n_cols = lattice.size().0;
        let at = |node: usize| (node % n_cols, node / n_cols);
        let counts = vec![true; lattice.n_nodes()];
        let is_gap = |node: usize| at(node) == (23, 13) || at(node) == (5, 25);
        let is_known: Vec<bool> = (0..lattice.n_nodes()).map(|node| !is_gap(node)).collect();
        for layout in 0..N_LAYOUTS {
            let left_out = LeftOut::new(&lattice, &is_known, &counts, layout);
            assert!(left_out.middles.len() > 20, "{}", left_out.middles.len());
            let n_nodes = left_out.contains.iter().filter(|is_in| **is_in).count();
            assert_eq!(n_nodes, left_out.middles.len() * WIDTH * WIDTH);
            assert!((0..lattice.n_nodes()).all(|n| !left_out.contains[n] || !is_gap(n)));
            for (i, a) in left_out.middles.iter().enumerate() {
                for b in &left_out.middles[..i] {
                    let ((ax, ay), (bx, by)) = (at(*a), at(*b));
                    assert!(ax.abs_diff(bx).max(ay.abs_diff(by)) >= PITCH);
                }
            }
            let off = |node: usize, (x, y): (usize, usize)| {
                at(node).0.abs_diff(x).max(at(node).1.abs_diff(y))
            };
            let to_gap = |node: &usize| off(*node, (23, 13)).min(off(*node, (5, 25)));
            assert!(left_out.middles.iter().map(to_gap).is_sorted(), "the nearest come first");
        }
    }

    #[test]
    fn without_known_ground_nothing_is_left_out() {
        let lattice = lattice();
        let none = vec![false; lattice.n_nodes()];
        let left_out = LeftOut::new(&lattice, &none, &vec![true; lattice.n_nodes()], 0);
        assert!(left_out.middles.is_empty());
        assert!((amplitude(&[]) - 1.0).abs() < 1e-12);
        // (2 + 0.1 · 18)/(2 + 18) = 0.19
        assert!((amplitude(&[0.1_f64.sqrt(); 18]) - 0.19_f64.sqrt()).abs() < 1e-12);
    }
}
