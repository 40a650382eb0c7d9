//! What the parts of a setup give together: areas of nodes, what counts as seen, linearisations.

use super::{NewestField, Setup};
use crate::mapping::bay::BayOnGrid;
use crate::mapping::datum::Linearization;
use crate::mapping::disturbance::{Flagged, Levels};
use crate::mapping::footprint::Footprint;
use crate::mapping::matern_field::{Information, Prior};
use crate::mapping::ray_ceiling::RayCeiling;
use crate::mapping::shares::SeenCells;
use crate::mapping::silence::Floor;
use crate::mapping::unseen_patch::{Ground, VarBesideSeen};
use std::sync::Arc;

/// Nodes that stand for less than this share of a cell are no ground by themselves: they lie in walls or outside, where no beam
/// could have reached them.
const LEAST_GROUND_SHARE: f64 = 0.5;
/// A cell counts as seen from this much of a patch on: one hit in its middle, or two beside it.
const SEEN_FROM_PATCHES: f64 = 0.5;

impl Setup {
    /// How many patches each square has, by its south-west node.
    pub(super) fn n_patches(&self, turns: &[Arc<Footprint>]) -> Vec<u32> {
        let mut n_patches = vec![0; self.lattice.n_nodes()];
        for patch in turns.iter().flat_map(|turn| &turn.patches) {
            let place = patch.place();
            if let Some(row) = self.lattice.row_at(place.x, place.y) {
                n_patches[row.nodes[0] as usize] += 1;
            }
        }
        n_patches
    }

    /// The areas that each node stands for, m², of the whole region and of its bays.
    pub(super) fn areas_m2(&self) -> Vec<Vec<f64>> {
        let mut areas_m2: Vec<Vec<f64>> =
            self.bays.iter().map(|bay| self.areas_of_bay_m2(bay)).collect();
        if let [whole, bays @ ..] = areas_m2.as_mut_slice()
            && !bays.is_empty()
        {
            // The whole is the sum of its bays to the last digit.
            for (node, area_m2) in whole.iter_mut().enumerate() {
                *area_m2 = bays.iter().map(|bay| bay[node]).sum();
            }
        }
        areas_m2
    }

    /// The area of a bay that each node stands for, m²: what its surface is integrated with.
    ///
    /// Whole cells count with their mean height. A cell that a border cuts counts with the height
    /// where its base is taken, and over an earlier survey every cell does: an unchanged surface
    /// has no volume over itself.
    fn areas_of_bay_m2(&self, bay: &BayOnGrid) -> Vec<f64> {
        let whole_m2 = self.lattice.grid().cell_area_m2() * (1.0 - 1e-9);
        let mut of_whole_cells = vec![0.0; self.lattice.n_nodes()];
        let mut areas_m2 = vec![0.0; self.lattice.n_nodes()];
        for ((x_m, y_m), area_m2) in &bay.areas {
            if *area_m2 >= whole_m2 && !bay.is_over_survey {
                of_whole_cells[self.lattice.nearest_node(*x_m, *y_m)] += area_m2;
            } else if let Some(row) = self.lattice.row_at(*x_m, *y_m) {
                for (node, weight) in std::iter::zip(row.nodes, row.weights) {
                    areas_m2[node as usize] += weight * area_m2;
                }
            } else {
                // Between walls on all sides: its own cell's node stands alone.
                areas_m2[self.lattice.nearest_node(*x_m, *y_m)] += area_m2;
            }
        }
        let of_means = self.lattice.spread_over_cells(&of_whole_cells);
        std::iter::zip(areas_m2, of_means).map(|(a, b)| a + b).collect()
    }

    /// Nodes that belong to what is measured.
    pub(super) fn counts(&self) -> Vec<bool> {
        self.areas_m2()[0].iter().map(|area_m2| *area_m2 > 0.0).collect()
    }

    pub(super) fn seen(&self, info: &Information, flagged: &Flagged) -> SeenCells {
        let grid = self.lattice.grid();
        let is_seen = |cell| info.n_hits(self.lattice.node_of_cell(cell)) >= SEEN_FROM_PATCHES;
        let is_seen: Vec<bool> = (0..grid.n_cells()).map(is_seen).collect();
        SeenCells::new(grid, &is_seen, flagged.clone())
    }

    /// What a node's own data leave of the prior's variance, m²: too little where neighbours know
    /// more. The volumes do not depend on it.
    pub(super) fn own_var_m2(prior: &Prior, info: &Information) -> Vec<f64> {
        let prior_info = prior.sigma_m.powi(-2);
        (0..info.n_nodes()).map(|node| 1.0 / (prior_info + info.info_per_m2(node))).collect()
    }

    /// The variance of every node by its distance to known ones, m².
    pub(super) fn var_beside_m2(&self, prior: &Prior, is_known: &[bool]) -> Vec<f64> {
        let beside = VarBesideSeen::new(prior, self.lattice.spacing_m());
        beside.on(&self.lattice, is_known)
    }

    /// No ground is lower than this, m over the hall floor: the lowest base, but for one that was dug into.
    pub(super) fn floor_m(&self) -> f64 {
        if self.may_be_dug_into() { f64::NEG_INFINITY } else { self.lowest_base_m() }
    }

    /// What stops rays where no ground is known: the base, or everywhere the lowest one where it may be dug into.
    pub(super) fn floor(&self) -> Floor {
        let lowest_m = self.lowest_base_m();
        let bases = self.bays.first().filter(|_| !self.may_be_dug_into()).map(|whole| &whole.base);
        let of_cell = |cell: usize| {
            let base = bases.filter(|base| base.cell_areas_m2[cell] > 0.0);
            base.map_or(lowest_m, |base| base.cell_base_m[cell])
        };
        let of_cells_m = (0..self.lattice.grid().n_cells()).map(of_cell).collect();
        Floor { of_cells_m, elsewhere_m: lowest_m }
    }

    fn may_be_dug_into(&self) -> bool {
        self.bays.iter().any(|bay| bay.is_over_survey)
    }

    fn lowest_base_m(&self) -> f64 {
        let lowest_m = self.bays.first().and_then(|whole| whole.base.lowest_m());
        lowest_m.unwrap_or(f64::NEG_INFINITY)
    }

    /// What is known of the ground at each node, of which these areas count.
    pub(super) fn ground(&self, is_known: &[bool], areas_m2: &[f64]) -> Vec<Ground> {
        let is_hidden = self.lattice.far_from(is_known);
        let least_m2 = LEAST_GROUND_SHARE * self.lattice.grid().cell_area_m2();
        let at_node = |node: usize| match () {
            () if is_known[node] || areas_m2[node] < least_m2 => Ground::Known,
            () if is_hidden[node] => Ground::Core,
            () => Ground::Rim,
        };
        (0..self.lattice.n_nodes()).map(at_node).collect()
    }

    /// No beam has passed over anything.
    pub(super) fn ceiling(&self) -> Arc<RayCeiling> {
        Arc::new(RayCeiling::new(self.lattice.n_nodes()))
    }

    /// Nothing seen, so nothing moved.
    pub(super) fn levels(&self) -> Arc<Levels> {
        let super::Settings { nugget_m, slope_sigma, .. } = self.settings;
        Arc::new(Levels::new(self.lattice.grid(), nugget_m, slope_sigma))
    }

    /// What a patch is worth beside the newest surface.
    pub(super) fn linearization<'a>(
        &'a self,
        n_patches: &'a [u32],
        newest: Option<&'a NewestField>,
    ) -> Linearization<'a> {
        Linearization {
            lattice: &self.lattice,
            n_patches,
            heights_m: newest.map(|newest| newest.heights_m.as_slice()),
            is_known: newest.map_or(&[], |newest| newest.is_known.as_slice()),
            lidars: &self.lidars,
            roughness_m: newest
                .and_then(NewestField::shown_roughness_m)
                .unwrap_or(self.settings.nugget_m),
            scatter_m: newest.and_then(|newest| newest.scatter_m).unwrap_or(0.0),
            slope_sigma: self.settings.slope_sigma,
            occlusion_share: self.settings.occlusion_share,
        }
    }
}
