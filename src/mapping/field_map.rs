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
use super::disturbance::{Flagged, Levels, Undisturbed};
use super::footprint::{Footprint, Patch};
use super::grid_map::Bays;
use super::hidden_ground::HiddenGround;
use super::mapper::SolvedSurface;
use super::matern_field::{
    self, Adjoint, FieldError, Information, Lattice, Prior, Solution, Solver,
};
use super::projection::LidarMount;
use super::ray_ceiling::RayCeiling;
use super::roughness::Residuals;
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
    /// Roughness below the cell size `σ_ε`, m, at least: the data may show more.
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
            nugget_m: 0.007,
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
    /// The LiDAR of each vehicle; one, unless maps of several vehicles are merged.
    pub lidars: Vec<LidarMount>,
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
    /// How far the patches of a square scatter about each other, m.
    pub scatter_m: f64,
    /// What is known of ground that no beam reached.
    pub hidden: HiddenGround,
}

/// The turns of a flight, and the newest surface.
#[derive(Debug, Clone)]
pub struct FieldMap {
    setup: Arc<Setup>,
    footprints: Vec<Arc<Footprint>>,
    levels: Arc<Levels>,
    ceiling: Arc<RayCeiling>,
    newest: Option<Arc<NewestField>>,
}

impl FieldMap {
    /// A map without a turn.
    #[must_use]
    pub fn new(setup: Arc<Setup>) -> Self {
        let (levels, ceiling) = (setup.levels(), setup.ceiling());
        Self { setup, footprints: Vec::new(), levels, ceiling, newest: None }
    }

    /// Takes in a turn.
    pub fn push(&mut self, mut footprint: Footprint) {
        Arc::make_mut(&mut self.levels).take(&self.setup.lattice, &mut footprint);
        if let Some(lidar) = self.setup.lidars.get(footprint.lidar_idx) {
            Arc::make_mut(&mut self.ceiling).take(&self.setup.lattice, lidar, &footprint);
        }
        self.footprints.push(Arc::new(footprint));
    }

    /// The turns so far, in their order.
    #[must_use]
    pub fn turns(&self) -> &[Arc<Footprint>] {
        &self.footprints
    }

    /// The same map with the LiDAR of each of several vehicles.
    pub(super) fn set_lidars(&mut self, lidars: Vec<LidarMount>) {
        Arc::make_mut(&mut self.setup).lidars = lidars;
    }

    /// Forgets all turns and surfaces.
    pub fn restart(&mut self) {
        self.footprints.clear();
        self.levels = self.setup.levels();
        self.ceiling = self.setup.ceiling();
        self.newest = None;
    }

    /// Drops the turns after `since`, and the surface if it may rest on them; the number of their
    /// beams.
    pub fn forget_since(&mut self, since: Stamp<Mono>) -> u64 {
        let is_kept = |footprint: &Arc<Footprint>| footprint.error.at <= since;
        let dropped = self.footprints.iter().filter(|footprint| !is_kept(footprint));
        let patches = dropped.flat_map(|footprint| &footprint.patches);
        let n_beams = patches.map(|patch| u64::from(patch.n_beams)).sum();
        let kept = std::mem::take(&mut self.footprints).into_iter().filter(is_kept);
        // Levels are sorted turn by turn: those of wrong poses must not judge the later ones.
        self.levels = self.setup.levels();
        self.ceiling = self.setup.ceiling();
        for footprint in kept.collect::<Vec<_>>() {
            self.push(Arc::unwrap_or_clone(footprint));
        }
        if n_beams > 0 {
            self.newest = None;
        }
        n_beams
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
        let at = self.setup.linearization(&[], None);
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
            levels: Arc::clone(&self.levels),
            ceiling: Arc::clone(&self.ceiling),
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
    levels: Arc<Levels>,
    ceiling: Arc<RayCeiling>,
    newest: Option<Arc<NewestField>>,
    is_final: bool,
}

/// What the turns know, added up.
struct Data {
    info: Information,
    n_refused: u64,
    /// What the data differ by from the surface that they were linearised with.
    residuals: Residuals,
}

/// One solution.
struct Round {
    solution: Solution,
    data: Data,
    /// The surface whose slopes the data were linearised with.
    before: Option<NewestField>,
    /// What the solution knew of hidden ground.
    hidden: HiddenGround,
    /// Variance of the height at every node, m², where it was affordable.
    var_m2: Option<Vec<f64>>,
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
        let turns = self.levels.judge(&self.footprints);
        let n_patches = self.setup.n_patches(&turns.footprints);
        // The first solution of all has no slopes to start from.
        let n_rounds =
            if self.is_final { FINAL_ROUNDS } else { 1 + usize::from(self.newest.is_none()) };
        // After landing all data meet as equals: an early, wrong surface must not refuse later ones.
        let first = self.newest.as_deref().filter(|_| !self.is_final);
        let mut round = self.round(&turns.footprints, &n_patches, first)?;
        for _ in 1..n_rounds {
            round = self.round(&turns.footprints, &n_patches, Some(&round.newest))?;
        }
        self.account(&turns, &n_patches, round)
    }

    /// One solution with the slopes of the one before; after landing, what hides behind crests is
    /// settled in it.
    fn round(
        &self,
        turns: &[Arc<Footprint>],
        n_patches: &[u32],
        before: Option<&NewestField>,
    ) -> Result<Round, FieldError> {
        let setup = &self.setup;
        let at = setup.linearization(n_patches, before);
        let data = self.gather(turns, &at);
        let is_known: Vec<bool> = (0..setup.lattice.n_nodes())
            .map(|node| data.info.n_hits(node) >= KNOWN_FROM_PATCHES)
            .collect();
        let ceiling_m =
            |node: usize| if is_known[node] { None } else { self.ceiling.at_node_m(node) };
        let softness_m = at.ceiling_softness_m();
        // In flight the newest conditions are good enough, and are renewed for the next solve.
        let n_sweeps = if self.is_final { FINAL_SWEEPS } else { 1 };
        let start = before.or(self.newest.as_deref());
        let mut hidden = start.map_or_else(HiddenGround::default, |start| {
            start.hidden.among(|node| ceiling_m(node).is_some())
        });
        let mut sweep = 1;
        loop {
            let solution = self.solution(&data.info, &hidden, before)?;
            let var_m2 = self.var_m2(&solution);
            let (next, step) = match &var_m2 {
                Some(var_m2) => hidden.renewed(solution.height_m(), var_m2, ceiling_m, softness_m),
                None => (hidden.clone(), 0.0),
            };
            if sweep == n_sweeps || step < SETTLED_SIGMAS {
                let scatter_m = data.residuals.scatter_m().or(before.map(|b| b.scatter_m));
                let newest = NewestField {
                    heights_m: solution.height_m().to_vec(),
                    is_known,
                    scatter_m: scatter_m.unwrap_or(0.0),
                    hidden: next,
                };
                return Ok(Round {
                    solution,
                    data,
                    before: before.cloned(),
                    hidden,
                    var_m2,
                    newest,
                });
            }
            hidden = next;
            sweep += 1;
        }
    }

    /// The field given the data and what is known of hidden ground.
    fn solution(
        &self,
        info: &Information,
        hidden: &HiddenGround,
        before: Option<&NewestField>,
    ) -> Result<Solution, FieldError> {
        let mut info = info.clone();
        hidden.add_to(&mut info);
        matern_field::solve(
            &self.setup.lattice,
            &self.setup.settings.prior(),
            &info,
            Solver::Automatic,
            before.map(|before| before.heights_m.as_slice()),
        )
    }

    /// Adds up what all turns know.
    fn gather(&self, turns: &[Arc<Footprint>], at: &Linearization<'_>) -> Data {
        let setup = &self.setup;
        let mut data = Data {
            info: Information::new(&setup.lattice),
            n_refused: 0,
            residuals: Residuals::new(setup.lattice.n_nodes()),
        };
        for footprint in turns {
            let Some(turn) = Turn::new(footprint, *at) else { continue };
            for patch in &footprint.patches {
                let Some(datum) = turn.datum(patch) else { continue };
                if !at.believes(&datum) {
                    data.n_refused += u64::from(patch.n_beams);
                    continue;
                }
                if let Some(surface_m) = at.known_surface_m(&datum.row) {
                    data.residuals.push(footprint.error.at, &datum, surface_m);
                }
                data.info.add(&datum.row, datum.height_m, datum.weight_per_m2);
            }
        }
        data
    }

    /// The volumes of a solution with their budgets.
    fn account(
        &self,
        turns: &Undisturbed,
        n_patches: &[u32],
        round: Round,
    ) -> Result<SolvedSurface, FieldError> {
        let setup = &self.setup;
        let at = setup.linearization(n_patches, round.before.as_ref());
        let areas_m2 = setup.areas_m2();
        let adjoint = |of_bay: &Vec<f64>| round.solution.adjoint(of_bay, None);
        let adjoints = areas_m2.iter().map(adjoint).collect::<Result<Vec<_>, _>>()?;
        let prior_vars_m6 = adjoints
            .iter()
            .map(|adjoint| self.prior_var_m6(&round.solution, adjoint))
            .collect::<Result<Vec<_>, _>>()?;
        let q_m2: Vec<&[f64]> = adjoints.iter().map(|adjoint| adjoint.q.as_slice()).collect();
        let budgets = data_budgets(&turns.footprints, &at, &q_m2, &setup.settings.calibration);
        let mean_m = setup.lattice.on_cells(&round.newest.heights_m);
        let seen = setup.seen(&round.data.info, &turns.flagged);
        let range_m = setup.settings.range_m;
        let adjoints = std::iter::zip(&adjoints, prior_vars_m6);
        let solved = std::iter::zip(std::iter::zip(&areas_m2, adjoints), budgets);
        let accounts = std::iter::zip(setup.bays.iter(), solved)
            .map(|(bay, ((areas_m2, (adjoint, prior_var_m6)), mut budget))| {
                let above_floor_m3 = round.solution.functional(areas_m2, adjoint);
                let volume_m3 = above_floor_m3 - bay.base.above_floor_m3();
                let prior = BudgetRow { source: BudgetSource::Prior, var_m6: prior_var_m6 };
                budget.rows.insert(0, prior);
                let var_m6 = round.hidden.var_m6(&adjoint.q);
                budget.rows.push(BudgetRow { source: BudgetSource::HiddenGround, var_m6 });
                if !bay.base.errors.is_empty() {
                    budget.push_shared(BudgetSource::Base, &bay.base.errors);
                }
                bay.account(self.at, (volume_m3, &mean_m), budget, &seen, range_m)
            })
            .collect();
        let var_m2 = round.var_m2.unwrap_or_else(|| setup.own_var_m2(&round.data.info));
        let sigma_m = setup.lattice.on_cells(&var_m2).iter().map(|var| var.sqrt()).collect();
        let grid = *setup.lattice.grid();
        let disturbed_cells = turns.flagged.cells().collect();
        let surface = HeightMap { at: self.at, grid, mean_m, sigma_m, disturbed_cells };
        Ok(SolvedSurface {
            accounts,
            surface,
            n_beams_refused: turns.n_beams_left_out + round.data.n_refused,
            disturbed: turns.flagged.areas(&grid),
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
    /// information, 1/m².
    pub(super) fn for_each_patch(
        &self,
        until: Option<Stamp<Mono>>,
        mut visit: impl FnMut(&Footprint, &Patch, f64),
    ) {
        let n_patches = self.setup.n_patches(&self.footprints);
        let at = self.setup.linearization(&n_patches, self.newest.as_deref());
        let is_past = |f: &&Arc<Footprint>| until.is_none_or(|until| f.error.at <= until);
        for footprint in self.footprints.iter().filter(is_past) {
            let Some(turn) = Turn::new(footprint, at) else { continue };
            for patch in &footprint.patches {
                if let Some(datum) = turn.datum(patch).filter(|datum| at.believes(datum)) {
                    visit(footprint, patch, datum.weight_per_m2);
                }
            }
        }
    }

    /// What the prior contributes to a volume's variance, m⁶: after landing as the data show it, in
    /// flight, where that takes too long, as it was configured.
    fn prior_var_m6(&self, solution: &Solution, adjoint: &Adjoint) -> Result<f64, FieldError> {
        if self.is_final { solution.shown_prior_var(adjoint) } else { Ok(adjoint.prior_var) }
    }

    /// Variance of the height at every node, m²: exact after landing and on maps that are solved by a
    /// factor; none in flight over larger ones, where it takes gigabytes, and where the factor does
    /// not fit into memory.
    fn var_m2(&self, solution: &Solution) -> Option<Vec<f64>> {
        let n_nodes = self.setup.lattice.n_nodes();
        let is_direct = n_nodes <= Solver::MOST_NODES_DIRECT;
        let is_affordable = is_direct || self.is_final && n_nodes <= MOST_NODES_FINAL;
        is_affordable.then(|| solution.marginal_var_m2().ok()).flatten()
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

/// How often what hides behind crests is renewed after landing, at most …
const FINAL_SWEEPS: usize = 8;
/// … and it has settled when a node moves by less than this, in its σ.
const SETTLED_SIGMAS: f64 = 0.05;
/// Exact variances of more nodes than this take gigabytes: 500 × 500.
const MOST_NODES_FINAL: usize = 250_000;
/// A node may judge outliers from this much of a patch on.
const KNOWN_FROM_PATCHES: f64 = 0.5;
/// A cell counts as seen from this much of a patch on: one hit in its middle, or two beside it.
const SEEN_FROM_PATCHES: f64 = 0.5;

impl Setup {
    /// How many patches each square has, by its south-west node.
    fn n_patches(&self, turns: &[Arc<Footprint>]) -> Vec<u32> {
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
    fn areas_m2(&self) -> Vec<Vec<f64>> {
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

    fn seen(&self, info: &Information, flagged: &Flagged) -> SeenCells {
        let grid = self.lattice.grid();
        let is_seen = |cell| info.n_hits(self.lattice.node_of_cell(cell)) >= SEEN_FROM_PATCHES;
        let is_seen: Vec<bool> = (0..grid.n_cells()).map(is_seen).collect();
        SeenCells::new(grid, &is_seen, flagged.clone())
    }

    /// What a node's own data leave of the prior's variance, m²: too little where neighbours know
    /// more. The volumes do not depend on it.
    fn own_var_m2(&self, info: &Information) -> Vec<f64> {
        let prior_info = self.settings.sigma_m.powi(-2);
        (0..info.n_nodes()).map(|node| 1.0 / (prior_info + info.info_per_m2(node))).collect()
    }

    /// No beam has passed over anything.
    fn ceiling(&self) -> Arc<RayCeiling> {
        Arc::new(RayCeiling::new(self.lattice.n_nodes()))
    }

    /// Nothing seen, so nothing moved.
    fn levels(&self) -> Arc<Levels> {
        let Settings { nugget_m, slope_sigma, .. } = self.settings;
        Arc::new(Levels::new(self.lattice.grid(), nugget_m, slope_sigma))
    }

    /// What a patch is worth beside the newest surface.
    fn linearization<'a>(
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
            roughness_m: newest.map_or(0.0, |newest| newest.scatter_m).max(self.settings.nugget_m),
            scatter_m: newest.map_or(0.0, |newest| newest.scatter_m),
            slope_sigma: self.settings.slope_sigma,
        }
    }
}
