//! The lowest surface that was ever seen.
//!
//! Every survey lies too high or too low as a whole, by an error that all its cells share. Cell by cell,
//! the lowest of many surveys would be that of the lowest survey, and one that lies high by chance would
//! count as material. So both levels are brought together first:
//!
//! ```text
//! D = median of (seen − remembered) over the cells that may be the same ground
//! D ← D (σ_m² + σ_s²)/(σ_m² + σ_s² + σ_D²)        σ_D² = π/2 · mean of the cells' own variances / n
//! remembered ← remembered + g D,  seen ← seen − (1 − g) D,   g = w_s/(w_m + w_s)
//! σ ← (1 − g) σ_m + g σ_s
//! ```
//! - `σ_m`, `σ_s`: what all cells of memory and survey share, m; `w_s` = 1/`σ_s`², `w_m` the sum of
//!   those before
//!
//! The level so becomes the weighted mean of all surveys. Its σ is no smaller than theirs, for the same
//! vehicle brings the same errors on every day.
//! Checked: `the_level_of_ten_days_is_their_mean`.

use super::{Floor, FloorError, read_grid, write_grid};
use crate::messages::GridGeometry;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// What a memory has learned.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Learned {
    /// Cells seen for the first time.
    pub n_new: usize,
    /// Cells seen lower than ever.
    pub n_lower: usize,
    /// Cells seen again as low as ever.
    pub n_confirmed: usize,
    /// So much higher the survey lay than the memory as a whole, m; taken out before cells were
    /// compared. `None` if too few cells were the same ground.
    pub level_m: Option<f64>,
}

/// What all heights of a memory share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// Standard deviation of an error common to all cells, m.
    pub sigma_m: f64,
    /// What the level weighs beside that of a new survey, 1/m².
    pub weight_per_m2: f64,
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
    /// What all cells share; `None` before anything was seen.
    pub level: Option<Level>,
}

/// Lower by so many σ of the difference is lower, and higher is something that lies on it.
const DIFFERENT_SIGMAS: f64 = 4.0;
/// Fewer cells of the same ground do not tell how the levels differ.
const LEAST_COMMON_CELLS: usize = 20;
/// A level is not known better than this, m, when it is weighed.
const LEAST_LEVEL_SIGMA_M: f64 = 1e-4;
/// The level's σ of a folder without a word of it, m: that of a base without one.
const UNTOLD_LEVEL_SIGMA_M: f64 = 0.01;

impl Level {
    /// The level of one survey.
    #[must_use]
    fn of(sigma_m: f64) -> Self {
        Self { sigma_m, weight_per_m2: sigma_m.max(LEAST_LEVEL_SIGMA_M).powi(-2) }
    }

    /// The mean of both levels, and the share of the other in it.
    fn joined(&self, other: &Self) -> (Self, f64) {
        let weight_per_m2 = self.weight_per_m2 + other.weight_per_m2;
        let share = other.weight_per_m2 / weight_per_m2;
        let sigma_m = (1.0 - share) * self.sigma_m + share * other.sigma_m;
        (Self { sigma_m, weight_per_m2 }, share)
    }
}

impl FloorMemory {
    /// Nothing seen yet.
    #[must_use]
    pub fn empty(grid: GridGeometry) -> Self {
        let n = grid.n_cells();
        let (height_m, sigma_m, date) = (vec![f64::NAN; n], vec![0.0; n], vec![f64::NAN; n]);
        Self { grid, height_m, sigma_m, date, level: None }
    }

    /// Takes in a survey of that date, both brought to a common level. Where both are equal within four σ,
    /// own and shared, they are averaged by their own variances, so that the lowest of many noisy looks
    /// is not taken for the floor.
    pub fn take(&mut self, seen: &Floor, date: u32) -> Learned {
        let seen_level = Level::of(seen.shared_sigma_m);
        let before = self.level.unwrap_or(seen_level);
        let shared_var_m2 = before.sigma_m.powi(2) + seen_level.sigma_m.powi(2);
        let level_m = self.level_of(seen, shared_var_m2);
        let (mut memory_by_m, mut seen_by_m) = (0.0, 0.0);
        self.level = Some(match (self.level, level_m) {
            (None, _) => seen_level,
            (Some(level), Some(level_m)) => {
                let (level, share) = level.joined(&seen_level);
                (memory_by_m, seen_by_m) = (share * level_m, (share - 1.0) * level_m);
                level
            }
            // Patches of different days side by side: none of them is known better than the worst.
            (Some(level), None) => {
                Level { sigma_m: level.sigma_m.max(seen_level.sigma_m), ..level }
            }
        });
        let mut learned = Learned { level_m, ..Learned::default() };
        for cell in 0..self.height_m.len() {
            self.height_m[cell] += memory_by_m;
            let height_m = seen.height_m[cell] + seen_by_m;
            if height_m.is_finite() {
                let var_m2 = seen.sigma_m[cell].powi(2);
                self.take_cell(cell, (height_m, var_m2), shared_var_m2, date, &mut learned);
            }
        }
        learned
    }

    fn take_cell(
        &mut self,
        cell: usize,
        (height_m, var_m2): (f64, f64),
        shared_var_m2: f64,
        date: u32,
        learned: &mut Learned,
    ) {
        let (old_m, old_var_m2) = (self.height_m[cell], self.sigma_m[cell].powi(2));
        let differ_m = DIFFERENT_SIGMAS * (var_m2 + old_var_m2 + shared_var_m2).sqrt();
        let (height_m, var_m2) = if !old_m.is_finite() {
            learned.n_new += 1;
            (height_m, var_m2)
        } else if height_m < old_m - differ_m {
            learned.n_lower += 1;
            (height_m, var_m2)
        } else if height_m > old_m + differ_m {
            return;
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

    /// D: by how much the survey lies higher as a whole, m. Cells that differ by more than both levels and
    /// their own noise allow are other ground, or something on it, and do not count.
    #[expect(clippy::cast_precision_loss, reason = "counts of cells")]
    fn level_of(&self, seen: &Floor, shared_var_m2: f64) -> Option<f64> {
        let (mut differences_m, mut own_var_m2) = (Vec::new(), 0.0);
        for cell in 0..self.height_m.len() {
            let difference_m = seen.height_m[cell] - self.height_m[cell];
            let var_m2 = seen.sigma_m[cell].powi(2) + self.sigma_m[cell].powi(2);
            // False for what either has not seen.
            if difference_m.abs() <= DIFFERENT_SIGMAS * (var_m2 + shared_var_m2).sqrt() {
                differences_m.push(difference_m);
                own_var_m2 += var_m2;
            }
        }
        let n = differences_m.len();
        if n < LEAST_COMMON_CELLS {
            return None;
        }
        differences_m.sort_by(f64::total_cmp);
        let median_m = f64::midpoint(differences_m[(n - 1) / 2], differences_m[n / 2]);
        let median_var_m2 = std::f64::consts::FRAC_PI_2 * own_var_m2 / (n as f64).powi(2);
        let total_m2 = (shared_var_m2 + median_var_m2).max(f64::MIN_POSITIVE);
        Some(median_m * shared_var_m2 / total_m2)
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
        let level = Some(read_level(&folder.join(LEVEL_NAME))?);
        Ok(Self { grid, height_m: height_m?, sigma_m: sigma_m?, date: date?, level })
    }

    /// Writes the three grids and what their cells share.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), FloorError> {
        let values = [&self.height_m, &self.sigma_m, &self.date];
        fs::create_dir_all(folder)
            .map_err(|source| FloorError::File { path: folder.to_owned(), source })?;
        std::iter::zip(NAMES, values)
            .try_for_each(|(name, values)| write_grid(&folder.join(name), &self.grid, values))?;
        self.level.as_ref().map_or(Ok(()), |level| write_level(&folder.join(LEVEL_NAME), level))
    }

    /// The files of heights and of their σ in a folder, for a base of kind `survey`.
    #[must_use]
    pub fn base_files(folder: &Path) -> (PathBuf, PathBuf) {
        (folder.join(NAMES[0]), folder.join(NAMES[1]))
    }
}

/// Files of a memory: heights, their σ, dates.
const NAMES: [&str; 3] = ["lowest.asc", "lowest-sigma.asc", "lowest-date.asc"];
/// The file of its level.
const LEVEL_NAME: &str = "lowest-level.toml";

fn read_level(path: &Path) -> Result<Level, FloorError> {
    if !path.exists() {
        return Ok(Level::of(UNTOLD_LEVEL_SIGMA_M));
    }
    let refuse = |reason| FloorError::Level { path: path.to_owned(), reason };
    let text = fs::read_to_string(path)
        .map_err(|source| FloorError::File { path: path.to_owned(), source })?;
    let level: Level = toml::from_str(&text).map_err(|error| refuse(error.to_string()))?;
    let is_sound = level.sigma_m >= 0.0
        && level.sigma_m.is_finite()
        && level.weight_per_m2 > 0.0
        && level.weight_per_m2.is_finite();
    if is_sound { Ok(level) } else { Err(refuse(format!("{level:?} is no level"))) }
}

fn write_level(path: &Path, level: &Level) -> Result<(), FloorError> {
    let text = toml::to_string(level)
        .map_err(|error| FloorError::Level { path: path.to_owned(), reason: error.to_string() })?;
    fs::write(path, text).map_err(|source| FloorError::File { path: path.to_owned(), source })
}
