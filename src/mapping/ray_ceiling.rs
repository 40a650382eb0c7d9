//! How high ground can be where no beam ended: below every beam that passed over it.
//!
//! ```text
//!   LiDAR ●
//!            ╲  ray
//!      crest   ╲
//!      ╱╲________╲          ground behind the crest lies below the ray,
//!     ╱   ?   ?   ╲ hit     which is the only thing that is known of it
//! ```
//! Rays are followed from their ends, on material or elsewhere (a wall, the floor beside it), back to the
//! LiDAR. A single wrong range (a mirror, a beam through a gap) would put a ray underground, so a ray is
//! believed as far as another turn's, over the same node or within half a metre, is as low: each node
//! keeps its lowest rays of two turns. In flight turns follow each other by decimetres. Where a vehicle
//! turns on the spot, they pass half a metre to a metre apart at ten metres; the second lowest over the same node is
//! of another place then, and much higher.
//!
//! Hidden ground lies between rays as under them: nodes half a metre beside a ray have its ceiling, less
//! sharply. Nearer ones would say the same twice.
//! Checked: `rays_match_a_walk_along_them`, `one_wrong_range_lowers_the_ceiling_by_half_a_metre_of_a_ray_at_most`,
//! `a_ray_of_another_turn_within_half_a_metre_confirms`, `nodes_half_a_metre_beside_rays_have_their_ceilings`.

use super::footprint::{Footprint, Patch};
use super::matern_field::Lattice;
use super::projection::LidarMount;
use nalgebra::Vector3;

/// The lowest rays over every node.
#[derive(Debug, Clone, PartialEq)]
pub struct RayCeiling {
    nodes: Vec<TwoLowest>,
}

/// What ground at a node stays below.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ceiling {
    /// m over the hall floor.
    pub height_m: f64,
    /// How far the rays that say so pass beside the node, in steps of the lattice; 0 over it.
    pub steps: u32,
}

/// How far beside rays nodes have their ceilings, and other turns confirm a ray, m.
const BESIDE_M: f64 = 0.5;

/// The lowest ray over a node, and the lowest of all other turns, m over the hall floor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct TwoLowest {
    lowest_m: f32,
    lowest_turn: u32,
    next_m: f32,
}

impl TwoLowest {
    /// Higher than any ray, and a number: what the brain hands out holds no infinity.
    const NO_RAY_M: f32 = f32::MAX;
    const NONE: Self = Self { lowest_m: Self::NO_RAY_M, lowest_turn: 0, next_m: Self::NO_RAY_M };

    /// The lowest ray of another turn than this.
    const fn besides(&self, turn: u32) -> f32 {
        if self.lowest_turn == turn { self.next_m } else { self.lowest_m }
    }

    const fn take(&mut self, height_m: f32, turn: u32) {
        if turn == self.lowest_turn {
            self.lowest_m = self.lowest_m.min(height_m);
        } else if height_m < self.lowest_m {
            self.next_m = self.lowest_m;
            self.lowest_m = height_m;
            self.lowest_turn = turn;
        } else {
            self.next_m = self.next_m.min(height_m);
        }
    }
}

impl RayCeiling {
    /// Nothing has passed over so many nodes.
    #[must_use]
    pub fn new(n_nodes: usize) -> Self {
        Self { nodes: vec![TwoLowest::NONE; n_nodes] }
    }

    /// Takes in the rays of a turn that ended somewhere; each turn has a number of its own.
    pub fn take(
        &mut self,
        lattice: &Lattice,
        lidar: &LidarMount,
        turn_idx: usize,
        footprint: &Footprint,
    ) {
        let lidar_m = (footprint.hall_from_body * lidar.body_from_lidar.origin).coords;
        let hits = footprint.patches.iter().map(Patch::place);
        let elsewhere = footprint.passed_to_m.iter().map(|end| Vector3::from(*end).map(f64::from));
        self.take_rays(lattice, turn_idx, &lidar_m, hits.chain(elsewhere));
    }

    /// Takes in rays of a turn, from the LiDAR to these ends, in the hall, m.
    pub fn take_rays(
        &mut self,
        lattice: &Lattice,
        turn_idx: usize,
        lidar_m: &Vector3<f64>,
        ends_m: impl IntoIterator<Item = Vector3<f64>>,
    ) {
        // 0 is that of no ray.
        let turn = u32::try_from(turn_idx + 1).unwrap_or(u32::MAX);
        for end_m in ends_m {
            self.take_ray(lattice, turn, &end_m, lidar_m);
        }
    }

    /// Visits the nodes nearest to a ray: one on each line of the lattice that it crosses, lines
    /// across the axis along which it runs further.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "indices are checked to lie on the lattice; millimetres are kept at 100 m"
    )]
    fn take_ray(
        &mut self,
        lattice: &Lattice,
        turn: u32,
        hit_m: &Vector3<f64>,
        lidar_m: &Vector3<f64>,
    ) {
        let (origin, spacing_m) = (lattice.place_m(0), lattice.spacing_m());
        let on_lattice =
            |p: &Vector3<f64>| [(p.x - origin.0) / spacing_m, (p.y - origin.1) / spacing_m];
        let (from, to) = (on_lattice(hit_m), on_lattice(lidar_m));
        let (n_cols, n_rows) = lattice.size();
        let is_along_x = (to[0] - from[0]).abs() >= (to[1] - from[1]).abs();
        let (along, across) = if is_along_x { (0, 1) } else { (1, 0) };
        let (n_along, n_across) = if is_along_x { (n_cols, n_rows) } else { (n_rows, n_cols) };
        let run = to[along] - from[along];
        // A ray from straight above passes over nothing but what it hits.
        if !(run.abs() >= 1.0 && lidar_m.z > hit_m.z) {
            return;
        }
        let (low, high) = (from[along].min(to[along]).max(0.0), from[along].max(to[along]));
        let last = (n_along - 1) as f64;
        for line in low.ceil() as usize..=high.floor().min(last) as usize {
            let t = (line as f64 - from[along]) / run;
            let beside = (from[across] + t * (to[across] - from[across])).round();
            if beside < 0.0 || beside > (n_across - 1) as f64 {
                continue;
            }
            let (col, row) =
                if is_along_x { (line, beside as usize) } else { (beside as usize, line) };
            let height_m = hit_m.z + t * (lidar_m.z - hit_m.z);
            self.nodes[row * n_cols + col].take(height_m as f32, turn);
        }
    }

    /// The ceilings over hidden nodes of the grid, under rays and, of those that count, half a metre
    /// beside; from step to step the mean of what lies next to a node. Over ground that is seen rays
    /// only end, so nothing follows from them for the ground beside. Walls part them.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few steps")]
    pub fn over_hidden(
        &self,
        lattice: &Lattice,
        is_hidden: &[bool],
        counts: &[bool],
    ) -> Vec<Option<Ceiling>> {
        let under_ray = |node: usize| {
            // The padding is how the surface would go on, and bears its border. What rays pass over
            // there is what really stands or lies beyond, and may be much lower.
            let is_open = is_hidden[node] && lattice.is_of_grid(node);
            let height_m = self.at_node_m(lattice, node).filter(|_| is_open)?;
            Some(Ceiling { height_m, steps: 0 })
        };
        let mut ceilings: Vec<Option<Ceiling>> = (0..self.nodes.len()).map(under_ray).collect();
        let mut edge: Vec<usize> =
            (0..ceilings.len()).filter(|node| ceilings[*node].is_some()).collect();
        let most_steps = (BESIDE_M / lattice.spacing_m()).round().max(1.0) as u32;
        for steps in 1..=most_steps {
            let beside = edge.iter().flat_map(|node| lattice.joined(*node));
            let is_open = |node: &usize| {
                let may_have_one = is_hidden[*node] && counts[*node] && lattice.is_of_grid(*node);
                may_have_one && ceilings[*node].is_none()
            };
            let mut next: Vec<usize> = beside.filter(is_open).collect();
            next.sort_unstable();
            next.dedup();
            let mean_m = |node: &usize| {
                let near = lattice.joined(*node).filter_map(|near| ceilings[near]);
                let (sum_m, n) =
                    near.fold((0.0, 0.0), |(sum_m, n), c| (sum_m + c.height_m, n + 1.0));
                sum_m / n
            };
            let means_m: Vec<f64> = next.iter().map(mean_m).collect();
            for (node, height_m) in std::iter::zip(&next, means_m) {
                ceilings[*node] = Some(Ceiling { height_m, steps });
            }
            edge = next;
        }
        let is_kept = |over: &Ceiling| over.steps == 0 || over.steps == most_steps;
        ceilings.into_iter().map(|over| over.filter(is_kept)).collect()
    }

    /// The height that ground at a node stays below, m over the hall floor: its lowest ray, or if
    /// higher the lowest of another turn over it or within half a metre; `None` without such a one.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few steps")]
    pub fn at_node_m(&self, lattice: &Lattice, node: usize) -> Option<f64> {
        let own = self.nodes[node];
        let n_steps = (BESIDE_M / lattice.spacing_m()).round() as usize;
        let of_others =
            lattice.within(node, n_steps).map(|near| self.nodes[near].besides(own.lowest_turn));
        let confirming_m = of_others.fold(own.next_m, f32::min);
        let height_m = own.lowest_m.max(confirming_m);
        (height_m < TwoLowest::NO_RAY_M).then(|| height_m.into())
    }
}

#[cfg(test)]
mod tests;
