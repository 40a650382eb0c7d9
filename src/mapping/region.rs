//! Which part of the hall is measured, and what of it does not count.

use super::base::BaseSurface;
use super::bay::{Bay, BayError, BayOnGrid, WHOLE_REGION, check_outlines};
use super::clip::{Part, part_of};
use super::polygon::{Place, Polygon};
use super::volume::Base;
use crate::messages::GridGeometry;

pub use super::rect::Rect;

/// What stands in the region: not material, not measured.
#[derive(Debug, Clone, PartialEq)]
pub enum Footprint {
    /// A rectangle along the hall's axes. Its margin has square corners.
    Rect(Rect),
    /// Any polygon. Its margin is round.
    Polygon(Polygon),
}

impl From<Rect> for Footprint {
    fn from(rect: Rect) -> Self {
        Self::Rect(rect)
    }
}

impl Footprint {
    /// True if (x, y) lies inside or at most `margin_m` beside it.
    #[must_use]
    pub fn contains(&self, x_m: f64, y_m: f64, margin_m: f64) -> bool {
        match self {
            Self::Rect(rect) => rect.contains(x_m, y_m, margin_m),
            Self::Polygon(polygon) => polygon.is_within(x_m, y_m, margin_m),
        }
    }

    /// True if the straight line between two points (x, y) touches it.
    #[must_use]
    pub fn cuts(&self, a: Place, b: Place) -> bool {
        match self {
            Self::Rect(rect) => rect.cuts(a, b),
            Self::Polygon(polygon) => polygon.cuts(a, b),
        }
    }

    fn to_polygon(&self) -> Polygon {
        match self {
            Self::Rect(rect) => Polygon::from(*rect),
            Self::Polygon(polygon) => polygon.clone(),
        }
    }
}

/// The region of interest D, its bays and what stands in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// The region of interest.
    pub bounds: Rect,
    /// Footprints of walls, machines, beams.
    pub exclusions: Vec<Footprint>,
    /// Hits this close to an exclusion are left out as well, m.
    pub exclusion_margin_m: f64,
    /// What is measured for itself; if empty, the whole region is one bay.
    pub bays: Vec<Bay>,
}

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

    /// True if a hit at (x, y) may be used; one nearer than `border_m` to the region's border may not.
    #[must_use]
    pub fn accepts(&self, x_m: f64, y_m: f64, border_m: f64) -> bool {
        self.bounds.contains(x_m, y_m, -border_m)
            && !self.exclusions.iter().any(|e| e.contains(x_m, y_m, self.exclusion_margin_m))
    }

    /// True if an exclusion stands between two points (x, y): what lies on one side of a wall says
    /// nothing about the other.
    #[must_use]
    pub fn separates(&self, a: (f64, f64), b: (f64, f64)) -> bool {
        self.exclusions.iter().any(|exclusion| exclusion.cuts(a, b))
    }

    /// The point itself, or if it lies in an exclusion the nearest one outside, looked for on a
    /// lattice over the square of edge `reach_m` around it; the point itself if there is none.
    #[must_use]
    pub fn beside_exclusions(&self, place: Place, reach_m: f64) -> Place {
        const PARTS: i32 = 8;
        let is_outside =
            |p: &Place| !self.exclusions.iter().any(|exclusion| exclusion.contains(p.0, p.1, 0.0));
        if is_outside(&place) {
            return place;
        }
        let step_m = reach_m / f64::from(2 * PARTS);
        let offsets = || (-PARTS..=PARTS).map(|k| f64::from(k) * step_m);
        let distance = |p: &Place| (p.0 - place.0).hypot(p.1 - place.1);
        offsets()
            .flat_map(|dy| offsets().map(move |dx| (place.0 + dx, place.1 + dy)))
            .filter(is_outside)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap_or(place)
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
        let mut areas_m2 = vec![0.0; grid.n_cells()];
        for (cell, part) in self.parts_of(&Polygon::from(self.bounds), grid) {
            areas_m2[cell] = part.area_m2;
        }
        areas_m2
    }

    /// The bays on a grid; without any, the whole region over `hall_base`.
    ///
    /// Ground where an earlier survey as a base has no height does not count;
    /// [`Self::check_bays`] refuses such bays before a flight.
    #[must_use]
    pub fn bays_on(&self, grid: &GridGeometry, hall_base: &BaseSurface) -> Vec<BayOnGrid> {
        if self.bays.is_empty() {
            let bay = Bay {
                name: WHOLE_REGION.to_owned(),
                outline: Polygon::from(self.bounds),
                base: hall_base.clone(),
                density: None,
            };
            return vec![bay.on_grid(self, grid)];
        }
        self.bays.iter().map(|bay| bay.on_grid(self, grid)).collect()
    }

    /// The whole hall first, then its bays, if there are any: what volumes are stated of.
    ///
    /// Bays over the same base share its errors, so they add up in the hall's.
    #[must_use]
    pub fn whole_and_bays_on(
        &self,
        grid: &GridGeometry,
        hall_base: &BaseSurface,
    ) -> Vec<BayOnGrid> {
        let mut bays = self.bays_on(grid, hall_base);
        if self.bays.len() <= 1 && bays[0].name == WHOLE_REGION {
            return bays;
        }
        let mut base = Base::total(bays.iter().map(|bay| &bay.base), grid.n_cells());
        let surfaces: Vec<&BaseSurface> = self.bays.iter().map(|bay| &bay.base).collect();
        for (index, surface) in surfaces.iter().enumerate() {
            if surfaces[..index].contains(surface) {
                continue;
            }
            let on_it = std::iter::zip(&surfaces, &bays).filter(|(other, _)| other == &surface);
            let areas: Vec<(Place, f64)> =
                on_it.flat_map(|(_, bay)| bay.areas.iter().copied()).collect();
            base.errors.extend(surface.errors(&areas));
        }
        // Tonnes add up without further ado for one material only.
        let density =
            bays[0].density.filter(|_| bays.iter().all(|bay| bay.density == bays[0].density));
        let areas = bays.iter().flat_map(|bay| bay.areas.iter().copied()).collect();
        let is_over_survey = bays.iter().all(|bay| bay.is_over_survey);
        let name = WHOLE_REGION.to_owned();
        bays.insert(0, BayOnGrid { name, base, areas, is_over_survey, density });
        bays
    }

    /// Checks that the bays lie in the region and do not overlap, that something is left of each,
    /// and that there is a base everywhere below it.
    ///
    /// # Errors
    /// The first bay that does not fit.
    pub fn check_bays(&self, grid: &GridGeometry) -> Result<(), BayError> {
        check_outlines(&self.bays, &self.bounds)?;
        self.bays.iter().try_for_each(|bay| bay.check_ground(self, grid))
    }

    /// What every cell has of an outline, inside the region and outside of the exclusions; cells
    /// with nothing of it are left out.
    #[must_use]
    pub(super) fn parts_of(&self, outline: &Polygon, grid: &GridGeometry) -> Vec<(usize, Part)> {
        let bounds = Polygon::from(self.bounds);
        let exclusions: Vec<Polygon> = self.exclusions.iter().map(Footprint::to_polygon).collect();
        let inside = [&bounds, outline];
        let outside: Vec<&Polygon> = exclusions.iter().collect();
        let is_cut = cells_on_borders(grid, inside.into_iter().chain(&exclusions));
        let part = |cell: usize| {
            let (x, y) = grid.centre_m(cell);
            if is_cut[cell] {
                return part_of(&cell_rect(grid, cell), &inside, &outside);
            }
            let counts = inside.iter().all(|polygon| polygon.contains(x, y))
                && !exclusions.iter().any(|polygon| polygon.contains(x, y));
            let area_m2 = if counts { grid.cell_area_m2() } else { 0.0 };
            Part { area_m2, centroid_m: (x, y) }
        };
        (0..grid.n_cells())
            .map(|cell| (cell, part(cell)))
            .filter(|(_, part)| part.area_m2 > 0.0)
            .collect()
    }
}

/// A cell as a rectangle; neighbours share their sides to the last bit.
#[expect(clippy::cast_precision_loss, reason = "cell counts stay far below 2^53")]
fn cell_rect(grid: &GridGeometry, index: usize) -> Rect {
    let (row, col) = (index / grid.n_cols, index % grid.n_cols);
    let x_m = |col: usize| grid.x_min_m + col as f64 * grid.cell_m;
    let y_m = |row: usize| grid.y_min_m + row as f64 * grid.cell_m;
    Rect { x_min_m: x_m(col), y_min_m: y_m(row), x_max_m: x_m(col + 1), y_max_m: y_m(row + 1) }
}

/// True for every cell that an edge of the polygons may touch.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "numbers are clamped to the grid before the cast"
)]
fn cells_on_borders<'a>(
    grid: &GridGeometry,
    polygons: impl Iterator<Item = &'a Polygon>,
) -> Vec<bool> {
    let mut is_cut = vec![false; grid.n_cells()];
    // In cells, and a little wider, so that an edge on the line between cells marks both.
    let cells = |value: f64, first: f64| (value - first) / grid.cell_m;
    let range = |a: f64, b: f64, n: usize| {
        let low = (a.min(b) - 1e-6).floor().clamp(0.0, n as f64);
        let high = ((a.max(b) + 1e-6).floor() + 1.0).clamp(0.0, n as f64);
        low as usize..high as usize
    };
    for (a, b) in polygons.flat_map(Polygon::edges) {
        let (ax, ay) = (cells(a.0, grid.x_min_m), cells(a.1, grid.y_min_m));
        let (bx, by) = (cells(b.0, grid.x_min_m), cells(b.1, grid.y_min_m));
        for row in range(ay, by, grid.n_rows) {
            // The edge's x within this row.
            let x_at = |y: f64| {
                let along = ((y - ay) / (by - ay)).clamp(0.0, 1.0);
                if along.is_finite() { ax + along * (bx - ax) } else { ax }
            };
            let is_level = (by - ay).abs() < 1e-9;
            let (low, high) =
                if is_level { (ax, bx) } else { (x_at(row as f64), x_at(row as f64 + 1.0)) };
            for col in range(low, high, grid.n_cols) {
                is_cut[grid.index(col, row)] = true;
            }
        }
    }
    is_cut
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_add_up_to_the_region_without_its_exclusions() {
        let region = Region {
            bounds: Rect { x_min_m: -1.0, y_min_m: 2.0, x_max_m: 14.8, y_max_m: 17.3 },
            exclusions: vec![
                Rect { x_min_m: 3.0, y_min_m: 4.0, x_max_m: 3.3, y_max_m: 9.0 }.into(),
                Rect { x_min_m: 3.0, y_min_m: 8.7, x_max_m: 7.0, y_max_m: 9.0 }.into(),
            ],
            exclusion_margin_m: 0.1,
            bays: Vec::new(),
        };
        let grid = region.grid(0.25);
        assert_eq!((grid.n_cols, grid.n_rows), (64, 62));
        let total: f64 = region.cell_areas_m2(&grid).iter().sum();
        // 15.8 × 15.3 − 0.3 × 5 − 4 × 0.3 + 0.3 × 0.3 (the corner belongs to both walls)
        let expected = 15.8 * 15.3 - 1.5 - 1.2 + 0.09;
        assert!((total - expected).abs() < 1e-10, "{total} against {expected}");
    }

    #[test]
    fn whole_cells_do_not_gain_a_column() {
        let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 20.0, y_max_m: 20.0 };
        let region = Region { bounds, exclusions: vec![], exclusion_margin_m: 0.0, bays: vec![] };
        assert_eq!(region.grid(0.1).n_cols, 200);
        assert!(!region.accepts(20.01, 3.0, 0.0) && region.accepts(19.99, 3.0, 0.0));
        assert!(!region.accepts(19.99, 3.0, 0.03) && region.accepts(19.96, 3.0, 0.03));
    }

    #[test]
    fn a_point_in_a_wall_moves_to_the_nearest_ground() {
        let wall = Rect { x_min_m: 2.0, y_min_m: 0.0, x_max_m: 2.3, y_max_m: 5.0 };
        let region = Region {
            bounds: Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 6.0, y_max_m: 6.0 },
            exclusions: vec![wall.into()],
            exclusion_margin_m: 0.0,
            bays: Vec::new(),
        };
        let (x, y) = region.beside_exclusions((2.22, 3.0), 0.5);
        assert!((2.3..2.3 + 0.5 / 16.0 + 1e-9).contains(&x) && (y - 3.0).abs() < 1e-12, "{x} {y}");
        assert_eq!(region.beside_exclusions((1.0, 1.0), 0.5), (1.0, 1.0));
        // Too deep inside to find a way out.
        assert_eq!(region.beside_exclusions((2.15, 2.0), 0.1), (2.15, 2.0));
    }
}
