//! Which part of the hall is measured, and what of it does not count.

use crate::messages::GridGeometry;

/// A rectangle along the hall's axes, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Smallest x, m.
    pub x_min_m: f64,
    /// Smallest y, m.
    pub y_min_m: f64,
    /// Largest x, m.
    pub x_max_m: f64,
    /// Largest y, m.
    pub y_max_m: f64,
}

impl Rect {
    /// True if (x, y) lies in the rectangle or at most `margin_m` beside it.
    #[must_use]
    pub fn contains(&self, x_m: f64, y_m: f64, margin_m: f64) -> bool {
        x_m >= self.x_min_m - margin_m
            && x_m <= self.x_max_m + margin_m
            && y_m >= self.y_min_m - margin_m
            && y_m <= self.y_max_m + margin_m
    }

    /// True if the straight line between two points (x, y) touches the rectangle.
    ///
    /// Source: the slab test of Kay and Kajiya 1986, in two dimensions.
    #[must_use]
    pub fn cuts(&self, a: (f64, f64), b: (f64, f64)) -> bool {
        let slab = |a: f64, b: f64, low: f64, high: f64| {
            let step = b - a;
            if step == 0.0 {
                let is_between = (low..=high).contains(&a);
                return if is_between { (0.0, 1.0) } else { (1.0, 0.0) };
            }
            let (s, t) = ((low - a) / step, (high - a) / step);
            (s.min(t).max(0.0), s.max(t).min(1.0))
        };
        let (x_in, x_out) = slab(a.0, b.0, self.x_min_m, self.x_max_m);
        let (y_in, y_out) = slab(a.1, b.1, self.y_min_m, self.y_max_m);
        x_in.max(y_in) <= x_out.min(y_out)
    }

    /// Extent along x and y, m.
    #[must_use]
    pub fn size_m(&self) -> (f64, f64) {
        (self.x_max_m - self.x_min_m, self.y_max_m - self.y_min_m)
    }
}

/// The region of interest D without what stands in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// The region of interest.
    pub bounds: Rect,
    /// Footprints of walls and machines: not material, not measured.
    pub exclusions: Vec<Rect>,
    /// Hits this close to an exclusion are left out as well, m.
    pub exclusion_margin_m: f64,
}

/// Points per cell edge when areas are cut by borders: 1/32 of an edge, 8 mm at 0.25 m.
const SAMPLES_PER_EDGE: u32 = 32;

impl Region {
    /// The grid of square cells that covers the region.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a float cast to an integer saturates, and settings bound both numbers"
    )]
    pub fn grid(&self, cell_m: f64) -> GridGeometry {
        let (width_m, depth_m) = self.bounds.size_m();
        // A region that is a whole number of cells must not gain one from rounding.
        let count = |extent_m: f64| (extent_m / cell_m - 1e-9).ceil().max(1.0) as usize;
        GridGeometry {
            x_min_m: self.bounds.x_min_m,
            y_min_m: self.bounds.y_min_m,
            cell_m,
            n_cols: count(width_m),
            n_rows: count(depth_m),
        }
    }

    /// True if a hit at (x, y) may be used.
    #[must_use]
    pub fn accepts(&self, x_m: f64, y_m: f64) -> bool {
        self.bounds.contains(x_m, y_m, 0.0)
            && !self.exclusions.iter().any(|e| e.contains(x_m, y_m, self.exclusion_margin_m))
    }

    /// True if an exclusion stands between two points (x, y): what lies on one side of a wall says
    /// nothing about the other.
    #[must_use]
    pub fn separates(&self, a: (f64, f64), b: (f64, f64)) -> bool {
        self.exclusions.iter().any(|exclusion| exclusion.cuts(a, b))
    }

    /// True for every cell whose centre is within `reach_m` of an exclusion.
    #[must_use]
    pub fn cells_near_exclusions(&self, grid: &GridGeometry, reach_m: f64) -> Vec<bool> {
        let is_near = |index| {
            let (x, y) = grid.centre_m(index);
            self.exclusions.iter().any(|exclusion| exclusion.contains(x, y, reach_m))
        };
        (0..grid.n_cells()).map(is_near).collect()
    }

    /// The area of each cell that counts, m²: inside the region and outside the exclusions.
    #[must_use]
    pub fn cell_areas_m2(&self, grid: &GridGeometry) -> Vec<f64> {
        (0..grid.n_cells()).map(|index| self.cell_area_m2(grid, index)).collect()
    }

    fn cell_area_m2(&self, grid: &GridGeometry, index: usize) -> f64 {
        let (x, y) = grid.centre_m(index);
        let half_m = grid.cell_m / 2.0;
        let is_whole = self.bounds.contains(x, y, -half_m)
            && !self.exclusions.iter().any(|e| e.contains(x, y, half_m));
        if is_whole {
            return grid.cell_area_m2();
        }
        let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(SAMPLES_PER_EDGE) - 0.5;
        let counts = |i: u32, j: u32| {
            let (px, py) = (x + offset(i) * grid.cell_m, y + offset(j) * grid.cell_m);
            self.bounds.contains(px, py, 0.0)
                && !self.exclusions.iter().any(|e| e.contains(px, py, 0.0))
        };
        let n_inside = (0..SAMPLES_PER_EDGE)
            .flat_map(|j| (0..SAMPLES_PER_EDGE).map(move |i| (i, j)))
            .filter(|&(i, j)| counts(i, j))
            .fold(0.0, |n, _| n + 1.0);
        grid.cell_area_m2() * n_inside / f64::from(SAMPLES_PER_EDGE * SAMPLES_PER_EDGE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_add_up_to_the_region_without_its_exclusions() {
        let region = Region {
            bounds: Rect { x_min_m: -1.0, y_min_m: 2.0, x_max_m: 14.8, y_max_m: 17.3 },
            exclusions: vec![
                Rect { x_min_m: 3.0, y_min_m: 4.0, x_max_m: 3.3, y_max_m: 9.0 },
                Rect { x_min_m: 3.0, y_min_m: 8.7, x_max_m: 7.0, y_max_m: 9.0 },
            ],
            exclusion_margin_m: 0.1,
        };
        let grid = region.grid(0.25);
        assert_eq!((grid.n_cols, grid.n_rows), (64, 62));
        let total: f64 = region.cell_areas_m2(&grid).iter().sum();
        // 15.8 × 15.3 − 0.3 × 5 − 4 × 0.3 + 0.3 × 0.3 (the corner belongs to both walls)
        let expected = 15.8 * 15.3 - 1.5 - 1.2 + 0.09;
        // Borders are known to half a sample, 4 mm, along 80 m.
        assert!((total - expected).abs() < 0.004 * 80.0, "{total} against {expected}");
    }

    #[test]
    fn walls_separate_what_lies_on_their_sides() {
        let wall = Rect { x_min_m: 3.0, y_min_m: 4.0, x_max_m: 3.3, y_max_m: 9.0 };
        assert!(wall.cuts((2.5, 6.0), (3.8, 6.4)));
        assert!(wall.cuts((2.5, 3.5), (3.5, 4.9)), "just inside the wall's end");
        assert!(!wall.cuts((2.5, 3.0), (3.8, 3.9)), "past the wall's end");
        assert!(!wall.cuts((2.5, 6.0), (2.9, 8.0)), "on one side");
        assert!(wall.cuts((3.1, 2.0), (3.1, 5.0)), "along the wall");
        assert!(!wall.cuts((2.9, 2.0), (2.9, 5.0)), "beside the wall");
    }

    #[test]
    fn whole_cells_do_not_gain_a_column() {
        let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 20.0, y_max_m: 20.0 };
        let region = Region { bounds, exclusions: Vec::new(), exclusion_margin_m: 0.0 };
        assert_eq!(region.grid(0.1).n_cols, 200);
        assert!(!region.accepts(20.01, 3.0) && region.accepts(19.99, 3.0));
    }
}
