//! The newest surface as planners look at it: what hides what.

use crate::mapping::KnownHeights;
use nalgebra::{Vector2, Vector3};

/// The ray is looked at this often, in cells.
const STEP_CELLS: f64 = 0.8;
/// A cell hides what is behind it only if it stands this far above the ray, in cells.
const CLEARANCE_CELLS: f64 = 0.4;

/// Ground that no ray has reached yet lies so much lower than the surface drawn over it, m.
const HOLLOW_M: f64 = 0.5;

/// Share of the ground at `end` (x, y) that is seen from `origin`: none behind ground that the map
/// knows; else all of it where the map knows it, and `unknown_ratio` where it does not.
#[must_use]
pub fn seen_ratio(
    heights: &KnownHeights,
    origin: &Vector3<f64>,
    end: &Vector2<f64>,
    unknown_ratio: f64,
) -> f64 {
    let Some(end_cell) = heights.grid.cell_at(end.x, end.y) else { return 0.0 };
    // Ground is unknown because it was hidden so far: it lies low rather than high.
    let hollow_m = if heights.is_known[end_cell] { 0.0 } else { HOLLOW_M };
    let target = Vector3::new(end.x, end.y, heights.height_m[end_cell] - hollow_m);
    let way_m = (target - origin).xy().norm();
    let cell_m = heights.grid.cell_m;
    let n_parts = (way_m / (STEP_CELLS * cell_m)).ceil().max(1.0);
    let step = (origin - target) / n_parts;
    // From the end, where the ray is lowest; the first cell is the ground itself.
    let mut on_ray = target + step;
    let mut k = 1.0;
    while k < n_parts && on_ray.z <= heights.highest_m {
        let hides = heights.grid.cell_at(on_ray.x, on_ray.y).is_some_and(|cell| {
            heights.is_known[cell] && heights.height_m[cell] > on_ray.z + CLEARANCE_CELLS * cell_m
        });
        if hides {
            return 0.0;
        }
        on_ray += step;
        k += 1.0;
    }
    if heights.is_known[end_cell] { 1.0 } else { unknown_ratio }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::GridGeometry;

    /// A level floor with a wall of 2 m at x = 5 m; nothing is known beyond x = 8 m.
    fn hall() -> KnownHeights {
        let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 48, n_rows: 4 };
        let x_m = |cell: usize| grid.centre_m(cell).0;
        KnownHeights {
            grid,
            height_m: (0..grid.n_cells())
                .map(|cell| if (5.0..5.25).contains(&x_m(cell)) { 2.0 } else { 0.0 })
                .collect(),
            is_known: (0..grid.n_cells()).map(|cell| x_m(cell) < 8.0).collect(),
            highest_m: 2.0,
        }
    }

    #[test]
    fn a_wall_hides_the_ground_behind_it_and_nothing_else() {
        let heights = hall();
        let seen = |height_m: f64, x_m: f64| {
            let origin = Vector3::new(1.0, 0.5, height_m);
            seen_ratio(&heights, &origin, &Vector2::new(x_m, 0.5), 0.7)
        };
        // From 4 m over x = 1 m the ray over the wall's far top at x = 5.25 m meets the floor at x = 9.5 m,
        // and unknown ground, which is looked for half a metre lower, at x = 10.6 m.
        let is = |(height_m, x_m): (f64, f64), ratio: f64| {
            assert!((seen(height_m, x_m) - ratio).abs() < 1e-12, "{height_m} m, x = {x_m} m");
        };
        [3.0, 4.5].iter().for_each(|x_m| is((4.0, *x_m), 1.0));
        [6.0, 7.5, 8.5, 9.8].iter().for_each(|x_m| is((4.0, *x_m), 0.0));
        is((4.0, 11.2), 0.7);
        // From 16 m the shadow is less than 0.6 m long.
        is((16.0, 6.0), 1.0);
        is((16.0, 8.5), 0.7);
        // Off the map.
        is((4.0, 12.0), 0.0);
    }
}
