//! The patches of unseen ground that a map has, on the coarse lattice.
//!
//! Looks part them: ground that they leave is off together with what hangs together with it, and less uncertain the nearer
//! seen ground has come,
//!
//! ```text
//! S_p = Σ_{j∈p} u_j σ_j √(v_j b_j/b⁰_j)        p: part of a patch of the map that looks leave
//! ```
//! - `b`: variance of unseen ground by its distance to seen ground ([`VarBesideSeen`]), m²; `b⁰`: the same in the map

use super::looks::Rest;
use crate::mapping::matern_field::Lattice;
use crate::mapping::unseen_patch::{
    Ground, OpenNode, PatchError, VarBesideSeen, patches, surpluses_m6,
};
use std::collections::BTreeMap;

/// All of them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OpenPatches {
    patches: Vec<OpenPatch>,
    /// Nodes that stand for ground that counts; others are never seen.
    counts: Vec<bool>,
    /// b⁰ at every node of the lattice, m².
    var_beside_m2: Vec<f64>,
}

/// What looks leave of them.
struct Left {
    /// By node, which part it belongs to; `None` if it is seen.
    part_of: Vec<Option<usize>>,
    /// b, m².
    var_beside_m2: Vec<f64>,
}

/// One of them, that is off as a whole.
#[derive(Debug, Clone, PartialEq)]
struct OpenPatch {
    /// By rising node of the lattice.
    ground: Vec<OpenGround>,
}

/// Its ground nearest to a node.
#[derive(Debug, Clone, Copy, PartialEq)]
struct OpenGround {
    node: usize,
    /// u, m².
    area_m2: f64,
    /// Σ u σ, m³.
    error_m3: f64,
}

/// The node that a place counts most for: on its side of a wall, if it has one there.
fn node_of(lattice: &Lattice, (x_m, y_m): (f64, f64)) -> usize {
    let heaviest = lattice.row_at(x_m, y_m).and_then(|row| {
        let by_weight = std::iter::zip(row.nodes, row.weights);
        by_weight.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(node, _)| node as usize)
    });
    heaviest.unwrap_or_else(|| lattice.nearest_node(x_m, y_m))
}

impl OpenPatches {
    /// On this lattice, of the nodes of the map; nodes of the lattice stand for these areas, m².
    pub(super) fn new(
        lattice: &Lattice,
        w_m2: &[f64],
        patches: &[Vec<OpenNode>],
        var_beside: &VarBesideSeen,
    ) -> Self {
        let patches: Vec<OpenPatch> =
            patches.iter().map(|patch| OpenPatch::new(lattice, patch)).collect();
        let counts: Vec<bool> = w_m2.iter().map(|w_m2| *w_m2 > 0.0).collect();
        let mut is_seen = counts.clone();
        for ground in patches.iter().flat_map(|patch| &patch.ground) {
            is_seen[ground.node] = false;
        }
        Self { patches, counts, var_beside_m2: var_beside.on(lattice, &is_seen) }
    }

    /// What they add to the variance after looks that leave this at every node, beyond what the field with
    /// this adjoint has for them, m⁶.
    pub(super) fn surplus_m6(
        &self,
        lattice: &Lattice,
        var_beside: &VarBesideSeen,
        rests: &[Rest],
        q_m2: &[f64],
    ) -> f64 {
        let left = self.left(lattice, var_beside, rests);
        let errors: Vec<PatchError> =
            self.patches.iter().flat_map(|patch| patch.errors(rests, q_m2, &left, self)).collect();
        surpluses_m6(&errors).into_iter().sum()
    }

    fn left(&self, lattice: &Lattice, var_beside: &VarBesideSeen, rests: &[Rest]) -> Left {
        let mut ground = vec![Ground::Known; lattice.n_nodes()];
        for open in self.patches.iter().flat_map(|patch| &patch.ground) {
            if rests[open.node].var_share > 0.0 {
                ground[open.node] = Ground::Core;
            }
        }
        let mut part_of = vec![None; lattice.n_nodes()];
        for (part, nodes) in patches(lattice, &ground).into_iter().enumerate() {
            nodes.into_iter().for_each(|node| part_of[node] = Some(part));
        }
        let is_seen: Vec<bool> = std::iter::zip(&ground, &self.counts)
            .map(|(ground, counts)| *ground == Ground::Known && *counts)
            .collect();
        Left { part_of, var_beside_m2: var_beside.on(lattice, &is_seen) }
    }
}

impl OpenPatch {
    /// On this lattice, of the nodes of the map.
    fn new(lattice: &Lattice, patch: &[OpenNode]) -> Self {
        let mut by_node: BTreeMap<usize, OpenGround> = BTreeMap::new();
        for fine in patch {
            let node = node_of(lattice, fine.place_m);
            let none = OpenGround { node, area_m2: 0.0, error_m3: 0.0 };
            let ground = by_node.entry(node).or_insert(none);
            ground.area_m2 += fine.area_m2;
            ground.error_m3 += fine.error_m3;
        }
        Self { ground: by_node.into_values().collect() }
    }

    /// Those of the parts that looks leave of it.
    fn errors(
        &self,
        rests: &[Rest],
        q_m2: &[f64],
        left: &Left,
        all: &OpenPatches,
    ) -> impl Iterator<Item = PatchError> + use<> {
        let mut parts: BTreeMap<usize, PatchError> = BTreeMap::new();
        for ground in &self.ground {
            let Some(part) = left.part_of[ground.node] else { continue };
            let nearer = left.var_beside_m2[ground.node] / all.var_beside_m2[ground.node];
            let stays = rests[ground.node].var_share.sqrt();
            let none = PatchError { shared_m3: 0.0, by_field_m6: 0.0 };
            let error = parts.entry(part).or_insert(none);
            error.shared_m3 += stays * nearer.sqrt() * ground.error_m3;
            error.by_field_m6 += stays * ground.area_m2 * q_m2[ground.node];
        }
        parts.into_values()
    }
}
