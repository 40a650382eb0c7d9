//! What the map of the change is held against: the last survey, or the surveyed floor.

use crate::mapping;
use crate::mapping::base::BaseSurface;
use crate::mapping::surveyed_base::{SurveyedBase, SurveyedBaseError};
use crate::messages::GridGeometry;
use crate::record::replay::ReplayError;
use crate::record::{read_accounts, read_times};
use std::path::{Path, PathBuf};

/// Heights on the cells of the present map.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Earlier {
    /// Which, for people.
    pub(super) name: String,
    /// Height of each cell, m; `None` where it knows none.
    pub(super) heights_m: Vec<Option<f64>>,
}

/// Why a log is no earlier survey.
#[derive(Debug, thiserror::Error)]
pub(super) enum EarlierError {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    Log {
        /// Which.
        path: PathBuf,
        /// Why.
        source: ReplayError,
    },
    /// It holds no surface.
    #[error("{}: no surface in it", path.display())]
    NoSurface {
        /// Which.
        path: PathBuf,
    },
    /// Its surface is none.
    #[error("{}: {source}", path.display())]
    BrokenSurface {
        /// Which.
        path: PathBuf,
        /// Why.
        source: SurveyedBaseError,
    },
    /// It is of another place.
    #[error("{}: its map does not overlap this hall's", path.display())]
    Elsewhere {
        /// Which.
        path: PathBuf,
    },
}

impl Earlier {
    /// The surface that a survey's log ends with, on these cells. Reads the whole log: blocks for seconds.
    pub(super) fn of_survey(log: &Path, grid: &GridGeometry) -> Result<Self, EarlierError> {
        let path = || log.to_owned();
        let unread = |source| EarlierError::Log { path: path(), source };
        let surface = read_accounts(log).map_err(unread)?.surface;
        let surface = surface.ok_or_else(|| EarlierError::NoSurface { path: path() })?;
        let surface = SurveyedBase::from_map(&surface, 0.0)
            .map_err(|source| EarlierError::BrokenSurface { path: path(), source })?;
        let heights_m = on_cells(&surface, grid);
        if heights_m.iter().all(Option::is_none) {
            return Err(EarlierError::Elsewhere { path: path() });
        }
        let file = log.file_name().unwrap_or_default().to_string_lossy();
        let started = read_times(log).map_err(unread)?.started_utc;
        let day = started.as_deref().and_then(|utc| utc.get(..10));
        let name = day.map_or_else(|| format!("survey {file}"), |day| format!("survey of {day}"));
        Ok(Self { name, heights_m })
    }

    /// The floor under the bays that lie on a surveyed one; `None` without such bays.
    pub(super) fn of_base(settings: &mapping::Settings, grid: &GridGeometry) -> Option<Self> {
        let hall_base = BaseSurface::level(settings.base_height_m);
        let bays = settings.region.whole_and_bays_on(grid, &hall_base);
        let mut heights_m = vec![None; grid.n_cells()];
        for bay in bays.iter().filter(|bay| bay.is_over_survey) {
            for (cell, height_m) in heights_m.iter_mut().enumerate() {
                if bay.base.cell_areas_m2[cell] > 0.0 {
                    *height_m = Some(bay.base.cell_base_m[cell]);
                }
            }
        }
        let has_some = heights_m.iter().any(Option::is_some);
        has_some.then(|| Self { name: "surveyed floor".to_owned(), heights_m })
    }
}

/// A surface on other cells; nothing beyond its own.
fn on_cells(surface: &SurveyedBase, grid: &GridGeometry) -> Vec<Option<f64>> {
    (0..grid.n_cells())
        .map(|cell| {
            let (x_m, y_m) = grid.centre_m(cell);
            surface.has_height(x_m, y_m).then(|| surface.height_m(x_m, y_m))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::HeightMap;
    use crate::time::Stamp;

    fn resampled(earlier: &HeightMap, grid: &GridGeometry) -> Vec<Option<f64>> {
        on_cells(&SurveyedBase::from_map(earlier, 0.0).unwrap(), grid)
    }

    /// z = 1 + 0.5 x − 0.25 y at the centres of the cells.
    fn plane(x_min_m: f64, cell_m: f64, n: usize) -> HeightMap {
        let grid = GridGeometry { x_min_m, y_min_m: -1.0, cell_m, n_cols: n, n_rows: n };
        let mean_m = (0..grid.n_cells())
            .map(|cell| {
                let (x, y) = grid.centre_m(cell);
                1.0 + 0.5 * x - 0.25 * y
            })
            .collect();
        let sigma_m = vec![0.01; grid.n_cells()];
        HeightMap { at: Stamp::ZERO, grid, mean_m, sigma_m, disturbed_cells: Vec::new() }
    }

    #[test]
    fn a_plane_stays_itself_on_other_cells() {
        let earlier = plane(0.0, 0.4, 12);
        // Cells of another size, reaching beyond the earlier map on the right.
        let now = plane(1.1, 0.25, 20);
        let found = resampled(&earlier, &now.grid);
        let mut n_known = 0;
        for (cell, height_m) in found.iter().enumerate() {
            let (x, y) = now.grid.centre_m(cell);
            // The earlier map ends at x = 4.8, y = 3.8; its outermost half cells are level.
            let is_inside = x < 4.8 && y < 3.8;
            assert_eq!(height_m.is_some(), is_inside, "{x} {y}");
            let is_between = x < 4.6 && (-0.8..3.6).contains(&y);
            if let Some(height_m) = height_m.filter(|_| is_between) {
                assert!((height_m - now.mean_m[cell]).abs() < 1e-12);
                n_known += 1;
            }
        }
        assert!(n_known > 150, "{n_known}");
    }

    #[test]
    fn the_same_cells_give_the_same_numbers() {
        let earlier = plane(0.3, 0.25, 9);
        let found = resampled(&earlier, &earlier.grid);
        for (found, known) in std::iter::zip(found, &earlier.mean_m) {
            assert!((found.unwrap() - known).abs() < 1e-12);
        }
    }

    #[test]
    fn a_file_that_is_no_log_is_named() {
        let error = Earlier::of_survey(Path::new("no/such.mcap"), &plane(0.0, 1.0, 2).grid);
        assert!(error.unwrap_err().to_string().contains("no/such.mcap"));
    }
}
