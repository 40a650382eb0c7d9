//! The patches of unseen ground that a map has, on the coarse lattice.

use super::looks::Rest;
use crate::mapping::matern_field::Lattice;
use crate::mapping::unseen_patch::OpenNode;
use std::collections::BTreeMap;

/// A patch that is off as a whole.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OpenPatch {
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

impl OpenPatch {
    /// On this lattice, of the nodes of the map.
    pub(super) fn new(lattice: &Lattice, patch: &[OpenNode]) -> Self {
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

    /// What it adds to the variance after looks that leave this at every node, beyond what the field with
    /// this adjoint has for it, m⁶.
    pub(super) fn surplus_m6(&self, rests: &[Rest], q_m2: &[f64]) -> f64 {
        let (mut shared_m3, mut by_field_m6) = (0.0, 0.0);
        for ground in &self.ground {
            let stays = rests[ground.node].var_share.sqrt();
            shared_m3 += stays * ground.error_m3;
            by_field_m6 += stays * ground.area_m2 * q_m2[ground.node];
        }
        (shared_m3 * shared_m3 - by_field_m6.max(0.0)).max(0.0)
    }
}
