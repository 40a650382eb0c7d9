//! The paper's map of a flight: a height grid, and a sparse Gaussian process over it.

use super::bay::BayOnGrid;
use super::disturbance::Flagged;
use super::gaps::gaps;
use super::kalman_grid::{self, KalmanGrid};
use super::projection::Hit;
use super::region::Region;
use super::shares::SeenCells;
use super::sparse_gp::{self, GpError, Posterior};
use super::surface_work::{KnownHeights, SolvedSurface};
use crate::messages::{
    BudgetRow, BudgetSource, GridGeometry, HeightMap, VolumeAccount, VolumeBudget,
};
use crate::time::{Mono, Stamp};
use std::sync::Arc;

/// How the variances of the cells become the variance of the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VolumeVariance {
    /// A² Σ Σ*_ij: the marginal variances added, as printed.
    Printed,
    /// 1ᵀ Σ* 1: the variance of the sum.
    #[default]
    Full,
}

/// What the grid must know before a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// How hits update the cells.
    pub kalman_grid: kalman_grid::Settings,
    /// The prior of the Gaussian process over the cells.
    pub gp: sparse_gp::Settings,
    /// The prior height is the mean of the measured cells instead of the configured one, so that
    /// ground that nothing saw counts as average ground.
    pub estimates_prior_height: bool,
    /// How σ^V is added up.
    pub volume_variance: VolumeVariance,
}

impl Default for Settings {
    fn default() -> Self {
        let kalman_grid = kalman_grid::Settings::default();
        Self {
            kalman_grid,
            gp: sparse_gp::Settings {
                smoothness_nu: 1.5,
                length_scale_m: kalman_grid.length_scale_m,
                reach: kalman_grid.reach,
                sigma_m: kalman_grid.prior_sigma_m,
                mean_m: kalman_grid.prior_height_m,
                cut: sparse_gp::Cut::Taper,
            },
            estimates_prior_height: true,
            volume_variance: VolumeVariance::Full,
        }
    }
}

/// What is measured: the whole region, then its bays if it has more than one.
pub type Bays = Arc<Vec<BayOnGrid>>;

/// The growing grid of one flight.
#[derive(Debug, Clone)]
pub struct GridMap {
    settings: Settings,
    grid: KalmanGrid,
    bays: Bays,
    /// Cells whose hits may reach over an exclusion.
    is_near_exclusion: Vec<bool>,
}

impl GridMap {
    /// A grid at its prior.
    #[must_use]
    pub fn new(settings: Settings, region: &Region, geometry: GridGeometry, bays: Bays) -> Self {
        let kalman = settings.kalman_grid;
        // Half a cell's diagonal: the hit may be anywhere in its cell.
        let reach_m = kalman.reach * kalman.length_scale_m + geometry.cell_m;
        let is_near_exclusion = region.cells_near_exclusions(&geometry, reach_m);
        Self { settings, grid: KalmanGrid::new(geometry, kalman), bays, is_near_exclusion }
    }

    /// Begins a new map.
    pub fn restart(&mut self) {
        self.grid = KalmanGrid::new(*self.grid.geometry(), self.settings.kalman_grid);
    }

    /// Updates the cells around a hit.
    pub fn insert(&mut self, hit: &Hit, region: &Region) {
        let place = (hit.place.coords.x, hit.place.coords.y);
        let cell = self.grid.geometry().cell_at(place.0, place.1);
        // Looking for walls in between costs more than the update, and most cells have none near.
        if cell.is_some_and(|cell| self.is_near_exclusion[cell]) {
            self.grid.insert(hit, |centre| !region.separates(place, centre));
        } else {
            self.grid.insert(hit, |_| true);
        }
    }

    /// The cells.
    #[must_use]
    pub const fn grid(&self) -> &KalmanGrid {
        &self.grid
    }

    /// The volumes of the cells as they are: what is left when the surface cannot be solved.
    ///
    /// What neighbours have in common is not known without a solve. So their variances are added only where
    /// that is asked for, as printed; else every cell counts as off by the same number of its σ, and no
    /// cells can do worse together.
    #[must_use]
    pub fn cell_volumes(&self, at: Stamp<Mono>) -> Vec<VolumeAccount> {
        let seen = self.seen();
        let account = |bay: &BayOnGrid| {
            let areas_m2 = &bay.base.cell_areas_m2;
            let by_cell = std::iter::zip(areas_m2, self.grid.var_m2());
            let law = self.settings.volume_variance;
            let var_m6 = match law {
                VolumeVariance::Printed => by_cell.map(|(area, var)| area * area * var).sum(),
                VolumeVariance::Full => {
                    by_cell.map(|(area, var)| area * var.sqrt()).sum::<f64>().powi(2)
                }
            };
            let sum = (var_m6, law);
            let range_m = self.settings.gp.length_scale_m;
            account(at, bay, self.grid.mean_m(), sum, &seen, range_m)
        };
        self.bays.iter().map(account).collect()
    }

    fn seen(&self) -> SeenCells {
        let is_hit: Vec<bool> = self.grid.n_hits().iter().map(|n| *n > 0).collect();
        SeenCells::new(self.grid.geometry(), &is_hit, Flagged::default())
    }

    /// h0: configured, or the mean height of the cells that a beam has hit.
    fn prior_height_m(&self) -> f64 {
        let configured_m = self.settings.kalman_grid.prior_height_m;
        let Some(hall) = self.bays.first().filter(|_| self.settings.estimates_prior_height) else {
            return configured_m;
        };
        let areas_m2 = hall.base.cell_areas_m2.iter().zip(self.grid.n_hits());
        let (area_m2, volume_m3) = std::iter::zip(areas_m2, self.grid.mean_m())
            .filter(|((_, n_hits), _)| **n_hits > 0)
            .fold((0.0, 0.0), |(area, volume), ((a, _), mean)| (area + a, volume + a * mean));
        if area_m2 > 0.0 { volume_m3 / area_m2 } else { configured_m }
    }

    /// Everything a solve of the surface needs, as it is now.
    #[must_use]
    pub fn snapshot(&self, at: Stamp<Mono>, wants_marginals: bool) -> SolveGrid {
        let prior_height_m = self.prior_height_m();
        SolveGrid {
            at,
            geometry: *self.grid.geometry(),
            cell_mean_m: self.grid.mean_on_prior_m(prior_height_m),
            cell_var_m2: self.grid.var_m2().to_vec(),
            seen: self.seen(),
            bays: Arc::clone(&self.bays),
            gp: sparse_gp::Settings { mean_m: prior_height_m, ..self.settings.gp },
            volume_variance: self.settings.volume_variance,
            wants_marginals,
        }
    }
}

/// One volume of the grid. The paper knows one source, the cells' variances; where they are not added as
/// printed, the base under the material counts too.
fn account(
    at: Stamp<Mono>,
    bay: &BayOnGrid,
    mean_m: &[f64],
    (var_m6, law): (f64, VolumeVariance),
    seen: &SeenCells,
    range_m: f64,
) -> VolumeAccount {
    let rows = vec![BudgetRow { source: BudgetSource::BeamNoise, var_m6 }];
    let mut budget = VolumeBudget { rows, shared: Vec::new() };
    if law == VolumeVariance::Full && !bay.base.errors.is_empty() {
        budget.push_shared(BudgetSource::Base, &bay.base.errors);
    }
    bay.account(at, (bay.base.volume_m3(mean_m), mean_m), budget, seen, range_m)
}

/// The work of turning cells into a surface and its volumes; a pure function of its fields.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveGrid {
    at: Stamp<Mono>,
    geometry: GridGeometry,
    cell_mean_m: Vec<f64>,
    cell_var_m2: Vec<f64>,
    seen: SeenCells,
    bays: Bays,
    gp: sparse_gp::Settings,
    volume_variance: VolumeVariance,
    wants_marginals: bool,
}

impl SolveGrid {
    /// Variance of each cell, m².
    pub(super) fn cell_var_m2(&self) -> &[f64] {
        &self.cell_var_m2
    }

    /// Where the cells are.
    pub(super) const fn geometry(&self) -> &GridGeometry {
        &self.geometry
    }

    /// The same work for other volumes.
    pub(super) fn over(&self, bays: Bays) -> Self {
        Self { bays, ..self.clone() }
    }

    /// Cells, their heights, and which were hit.
    pub(super) fn known_heights(&self) -> KnownHeights {
        let is_known =
            self.cell_var_m2.iter().map(|var| *var < 0.25 * self.gp.sigma_m.powi(2)).collect();
        KnownHeights::new(self.geometry, self.cell_mean_m.clone(), is_known, self.gp.sigma_m)
    }

    /// σ of a cell before any hit, m.
    pub(super) const fn prior_sigma_m(&self) -> f64 {
        self.gp.sigma_m
    }

    /// Solves.
    ///
    /// # Errors
    /// [`GpError`] from the Gaussian process.
    pub fn run(&self) -> Result<SolvedSurface, GpError> {
        let posterior =
            Posterior::new(&self.geometry, &self.cell_mean_m, &self.cell_var_m2, &self.gp)?;
        let needs_marginals =
            self.wants_marginals || self.volume_variance == VolumeVariance::Printed;
        let var_m2 =
            if needs_marginals { posterior.marginal_var_m2() } else { self.cell_var_m2.clone() };
        let account = |bay: &BayOnGrid| {
            let areas_m2 = &bay.base.cell_areas_m2;
            let var_m6 = match self.volume_variance {
                VolumeVariance::Full => posterior.sum_var(areas_m2),
                VolumeVariance::Printed => {
                    std::iter::zip(areas_m2, &var_m2).map(|(area, var)| area * area * var).sum()
                }
            };
            let (mean_m, sum) = (posterior.mean_m(), (var_m6, self.volume_variance));
            account(self.at, bay, mean_m, sum, &self.seen, self.gp.length_scale_m)
        };
        let coverage = self.seen.coverage(self.gp.length_scale_m);
        let areas_m2 = self.bays.first().map_or(&[][..], |whole| &whole.base.cell_areas_m2);
        let own_m6: Vec<f64> =
            std::iter::zip(areas_m2, &var_m2).map(|(area, var)| area * area * var).collect();
        let gaps = gaps(&self.geometry, areas_m2, &coverage, &own_m6);
        let surface = HeightMap {
            at: self.at,
            grid: self.geometry,
            mean_m: posterior.mean_m().to_vec(),
            sigma_m: var_m2.iter().map(|var| var.sqrt()).collect(),
            disturbed_cells: Vec::new(),
        };
        let accounts = self.bays.iter().map(account).collect();
        Ok(SolvedSurface {
            accounts,
            surface,
            coverage,
            n_beams_refused: 0,
            disturbed: Vec::new(),
            gaps,
            newest: None,
        })
    }
}
