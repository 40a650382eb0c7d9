//! An earlier survey as a base.

use super::polygon::Place;
use crate::messages::{GridGeometry, HeightMap};

/// The heights of an earlier survey, between cell centres by bilinear interpolation.
///
/// Beyond the outermost centres the nearest value counts. Cells without a height are allowed
/// where no bay needs them.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyedBase {
    grid: GridGeometry,
    /// NaN where there is none.
    height_m: Vec<f64>,
    /// Of each cell alone.
    cell_sigma_m: Vec<f64>,
    sigma_m: f64,
}

/// Standard deviation of an error common to all cells, m, with which the volume over a whole base has the
/// variance `var_m6`, m⁶:
///
/// ```text
/// σ² = (σ_V² − Σ (w_c σ_c)²) / (Σ w_c)²
/// ```
/// - `w_c`: area of cell c that counts, m²; `σ_c`: its own standard deviation, m
///
/// The errors of neighbouring cells are alike, so their independent sum is too small; what it leaves of
/// the survey's own variance is laid on all cells together. 0 where it leaves nothing.
/// Checked: `the_volume_of_a_base_has_the_variance_of_its_survey`.
#[must_use]
pub fn common_sigma_m(var_m6: f64, cell_areas_m2: &[f64], cell_sigma_m: &[f64]) -> f64 {
    let area_m2: f64 = cell_areas_m2.iter().sum();
    let counting = std::iter::zip(cell_areas_m2, cell_sigma_m).filter(|(area, _)| **area > 0.0);
    let own_m6: f64 = counting.map(|(area, sigma)| (area * sigma).powi(2)).sum();
    if area_m2 > 0.0 { (var_m6 - own_m6).max(0.0).sqrt() / area_m2 } else { 0.0 }
}

/// Why numbers make no base.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SurveyedBaseError {
    /// The number of values is not the number of cells.
    #[error("{got} values for a grid of {expected} cells")]
    WrongCount {
        /// Number of values.
        got: usize,
        /// Number of cells.
        expected: usize,
    },
    /// A standard deviation is negative, infinite or no number.
    #[error("the standard deviation of cell {index} is {sigma_m} m")]
    BadSigma {
        /// Which cell.
        index: usize,
        /// Its standard deviation, m.
        sigma_m: f64,
    },
}

impl SurveyedBase {
    /// A base from heights over the hall floor, their own standard deviations, and that of an
    /// error common to all of them. A height that is not finite is none.
    ///
    /// # Errors
    /// Counts that do not fit, or a standard deviation that is none.
    pub fn new(
        grid: GridGeometry,
        height_m: Vec<f64>,
        cell_sigma_m: Vec<f64>,
        sigma_m: f64,
    ) -> Result<Self, SurveyedBaseError> {
        for values in [&height_m, &cell_sigma_m] {
            if values.len() != grid.n_cells() {
                let (got, expected) = (values.len(), grid.n_cells());
                return Err(SurveyedBaseError::WrongCount { got, expected });
            }
        }
        let has_height = |index: usize| height_m[index].is_finite();
        let is_bad = |sigma: f64| !(sigma.is_finite() && sigma >= 0.0);
        let bad = (0..grid.n_cells()).find(|&i| has_height(i) && is_bad(cell_sigma_m[i]));
        if let Some(index) = bad {
            return Err(SurveyedBaseError::BadSigma { index, sigma_m: cell_sigma_m[index] });
        }
        Ok(Self { grid, height_m, cell_sigma_m, sigma_m })
    }

    /// The surface of a survey as a base, with the standard deviation of its common error, m.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn from_map(map: &HeightMap, sigma_m: f64) -> Result<Self, SurveyedBaseError> {
        Self::new(map.grid, map.mean_m.clone(), map.sigma_m.clone(), sigma_m)
    }

    /// Standard deviation of the error that all heights share, m.
    #[must_use]
    pub const fn sigma_m(&self) -> f64 {
        self.sigma_m
    }

    /// Height at a place, m; NaN where the survey has none.
    #[must_use]
    pub fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.nodes(x_m, y_m).map(|(cell, weight)| weight * self.height_m[cell]).sum()
    }

    /// True if the survey reaches to a place: not farther out than half a cell, and no gap.
    #[must_use]
    pub fn has_height(&self, x_m: f64, y_m: f64) -> bool {
        // A border that rounding moved is still the border.
        let slack_m = 1e-6 * self.grid.cell_m;
        let (x_max_m, y_max_m) = self.grid.max_corner_m();
        (self.grid.x_min_m - slack_m..=x_max_m + slack_m).contains(&x_m)
            && (self.grid.y_min_m - slack_m..=y_max_m + slack_m).contains(&y_m)
            && self.height_m(x_m, y_m).is_finite()
    }

    /// Variance of the height at a place without the common error, m².
    #[must_use]
    pub fn own_var_m2(&self, x_m: f64, y_m: f64) -> f64 {
        self.nodes(x_m, y_m).map(|(cell, w)| (w * self.cell_sigma_m[cell]).powi(2)).sum()
    }

    /// Standard deviation of the volume by the cells' own errors, as if they were independent, m³;
    /// [`common_sigma_m`] makes up for it.
    pub(super) fn cells_sigma_m3(&self, areas: &[(Place, f64)]) -> f64 {
        let mut area_of_node = vec![0.0; self.grid.n_cells()];
        for ((x_m, y_m), area) in areas {
            for (node, weight) in self.nodes(*x_m, *y_m) {
                area_of_node[node] += weight * area;
            }
        }
        std::iter::zip(area_of_node, &self.cell_sigma_m)
            .filter(|(area, _)| *area != 0.0)
            .map(|(area, sigma)| (area * sigma).powi(2))
            .sum::<f64>()
            .sqrt()
    }

    /// The cells around a place with their bilinear weights, none of them zero.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "clamped to the grid before the cast"
    )]
    fn nodes(&self, x_m: f64, y_m: f64) -> impl Iterator<Item = (usize, f64)> {
        let grid = self.grid;
        // In cells, with centres at whole numbers; rounding must not reach for a neighbour.
        let along = |value: f64, first: f64, n: usize| {
            let at = ((value - first) / grid.cell_m - 0.5).clamp(0.0, (n - 1) as f64);
            let at = if (at - at.round()).abs() < 1e-9 { at.round() } else { at };
            (at.floor() as usize, at.fract())
        };
        let (col, right) = along(x_m, grid.x_min_m, grid.n_cols);
        let (row, up) = along(y_m, grid.y_min_m, grid.n_rows);
        let corners = [
            (0, 0, (1.0 - right) * (1.0 - up)),
            (1, 0, right * (1.0 - up)),
            (0, 1, (1.0 - right) * up),
            (1, 1, right * up),
        ];
        corners
            .into_iter()
            .filter(|(_, _, weight)| *weight != 0.0)
            .map(move |(i, j, weight)| (grid.index(col + i, row + j), weight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: GridGeometry =
        GridGeometry { x_min_m: -1.0, y_min_m: 2.0, cell_m: 0.5, n_cols: 5, n_rows: 4 };

    fn base(of: impl Fn(f64, f64) -> f64) -> SurveyedBase {
        let heights = (0..GRID.n_cells()).map(|i| of(GRID.centre_m(i).0, GRID.centre_m(i).1));
        let sigmas = (0_u8..20).map(|i| 0.01 + 0.001 * f64::from(i)).collect();
        SurveyedBase::new(GRID, heights.collect(), sigmas, 0.02).expect("a base")
    }

    #[test]
    fn cells_keep_their_values_and_a_bilinear_surface_its_form() {
        let of = |x: f64, y: f64| 0.3 + 0.2 * x - 0.7 * y + 0.11 * x * y;
        let base = base(of);
        for index in 0..GRID.n_cells() {
            let (x, y) = GRID.centre_m(index);
            assert!((base.height_m(x, y) - of(x, y)).abs() < 1e-15);
        }
        for (x, y) in [(-0.4, 2.6), (0.93, 3.71), (1.2, 2.3)] {
            assert!((base.height_m(x, y) - of(x, y)).abs() < 1e-12);
        }
        // The nearest centre counts beyond the outermost.
        assert!((base.height_m(-9.0, 2.75) - of(-0.75, 2.75)).abs() < 1e-12);
    }

    #[test]
    fn a_gap_is_known_and_harms_only_its_neighbours() {
        let base = base(|x, y| if x > 1.0 && y > 3.0 { f64::NAN } else { 1.0 });
        assert!(base.has_height(1.25, 2.75), "the node below the gap");
        assert!(!base.has_height(1.25, 3.0), "half way into the gap");
        assert!(!base.has_height(1.6, 2.5) && base.has_height(1.5, 2.5), "the outer border");
    }

    #[test]
    fn one_whole_cell_has_its_own_sigma() {
        let base = base(|_, _| 0.0);
        // Cell 7 has σ = 0.017 m; half its area there and half on cell 8 with 0.018.
        let areas = [(GRID.centre_m(7), 0.125), (GRID.centre_m(8), 0.125)];
        let expected = 0.125 * 0.017_f64.hypot(0.018);
        assert!((base.cells_sigma_m3(&areas) - expected).abs() < 1e-15);
        let (x, y) = GRID.centre_m(7);
        assert!(
            (base.own_var_m2(x + 0.25, y) - (0.017_f64.powi(2) + 0.018_f64.powi(2)) / 4.0).abs()
                < 1e-12
        );
    }

    #[test]
    fn the_volume_of_a_base_has_the_variance_of_its_survey() {
        // A field whose errors fall off with the distance: cov(i, j) = σ_i σ_j e^(−|i − j|/0.6 m), and a lift.
        let (n, lift_m) = (GRID.n_cells(), 0.004);
        let sigmas: Vec<f64> = (0_u8..20).map(|i| 0.01 + 0.001 * f64::from(i)).collect();
        let areas: Vec<f64> = (0_u8..20).map(|i| 0.25 - 0.005 * f64::from(i % 3)).collect();
        let cov = nalgebra::DMatrix::from_fn(n, n, |i, j| {
            let (a, b) = (GRID.centre_m(i), GRID.centre_m(j));
            let distance_m = (a.0 - b.0).hypot(a.1 - b.1);
            sigmas[i] * sigmas[j] * (-distance_m / 0.6).exp() + lift_m * lift_m
        });
        let weights = nalgebra::DVector::from_vec(areas.clone());
        let var_m6 = weights.dot(&(&cov * &weights));
        let own: Vec<f64> = (0..n).map(|i| cov[(i, i)].sqrt()).collect();
        let common_m = common_sigma_m(var_m6, &areas, &own);
        let base = SurveyedBase::new(GRID, vec![0.0; n], own.clone(), common_m).expect("a base");
        let places: Vec<(Place, f64)> = (0..n).map(|i| (GRID.centre_m(i), areas[i])).collect();
        let errors = crate::mapping::base::BaseSurface::Survey(base).errors(&places);
        let claimed_m6: f64 = errors.iter().map(|(by, sigma)| (by * sigma).powi(2)).sum();
        assert!((claimed_m6 / var_m6 - 1.0).abs() < 1e-12, "{claimed_m6} {var_m6}");
        // And by draws of that field; the independent sum alone falls short of half of it.
        let root = cov.cholesky().expect("positive").l();
        let mut noise = crate::stats::SeedBook::new(8).stream("base");
        let n_draws = 20_000_u32;
        let squares_m6: f64 = (0..n_draws)
            .map(|_| &root * nalgebra::DVector::from_fn(n, |_, _| noise.normal()))
            .map(|heights_m| weights.dot(&heights_m).powi(2))
            .sum();
        let drawn_m6 = squares_m6 / f64::from(n_draws);
        // The standard error of a variance is √(2/n) = 1 %; 4 of them.
        assert!((drawn_m6 / claimed_m6 - 1.0).abs() < 0.04, "{drawn_m6} {claimed_m6}");
        let own_m6: f64 = std::iter::zip(&areas, &own).map(|(a, s)| (a * s).powi(2)).sum();
        assert!(own_m6 < 0.5 * drawn_m6, "{own_m6} {drawn_m6}");
        assert!(common_sigma_m(0.5 * own_m6, &areas, &own).abs() < 1e-15, "nothing is left");
    }

    #[test]
    fn wrong_counts_and_sigmas_are_refused() {
        let error = SurveyedBase::new(GRID, vec![0.0; 19], vec![0.0; 20], 0.0).unwrap_err();
        assert_eq!(error, SurveyedBaseError::WrongCount { got: 19, expected: 20 });
        let mut sigmas = vec![0.01; 20];
        sigmas[3] = -0.5;
        let error = SurveyedBase::new(GRID, vec![0.0; 20], sigmas, 0.0).unwrap_err();
        assert_eq!(error, SurveyedBaseError::BadSigma { index: 3, sigma_m: -0.5 });
    }
}
