//! What the turns of a flight say about the prior that they were solved with.

use super::SolveField;
use crate::mapping::datum::Turn;
use crate::mapping::matern_field::{self, FieldError, PriorEstimate};

impl SolveField {
    /// The prior under which the heights of this flight are most likely, searched from the configured one.
    ///
    /// One patch stands for each square of nodes, the first that the newest surface believes, since what
    /// the nodes cannot show of a square is common to all of its patches. Only ground that counts for the
    /// volume has a say: flat floor beside the material would make it look smooth. Takes two sparse factors
    /// an evaluation: seconds at 100 × 100 cells, a minute at 300 × 300.
    ///
    /// # Errors
    /// [`FieldError`] from the field.
    pub fn learn_prior(&self) -> Result<PriorEstimate, FieldError> {
        let setup = &self.setup;
        let counts: Vec<bool> = setup.areas_m2()[0].iter().map(|area| *area > 0.0).collect();
        let n_patches = setup.n_patches(&self.footprints);
        let at = setup.linearization(&n_patches, self.newest.as_deref());
        let mut is_taken = vec![false; setup.lattice.n_nodes()];
        let mut data = Vec::new();
        for footprint in &self.footprints {
            let Some(turn) = Turn::new(footprint, at) else { continue };
            for datum in footprint.patches.iter().filter_map(|patch| turn.datum(patch)) {
                let square = datum.row.nodes[0] as usize;
                if is_taken[square] || !datum.row.touches(&counts) || !at.believes(&datum) {
                    continue;
                }
                is_taken[square] = true;
                data.push(matern_field::Datum {
                    row: datum.row,
                    height_m: datum.height_m,
                    white_var_m2: datum.var_m2() - datum.roughness_var_m2,
                });
            }
        }
        let settings = &setup.settings;
        matern_field::estimate_prior(&setup.lattice, &data, &settings.prior(), settings.nugget_m)
    }
}
