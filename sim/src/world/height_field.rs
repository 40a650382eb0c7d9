//! Material as heights on a regular grid, bilinear between the nodes.

use super::{Region, WorldError, bay};
use nalgebra::Vector3;

/// Levels of the maximum pyramid over the cells; the coarsest cell spans 2⁶ cells.
const N_LEVELS: usize = 7;

/// Heights of the material over the hall floor.
///
/// ```text
///  y ▲  3───4───5      node = row · n_cols + col; row grows with y, col with x
///    │  │ 0 │ 1 │      cells lie between four nodes; h is bilinear in each
///    │  0───1───2      (x_min, y_min) is node 0
///    └────────────▶ x
/// ```
/// Outside of the nodes' rectangle there is no material; its border is a cliff.
#[derive(Debug, Clone)]
pub struct HeightField {
    x_min_m: f64,
    y_min_m: f64,
    pitch_m: f64,
    n_cols: usize,
    n_rows: usize,
    heights_m: Vec<f64>,
    peak_m: f64,
    /// Level 0 holds the highest node of each cell, level k that of 2ᵏ × 2ᵏ cells.
    peaks: Vec<PeakLevel>,
}

/// One level of the maximum pyramid.
#[derive(Debug, Clone)]
struct PeakLevel {
    n_cols: usize,
    peaks_m: Vec<f64>,
}

/// The bilinear patch of one cell: `h = a + b·u + c·v + d·u·v` with u, v in 0 to 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patch {
    pub(crate) a: f64,
    pub(crate) b: f64,
    pub(crate) c: f64,
    pub(crate) d: f64,
}

impl Patch {
    pub(crate) fn height_m(&self, u: f64, v: f64) -> f64 {
        self.a + self.b * u + (self.c + self.d * u) * v
    }
}

impl HeightField {
    /// The field with these nodes; `heights_m` holds rows from low to high y.
    ///
    /// # Errors
    /// [`WorldError::BadField`] for fewer than 2 × 2 nodes, a wrong number of heights, heights
    /// that are negative or not finite, or a pitch that is not above zero.
    pub fn new(
        corner_m: (f64, f64),
        pitch_m: f64,
        n_cols: usize,
        heights_m: Vec<f64>,
    ) -> Result<Self, WorldError> {
        let n_rows = heights_m.len().checked_div(n_cols).unwrap_or(0);
        let is_surface = n_cols >= 2
            && n_rows >= 2
            && n_cols * n_rows == heights_m.len()
            && pitch_m > 0.0
            && heights_m.iter().all(|h| h.is_finite() && *h >= 0.0);
        if !is_surface {
            return Err(WorldError::BadField);
        }
        let peaks = pyramid(&heights_m, n_cols, n_rows);
        let peak_m = heights_m.iter().copied().fold(0.0, f64::max);
        let (x_min_m, y_min_m) = corner_m;
        Ok(Self { x_min_m, y_min_m, pitch_m, n_cols, n_rows, heights_m, peak_m, peaks })
    }

    /// The field that samples `height_m(x, y)` on nodes `pitch_m` apart; the far borders move to
    /// the nearest node.
    ///
    /// # Errors
    /// [`WorldError::BadField`] as [`Self::new`].
    pub fn from_fn(
        region: &Region,
        pitch_m: f64,
        height_m: impl Fn(f64, f64) -> f64,
    ) -> Result<Self, WorldError> {
        let n_cols = index_from(region.length_m() / pitch_m + 0.5) + 1;
        let n_rows = index_from(region.width_m() / pitch_m + 0.5) + 1;
        let node = |i: usize| {
            let x_m = region.x_min_m + (i % n_cols) as f64 * pitch_m;
            height_m(x_m, region.y_min_m + (i / n_cols) as f64 * pitch_m)
        };
        let heights_m = (0..n_cols * n_rows).map(node).collect();
        Self::new((region.x_min_m, region.y_min_m), pitch_m, n_cols, heights_m)
    }

    /// The rectangle between the outer nodes.
    #[must_use]
    pub fn region(&self) -> Region {
        let span_m = |n: usize| (n - 1) as f64 * self.pitch_m;
        Region::new(
            self.x_min_m,
            self.y_min_m,
            self.x_min_m + span_m(self.n_cols),
            self.y_min_m + span_m(self.n_rows),
        )
    }

    /// Distance between nodes, m.
    #[must_use]
    pub fn pitch_m(&self) -> f64 {
        self.pitch_m
    }

    /// The heights of the nodes, rows from low to high y, m.
    #[must_use]
    pub fn heights_m(&self) -> &[f64] {
        &self.heights_m
    }

    /// Height of the highest node, m.
    #[must_use]
    pub fn peak_m(&self) -> f64 {
        self.peak_m
    }

    /// Height of the material at (x, y), m; 0 outside of the field.
    #[must_use]
    pub fn height_at(&self, x_m: f64, y_m: f64) -> f64 {
        if !self.region().contains(x_m, y_m) {
            return 0.0;
        }
        let (across, up) = self.grid_coords(x_m, y_m);
        let (col, row) = self.cell_of(across, up);
        self.patch(col, row).height_m(across - col as f64, up - row as f64)
    }

    /// (x, y) in units of cells from node 0.
    pub(crate) fn grid_coords(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        ((x_m - self.x_min_m) / self.pitch_m, (y_m - self.y_min_m) / self.pitch_m)
    }

    /// The cell (col, row) at these grid coordinates, or the nearest one.
    pub(crate) fn cell_of(&self, across: f64, up: f64) -> (usize, usize) {
        (index_from(across).min(self.n_cols - 2), index_from(up).min(self.n_rows - 2))
    }

    /// The bilinear surface of a cell.
    pub(crate) fn patch(&self, col: usize, row: usize) -> Patch {
        let low = row * self.n_cols + col;
        let high = low + self.n_cols;
        let (h00, h10) = (self.heights_m[low], self.heights_m[low + 1]);
        let (h01, h11) = (self.heights_m[high], self.heights_m[high + 1]);
        Patch { a: h00, b: h10 - h00, c: h01 - h00, d: h11 - h10 - h01 + h00 }
    }

    /// The highest node of the block of 2^level × 2^level cells that holds a cell, m.
    pub(crate) fn block_peak_m(&self, level: usize, col: usize, row: usize) -> f64 {
        let blocks = &self.peaks[level];
        blocks.peaks_m[(row >> level) * blocks.n_cols + (col >> level)]
    }

    /// The coarsest level of [`Self::block_peak_m`].
    pub(crate) fn top_level(&self) -> usize {
        self.peaks.len() - 1
    }

    /// Volume under the surface over a rectangle, m³; exact.
    ///
    /// The integral of a bilinear function over an aligned rectangle is its area times the value
    /// in the middle.
    #[must_use]
    pub fn integral_m3(&self, over: &Region) -> f64 {
        self.sum_over_cells(over, |piece| {
            let (x_m, y_m) = piece.centre_m();
            piece.area_m2() * self.height_at(x_m, y_m)
        })
    }

    /// Volume under the surface and under `top_m` over a rectangle, m³; midpoint rule.
    pub(crate) fn integral_below_m3(&self, over: &Region, top_m: f64) -> f64 {
        const N_PIECES: usize = 16;
        self.sum_over_cells(over, |piece| {
            let step = |low_m: f64, length_m: f64, i: usize| {
                low_m + (i as f64 + 0.5) / N_PIECES as f64 * length_m
            };
            let heights = (0..N_PIECES * N_PIECES).map(|i| {
                let x_m = step(piece.x_min_m, piece.length_m(), i % N_PIECES);
                let y_m = step(piece.y_min_m, piece.width_m(), i / N_PIECES);
                self.height_at(x_m, y_m).min(top_m)
            });
            heights.sum::<f64>() * piece.area_m2() / (N_PIECES * N_PIECES) as f64
        })
    }

    /// Volume under the surface over a polygon (corners x, y, m), m³; exact.
    #[must_use]
    pub fn integral_within_m3(&self, outline_m: &[[f64; 2]]) -> f64 {
        let Some(bounds) = bay::bounds(outline_m) else { return 0.0 };
        // The surface of one cell is a polynomial of degree 2.
        let sum_m3 = self.sum_over_cells(&bounds, |part| {
            let piece = bay::clipped(outline_m, part);
            bay::integral(&piece, 0, &|x_m, y_m| self.height_at(x_m, y_m))
        });
        sum_m3 * bay::signed_area_m2(outline_m).signum()
    }

    /// Volume under the surface and under `top_m` over the part of a polygon in a rectangle, m³;
    /// each triangle in 64 pieces.
    pub(crate) fn integral_below_within_m3(
        &self,
        outline_m: &[[f64; 2]],
        over: &Region,
        top_m: f64,
    ) -> f64 {
        const N_HALVINGS: u32 = 3;
        let sum_m3 = self.sum_over_cells(over, |part| {
            let piece = bay::clipped(outline_m, part);
            bay::integral(&piece, N_HALVINGS, &|x_m, y_m| self.height_at(x_m, y_m).min(top_m))
        });
        sum_m3 * bay::signed_area_m2(outline_m).signum()
    }

    /// Sum of `term` over the parts of the rectangle that lie in one cell each.
    fn sum_over_cells(&self, over: &Region, term: impl Fn(&Region) -> f64) -> f64 {
        let Some(inside) = self.region().overlap(over) else {
            return 0.0;
        };
        let (first_across, first_up) = self.grid_coords(inside.x_min_m, inside.y_min_m);
        let (last_across, last_up) = self.grid_coords(inside.x_max_m, inside.y_max_m);
        let (first_col, first_row) = self.cell_of(first_across, first_up);
        let (last_col, last_row) = self.cell_of(last_across, last_up);
        let mut sum = 0.0;
        for row in first_row..=last_row {
            for col in first_col..=last_col {
                sum += self.cell_region(col, row).overlap(&inside).map_or(0.0, |part| term(&part));
            }
        }
        sum
    }

    fn cell_region(&self, col: usize, row: usize) -> Region {
        let x_m = |i: usize| self.x_min_m + i as f64 * self.pitch_m;
        let y_m = |i: usize| self.y_min_m + i as f64 * self.pitch_m;
        Region::new(x_m(col), y_m(row), x_m(col + 1), y_m(row + 1))
    }

    /// Distance from a point to the material by its nodes, m; at most `reach_m`, 0 inside.
    ///
    /// Each node stands for a column of material from the floor up to its height.
    pub(crate) fn distance_m(&self, p: &Vector3<f64>, reach_m: f64) -> f64 {
        if p.z <= self.height_at(p.x, p.y) && self.region().contains(p.x, p.y) {
            return 0.0;
        }
        let near = Region::new(p.x, p.y, p.x, p.y).grown(reach_m);
        let Some(near) = self.region().overlap(&near) else {
            return reach_m;
        };
        let (first_across, first_up) = self.grid_coords(near.x_min_m, near.y_min_m);
        let (last_across, last_up) = self.grid_coords(near.x_max_m, near.y_max_m);
        let mut nearest_m = reach_m;
        for row in index_from(first_up)..=index_from(last_up).min(self.n_rows - 1) {
            for col in index_from(first_across)..=index_from(last_across).min(self.n_cols - 1) {
                let over_m = (p.z - self.heights_m[row * self.n_cols + col]).max(0.0);
                let dx_m = p.x - self.x_min_m - col as f64 * self.pitch_m;
                let dy_m = p.y - self.y_min_m - row as f64 * self.pitch_m;
                nearest_m = nearest_m.min(Vector3::new(dx_m, dy_m, over_m).norm());
            }
        }
        nearest_m
    }
}

/// The maximum pyramid over the cells of a field.
fn pyramid(heights_m: &[f64], n_cols: usize, n_rows: usize) -> Vec<PeakLevel> {
    let (cell_cols, cell_rows) = (n_cols - 1, n_rows - 1);
    let cell_peak = |i: usize| {
        let low = i / cell_cols * n_cols + i % cell_cols;
        let corners = [low, low + 1, low + n_cols, low + n_cols + 1];
        corners.iter().map(|&node| heights_m[node]).fold(0.0, f64::max)
    };
    let peaks_m = (0..cell_cols * cell_rows).map(cell_peak).collect();
    let mut levels = vec![PeakLevel { n_cols: cell_cols, peaks_m }];
    while levels.len() < N_LEVELS {
        let next = levels.last().and_then(coarser);
        let Some(next) = next else { break };
        levels.push(next);
    }
    levels
}

/// The next level: the highest of every 2 × 2 blocks; `None` above a single block.
fn coarser(fine: &PeakLevel) -> Option<PeakLevel> {
    let fine_rows = fine.peaks_m.len() / fine.n_cols;
    if fine.peaks_m.len() < 2 {
        return None;
    }
    let n_cols = fine.n_cols.div_ceil(2);
    let mut peaks_m = vec![0.0_f64; n_cols * fine_rows.div_ceil(2)];
    for (i, peak_m) in fine.peaks_m.iter().enumerate() {
        let block = i / fine.n_cols / 2 * n_cols + i % fine.n_cols / 2;
        peaks_m[block] = peaks_m[block].max(*peak_m);
    }
    Some(PeakLevel { n_cols, peaks_m })
}

/// The whole part of a number from zero up; 0 for anything below.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a float-to-integer cast saturates, and callers limit the result"
)]
pub(crate) fn index_from(value: f64) -> usize {
    value as usize
}
