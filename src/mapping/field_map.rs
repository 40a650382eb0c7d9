//! The map of a flight as a Matérn field: turns of the scanner in, volumes with their budgets out.
//!
//! The map is the list of its turns ([`Footprint`]). A solve reads all of them anew with the slopes
//! of the newest surface, so nothing of an early, coarse linearisation remains in the result, and
//! maps of several flights add up by joining their lists.
//!
//! ```text
//! turns ─▶ datum (row a, height z, variance R) ─▶ Σ aaᵀ/R, Σ a z/R ─▶ Q h = … ─▶ h, q ─▶ V, budget
//!            ▲ slopes, outliers                                           │
//!            └────────────────────────────────────────────────────────────┘
//! ```

use super::bay::BayOnGrid;
use super::budget::{CalibrationSigmas, data_budgets};
use super::datum::{Linearization, Turn};
use super::footprint::{Footprint, Patch};
use super::grid_map::Bays;
use super::mapper::SolvedSurface;
use super::matern_field::{self, FieldError, Information, Lattice, Prior, Solution, Solver};
use super::projection::LidarMount;
use super::shares::SeenCells;
use crate::messages::{BudgetRow, BudgetSource, GridGeometry, HeightMap};
use crate::time::{Mono, Stamp};
use std::sync::Arc;

/// What the field must know before a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Practical range ρ of the material's heights, m.
    pub range_m: f64,
    /// Standard deviation `σ_f` of the heights about their mean level, m.
    pub sigma_m: f64,
    /// Roughness below the cell size `σ_ε`, m.
    pub nugget_m: f64,
    /// Expected mean level, m, and its standard deviation, m.
    pub mean_level_m: (f64, f64),
    /// Standard deviation `σ_t` of the slope before anything is known.
    pub slope_sigma: f64,
    /// Errors that last the whole flight.
    pub calibration: CalibrationSigmas,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            range_m: 5.0,
            sigma_m: 1.0,
            nugget_m: 0.02,
            mean_level_m: (1.5, 1.5),
            slope_sigma: 0.6,
            calibration: CalibrationSigmas::default(),
        }
    }
}

/// What stays the same for all solves of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// What the field must know.
    pub settings: Settings,
    /// Nodes of the field.
    pub lattice: Arc<Lattice>,
    /// The LiDAR.
    pub lidar: LidarMount,
    /// What is measured: the whole region, then its bays.
    pub bays: Bays,
}

/// The newest surface, which the next solve starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct NewestField {
    /// Height of every node, m.
    pub heights_m: Vec<f64>,
    /// Nodes that rest on data.
    pub is_known: Vec<bool>,
}

/// The turns of a flight, and the newest surface.
#[derive(Debug, Clone)]
pub struct FieldMap {
    setup: Arc<Setup>,
    footprints: Vec<Arc<Footprint>>,
    newest: Option<Arc<NewestField>>,
}

impl FieldMap {
    /// A map without a turn.
    #[must_use]
    pub const fn new(setup: Arc<Setup>) -> Self {
        Self { setup, footprints: Vec::new(), newest: None }
    }

    /// Takes in a turn.
    pub fn push(&mut self, footprint: Footprint) {
        self.footprints.push(Arc::new(footprint));
    }

    /// Forgets all turns and surfaces.
    pub fn restart(&mut self) {
        self.footprints.clear();
        self.newest = None;
    }

    /// Starts the next solve from this surface.
    pub fn absorb(&mut self, newest: Arc<NewestField>) {
        self.newest = Some(newest);
    }

    /// The nodes.
    #[cfg(test)]
    pub(super) fn lattice(&self) -> &Lattice {
        &self.setup.lattice
    }

    /// The linearisation at these heights, with the configured roughness.
    #[cfg(test)]
    pub(super) fn linearization<'a>(&'a self, heights_m: &'a [f64]) -> Linearization<'a> {
        let at = self.setup.linearization(None);
        Linearization { heights_m: Some(heights_m), ..at }
    }

    /// When the newest turn was taken.
    #[must_use]
    pub fn newest_turn_at(&self) -> Option<Stamp<Mono>> {
        self.footprints.last().map(|footprint| footprint.error.at)
    }

    /// Everything a solve needs, as it is now.
    #[must_use]
    pub fn snapshot(&self, at: Stamp<Mono>, is_final: bool) -> SolveField {
        SolveField {
            at,
            setup: Arc::clone(&self.setup),
            footprints: self.footprints.clone(),
            newest: self.newest.clone(),
            is_final,
        }
    }
}

/// The work of turning footprints into a surface and its volumes; a pure function of its fields.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveField {
    at: Stamp<Mono>,
    setup: Arc<Setup>,
    footprints: Vec<Arc<Footprint>>,
    newest: Option<Arc<NewestField>>,
    is_final: bool,
}

/// What the turns know, added up.
struct Data {
    info: Information,
    n_refused: u64,
}

/// One solution.
struct Round {
    solution: Solution,
    data: Data,
    /// The surface whose slopes the data were linearised with.
    before: Option<NewestField>,
    newest: NewestField,
}

/// Solves after landing: one without slopes and gates, one with them, and one with better ones.
const FINAL_ROUNDS: usize = 3;

impl SolveField {
    /// Solves.
    ///
    /// # Errors
    /// [`FieldError`] from the field.
    pub fn run(&self) -> Result<SolvedSurface, FieldError> {
        // The first solution of all has no slopes to start from.
        let n_rounds =
            if self.is_final { FINAL_ROUNDS } else { 1 + usize::from(self.newest.is_none()) };
        // After landing all data meet as equals: an early, wrong surface must not refuse later ones.
        let first = self.newest.as_deref().filter(|_| !self.is_final);
        let mut round = self.round(first)?;
        for _ in 1..n_rounds {
            round = self.round(Some(&round.newest))?;
        }
        self.account(round)
    }

    /// One solution with the slopes of the one before.
    fn round(&self, before: Option<&NewestField>) -> Result<Round, FieldError> {
        let data = self.gather(&self.setup.linearization(before));
        let solution = matern_field::solve(
            &self.setup.lattice,
            &self.setup.settings.prior(),
            &data.info,
            Solver::Automatic,
            before.map(|before| before.heights_m.as_slice()),
        )?;
        let is_known =
            (0..self.setup.lattice.n_nodes()).map(|node| data.info.n_hits(node) > 0.0).collect();
        let newest = NewestField { heights_m: solution.height_m().to_vec(), is_known };
        Ok(Round { solution, data, before: before.cloned(), newest })
    }

    /// Adds up what all turns know.
    fn gather(&self, at: &Linearization<'_>) -> Data {
        let setup = &self.setup;
        let mut data = Data { info: Information::new(&setup.lattice), n_refused: 0 };
        for footprint in &self.footprints {
            let turn = Turn::new(footprint, *at);
            for patch in &footprint.patches {
                let Some(datum) = turn.datum(patch) else { continue };
                if !at.believes(&datum) {
                    data.n_refused += u64::from(patch.n_beams);
                    continue;
                }
                data.info.add(&datum.row, datum.height_m, 1.0 / datum.var_m2());
            }
        }
        data
    }

    /// The volumes of a solution with their budgets.
    fn account(&self, round: Round) -> Result<SolvedSurface, FieldError> {
        let setup = &self.setup;
        let at = setup.linearization(round.before.as_ref());
        let areas_m2 = |bay: &BayOnGrid| setup.lattice.from_cells(&bay.base.cell_areas_m2);
        let adjoint = |bay: &BayOnGrid| round.solution.adjoint(&areas_m2(bay), None);
        let adjoints = setup.bays.iter().map(adjoint).collect::<Result<Vec<_>, _>>()?;
        let q_m2: Vec<&[f64]> = adjoints.iter().map(|adjoint| adjoint.q.as_slice()).collect();
        let budgets = data_budgets(&self.footprints, &at, &q_m2, &setup.settings.calibration);
        let mean_m = setup.lattice.on_cells(&round.newest.heights_m);
        let seen = setup.seen(&round.data.info);
        let range_m = setup.settings.range_m;
        let accounts = std::iter::zip(setup.bays.iter(), std::iter::zip(adjoints, budgets))
            .map(|(bay, (adjoint, mut budget))| {
                // An iterative solution leaves something of V, which its adjoint knows.
                let w = areas_m2(bay);
                let raw_m3: f64 =
                    std::iter::zip(&w, round.solution.height_m()).map(|(w, h)| w * h).sum();
                let left_m3 = round.solution.functional(&w, &adjoint) - raw_m3;
                let prior = BudgetRow { source: BudgetSource::Prior, var_m6: adjoint.prior_var };
                budget.rows.insert(0, prior);
                if !bay.base.errors.is_empty() {
                    budget.push_shared(BudgetSource::Base, &bay.base.errors);
                }
                bay.account(self.at, (&mean_m, left_m3), budget, &seen, range_m)
            })
            .collect();
        let sigma_m =
            setup.lattice.on_cells(&self.var_m2(&round)?).iter().map(|var| var.sqrt()).collect();
        let surface = HeightMap { at: self.at, grid: *setup.lattice.grid(), mean_m, sigma_m };
        Ok(SolvedSurface {
            accounts,
            surface,
            n_beams_refused: round.data.n_refused,
            newest: Some(Arc::new(round.newest)),
        })
    }
}

impl SolveField {
    /// Cells, their heights, and which rest on data.
    pub(super) fn known_heights(&self) -> Option<(GridGeometry, Vec<f64>, Vec<bool>)> {
        let newest = self.newest.as_ref()?;
        let lattice = &self.setup.lattice;
        let grid = *lattice.grid();
        let is_known = |cell| newest.is_known[lattice.node_of_cell(cell)];
        let known = (0..grid.n_cells()).map(is_known).collect();
        Some((grid, lattice.on_cells(&newest.heights_m), known))
    }

    /// Shows every patch that the newest surface believes, of the turns up to an instant, with its
    /// information 1/R, 1/m².
    pub(super) fn for_each_patch(
        &self,
        until: Option<Stamp<Mono>>,
        mut visit: impl FnMut(&Footprint, &Patch, f64),
    ) {
        let at = self.setup.linearization(self.newest.as_deref());
        let is_past = |f: &&Arc<Footprint>| until.is_none_or(|until| f.error.at <= until);
        for footprint in self.footprints.iter().filter(is_past) {
            let turn = Turn::new(footprint, at);
            for patch in &footprint.patches {
                if let Some(datum) = turn.datum(patch).filter(|datum| at.believes(datum)) {
                    visit(footprint, patch, 1.0 / datum.var_m2());
                }
            }
        }
    }

    /// Variance of the height at every node, m²: exact after landing and on maps that are solved by a
    /// factor; in flight over larger ones, where the exact one takes gigabytes, what a node's own
    /// data leave of the prior.
    fn var_m2(&self, round: &Round) -> Result<Vec<f64>, FieldError> {
        let n_nodes = self.setup.lattice.n_nodes();
        if self.is_final || n_nodes <= Solver::MOST_NODES_DIRECT {
            return round.solution.marginal_var_m2();
        }
        let prior_info = self.setup.settings.sigma_m.powi(-2);
        Ok((0..n_nodes).map(|n| 1.0 / (prior_info + round.data.info.info_per_m2(n))).collect())
    }
}

impl Settings {
    /// The field before any beam.
    #[must_use]
    pub const fn prior(&self) -> Prior {
        Prior {
            range_m: self.range_m,
            sigma_m: self.sigma_m,
            mean_m: self.mean_level_m.0,
            mean_sigma_m: self.mean_level_m.1,
        }
    }
}

/// A cell counts as seen from this much of a patch on: one hit in its middle, or two beside it.
const SEEN_FROM_PATCHES: f64 = 0.5;

impl Setup {
    fn seen(&self, info: &Information) -> SeenCells {
        let grid = self.lattice.grid();
        let is_seen = |cell| info.n_hits(self.lattice.node_of_cell(cell)) >= SEEN_FROM_PATCHES;
        SeenCells::new(grid, &(0..grid.n_cells()).map(is_seen).collect::<Vec<_>>())
    }

    /// What a patch is worth beside the newest surface.
    fn linearization<'a>(&'a self, newest: Option<&'a NewestField>) -> Linearization<'a> {
        Linearization {
            lattice: &self.lattice,
            heights_m: newest.map(|newest| newest.heights_m.as_slice()),
            is_known: newest.map_or(&[], |newest| newest.is_known.as_slice()),
            lidar: &self.lidar,
            nugget_m: self.settings.nugget_m,
            slope_sigma: self.settings.slope_sigma,
        }
    }
}
