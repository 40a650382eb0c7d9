//! Ground that no beam reached lies higher or lower than believed as a whole.
//!
//! How deep it is behind a crest, or how high the next slope is beyond what was seen, is one unknown. A field that knows a
//! typical range only has such a patch off here one way and there another, and these make up for each
//! other in the volume; real ground does not. So every patch has the variance of an error that is shared
//! by all of it, if that is more than what the field has for it; and errors of different patches are correlated, for what
//! makes the guess wrong behind one crest of a hall does so behind others:
//!
//! ```text
//! Σ_k max(0, S_k² − Σ_{i∈k} w_i q_i) + ρ Σ_k Σ_{l≠k} S_k S_l,   S_k = Σ_{i∈k} w_i σ_i
//! ```
//! - `k`, `l`: patches of unseen nodes that hang together
//! - `w`: area that a node stands for, m²; `σ`: standard deviation of its height, m
//! - `q = Σ* w`: the field's covariance of the heights with the volume, m²·m
//!
//! What the field has between two patches is counted beside the second sum: an upper guess, too careful while little is seen.
//!
//! On simulated alps, halls and piles, seen in part, the sums of the errors of such patches and their rims are 0.6 to 1.2 of
//! Σ w σ (root mean square); by the field alone they are two to five of its σ. Patches of one hall mostly err with one sign.
//! Checked: `a_patch_is_off_as_a_whole_and_patches_are_in_part`, `walls_part_patches_and_distances_grow_with_the_steps`; in whole by campaigns of the simulator.

use super::matern_field::{Lattice, Prior};
use super::matern_kernel::matern_of;
use std::collections::VecDeque;

/// Unseen ground, patch by patch.
#[derive(Debug, Clone, PartialEq)]
pub struct UnseenGround {
    /// The nodes of each patch.
    patches: Vec<Vec<usize>>,
    /// Variance of the height at every node, m².
    var_m2: Vec<f64>,
}

/// What one patch may be off by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PatchError {
    /// S, m³.
    pub(super) shared_m3: f64,
    /// What the field has for it, m⁶.
    pub(super) by_field_m6: f64,
}

/// ρ: correlation of the errors of two patches of a hall.
///
/// Chosen so that volumes of surveys that end at σ/V = 1 %, with pockets left all over, are off by about their σ.
const CORRELATION: f64 = 0.1;

/// What is known of the ground at a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ground {
    /// It is seen, or no ground that counts by itself.
    Known,
    /// It is unseen beside what is seen. Thin gaps between scans are made of such nodes alone: they hang
    /// together over the whole map, and make no patch.
    Rim,
    /// It is unseen, and so is all around it.
    Core,
}

/// A node of a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenNode {
    /// Where it is, x and y, m.
    pub place_m: (f64, f64),
    /// Area that it stands for, m².
    pub area_m2: f64,
    /// w σ, m³.
    pub error_m3: f64,
}

/// The nodes of each patch: cores that hang together, and their rims; walls part them.
pub(super) fn patches(lattice: &Lattice, ground: &[Ground]) -> Vec<Vec<usize>> {
    let mut is_left: Vec<bool> = ground.iter().map(|ground| *ground != Ground::Known).collect();
    let mut patches = Vec::new();
    for seed in 0..is_left.len() {
        if ground[seed] != Ground::Core || !std::mem::take(&mut is_left[seed]) {
            continue;
        }
        let mut patch = vec![seed];
        let mut next = 0;
        while let Some(node) = patch.get(next).copied() {
            next += 1;
            if ground[node] == Ground::Core {
                let beside = lattice.joined(node);
                patch.extend(beside.filter(|near| std::mem::take(&mut is_left[*near])));
            }
        }
        patches.push(patch);
    }
    patches
}

/// What each patch adds to the variance of the volume, its part of what patches have in common included, m⁶.
pub(super) fn surpluses_m6(patches: &[PatchError]) -> Vec<f64> {
    let all_m3: f64 = patches.iter().map(|patch| patch.shared_m3).sum();
    let surplus_m6 = |PatchError { shared_m3, by_field_m6 }: &PatchError| {
        let own_m6 = shared_m3 * shared_m3 - by_field_m6.max(0.0);
        // Not `max`: what is no number must not look like none.
        let own_m6 = if own_m6 < 0.0 { 0.0 } else { own_m6 };
        own_m6 + CORRELATION * shared_m3 * (all_m3 - shared_m3)
    };
    patches.iter().map(surplus_m6).collect()
}

/// The variance of unseen ground where none could be computed, m²: by its distance to seen ground, which
/// may lie all around.
///
/// ```text
/// σ² (1 − r(d))²        r: correlation of the field over the distance d
/// ```
/// That meets the σ of nodes in the middle of gaps of the simulated halls.
#[derive(Debug, Clone, PartialEq)]
pub struct VarBesideSeen {
    /// By steps of the lattice; from its end on nothing is known.
    by_steps_m2: Vec<f64>,
    far_m2: f64,
}

impl VarBesideSeen {
    /// For steps of this length.
    #[must_use]
    pub fn new(prior: &Prior, spacing_m: f64) -> Self {
        let far_m2 = prior.sigma_m * prior.sigma_m;
        let mut by_steps_m2: Vec<f64> = Vec::new();
        let mut distance_m = 0.0;
        while by_steps_m2.last().is_none_or(|var_m2| *var_m2 < 0.99 * far_m2) {
            let correlation = matern_of(1.0, prior.kappa_per_m() * distance_m);
            by_steps_m2.push(far_m2 * (1.0 - correlation).powi(2));
            distance_m += spacing_m;
        }
        Self { by_steps_m2, far_m2 }
    }

    /// Node by node.
    #[must_use]
    pub fn on(&self, lattice: &Lattice, is_seen: &[bool]) -> Vec<f64> {
        let var_m2 = |steps: Option<usize>| {
            steps.and_then(|steps| self.by_steps_m2.get(steps)).copied().unwrap_or(self.far_m2)
        };
        steps_to(lattice, is_seen).into_iter().map(var_m2).collect()
    }
}

/// By node, how many links lead from it to the next marked node; `None` without one.
fn steps_to(lattice: &Lattice, is_marked: &[bool]) -> Vec<Option<usize>> {
    let mut steps: Vec<Option<usize>> = is_marked.iter().map(|is| is.then_some(0)).collect();
    let marked = is_marked.iter().enumerate().filter(|(_, is)| **is);
    let mut reached: VecDeque<(usize, usize)> = marked.map(|(node, _)| (node, 0)).collect();
    while let Some((node, n_steps)) = reached.pop_front() {
        for near in lattice.joined(node) {
            if steps[near].is_none() {
                steps[near] = Some(n_steps + 1);
                reached.push_back((near, n_steps + 1));
            }
        }
    }
    steps
}

impl UnseenGround {
    /// The patches of this ground; `var_m2`: variance of the height at every node, m².
    #[must_use]
    pub fn new(lattice: &Lattice, ground: &[Ground], var_m2: Vec<f64>) -> Self {
        Self { patches: patches(lattice, ground), var_m2 }
    }

    /// By node, whether it belongs to a patch.
    #[must_use]
    pub fn is_in_patch(&self) -> Vec<bool> {
        let mut is_in_patch = vec![false; self.var_m2.len()];
        self.patches.iter().flatten().for_each(|node| is_in_patch[*node] = true);
        is_in_patch
    }

    /// What each patch, being off as a whole and in part as the others, adds to the variance of the volume with these
    /// weights and this adjoint, m⁶.
    #[must_use]
    pub fn surplus_m6(&self, w_m2: &[f64], q_m2: &[f64]) -> Vec<f64> {
        let error = |patch: &Vec<usize>| PatchError {
            shared_m3: self.error_m3(patch, w_m2),
            by_field_m6: patch.iter().map(|node| w_m2[*node] * q_m2[*node]).sum(),
        };
        surpluses_m6(&self.patches.iter().map(error).collect::<Vec<_>>())
    }

    /// Adds each patch's surplus to its nodes' summands of the variance, by their shares of the error.
    pub fn spread(&self, surplus_m6: &[f64], w_m2: &[f64], summands_m6: &mut [f64]) {
        for (patch, surplus_m6) in std::iter::zip(&self.patches, surplus_m6) {
            let whole_m3 = self.error_m3(patch, w_m2);
            if whole_m3 > 0.0 {
                for node in patch {
                    let share = self.error_m3(&[*node], w_m2) / whole_m3;
                    summands_m6[*node] += surplus_m6 * share;
                }
            }
        }
    }

    /// σ of what lies around these nodes, all off together, m³.
    fn error_m3(&self, nodes: &[usize], w_m2: &[f64]) -> f64 {
        // Rounding may leave a variance below zero.
        let sigma_m = |node: usize| {
            if self.var_m2[node] < 0.0 { 0.0 } else { self.var_m2[node].sqrt() }
        };
        nodes.iter().map(|node| w_m2[*node] * sigma_m(*node)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::GridGeometry;

    const GRID: GridGeometry =
        GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 6, n_rows: 4 };

    #[test]
    fn a_patch_is_off_as_a_whole_and_patches_are_in_part() {
        let lattice = Lattice::covering(&GRID, 0.0, |_, _| false);
        let n_cols = lattice.size().0;
        let mut ground = vec![Ground::Known; lattice.n_nodes()];
        // Two nodes and their rim of one node, and one that touches that by a corner.
        let (one, other) = ([0, 1, n_cols + 1], [2 * n_cols + 2]);
        one.iter().chain(&other).for_each(|node| ground[*node] = Ground::Core);
        ground[n_cols + 1] = Ground::Rim;
        // Rims lead nowhere, and make no patch by themselves.
        ground[2 * n_cols + 1] = Ground::Rim;
        ground[4] = Ground::Rim;
        let found = patches(&lattice, &ground);
        assert_eq!(found, [one.to_vec(), vec![other[0], 2 * n_cols + 1]]);
        ground[2 * n_cols + 1] = Ground::Known;

        let mut var_m2 = vec![0.01; lattice.n_nodes()];
        var_m2[other[0]] = 0.04;
        let w_m2 = vec![0.25; lattice.n_nodes()];
        let none = vec![0.0; lattice.n_nodes()];
        // (3 · 0.25 · 0.1)² and (0.25 · 0.2)² m⁶, and 0.1 of the product for each.
        let expected_m6 =
            [0.075_f64.powi(2), 0.05_f64.powi(2)].map(|own_m6| own_m6 + 0.1 * 0.075 * 0.05);
        let unseen = UnseenGround::new(&lattice, &ground, var_m2.clone());
        let in_patch = unseen.is_in_patch();
        assert_eq!(
            (0..in_patch.len()).filter(|node| in_patch[*node]).count(),
            one.len() + other.len()
        );
        let surplus = unseen.surplus_m6(&w_m2, &none);
        let off = std::iter::zip(&surplus, expected_m6).map(|(got, expected)| got - expected);
        assert!(off.into_iter().all(|off| off.abs() < 1e-15), "{surplus:?}");
        // Nodes have their shares of it.
        let mut summands_m6 = none.clone();
        unseen.spread(&surplus, &w_m2, &mut summands_m6);
        assert!((summands_m6[1] - expected_m6[0] / 3.0).abs() < 1e-15);
        assert!((summands_m6.iter().sum::<f64>() - surplus.iter().sum::<f64>()).abs() < 1e-15);
        // A field that knows all heights of a patch to go together has its own error already.
        let by_field = |node| if one.contains(&node) { 0.075 * 0.1 } else { 0.0 };
        let q: Vec<f64> = (0..lattice.n_nodes()).map(by_field).collect();
        assert!((unseen.surplus_m6(&w_m2, &q)[0] - 0.1 * 0.075 * 0.05).abs() < 1e-15);
        var_m2[0] = f64::NAN;
        let broken = UnseenGround { var_m2, ..unseen };
        assert!(broken.surplus_m6(&w_m2, &none)[0].is_nan(), "no number stays none");
    }

    #[test]
    fn walls_part_patches_and_distances_grow_with_the_steps() {
        // A wall at x = 1.5 m.
        let lattice = Lattice::covering(&GRID, 0.0, |a, b| (a.0 < 1.5) != (b.0 < 1.5));
        let found = patches(&lattice, &vec![Ground::Core; lattice.n_nodes()]);
        let is_west = |node: usize| lattice.place_m(node).0 < 1.5;
        let is_one_side =
            |patch: &Vec<usize>| patch.iter().all(|node| is_west(*node) == is_west(patch[0]));
        assert!(found.len() == 2 && found.iter().all(is_one_side), "{found:?}");
        let prior = Prior { range_m: 4.0, sigma_m: 0.8, mean_m: 1.5, mean_sigma_m: 0.0 };
        let mut is_seen = vec![false; lattice.n_nodes()];
        is_seen[lattice.nearest_node(0.25, 0.25)] = true;
        let var_m2 = VarBesideSeen::new(&prior, lattice.spacing_m()).on(&lattice, &is_seen);
        let at = |x_m, y_m| var_m2[lattice.nearest_node(x_m, y_m)];
        // κ d = √8/4 · 0.5 = 0.353553; x K₁(x) there is 0.894158, K₁ by midpoints of the integral 9.6.24 of
        // Abramowitz and Stegun 1964.
        assert!((at(0.75, 0.25) - 0.64 * (1.0_f64 - 0.894_158).powi(2)).abs() < 1e-6);
        assert!(at(0.25, 0.25) < 1e-12 && at(1.25, 0.25) > at(0.75, 0.25));
        assert!((at(1.75, 0.25) - 0.64).abs() < 1e-12, "nothing is known behind the wall");
    }
}
