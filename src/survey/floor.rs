//! `stockpilot survey floor`: the empty floor as a base for later surveys, and the lowest surface that was
//! ever seen.
//!
//! ```text
//! LOG … ─▶ one map ─▶ heights and their σ, cell by cell ─▶ height_file, sigma_file of a base
//!                                                     └▶ memory: lowest height, its σ, its date
//! ```
//!
//! A base counts its cells' own σ as independent, which they are not, and knows one error common to
//! all of them. That one is chosen such that the volume of the base has the σ that the survey claims of
//! it, every source included: [`common_sigma_m`]. Of a small part of the floor less is known than that.
//!
//! Whoever measures over such a base with the vehicle that surveyed it has the same errors of ranges,
//! mounting and markers twice, and they count as independent, which is too careful. `stockpilot change`
//! between the floor's log and the later one takes them out.

mod memory;

pub use memory::{FloorMemory, Learned, Level};

use super::merge::{Joined, MergeLogsError, MergeOptions, join};
use crate::config::ascii_grid::{self, AsciiGrid, AsciiGridError};
use crate::mapping::surveyed_base::common_sigma_m;
use crate::mapping::{Mapper, SolveError};
use crate::messages::GridGeometry;
use crate::time::{Mono, Stamp};
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
    /// Standard deviation of what all cells share, m: what the cells' own σ leave of the volume's.
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
    /// What the memory knows of its own level makes no sense.
    #[error("{}: {reason}", path.display())]
    Level {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
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
    let Joined { mapper, at, .. } = join(logs, options)?;
    Ok(floor_of(mapper, at).map_err(MergeLogsError::from)?)
}

/// The floor that a map shows.
///
/// # Errors
/// A map that cannot be solved.
fn floor_of(mut mapper: Mapper, at: Stamp<Mono>) -> Result<Floor, SolveError> {
    let work = mapper.snapshot(at, true);
    let solved = work.run()?;
    mapper.absorb(&solved);
    let known = mapper.snapshot(at, true).known_heights();
    let is_known = known.map_or_else(Vec::new, |known| known.is_known);
    let surface = solved.surface;
    let (mut height_m, mut sigma_m) = (surface.mean_m, surface.sigma_m);
    let mut areas_m2 = mapper.base().cell_areas_m2.clone();
    for cell in 0..height_m.len() {
        if !is_known.get(cell).is_some_and(|is| *is) || surface.disturbed_cells.contains(&cell) {
            (height_m[cell], sigma_m[cell], areas_m2[cell]) = (f64::NAN, 0.0, 0.0);
        }
    }
    // The volume of what will be the base: without the cells that it lacks, and without a base itself.
    let volume = work.over_cells(&areas_m2).run()?;
    let var_m6 = volume.accounts.first().map_or(0.0, |account| account.budget.var_m6());
    let shared_sigma_m = common_sigma_m(var_m6, &areas_m2, &sigma_m);
    Ok(Floor { grid: surface.grid, height_m, sigma_m, shared_sigma_m })
}

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
mod tests;
