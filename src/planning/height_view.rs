//! The newest surface as planners look at it: what hides what.

use crate::messages::GridGeometry;
use nalgebra::{Vector2, Vector3};

/// Heights of the cells of the map that are known.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightView {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// Height of each cell, m; NaN where nothing was seen.
    pub height_m: Vec<f64>,
}

/// The ray is looked at this often, in cells.
const STEP_CELLS: f64 = 1.5;
/// A cell hides what is behind it only if it stands this far above the ray, in cells.
const CLEARANCE_CELLS: f64 = 0.4;

impl HeightView {
    /// Height of the surface at (x, y), m, where it is known.
    #[must_use]
    pub fn height_m(&self, x_m: f64, y_m: f64) -> Option<f64> {
        let height_m = self.height_m[self.grid.cell_at(x_m, y_m)?];
        height_m.is_finite().then_some(height_m)
    }

    /// Share of the ground at `end` that is seen from `origin`: 0 or 1 where the map knows it, else
    /// 0 behind what the map knows and `unknown_ratio` elsewhere. Ground that is not known is taken
    /// to lie as high as `level_m`.
    #[must_use]
    pub fn seen_ratio(
        &self,
        origin: &Vector3<f64>,
        end: &Vector2<f64>,
        level_m: f64,
        unknown_ratio: f64,
    ) -> f64 {
        let known_m = self.height_m(end.x, end.y);
        let target = Vector3::new(end.x, end.y, known_m.unwrap_or(level_m));
        let way_m = (target - origin).xy().norm();
        let clearance_m = CLEARANCE_CELLS * self.grid.cell_m;
        let n_parts = (way_m / (STEP_CELLS * self.grid.cell_m)).ceil().max(1.0);
        // From the end, where the ray is lowest; the first cell is the ground itself.
        let mut k = 1.0;
        while k < n_parts {
            let on_ray = target.lerp(origin, k / n_parts);
            let ground_m = self.height_m(on_ray.x, on_ray.y);
            if ground_m.is_some_and(|ground_m| ground_m > on_ray.z + clearance_m) {
                return 0.0;
            }
            k += 1.0;
        }
        if known_m.is_some() { 1.0 } else { unknown_ratio }
    }
}
