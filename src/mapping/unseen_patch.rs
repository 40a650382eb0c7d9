//! Ground that no beam reached lies higher or lower than believed as a whole.
//!
//! How deep it is behind a crest, or how high the next slope is beyond what was seen, is one unknown. A field that knows a
//! typical range only has such a patch off here one way and there another, and these make up for each
//! other in the volume; real ground does not. So every patch has the variance of an error that is shared
//! by all of it, if that is more than what the field has for it:
//!
//! ```text
//! Σ_k max(0, (Σ_{i∈k} w_i σ_i)² − Σ_{i∈k} w_i q_i)         k: patches of unseen nodes that hang together
//! ```
//! - `w`: area that a node stands for, m²; `σ`: standard deviation of its height, m
//! - `q = Σ* w`: the field's covariance of the heights with the volume, m²·m
//!
//! On simulated alps, halls and piles, seen in part, the sums of the errors of such patches are 0.6 to 1.2 of Σ w σ
//! (root mean square); by the field alone they are two to five of its σ.
//! Checked: `a_patch_is_off_as_a_whole_and_patches_are_not`; in whole by campaigns of the simulator.

use super::matern_field::Lattice;

/// The nodes of each patch of marked nodes that hang together, by their corners too.
#[must_use]
pub fn patches(lattice: &Lattice, is_unseen: &[bool]) -> Vec<Vec<usize>> {
    let mut is_left = is_unseen.to_vec();
    let mut patches = Vec::new();
    for seed in 0..is_left.len() {
        if !std::mem::take(&mut is_left[seed]) {
            continue;
        }
        let mut patch = vec![seed];
        let mut next = 0;
        while let Some(node) = patch.get(next).copied() {
            next += 1;
            patch.extend(lattice.around(node).filter(|near| std::mem::take(&mut is_left[*near])));
        }
        patches.push(patch);
    }
    patches
}

/// By node, how many steps, diagonal ones too, lie between it and the next one that is not marked; 0 for those.
pub fn steps_to_seen(lattice: &Lattice, is_unseen: &[bool]) -> impl Iterator<Item = usize> {
    let mut steps = vec![usize::MAX; is_unseen.len()];
    let mut reached: Vec<usize> = Vec::with_capacity(steps.len());
    reached.extend((0..is_unseen.len()).filter(|node| !is_unseen[*node]));
    reached.iter().for_each(|node| steps[*node] = 0);
    let mut next = 0;
    while let Some(node) = reached.get(next).copied() {
        next += 1;
        for near in lattice.around(node) {
            if steps[near] == usize::MAX {
                steps[near] = steps[node] + 1;
                reached.push(near);
            }
        }
    }
    steps.into_iter()
}

/// What patches that are off as a whole add to the variance of a volume, m⁶.
#[must_use]
pub fn shared_var_m6(patches: &[Vec<usize>], w_m2: &[f64], var_m2: &[f64], q: &[f64]) -> f64 {
    let of_patch = |patch: &Vec<usize>| {
        let shared_m3: f64 = patch.iter().map(|node| w_m2[*node] * var_m2[*node].sqrt()).sum();
        let by_field_m6: f64 = patch.iter().map(|node| w_m2[*node] * q[*node]).sum();
        (shared_m3 * shared_m3 - by_field_m6).max(0.0)
    };
    patches.iter().map(of_patch).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::GridGeometry;

    #[test]
    fn a_patch_is_off_as_a_whole_and_patches_are_not() {
        let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 6, n_rows: 4 };
        let lattice = Lattice::covering(&grid, 0.0, |_, _| false);
        let n_cols = lattice.size().0;
        let mut is_unseen = vec![false; lattice.n_nodes()];
        // Three nodes that touch by sides and corners, and one apart.
        let (one, other) = ([0, 1, n_cols + 2], [n_cols + 4]);
        one.iter().chain(&other).for_each(|node| is_unseen[*node] = true);
        let found = patches(&lattice, &is_unseen);
        assert_eq!(found, [one.to_vec(), other.to_vec()]);

        let steps: Vec<usize> = steps_to_seen(&lattice, &is_unseen).collect();
        assert_eq!(steps.iter().sum::<usize>(), 4, "each of the four touches a seen one");
        let all = vec![true; lattice.n_nodes()];
        assert!(steps_to_seen(&lattice, &all).all(|steps| steps == usize::MAX));

        let mut var_m2 = vec![0.01; lattice.n_nodes()];
        var_m2[n_cols + 4] = 0.04;
        let w_m2 = vec![0.25; lattice.n_nodes()];
        let none = vec![0.0; lattice.n_nodes()];
        // (3 · 0.25 · 0.1)² + (0.25 · 0.2)² m⁶.
        let var_m6 = shared_var_m6(&found, &w_m2, &var_m2, &none);
        assert!((var_m6 - (0.075_f64.powi(2) + 0.05_f64.powi(2))).abs() < 1e-15, "{var_m6}");
        // A field that knows all heights to go together has it already.
        let q: Vec<f64> = is_unseen.iter().map(|is| if *is { 0.075 * 0.1 } else { 0.0 }).collect();
        let var_m6 = shared_var_m6(&found[..1], &w_m2, &var_m2, &q);
        assert!(var_m6.abs() < 1e-15, "{var_m6}");
    }
}
