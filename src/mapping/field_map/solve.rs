//! From turns to a surface and its volumes.

use super::{NewestField, Setup};
use crate::mapping::budget::data_budgets;
use crate::mapping::datum::{Linearization, Turn};
use crate::mapping::disturbance::{Levels, Undisturbed};
use crate::mapping::footprint::{Footprint, Patch};
use crate::mapping::gaps::{Gap, gaps};
use crate::mapping::grid_map::Bays;
use crate::mapping::hidden_ground::HiddenGround;
use crate::mapping::left_out::{self, LeftOut};
use crate::mapping::matern_field::{self, FieldError, Information, Prior, Solution, Solver};
use crate::mapping::ray_ceiling::RayCeiling;
use crate::mapping::relief::relief_ratio;
use crate::mapping::roughness::Residuals;
use crate::mapping::silence::free_rays;
use crate::mapping::surface_work::{KnownHeights, SolvedSurface};
use crate::mapping::unseen_patch::{self, OpenNode, UnseenGround};
use crate::messages::{BudgetRow, BudgetSource, CellCoverage, GridGeometry, HeightMap};
use crate::time::{Mono, Stamp};
use std::sync::Arc;

/// The work of turning footprints into a surface and its volumes; a pure function of its fields.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveField {
    pub(super) at: Stamp<Mono>,
    pub(super) setup: Arc<Setup>,
    pub(super) footprints: Vec<Arc<Footprint>>,
    pub(super) levels: Arc<Levels>,
    pub(super) ceiling: Arc<RayCeiling>,
    pub(super) newest: Option<Arc<NewestField>>,
    pub(super) is_final: bool,
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
    /// What was expected of the ground.
    prior: Prior,
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
/// How often what hides behind crests is renewed after landing, in each of them, at most …
const FINAL_SWEEPS: usize = 8;
/// … and it has settled when a node moves by less than this, in its σ.
const SETTLED_SIGMAS: f64 = 0.05;
/// Exact variances of more nodes than this take gigabytes: 500 × 500.
const MOST_NODES_FINAL: usize = 250_000;
/// A node rests on data, and may judge outliers, from this much of a patch on.
const KNOWN_FROM_PATCHES: f64 = 0.5;

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
        let amplitude = if self.is_final {
            self.amplitude(&turns.footprints, &n_patches, &round)?
        } else {
            1.0
        };
        self.account(&turns, &n_patches, round, amplitude)
    }

    /// By what factor the ground beside gaps differs from what its configured σ expects; 1 where too
    /// little is known to tell, and where variances are too expensive.
    fn amplitude(
        &self,
        turns: &[Arc<Footprint>],
        n_patches: &[u32],
        full: &Round,
    ) -> Result<f64, FieldError> {
        let (setup, newest) = (&self.setup, &full.newest);
        let Some(full_var_m2) = &full.var_m2 else { return Ok(1.0) };
        let counts = setup.counts();
        let at = setup.linearization(n_patches, full.before.as_ref());
        let mut z = Vec::new();
        for layout in 0..left_out::N_LAYOUTS {
            let left_out = LeftOut::new(&setup.lattice, &newest.is_known, &counts, layout);
            if left_out.middles.len() < left_out::LEAST_SQUARES {
                continue;
            }
            let data = self.gather(turns, &at, Some(&left_out.contains));
            let without = self.solution(&full.prior, &data.info, &full.hidden, Some(newest))?;
            let Some(var_m2) = self.var_m2(&without) else { return Ok(1.0) };
            z.extend(left_out.middles.iter().map(|&node| {
                let off_m = newest.heights_m[node] - without.height_m()[node];
                off_m / (var_m2[node] - full_var_m2[node]).max(1e-12).sqrt()
            }));
        }
        Ok(left_out::amplitude(&z))
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
        let data = self.gather(turns, &at, None);
        let is_known: Vec<bool> = (0..setup.lattice.n_nodes())
            .map(|node| data.info.n_hits(node) >= KNOWN_FROM_PATCHES)
            .collect();
        let is_hidden = setup.lattice.far_from(&is_known);
        let counts = setup.counts();
        let ceilings = if self.affords_var() {
            let ceiling = self.ceiling_with_silence(turns, &at);
            ceiling.over_hidden(&setup.lattice, &is_hidden, &counts)
        } else {
            vec![None; setup.lattice.n_nodes()]
        };
        let ceiling = |node: usize| {
            ceilings[node].map(|over| (over.height_m, at.ceiling_softness_m(over.steps)))
        };
        // In flight the newest conditions are good enough, and are renewed for the next solve.
        let n_sweeps = if self.is_final { FINAL_SWEEPS } else { 1 };
        let mut hidden = before.map_or_else(HiddenGround::default, |before| {
            before.hidden.among(|node| ceiling(node).is_some())
        });
        let prior = self.prior(before, &counts);
        let mut sweep = 1;
        loop {
            let solution = self.solution(&prior, &data.info, &hidden, before)?;
            let var_m2 = self.var_m2(&solution);
            let (next, step) = match &var_m2 {
                Some(var_m2) => hidden.renewed(solution.height_m(), var_m2, ceiling),
                None => (hidden.clone(), 0.0),
            };
            if sweep == n_sweeps || step < SETTLED_SIGMAS {
                let scatter_m = data.residuals.scatter_m().or(before.and_then(|b| b.scatter_m));
                let newest = NewestField {
                    heights_m: solution.height_m().to_vec(),
                    var_m2: var_m2
                        .clone()
                        .unwrap_or_else(|| setup.var_beside_m2(&prior, &is_known)),
                    is_known,
                    scatter_m,
                    hidden: next,
                    adjoints_m2: before.map_or_else(Vec::new, |b| b.adjoints_m2.clone()),
                };
                return Ok(Round {
                    prior,
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

    /// The ceilings by all rays, those without an echo included.
    fn ceiling_with_silence(&self, turns: &[Arc<Footprint>], at: &Linearization<'_>) -> RayCeiling {
        let mut ceiling = RayCeiling::clone(&self.ceiling);
        for free in free_rays(turns, at, &self.setup.floor()) {
            ceiling.take_rays(at.lattice, free.turn_idx, &free.from_m, free.to_m);
        }
        ceiling
    }

    /// What is expected of the ground, by what the surface before shows of that which counts.
    fn prior(&self, before: Option<&NewestField>, counts: &[bool]) -> Prior {
        let (setup, prior) = (&self.setup, self.setup.settings.prior());
        let ratio = before.map_or(1.0, |before| {
            let is_shown: Vec<bool> =
                std::iter::zip(&before.is_known, counts).map(|(a, b)| *a && *b).collect();
            relief_ratio(&setup.lattice, &prior, &before.heights_m, &is_shown)
        });
        Prior { sigma_m: ratio * prior.sigma_m, ..prior }
    }

    /// The field given the data and what is known of hidden ground.
    fn solution(
        &self,
        prior: &Prior,
        info: &Information,
        hidden: &HiddenGround,
        before: Option<&NewestField>,
    ) -> Result<Solution, FieldError> {
        let mut info = info.clone();
        hidden.add_to(&mut info);
        let is_large = self.setup.lattice.n_nodes() > Solver::MOST_NODES_DIRECT;
        let solver = if is_large && !self.is_final { Solver::LIVE } else { Solver::Automatic };
        matern_field::solve(
            &self.setup.lattice,
            prior,
            &info,
            solver,
            before.map(|before| before.heights_m.as_slice()),
        )
    }

    /// Adds up what all turns know, but for patches that concern nodes left out.
    fn gather(
        &self,
        turns: &[Arc<Footprint>],
        at: &Linearization<'_>,
        left_out: Option<&[bool]>,
    ) -> Data {
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
                if left_out.is_some_and(|nodes| datum.row.touches(nodes)) {
                    continue;
                }
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
        mut round: Round,
        amplitude: f64,
    ) -> Result<SolvedSurface, FieldError> {
        let setup = &self.setup;
        let at = setup.linearization(n_patches, round.before.as_ref());
        let areas_m2 = setup.areas_m2();
        // After landing the result must not depend on the solves in flight.
        let earlier = if self.is_final { &[][..] } else { &round.newest.adjoints_m2 };
        let adjoint = |(bay, of_bay): (usize, &Vec<f64>)| {
            round.solution.adjoint(of_bay, earlier.get(bay).map(Vec::as_slice))
        };
        let adjoints = areas_m2.iter().enumerate().map(adjoint).collect::<Result<Vec<_>, _>>()?;
        let q_m2: Vec<&[f64]> = adjoints.iter().map(|adjoint| adjoint.q.as_slice()).collect();
        let budgets = data_budgets(&turns.footprints, &at, &q_m2, &setup.settings.calibration);
        let mean_m = setup.lattice.on_cells(&round.newest.heights_m);
        let seen = setup.seen(&round.data.info, &turns.flagged);
        let range_m = setup.settings.range_m;
        let newest = &round.newest;
        let ground = setup.ground(&newest.is_known, &areas_m2[0]);
        let unseen = UnseenGround::new(&setup.lattice, &ground, newest.var_m2.clone());
        let is_hidden = setup.lattice.far_from(&newest.is_known);
        let is_bridged: Vec<bool> =
            std::iter::zip(is_hidden, unseen.is_in_patch()).map(|(a, b)| !(a || b)).collect();
        let surplus_m6: Vec<Vec<f64>> = std::iter::zip(&areas_m2, &q_m2)
            .map(|(areas_m2, q_m2)| unseen.surplus_m6(areas_m2, q_m2))
            .collect();
        let mut summands_m6 = summands(&areas_m2[0], q_m2[0]);
        unseen.spread(&surplus_m6[0], &areas_m2[0], &mut summands_m6);
        let summands_m6 = setup.lattice.on_cells(&summands_m6);
        let of_bays = std::iter::zip(std::iter::zip(&areas_m2, &adjoints), &surplus_m6);
        let solved = std::iter::zip(of_bays, budgets);
        let accounts = std::iter::zip(setup.bays.iter(), solved)
            .map(|(bay, (((areas_m2, adjoint), surplus_m6), mut budget))| {
                let above_floor_m3 = round.solution.functional(areas_m2, adjoint);
                let volume_m3 = above_floor_m3 - bay.base.above_floor_m3();
                let in_gaps_m6 = round.solution.prior_var_at(adjoint, &is_bridged);
                let var_m6 = adjoint.prior_var - (1.0 - amplitude * amplitude) * in_gaps_m6;
                budget.rows.insert(0, BudgetRow { source: BudgetSource::Prior, var_m6 });
                let var_m6 = round.hidden.var_m6(&adjoint.q) + surplus_m6.iter().sum::<f64>();
                budget.rows.push(BudgetRow { source: BudgetSource::HiddenGround, var_m6 });
                if !bay.base.errors.is_empty() {
                    budget.push_shared(BudgetSource::Base, &bay.base.errors);
                }
                bay.account(self.at, (volume_m3, &mean_m), budget, &seen, range_m)
            })
            .collect();
        let var_m2 =
            round.var_m2.unwrap_or_else(|| Setup::own_var_m2(&round.prior, &round.data.info));
        let sigma_m = setup.lattice.on_cells(&var_m2).iter().map(|var| var.sqrt()).collect();
        let grid = *setup.lattice.grid();
        let coverage = seen.coverage(range_m);
        let gaps = gaps_of(&setup.bays, &grid, &coverage, &summands_m6);
        let disturbed_cells = turns.flagged.cells().collect();
        round.newest.adjoints_m2 = adjoints.into_iter().map(|adjoint| adjoint.q).collect();
        let surface = HeightMap { at: self.at, grid, mean_m, sigma_m, disturbed_cells };
        Ok(SolvedSurface {
            accounts,
            surface,
            coverage,
            n_beams_refused: turns.n_beams_left_out + round.data.n_refused,
            disturbed: turns.flagged.areas(&grid),
            gaps,
            newest: Some(Arc::new(round.newest)),
        })
    }
}

/// By node, its summand of the variance of Σ w h, m⁶.
fn summands(w_m2: &[f64], q: &[f64]) -> Vec<f64> {
    std::iter::zip(w_m2, q).map(|(w, q)| w * q).collect()
}

fn gaps_of(
    bays: &Bays,
    grid: &GridGeometry,
    coverage: &[CellCoverage],
    summands_m6: &[f64],
) -> Vec<Gap> {
    let whole = bays.first();
    whole
        .map_or_else(Vec::new, |whole| gaps(grid, &whole.base.cell_areas_m2, coverage, summands_m6))
}

impl SolveField {
    /// Σ aaᵀ/R and Σ a z/R of all turns with the slopes of the newest surface, and how many beams were refused:
    /// what every round of a solve does with the beams, each time with all of them.
    #[must_use]
    pub fn added_up(&self) -> (Information, u64) {
        let turns = self.levels.judge(&self.footprints);
        let n_patches = self.setup.n_patches(&turns.footprints);
        let at = self.setup.linearization(&n_patches, self.newest.as_deref());
        let data = self.gather(&turns.footprints, &at, None);
        (data.info, data.n_refused)
    }

    /// Where the cells are.
    pub(in crate::mapping) fn grid(&self) -> &GridGeometry {
        self.setup.lattice.grid()
    }

    /// The same work for other volumes.
    pub(in crate::mapping) fn over(&self, bays: Bays) -> Self {
        let setup = Arc::new(Setup { bays, ..self.setup.as_ref().clone() });
        Self { setup, ..self.clone() }
    }

    /// Cells, their heights, and which rest on data.
    pub(in crate::mapping) fn known_heights(&self) -> Option<KnownHeights> {
        let newest = self.newest.as_ref()?;
        let lattice = &self.setup.lattice;
        let of_cells = |at_node: &dyn Fn(usize) -> f64| -> Vec<f64> {
            (0..lattice.grid().n_cells()).map(|cell| at_node(lattice.node_of_cell(cell))).collect()
        };
        let at = self.setup.linearization(&[], Some(newest));
        let ceiling = self.ceiling_with_silence(&self.footprints, &at);
        let is_known = |cell| newest.is_known[lattice.node_of_cell(cell)];
        let is_known = (0..lattice.grid().n_cells()).map(is_known).collect();
        let heights_m = lattice.on_cells(&newest.heights_m);
        Some(KnownHeights {
            sigma_m: of_cells(&|node| newest.var_m2[node].max(0.0).sqrt()),
            floor_m: self.setup.floor_m(),
            ceiling_m: of_cells(&|node| ceiling.at_node_m(lattice, node).unwrap_or(f64::INFINITY)),
            ..KnownHeights::new(*lattice.grid(), heights_m, is_known, self.setup.settings.sigma_m)
        })
    }

    /// Patch by patch, the ground that the newest surface leaves unseen, but for cells that were hit since;
    /// `None` before there is a surface.
    pub(in crate::mapping) fn open_patches(&self, is_hit: &[bool]) -> Option<Vec<Vec<OpenNode>>> {
        let newest = self.newest.as_ref()?;
        let lattice = &self.setup.lattice;
        let mut is_known = newest.is_known.clone();
        for (cell, _) in is_hit.iter().enumerate().filter(|(_, is_hit)| **is_hit) {
            is_known[lattice.node_of_cell(cell)] = true;
        }
        let areas_m2 = self.setup.areas_m2().swap_remove(0);
        let ground = self.setup.ground(&is_known, &areas_m2);
        let open_node = |node: &usize| {
            let sigma_m = newest.var_m2[*node].max(0.0).sqrt();
            let area_m2 = areas_m2[*node];
            OpenNode { place_m: lattice.place_m(*node), area_m2, error_m3: area_m2 * sigma_m }
        };
        let patches = unseen_patch::patches(lattice, &ground);
        Some(patches.iter().map(|patch| patch.iter().map(open_node).collect()).collect())
    }

    /// Shows every patch that the newest surface believes, of the turns up to an instant, with its
    /// information, 1/m².
    pub(in crate::mapping) fn for_each_patch(
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

    /// Variance of the height at every node, m²: exact after landing and on maps that are solved by a
    /// factor; none in flight over larger ones, where it takes gigabytes, and where the factor does
    /// not fit into memory.
    fn var_m2(&self, solution: &Solution) -> Option<Vec<f64>> {
        self.affords_var().then(|| solution.marginal_var_m2().ok()).flatten()
    }

    fn affords_var(&self) -> bool {
        let n_nodes = self.setup.lattice.n_nodes();
        let is_direct = n_nodes <= Solver::MOST_NODES_DIRECT;
        is_direct || self.is_final && n_nodes <= MOST_NODES_FINAL
    }
}
