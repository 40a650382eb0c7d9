//! The newest surface as planners look at it: what hides what.
//!
//! ```text
//!   LiDAR ●
//!            ╲  over the highest crest between
//!      ╱╲       ╲
//!     ╱  ╲________╲ lowest height that is seen there, h_min
//! ```
//! Known ground is seen where it is no lower. Of unknown ground the height is a guess, below every ray that has passed
//! over it, so it is seen with
//!
//! ```text
//! P(h > h_min | f < h < u),   h ~ N(m, s²)
//! ```
//! - `m`, `s`: guess and its standard deviation, m, the guess taken half of that below the surface drawn there: ground is
//!   unknown because it was hidden so far, so it lies low rather than high
//! - `f`: the lowest base, m; `u`: what rays that passed over it leave, m. A look that reaches no lower than those before, or
//!   lower by less than rays are apart, sees nothing new.

use crate::mapping::KnownHeights;
use nalgebra::{Vector2, Vector3};

/// The ray is looked at this often, in cells.
const STEP_CELLS: f64 = 0.8;
/// Known ground is hidden only by what stands this far above the ray, in cells; unknown ground is seen only by a ray that
/// passes so far above what stands between.
const CLEARANCE_CELLS: f64 = 0.4;
/// A look must reach this much lower than those before, in cells.
const LOWER_CELLS: f64 = 0.5;
/// Unknown ground lies so much lower than the surface drawn over it, in its σ.
const HOLLOW_SIGMAS: f64 = 0.5;
/// … and hardly farther from that than this many.
const FAR_SIGMAS: f64 = 3.0;
/// A floor and a ceiling that leave the guess less than this contradict it.
const LEAST_POSSIBLE: f64 = 1e-6;

/// Share of the ground at `end` (x, y) that is seen from `origin`: all or none where the map knows it, else the
/// probability that it stands high enough.
#[must_use]
pub fn seen_ratio(heights: &KnownHeights, origin: &Vector3<f64>, end: &Vector2<f64>) -> f64 {
    let Some(cell) = heights.grid.cell_at(end.x, end.y) else { return 0.0 };
    let drawn_m = heights.height_m[cell];
    let clearance_m = CLEARANCE_CELLS * heights.grid.cell_m;
    let span = |low_m: f64, high_m: f64| Span { place: *end, low_m, high_m };
    if heights.is_known[cell] {
        let least_m = least_visible_m(heights, origin, &span(drawn_m, drawn_m), -clearance_m);
        return if least_m > drawn_m { 0.0 } else { 1.0 };
    }
    let sigma_m = heights.sigma_m[cell].max(1e-6);
    let guess_m = drawn_m - HOLLOW_SIGMAS * sigma_m;
    let (floor_m, ceiling_m) = (heights.floor_m, heights.ceiling_m[cell]);
    let below = |height_m: f64| normal_cdf((height_m - guess_m) / sigma_m);
    let (floor, ceiling) = (below(floor_m), below(ceiling_m));
    if ceiling - floor < LEAST_POSSIBLE {
        // Neither is as sure as that: the ground is at the one that is nearer to the guess.
        let height_m = if guess_m > ceiling_m { ceiling_m } else { guess_m.max(floor_m) };
        let least_m = least_visible_m(heights, origin, &span(height_m, height_m), clearance_m);
        return if least_m > height_m { 0.0 } else { 1.0 };
    }
    let far_m = FAR_SIGMAS * sigma_m;
    let low_m = (guess_m - far_m).max(floor_m);
    let high_m = (guess_m + far_m).min(ceiling_m);
    let least_m = least_visible_m(heights, origin, &span(low_m, high_m), clearance_m);
    if least_m >= high_m.min(ceiling_m - LOWER_CELLS * heights.grid.cell_m) {
        return 0.0;
    }
    ((ceiling - below(least_m).max(floor)) / (ceiling - floor)).clamp(0.0, 1.0)
}

/// Where ground may lie.
struct Span {
    /// x and y, m.
    place: Vector2<f64>,
    low_m: f64,
    high_m: f64,
}

/// The lowest height that is seen there from `origin` by rays that pass this far above the known ground between, m;
/// minus infinity if all of the span is, and no more exact than needed if none is.
fn least_visible_m(
    heights: &KnownHeights,
    origin: &Vector3<f64>,
    span: &Span,
    clearance_m: f64,
) -> f64 {
    let target = Vector3::new(span.place.x, span.place.y, span.low_m);
    let way_m = (target - origin).xy().norm();
    let n_parts = (way_m / (STEP_CELLS * heights.grid.cell_m)).ceil().max(1.0);
    let step = (origin - target) / n_parts;
    let mut least_m = f64::NEG_INFINITY;
    // From the end, where the ray is lowest; the first cell is the ground itself.
    let mut on_ray = target + step;
    let mut k = 1.0;
    while k < n_parts && on_ray.z <= heights.highest_m + clearance_m && least_m <= span.high_m {
        let cell = heights.grid.cell_at(on_ray.x, on_ray.y);
        if let Some(cell) = cell.filter(|cell| heights.is_known[*cell]) {
            let top_m = heights.height_m[cell] + clearance_m;
            // The ray over this cell, followed to the end.
            least_m = least_m.max(origin.z - (origin.z - top_m) * n_parts / (n_parts - k));
        }
        on_ray += step;
        k += 1.0;
    }
    least_m
}

/// Φ of the standard normal distribution.
fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::GridGeometry;

    const SIGMA_M: f64 = 0.5;

    /// A level floor with a wall of 2 m at x = 5 m; nothing is known beyond x = 8 m.
    fn hall() -> KnownHeights {
        let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 48, n_rows: 4 };
        let x_m = |cell: usize| grid.centre_m(cell).0;
        let height_m = |cell| if (5.0..5.25).contains(&x_m(cell)) { 2.0 } else { 0.0 };
        let heights_m = (0..grid.n_cells()).map(height_m).collect();
        let is_known = (0..grid.n_cells()).map(|cell| x_m(cell) < 8.0).collect();
        KnownHeights::new(grid, heights_m, is_known, SIGMA_M)
    }

    fn seen(heights: &KnownHeights, height_m: f64, x_m: f64) -> f64 {
        let origin = Vector3::new(1.0, 0.5, height_m);
        seen_ratio(heights, &origin, &Vector2::new(x_m, 0.5))
    }

    #[test]
    fn a_wall_hides_the_known_ground_behind_it_and_nothing_else() {
        let heights = hall();
        // From 4 m over x = 1 m the ray over the wall's far top at x = 5.25 m meets the floor at x = 9.5 m.
        for (height_m, x_m, ratio) in [
            (4.0, 3.0, 1.0),
            (4.0, 4.5, 1.0),
            (4.0, 6.0, 0.0),
            (4.0, 7.5, 0.0),
            // From 16 m the shadow is less than 0.6 m long.
            (16.0, 6.0, 1.0),
            // Off the map.
            (4.0, 12.0, 0.0),
        ] {
            let got = seen(&heights, height_m, x_m);
            assert!((got - ratio).abs() < 1e-12, "{height_m} m, x = {x_m} m: {got}");
        }
    }

    #[test]
    fn unknown_ground_is_seen_as_far_as_it_may_stand_high() {
        // The guess is N(−0.25, 0.5²). At x = 8.5 m the ray 0.1 m over the wall is 0.65 m high if it touches the
        // wall's far edge, and 0.48 m one step before it: upper tails of 1.79 σ and 1.46 σ (Abramowitz and Stegun,
        // table 26.1).
        let mut heights = hall();
        let free = seen(&heights, 4.0, 8.5);
        assert!((0.0367..0.0722).contains(&free), "{free}");
        // A floor at 0 m leaves the upper tail of 0.5 σ, 0.3085, to be shared out.
        heights.floor_m = 0.0;
        let floored = seen(&heights, 4.0, 8.5);
        assert!((floored - free / 0.308_538).abs() < 1e-5, "{floored}");
        // Everything on that floor is seen from above, and where the shadow has ended.
        assert!((seen(&heights, 16.0, 8.5) - 1.0).abs() < 1e-12);
        assert!((seen(&heights, 4.0, 11.0) - 1.0).abs() < 1e-12);
        // Rays that passed lower have shown already that nothing stands there.
        heights.ceiling_m = vec![0.45; heights.ceiling_m.len()];
        assert!(seen(&heights, 4.0, 8.5) < 1e-12);
        assert!((seen(&heights, 16.0, 8.5) - 1.0).abs() < 1e-12);
        // A look that reaches lower than they did by less than half a cell sees nothing new; one by more does.
        heights.ceiling_m = vec![0.6; heights.ceiling_m.len()];
        assert!(seen(&heights, 4.0, 8.5) < 1e-12);
        heights.ceiling_m = vec![0.78; heights.ceiling_m.len()];
        assert!(seen(&heights, 4.0, 8.5) > 1e-3);
        heights.ceiling_m = vec![-0.1; heights.ceiling_m.len()];
        // A ceiling under the floor is a small error of one of them: the ground is seen from above all the same.
        assert!((seen(&heights, 16.0, 8.5) - 1.0).abs() < 1e-12);
        assert!(seen(&heights, 4.0, 8.5) < 1e-12);
    }
}
