//! What the vehicle keeps away from: walls, ceiling, obstacles, the material, the fence.
//!
//! The vehicle is a ball of radius r about the body origin. A place is clear if
//!
//! ```text
//! distance to walls, ceiling, obstacles ≥ r + margin
//! height                                ≥ surface + r + clearance,   surface = h + 3σ of a map, or
//!                                                                    the highest level of any pile
//! inside the fence and between its heights
//! ```
//! and a straight way is clear if every place of it is. Walls, obstacles and fence are judged
//! exactly along the whole way, the surface never too favourably; nothing is sampled, so no thin
//! wall is stepped over.

use super::space::SpaceSettings;
use crate::mapping::polygon::Polygon;
use crate::mapping::solid;
use crate::messages::{GridGeometry, HeightMap};
use nalgebra::Vector3;
use std::sync::Arc;

/// By how much a place or a way misses what is demanded, m; 0 where it does not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shortfall {
    /// To walls, ceiling, obstacles and fence; infinite where it touches or leaves them.
    pub around_m: f64,
    /// To the material below.
    pub below_m: f64,
}

impl Shortfall {
    /// Nothing is missing.
    pub const NONE: Self = Self { around_m: 0.0, below_m: 0.0 };

    /// True if no more is missing than in `allowed`.
    #[must_use]
    pub fn is_within(&self, allowed: &Self) -> bool {
        self.around_m <= allowed.around_m && self.below_m <= allowed.below_m
    }
}

/// Judges places and ways by geometry alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Clearance {
    settings: Arc<SpaceSettings>,
    surface: Option<Arc<SurfaceTop>>,
}

/// Heights carry rounding of this size, m: a place exactly at its limit is clear.
const ROUNDING_M: f64 = 1e-9;

impl Clearance {
    /// Over piles of the configured highest level.
    #[must_use]
    pub const fn new(settings: Arc<SpaceSettings>) -> Self {
        Self { settings, surface: None }
    }

    /// The same with what a map says of the surface: h + 3σ, though never above the highest level
    /// that any pile has. Outside of the map that level stays.
    #[must_use]
    pub fn with_surface(&self, map: &HeightMap) -> Self {
        let s = &self.settings;
        let top = SurfaceTop::new(map, s.highest_surface_m, s.vehicle_radius_m);
        Self { settings: Arc::clone(&self.settings), surface: Some(Arc::new(top)) }
    }

    /// What is kept away from.
    #[must_use]
    pub fn settings(&self) -> &SpaceSettings {
        &self.settings
    }

    /// True if the vehicle may be at this place, m in the hall.
    #[must_use]
    pub fn is_clear(&self, place: &Vector3<f64>) -> bool {
        self.shortfall(place, place).is_within(&Shortfall::NONE)
    }

    /// True if the vehicle may fly the straight way.
    #[must_use]
    pub fn is_way_clear(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> bool {
        self.shortfall(from, to).is_within(&Shortfall::NONE)
    }

    /// What is missing where it is worst along the straight way.
    #[must_use]
    pub fn shortfall(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Shortfall {
        let (low_m, high_m) = (from.z.min(to.z), from.z.max(to.z));
        let above_m = self.height_shortfall_m(low_m, high_m);
        let around_m = above_m
            .max(self.wall_shortfall_m(from, to))
            .max(self.fence_shortfall_m(from, to))
            .max(self.obstacle_shortfall_m(from, to));
        Shortfall { around_m, below_m: self.surface_shortfall_m(from, to) }
    }

    fn keep_off_m(&self) -> f64 {
        self.settings.vehicle_radius_m + self.settings.margin_m
    }

    /// Ceiling and the fence's heights.
    fn height_shortfall_m(&self, low_m: f64, high_m: f64) -> f64 {
        let s = &self.settings;
        let ceiling = s.ceiling_m.map_or(0.0, |ceiling_m| {
            let room_m = ceiling_m - high_m;
            if room_m <= 0.0 { f64::INFINITY } else { missing_m(room_m, self.keep_off_m()) }
        });
        let fence = s.fence.as_ref().map_or(0.0, |fence| {
            missing_m(low_m, fence.min_height_m).max(missing_m(fence.max_height_m, high_m))
        });
        ceiling.max(fence)
    }

    fn wall_shortfall_m(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
        let Some(walls) = &self.settings.walls else { return 0.0 };
        match depth_m(walls, from, to) {
            depth_m if depth_m <= 0.0 => f64::INFINITY,
            depth_m => missing_m(depth_m, self.keep_off_m()),
        }
    }

    /// The body origin stays inside; the fence is no wall.
    fn fence_shortfall_m(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
        let outline = self.settings.fence.as_ref().and_then(|fence| fence.outline.as_ref());
        outline.map_or(0.0, |outline| match depth_m(outline, from, to) {
            depth_m if depth_m < 0.0 => -depth_m,
            _ => 0.0,
        })
    }

    fn obstacle_shortfall_m(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
        let keep_off_m = self.keep_off_m();
        let obstacles = &self.settings.obstacles;
        match solid::way_distance_m(obstacles, from, to, keep_off_m) {
            distance_m if distance_m <= 0.0 => f64::INFINITY,
            distance_m => missing_m(distance_m, keep_off_m),
        }
    }

    fn surface_shortfall_m(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
        let s = &self.settings;
        let least_m = s.vehicle_radius_m + s.surface_clearance_m;
        let flat_m =
            s.highest_surface_m.map_or(0.0, |top_m| missing_m(from.z.min(to.z), top_m + least_m));
        match &self.surface {
            Some(surface) if flat_m > 0.0 => surface.shortfall_m(from, to, least_m),
            // Nothing is higher than the highest level.
            _ => flat_m,
        }
    }
}

/// How much `have_m` is short of `need_m`, m.
fn missing_m(have_m: f64, need_m: f64) -> f64 {
    if have_m >= need_m - ROUNDING_M { 0.0 } else { need_m - have_m }
}

/// How deep a way lies inside a polygon where it comes nearest to the border, m; for a way that is
/// not inside altogether, minus how far its ends are outside, and 0 for one that is outside between.
fn depth_m(polygon: &Polygon, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let (a, b) = ((from.x, from.y), (to.x, to.y));
    let outside_m = polygon.distance_m(a.0, a.1).max(polygon.distance_m(b.0, b.1));
    if outside_m > 0.0 { -outside_m } else { polygon.border_distance_of_line_m(a, b) }
}

/// The highest that the surface may be, widened by the vehicle's radius.
#[derive(Debug, Clone, PartialEq)]
struct SurfaceTop {
    grid: GridGeometry,
    /// Highest top within reach of any place of the cell, m.
    widened_m: Vec<f64>,
    /// Outside of the grid, m.
    elsewhere_m: Option<f64>,
}

/// The surface counts this many of its σ higher.
const N_SIGMA: f64 = 3.0;

impl SurfaceTop {
    fn new(map: &HeightMap, highest_m: Option<f64>, radius_m: f64) -> Self {
        let grid = map.grid;
        let cap_m = highest_m.unwrap_or(f64::INFINITY);
        let tops_m: Vec<f64> = std::iter::zip(&map.mean_m, &map.sigma_m)
            .map(|(mean_m, sigma_m)| {
                let top_m = mean_m + N_SIGMA * sigma_m;
                // A cell that nobody knows may be as high as any.
                if top_m.is_finite() { top_m.min(cap_m) } else { cap_m }
            })
            .collect();
        // Between the middles of the cells of the looked-at place and of the material: the radius,
        // half a step of the way, and half a diagonal for each cell.
        let reach_m = radius_m + (0.5 + std::f64::consts::SQRT_2) * grid.cell_m;
        Self { widened_m: widened(&grid, &tops_m, reach_m), grid, elsewhere_m: highest_m }
    }

    /// What is missing along the way; it is looked at every cell, each time for half a cell around.
    fn shortfall_m(&self, from: &Vector3<f64>, to: &Vector3<f64>, least_m: f64) -> f64 {
        let along = to - from;
        let n_steps = (along.xy().norm() / self.grid.cell_m).ceil().max(1.0);
        let half_climb_m = 0.5 * along.z.abs() / n_steps;
        let mut worst_m = 0.0_f64;
        let mut k = 0.5;
        while k < n_steps {
            let p = from + along * (k / n_steps);
            if let Some(top_m) = self.top_m(p.x, p.y) {
                worst_m = worst_m.max(missing_m(p.z - half_climb_m, top_m + least_m));
            }
            k += 1.0;
        }
        worst_m
    }

    fn top_m(&self, x_m: f64, y_m: f64) -> Option<f64> {
        self.grid.cell_at(x_m, y_m).map_or(self.elsewhere_m, |cell| Some(self.widened_m[cell]))
    }
}

/// The largest value within `reach_m` of each cell's middle.
fn widened(grid: &GridGeometry, values: &[f64], reach_m: f64) -> Vec<f64> {
    let near: Vec<(usize, usize)> = (0..grid.n_rows)
        .flat_map(|row| (0..grid.n_cols).map(move |col| (col, row)))
        .take_while(|(_, row)| offset_m(*row, grid.cell_m) <= reach_m)
        .filter(|(col, row)| {
            offset_m(*col, grid.cell_m).hypot(offset_m(*row, grid.cell_m)) <= reach_m
        })
        .collect();
    let largest_at = |col: usize, row: usize| {
        let mut largest = f64::NEG_INFINITY;
        for (across, up) in &near {
            let cols = [col.checked_sub(*across), Some(col + across).filter(|c| *c < grid.n_cols)];
            let rows = [row.checked_sub(*up), Some(row + up).filter(|r| *r < grid.n_rows)];
            for near_row in rows.into_iter().flatten() {
                for near_col in cols.into_iter().flatten() {
                    largest = largest.max(values[grid.index(near_col, near_row)]);
                }
            }
        }
        largest
    };
    (0..grid.n_rows)
        .flat_map(|row| (0..grid.n_cols).map(move |col| (col, row)))
        .map(|(col, row)| largest_at(col, row))
        .collect()
}

#[expect(clippy::cast_precision_loss, reason = "cell counts stay far below 2^53")]
fn offset_m(n_cells: usize, cell_m: f64) -> f64 {
    n_cells as f64 * cell_m
}

#[cfg(test)]
mod tests;
