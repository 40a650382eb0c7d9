//! The paper's height grid: every cell a Gaussian height, every hit a Kalman update of the cells
//! around it.
//!
//! ```text
//! r = Σ^m_(z) + σ_t² (e^{s/l} − 1),   K = σ²/(σ² + r)
//! μ ← (1 − K) μ + K z,   σ ← (1 − K) σ  (printed)   or   σ² ← (1 − K) σ²  (Kalman)
//! ```
//! - `s`: horizontal distance from the hit to the cell's centre, m; cells with s ≤ γ l take part
//! - `l`: length scale, m; `σ_t`: slope of the terrain, whose square the paper reads as m² here
//!
//! Source: Balula et al. 2023, section 4. Cells are treated as independent and one hit updates
//! many of them, so σ is too small; the volume's honest uncertainty comes from elsewhere.

use super::KnownHeights;
use super::projection::{Hit, height_var_as_printed_m2};
use crate::messages::GridGeometry;

/// Which law shrinks a cell's uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VarianceUpdate {
    /// σ ← (1 − K) σ, as the paper prints it.
    Printed,
    /// σ² ← (1 − K) σ², the Kalman filter's own.
    #[default]
    Kalman,
}

/// How hits spread over the cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Length scale l, m.
    pub length_scale_m: f64,
    /// Reach γ in length scales.
    pub reach: f64,
    /// Standard deviation `σ_t` of the terrain's slope, no unit.
    pub slope_sigma: f64,
    /// Height that is expected before anything is seen, m.
    pub prior_height_m: f64,
    /// Standard deviation of that expectation, m.
    pub prior_sigma_m: f64,
    /// Which law shrinks σ.
    pub variance_update: VarianceUpdate,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            length_scale_m: 0.5,
            reach: 1.5,
            slope_sigma: 0.6,
            prior_height_m: 1.5,
            prior_sigma_m: 1.5,
            variance_update: VarianceUpdate::Kalman,
        }
    }
}

/// Mean and variance of the height in every cell.
#[derive(Debug, Clone, PartialEq)]
pub struct KalmanGrid {
    geometry: GridGeometry,
    settings: Settings,
    mean_m: Vec<f64>,
    var_m2: Vec<f64>,
    n_hits: Vec<u32>,
    /// `σ_t²` (e^{s/l} − 1) at equal steps of s²: the exponential of every pair would dominate.
    spread_var_m2: Vec<f64>,
}

const SPREAD_STEPS: usize = 1024;

impl KalmanGrid {
    /// A grid at its prior.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "the table is short")]
    pub fn new(geometry: GridGeometry, settings: Settings) -> Self {
        let n = geometry.n_cells();
        let reach_m = settings.reach * settings.length_scale_m;
        let spread = |step: usize| {
            let s_m = reach_m * (step as f64 / SPREAD_STEPS as f64).sqrt();
            settings.slope_sigma.powi(2) * (s_m / settings.length_scale_m).exp_m1()
        };
        Self {
            geometry,
            settings,
            mean_m: vec![settings.prior_height_m; n],
            var_m2: vec![settings.prior_sigma_m.powi(2); n],
            n_hits: vec![0; n],
            spread_var_m2: (0..=SPREAD_STEPS).map(spread).collect(),
        }
    }

    /// Updates all cells within reach of the hit whose centre (x, y) `is_open` to it.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "cell numbers are clamped to the grid before the cast; s² to the table"
    )]
    pub fn insert(&mut self, hit: &Hit, is_open: impl Fn((f64, f64)) -> bool) {
        let g = self.geometry;
        let (x, y, z) = (hit.place.coords.x, hit.place.coords.y, hit.place.coords.z);
        if let Some(cell) = g.cell_at(x, y) {
            self.n_hits[cell] = self.n_hits[cell].saturating_add(1);
        }
        let height_var_m2 = height_var_as_printed_m2(&hit.cov_m2, self.settings.slope_sigma);
        let reach_cells = self.settings.reach * self.settings.length_scale_m / g.cell_m;
        let steps_per_m2 = SPREAD_STEPS as f64 / (reach_cells * g.cell_m).powi(2);
        // In cells, with cell centres at whole numbers.
        let (cx, cy) = ((x - g.x_min_m) / g.cell_m - 0.5, (y - g.y_min_m) / g.cell_m - 0.5);
        let first = |c: f64| (c - reach_cells).ceil().max(0.0) as usize;
        let last =
            |c: f64, n: usize| ((c + reach_cells).floor() + 1.0).clamp(0.0, n as f64) as usize;
        for row in first(cy)..last(cy, g.n_rows) {
            let dy_m = (row as f64 - cy) * g.cell_m;
            for col in first(cx)..last(cx, g.n_cols) {
                let dx_m = (col as f64 - cx) * g.cell_m;
                let step = ((dx_m * dx_m + dy_m * dy_m) * steps_per_m2).round() as usize;
                if let Some(spread_var_m2) = self.spread_var_m2.get(step)
                    && is_open((x + dx_m, y + dy_m))
                {
                    self.update(g.index(col, row), z, height_var_m2 + spread_var_m2);
                }
            }
        }
    }

    fn update(&mut self, cell: usize, height_m: f64, noise_var_m2: f64) {
        let var_m2 = self.var_m2[cell];
        let gain = var_m2 / (var_m2 + noise_var_m2);
        self.mean_m[cell] += gain * (height_m - self.mean_m[cell]);
        let shrink = 1.0 - gain;
        self.var_m2[cell] = match self.settings.variance_update {
            VarianceUpdate::Printed => var_m2 * shrink * shrink,
            VarianceUpdate::Kalman => var_m2 * shrink,
        };
    }

    /// Where the cells are.
    #[must_use]
    pub const fn geometry(&self) -> &GridGeometry {
        &self.geometry
    }

    /// Mean height of each cell, m.
    #[must_use]
    pub fn mean_m(&self) -> &[f64] {
        &self.mean_m
    }

    /// The mean heights that the same hits would have left on another prior height, m.
    ///
    /// ```text
    /// μ' = μ + w (h0' − h0),   w = Π (1 − K) = σ²/σ_0² (Kalman) or σ/σ_0 (printed)
    /// ```
    /// Every update is linear in the mean, so this is exact.
    #[must_use]
    pub fn mean_on_prior_m(&self, prior_height_m: f64) -> Vec<f64> {
        let shift_m = prior_height_m - self.settings.prior_height_m;
        let prior_var_m2 = self.settings.prior_sigma_m.powi(2);
        std::iter::zip(&self.mean_m, &self.var_m2)
            .map(|(mean_m, var_m2)| {
                let var_share = var_m2 / prior_var_m2;
                let weight = match self.settings.variance_update {
                    VarianceUpdate::Printed => var_share.sqrt(),
                    VarianceUpdate::Kalman => var_share,
                };
                mean_m + weight * shift_m
            })
            .collect()
    }

    /// The heights of the cells; those that were hit are known.
    #[must_use]
    pub fn known_heights(&self) -> KnownHeights {
        let is_known: Vec<bool> = self.n_hits.iter().map(|n| *n > 0).collect();
        let sigma_m = self.settings.prior_sigma_m;
        KnownHeights::new(self.geometry, self.mean_m.clone(), is_known, sigma_m)
    }

    /// Variance of each cell, m².
    #[must_use]
    pub fn var_m2(&self) -> &[f64] {
        &self.var_m2
    }

    /// Number of hits inside each cell.
    #[must_use]
    pub fn n_hits(&self) -> &[u32] {
        &self.n_hits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point;
    use nalgebra::Matrix3;

    fn geometry() -> GridGeometry {
        GridGeometry { x_min_m: -1.0, y_min_m: 2.0, cell_m: 0.25, n_cols: 12, n_rows: 9 }
    }

    fn settings(variance_update: VarianceUpdate) -> Settings {
        Settings {
            length_scale_m: 0.4,
            reach: 1.5,
            slope_sigma: 0.6,
            prior_height_m: 0.0,
            prior_sigma_m: 1.0,
            variance_update,
        }
    }

    fn level_hit(x: f64, y: f64, z: f64, var_m2: f64) -> Hit {
        let mut cov_m2 = Matrix3::zeros();
        cov_m2[(2, 2)] = var_m2;
        Hit { place: Point::new(x, y, z), cov_m2 }
    }

    #[test]
    fn ten_equal_updates_meet_the_published_comparison() {
        // Prior variance 1, noise 0.04, ten hits on a cell's centre: the Kalman law gives
        // 1/√(1 + 10/0.04) = 0.063; the printed law 0.030.
        let sigma_after = |law| {
            let mut grid = KalmanGrid::new(geometry(), settings(law));
            let (x, y) = geometry().centre_m(40);
            for _ in 0..10 {
                grid.insert(&level_hit(x, y, 1.0, 0.04), |_| true);
            }
            grid.var_m2()[40].sqrt()
        };
        assert!((sigma_after(VarianceUpdate::Kalman) - 0.0631).abs() < 5e-4);
        assert!((sigma_after(VarianceUpdate::Printed) - 0.030).abs() < 5e-4);
    }

    #[test]
    fn a_hit_updates_exactly_the_cells_within_reach() {
        let mut grid = KalmanGrid::new(geometry(), settings(VarianceUpdate::Kalman));
        let (x, y) = (0.31, 2.07);
        grid.insert(&level_hit(x, y, 2.0, 0.01), |_| true);
        let mut n_updated = 0;
        for cell in 0..geometry().n_cells() {
            let (cell_x, cell_y) = geometry().centre_m(cell);
            let s = (cell_x - x).hypot(cell_y - y);
            // By the formula, independent of the table; one table step is 0.3 % of s²_max.
            if s <= 0.599 {
                let r = 0.01 + 0.36 * ((s / 0.4).exp() - 1.0);
                let gain = 1.0 / (1.0 + r);
                assert!((grid.mean_m()[cell] - 2.0 * gain).abs() < 2e-3, "cell {cell}");
                n_updated += 1;
            } else if s > 0.601 {
                assert!(grid.mean_m()[cell].abs() < 1e-15, "cell {cell} is out of reach");
            }
        }
        assert!(n_updated > 8);
    }

    #[test]
    fn another_prior_height_gives_what_it_would_have_given_from_the_start() {
        for law in [VarianceUpdate::Printed, VarianceUpdate::Kalman] {
            let run = |prior_height_m| {
                let mut grid =
                    KalmanGrid::new(geometry(), Settings { prior_height_m, ..settings(law) });
                for k in 0..5 {
                    let k = f64::from(k);
                    grid.insert(&level_hit(0.3 * k, 2.5 + 0.2 * k, 1.0 + k, 0.05), |_| true);
                }
                grid
            };
            let (low, high) = (run(0.0), run(2.0));
            for (a, b) in low.mean_on_prior_m(2.0).iter().zip(high.mean_m()) {
                assert!((a - b).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn hits_at_the_border_stay_inside_the_grid() {
        let mut grid = KalmanGrid::new(geometry(), settings(VarianceUpdate::Kalman));
        for (x, y) in [(-1.0, 2.0), (2.0, 4.25), (-50.0, 3.0), (0.0, 99.0)] {
            grid.insert(&level_hit(x, y, 1.0, 0.01), |_| true);
        }
        assert!(grid.mean_m().iter().all(|m| m.is_finite()));
    }
}
