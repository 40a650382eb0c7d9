//! The measured surface and its volume.

use super::VolumeBudget;
use crate::time::{Mono, Stamp};

/// A regular grid of square cells over the region of interest.
///
/// ```text
///  y ▲   ┌───┬───┬───┐
///    │   │ 3 │ 4 │ 5 │    index = row · n_cols + col
///    │   ├───┼───┼───┤    row grows with y, col grows with x
///    │   │ 0 │ 1 │ 2 │    (x_min, y_min) is the outer corner of cell 0
///    └── └───┴───┴───┘ ─▶ x
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridGeometry {
    /// Outer corner of cell 0 in the hall, x, m.
    pub x_min_m: f64,
    /// Outer corner of cell 0 in the hall, y, m.
    pub y_min_m: f64,
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Cells along x.
    pub n_cols: usize,
    /// Cells along y.
    pub n_rows: usize,
}

impl GridGeometry {
    /// Number of cells.
    #[must_use]
    pub const fn n_cells(&self) -> usize {
        self.n_cols * self.n_rows
    }

    /// Area of a cell, m².
    #[must_use]
    pub fn cell_area_m2(&self) -> f64 {
        self.cell_m * self.cell_m
    }

    /// Index of the cell at (`col`, `row`), both inside the grid.
    #[must_use]
    pub const fn index(&self, col: usize, row: usize) -> usize {
        row * self.n_cols + col
    }

    /// Centre of a cell in the hall, x and y, m.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "cell counts stay far below 2^53")]
    pub fn centre_m(&self, index: usize) -> (f64, f64) {
        let (row, col) = (index / self.n_cols, index % self.n_cols);
        (
            self.x_min_m + (col as f64 + 0.5) * self.cell_m,
            self.y_min_m + (row as f64 + 0.5) * self.cell_m,
        )
    }

    /// The cell that holds (x, y), if it is inside the grid.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "the quotient is checked to lie in the grid before the cast"
    )]
    pub fn cell_at(&self, x_m: f64, y_m: f64) -> Option<usize> {
        let col = ((x_m - self.x_min_m) / self.cell_m).floor();
        let row = ((y_m - self.y_min_m) / self.cell_m).floor();
        let is_inside =
            col >= 0.0 && row >= 0.0 && col < self.n_cols as f64 && row < self.n_rows as f64;
        is_inside.then(|| self.index(col as usize, row as usize))
    }

    /// Outer corner opposite to (`x_min_m`, `y_min_m`), m.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "cell counts stay far below 2^53")]
    pub fn max_corner_m(&self) -> (f64, f64) {
        (
            self.x_min_m + self.n_cols as f64 * self.cell_m,
            self.y_min_m + self.n_rows as f64 * self.cell_m,
        )
    }
}

/// The height of the surface over the hall floor, per cell.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    /// When it was computed.
    pub at: Stamp<Mono>,
    /// Where the cells are.
    pub grid: GridGeometry,
    /// Expected height of each cell, m.
    pub mean_m: Vec<f64>,
    /// Its standard deviation, m.
    pub sigma_m: Vec<f64>,
    /// Cells, by number, that something has covered or changed since their ground was last seen:
    /// they keep what was known before, or nothing.
    pub disturbed_cells: Vec<usize>,
}

/// How the height of a cell is known. The order is that of [`VolumeShares`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellCoverage {
    /// A beam has hit it.
    Measured,
    /// It lies near cells that a beam has hit.
    Interpolated,
    /// Nothing was seen near it.
    Unseen,
    /// Something has moved in it since it was seen.
    Disturbed,
}

/// Ground that something has covered or changed since it was last seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisturbedArea {
    /// Its area, m².
    pub area_m2: f64,
    /// Its middle in the hall, x and y, m.
    pub centre_m: [f64; 2],
}

/// How much there is, and how sure that is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeEstimate {
    /// When it was computed.
    pub at: Stamp<Mono>,
    /// Volume between the surface and the base, m³.
    pub volume_m3: f64,
    /// Its standard deviation, m³.
    pub sigma_m3: f64,
    /// Share of the cells that a beam has hit, 0 to 1.
    pub coverage_ratio: f64,
}

/// How much of a volume rests on measurements; the four add up to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VolumeShares {
    /// Over cells that a beam has hit, 0 to 1.
    pub measured_ratio: f64,
    /// Near such cells, 0 to 1.
    pub interpolated_ratio: f64,
    /// Where nothing was seen, 0 to 1.
    pub unseen_ratio: f64,
    /// Where something moved since the ground was last seen, 0 to 1.
    pub disturbed_ratio: f64,
}

/// A mass, and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mass {
    /// Mass, t.
    pub mass_t: f64,
    /// Its standard deviation, t.
    pub sigma_t: f64,
}

/// One volume with the account of its uncertainty: of the whole region, or of one bay.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeAccount {
    /// What is measured.
    pub name: String,
    /// How much there is.
    pub estimate: VolumeEstimate,
    /// What it weighs, where the material's density is known.
    pub mass: Option<Mass>,
    /// Where the uncertainty comes from.
    pub budget: VolumeBudget,
    /// How much of it rests on measurements.
    pub shares: VolumeShares,
}

/// Where every beam went; the counts add up to `received`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HitCounts {
    /// Beams that came from the driver.
    pub received: u64,
    /// Beams that changed the map.
    pub used: u64,
    /// Beams without a return, or outside the trusted range.
    pub no_return: u64,
    /// Beams inside a sector that the own body hides.
    pub own_body: u64,
    /// Hits outside the region of interest or too near its border to be surely inside, and such as
    /// are higher than any pile can be.
    pub outside: u64,
    /// Beams without a pose: before the first fix, or older than the ring.
    pub no_pose: u64,
    /// Beams while the pose was too uncertain to map with.
    pub poor_pose: u64,
    /// Beams while the vehicle was not flying a survey.
    pub on_ground: u64,
    /// Beams among `used` that turned out not to be of the surface: dust, edges, machines.
    pub refused: u64,
    /// Beams that had been used and were dropped again, because their pose turned out to be wrong.
    pub forgotten: u64,
}

impl std::ops::AddAssign for HitCounts {
    fn add_assign(&mut self, other: Self) {
        self.received += other.received;
        self.used += other.used;
        self.no_return += other.no_return;
        self.own_body += other.own_body;
        self.outside += other.outside;
        self.no_pose += other.no_pose;
        self.poor_pose += other.poor_pose;
        self.on_ground += other.on_ground;
        self.refused += other.refused;
        self.forgotten += other.forgotten;
    }
}
