//! `stockpilot survey floor`: the empty floor as a base for later surveys, and the lowest surface that was
//! ever seen.
//!
//! ```text
//! LOG … ─▶ one map ─▶ heights and their σ, cell by cell ─▶ height_file, sigma_file of a base
//!                                                     └▶ memory: lowest height, its σ, its date
//! ```

use super::merge::{Joined, MergeLogsError, MergeOptions, join};
use crate::config::ascii_grid::{self, AsciiGrid, AsciiGridError};
use crate::messages::{BudgetSource, GridGeometry};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A surface that was seen, cell by cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// Height of each cell over the hall's zero, m; NaN where nothing was seen.
    pub height_m: Vec<f64>,
    /// Its own standard deviation, m; 0 where nothing was seen.
    pub sigma_m: Vec<f64>,
    /// Standard deviation of what all cells share (mounting, ranges, clock, markers), m.
    pub shared_sigma_m: f64,
}

/// Why there is no floor.
#[derive(Debug, thiserror::Error)]
pub enum FloorError {
    /// The logs have no common map.
    #[error(transparent)]
    Logs(#[from] MergeLogsError),
    /// A file of the memory cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file of the memory is no grid.
    #[error("{}: {source}", path.display())]
    Grid {
        /// Which.
        path: PathBuf,
        /// Why.
        source: AsciiGridError,
    },
    /// The memory is of other cells.
    #[error("{} has other cells than this survey", path.display())]
    OtherCells {
        /// Which.
        path: PathBuf,
    },
}

/// Surveys the floor from logs of flights over it.
///
/// # Errors
/// [`FloorError::Logs`].
pub fn survey_floor(logs: &[PathBuf], options: MergeOptions) -> Result<Floor, FloorError> {
    let Joined { mut mapper, at, .. } = join(logs, options)?;
    let solved = mapper.snapshot(at, true).run().map_err(MergeLogsError::from)?;
    mapper.absorb(&solved);
    let known = mapper.snapshot(at, true).known_heights();
    let surface = solved.surface;
    let mut floor = Floor {
        grid: surface.grid,
        height_m: surface.mean_m,
        sigma_m: surface.sigma_m,
        shared_sigma_m: 0.0,
    };
    let is_known = known.map_or_else(Vec::new, |known| known.is_known);
    for (cell, is_known) in is_known.into_iter().enumerate() {
        if !is_known || surface.disturbed_cells.contains(&cell) {
            (floor.height_m[cell], floor.sigma_m[cell]) = (f64::NAN, 0.0);
        }
    }
    if let Some(whole) = solved.accounts.first() {
        let shared = whole.budget.rows.iter().filter(|row| is_shared(row.source));
        let area_m2: f64 = mapper.base().cell_areas_m2.iter().sum();
        floor.shared_sigma_m = shared.map(|row| row.var_m6).sum::<f64>().sqrt() / area_m2;
    }
    Ok(floor)
}

/// True for errors that lift the whole surface, or nearly.
const fn is_shared(source: BudgetSource) -> bool {
    matches!(
        source,
        BudgetSource::LidarMounting
            | BudgetSource::RangeBias
            | BudgetSource::RangeScale
            | BudgetSource::ClockOffset
            | BudgetSource::MarkerMap
    )
}

/// What a memory has learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Learned {
    /// Cells seen for the first time.
    pub n_new: usize,
    /// Cells seen lower than ever.
    pub n_lower: usize,
    /// Cells seen again as low as ever.
    pub n_confirmed: usize,
}

/// The lowest surface that was ever seen, in three grids of a folder that stand for a base too.
#[derive(Debug, Clone, PartialEq)]
pub struct FloorMemory {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// Lowest height of each cell, m; NaN where nothing was seen yet.
    pub height_m: Vec<f64>,
    /// Its standard deviation, m.
    pub sigma_m: Vec<f64>,
    /// When it was last seen so low: 20260304 for the fourth of March 2026; NaN for never.
    pub date: Vec<f64>,
}

/// Lower by so many σ of the difference is lower, and higher is something that lies on it.
const DIFFERENT_SIGMAS: f64 = 4.0;

impl FloorMemory {
    /// Nothing seen yet.
    #[must_use]
    pub fn empty(grid: GridGeometry) -> Self {
        let n = grid.n_cells();
        Self { grid, height_m: vec![f64::NAN; n], sigma_m: vec![0.0; n], date: vec![f64::NAN; n] }
    }

    /// Takes in a survey of that date. Where both are equal within four σ, they are averaged by their
    /// variances, so that the lowest of many noisy looks is not taken for the floor.
    pub fn take(&mut self, seen: &Floor, date: u32) -> Learned {
        let mut learned = Learned::default();
        for cell in 0..self.height_m.len() {
            let (height_m, var_m2) = (seen.height_m[cell], seen.sigma_m[cell].powi(2));
            if !height_m.is_finite() {
                continue;
            }
            let (old_m, old_var_m2) = (self.height_m[cell], self.sigma_m[cell].powi(2));
            let differ_m = DIFFERENT_SIGMAS * (var_m2 + old_var_m2).sqrt();
            let (height_m, var_m2) = if !old_m.is_finite() {
                learned.n_new += 1;
                (height_m, var_m2)
            } else if height_m < old_m - differ_m {
                learned.n_lower += 1;
                (height_m, var_m2)
            } else if height_m > old_m + differ_m {
                continue;
            } else {
                learned.n_confirmed += 1;
                let total = (var_m2 + old_var_m2).max(f64::MIN_POSITIVE);
                let share = old_var_m2 / total;
                (old_m + share * (height_m - old_m), share * var_m2)
            };
            self.height_m[cell] = height_m;
            self.sigma_m[cell] = var_m2.sqrt();
            self.date[cell] = f64::from(date);
        }
        learned
    }

    /// Reads a memory; an empty one if the folder has none.
    ///
    /// # Errors
    /// Files that cannot be read or do not fit together.
    pub fn read(folder: &Path, grid: GridGeometry) -> Result<Self, FloorError> {
        if !folder.join(NAMES[0]).exists() {
            return Ok(Self::empty(grid));
        }
        let [height_m, sigma_m, date] = NAMES.map(|name| read_grid(&folder.join(name), grid));
        Ok(Self { grid, height_m: height_m?, sigma_m: sigma_m?, date: date? })
    }

    /// Writes the three grids.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), FloorError> {
        let values = [&self.height_m, &self.sigma_m, &self.date];
        fs::create_dir_all(folder)
            .map_err(|source| FloorError::File { path: folder.to_owned(), source })?;
        std::iter::zip(NAMES, values)
            .try_for_each(|(name, values)| write_grid(&folder.join(name), &self.grid, values))
    }
}

/// Files of a memory: heights, their σ, dates.
const NAMES: [&str; 3] = ["lowest.asc", "lowest-sigma.asc", "lowest-date.asc"];

impl Floor {
    /// Writes `PATH.asc` and `PATH-sigma.asc`.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn write(&self, stem: &Path) -> Result<(PathBuf, PathBuf), FloorError> {
        let with = |end: &str| {
            let mut path = stem.as_os_str().to_owned();
            path.push(end);
            PathBuf::from(path)
        };
        let (heights, sigmas) = (with(".asc"), with("-sigma.asc"));
        write_grid(&heights, &self.grid, &self.height_m)?;
        write_grid(&sigmas, &self.grid, &self.sigma_m)?;
        Ok((heights, sigmas))
    }
}

fn write_grid(path: &Path, grid: &GridGeometry, values: &[f64]) -> Result<(), FloorError> {
    fs::write(path, ascii_grid::write(grid, values))
        .map_err(|source| FloorError::File { path: path.to_owned(), source })
}

fn read_grid(path: &Path, grid: GridGeometry) -> Result<Vec<f64>, FloorError> {
    let text = fs::read_to_string(path)
        .map_err(|source| FloorError::File { path: path.to_owned(), source })?;
    let AsciiGrid { grid: found, values } = ascii_grid::parse(&text)
        .map_err(|source| FloorError::Grid { path: path.to_owned(), source })?;
    if found == grid { Ok(values) } else { Err(FloorError::OtherCells { path: path.to_owned() }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;

    fn grid() -> GridGeometry {
        GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 40, n_rows: 25 }
    }

    fn seen(height_m: impl Fn(usize) -> f64) -> Floor {
        let n = grid().n_cells();
        Floor {
            grid: grid(),
            height_m: (0..n).map(height_m).collect(),
            sigma_m: vec![0.01; n],
            shared_sigma_m: 0.005,
        }
    }

    #[test]
    fn many_noisy_looks_at_one_floor_do_not_sink_it() {
        let mut noise = SeedBook::new(4).stream("floor");
        let mut memory = FloorMemory::empty(grid());
        for day in 0..30 {
            let draws: Vec<f64> = (0..grid().n_cells()).map(|_| 0.01 * noise.normal()).collect();
            memory.take(&seen(|cell| 0.2 + draws[cell]), 20_260_301 + day);
        }
        let mean_m = memory.height_m.iter().sum::<f64>() / memory.height_m.len() as f64;
        // The plain minimum of 30 looks would lie 20 mm low.
        assert!((mean_m - 0.2).abs() < 0.002, "{mean_m}");
    }

    #[test]
    fn what_lies_on_the_floor_is_no_floor_and_a_lower_one_is_dated() {
        let mut memory = FloorMemory::empty(grid());
        let first = memory.take(&seen(|cell| if cell < 10 { 1.0 } else { 0.0 }), 20_260_301);
        assert_eq!((first.n_new, first.n_lower), (1000, 0));
        // The heap has moved: from the first ten cells to the next ten.
        let moved = |cell| if (10..20).contains(&cell) { 1.5 } else { 0.0 };
        let second = memory.take(&seen(moved), 20_260_402);
        assert_eq!((second.n_new, second.n_lower, second.n_confirmed), (0, 10, 980));
        assert!(memory.height_m.iter().all(|height_m| height_m.abs() < 1e-12));
        let dates = [0, 15, 30].map(|cell| memory.date[cell]);
        assert!((dates[0] - 20_260_402.0).abs() < 0.5 && (dates[1] - 20_260_301.0).abs() < 0.5);
    }

    #[test]
    fn a_memory_comes_back_from_its_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut memory = FloorMemory::read(folder.path(), grid()).expect("empty");
        memory.take(&seen(|cell| if cell == 3 { f64::NAN } else { 0.125 }), 20_260_301);
        memory.write(folder.path()).expect("written");
        let again = FloorMemory::read(folder.path(), grid()).expect("a memory");
        assert!(again.height_m[3].is_nan() && again.date[3].is_nan());
        assert_eq!(
            (&again.height_m[4..], &again.sigma_m),
            (&memory.height_m[4..], &memory.sigma_m)
        );
        let other = GridGeometry { n_cols: 25, n_rows: 40, ..grid() };
        let error = FloorMemory::read(folder.path(), other).unwrap_err();
        assert!(matches!(error, FloorError::OtherCells { .. }), "{error}");
    }
}
