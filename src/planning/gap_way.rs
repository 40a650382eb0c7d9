//! The way of a flight into the gaps of a survey that is kept.
//!
//! Each gap gets passes along the heading, so that the scan plane, which stands across it, sweeps over
//! the gap from straight above: nothing hides there that a slanting view from the legs beside it did not
//! see.
//!
//! ```text
//!        ┌──────────┐
//!   ─────┼──▶───────┼─────   passes no further apart than what a look of 25° from straight down covers,
//!   ─────┼──▶───────┼─────   longer than the gap by a lead at each end
//!        └──────────┘
//! ```
//! A place of a pass where the vehicle must not be is left out; a gap of which no place is free is seen
//! from the nearest free site in reach of the beams, or not at all.

use super::free_space::FreeSpace;
use super::{Settings, Waypoint};
use crate::geometry::Point;
use crate::mapping::gaps::Gap;
use crate::messages::GridGeometry;
use nalgebra::{Rotation2, Vector2};

/// Gaps are looked into from no further off straight above than this, rad.
const LOOK_RAD: f64 = 0.44;
/// A pass is longer than its gap by this at each end, m: the vehicle may still brake there.
const LEAD_M: f64 = 1.0;

/// Ways over one gap, each to be flown from either end; none if it is out of reach.
#[must_use]
pub fn passes(
    gap: &Gap,
    grid: &GridGeometry,
    settings: &Settings,
    free_space: &FreeSpace,
) -> Vec<Vec<Waypoint>> {
    let passes: Vec<Vec<Waypoint>> = lines(gap, grid, settings)
        .into_iter()
        .map(|[from, to]| {
            let steps = from.steps_to(&to, settings.step_radius_m);
            let all = std::iter::once(from).chain(steps);
            all.filter(|waypoint| free_space.is_free(waypoint)).collect::<Vec<_>>()
        })
        .filter(|pass| !pass.is_empty())
        .collect();
    if passes.is_empty() {
        return beside(gap, settings, free_space).into_iter().collect();
    }
    passes
}

/// The ends of the passes over a gap, whether the vehicle may be there or not.
fn lines(gap: &Gap, grid: &GridGeometry, settings: &Settings) -> Vec<[Waypoint; 2]> {
    let hall_from_heading = Rotation2::new(settings.yaw_rad);
    let places: Vec<Vector2<f64>> = gap
        .cells
        .iter()
        .map(|cell| {
            let (x, y) = grid.centre_m(*cell);
            hall_from_heading.inverse() * Vector2::new(x, y)
        })
        .collect();
    let span = |of: &dyn Fn(&Vector2<f64>) -> f64, places: &[&Vector2<f64>]| {
        let values = places.iter().map(|place| of(place));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let all: Vec<&Vector2<f64>> = places.iter().collect();
    let (low_m, high_m) = span(&|p| p.y, &all);
    let over_ground_m = settings.height_m - settings.nominal_height_m;
    let spacing_m = (2.0 * over_ground_m * LOOK_RAD.tan()).max(grid.cell_m);
    let n_lines = ((high_m - low_m + grid.cell_m) / spacing_m).ceil().max(1.0);
    let step_m = (high_m - low_m) / n_lines;
    let at = |u: f64, v: f64| {
        let place = hall_from_heading * Vector2::new(u, v);
        let place = Point::new(place.x, place.y, settings.height_m);
        Waypoint { place, yaw_rad: settings.yaw_rad }
    };
    std::iter::successors(Some(0.5), |k| (k + 1.0 < n_lines).then_some(k + 1.0))
        .filter_map(|k| {
            let v = low_m + k * step_m;
            let is_of_line = |p: &&Vector2<f64>| (p.y - v).abs() <= 0.5 * (step_m + grid.cell_m);
            let of_line: Vec<&Vector2<f64>> = places.iter().filter(is_of_line).collect();
            // Two arms of a gap may leave nothing between them.
            let (from, to) = span(&|p| p.x, &of_line);
            (!of_line.is_empty()).then(|| [at(from - LEAD_M, v), at(to + LEAD_M, v)])
        })
        .collect()
}

/// The nearest free site from which beams reach the middle of a gap.
fn beside(gap: &Gap, settings: &Settings, free_space: &FreeSpace) -> Option<Vec<Waypoint>> {
    let [x, y] = gap.centre_m;
    let over_ground_m = settings.height_m - settings.nominal_height_m;
    let reach_m = over_ground_m * settings.swath_half_angle_rad.tan();
    let middle = Vector2::new(x, y);
    let off_m = |waypoint: &Waypoint| (waypoint.place.coords.xy() - middle).norm();
    free_space
        .feasible()
        .map(|site| site.waypoint)
        .filter(|waypoint| off_m(waypoint) <= reach_m)
        .min_by(|a, b| off_m(a).total_cmp(&off_m(b)))
        .map(|site| vec![site])
}

/// All passes as one way: always on to the nearest end of a pass that is left.
#[must_use]
pub fn ordered(mut passes: Vec<Vec<Waypoint>>, from: &Waypoint) -> Vec<Waypoint> {
    let mut way: Vec<Waypoint> = Vec::new();
    passes.retain(|pass| !pass.is_empty());
    while !passes.is_empty() {
        let here = *way.last().unwrap_or(from);
        let off_m = |pass: &[Waypoint], is_turned: bool| {
            let end = if is_turned { pass.last() } else { pass.first() };
            end.map_or(f64::INFINITY, |end| here.distance_m(end))
        };
        let ends = passes.iter().enumerate().flat_map(|(k, pass)| {
            [false, true].map(|is_turned| (k, is_turned, off_m(pass, is_turned)))
        });
        let Some((next, is_turned, _)) = ends.min_by(|a, b| a.2.total_cmp(&b.2)) else { break };
        let mut pass = passes.remove(next);
        if is_turned {
            pass.reverse();
        }
        way.extend(pass);
    }
    way
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::region::Rect;

    const GRID: GridGeometry =
        GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 40, n_rows: 40 };

    fn settings(yaw_rad: f64) -> Settings {
        let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 20.0, y_max_m: 20.0 };
        Settings { yaw_rad, ..Settings::over(bounds) }
    }

    /// A gap of whole cells.
    fn gap(rect: Rect) -> Gap {
        let is_inside = |cell: &usize| {
            let (x, y) = GRID.centre_m(*cell);
            (rect.x_min_m..rect.x_max_m).contains(&x) && (rect.y_min_m..rect.y_max_m).contains(&y)
        };
        let cells: Vec<usize> = (0..GRID.n_cells()).filter(is_inside).collect();
        let centre_m = [0.5 * (rect.x_min_m + rect.x_max_m), 0.5 * (rect.y_min_m + rect.y_max_m)];
        Gap { cells, area_m2: rect.size_m().0 * rect.size_m().1, centre_m, share: 0.1 }
    }

    #[test]
    fn a_small_gap_is_crossed_once_through_its_middle() {
        let rect = Rect { x_min_m: 4.0, y_min_m: 10.0, x_max_m: 7.0, y_max_m: 12.0 };
        let lines = lines(&gap(rect), &GRID, &settings(0.0));
        assert_eq!(lines.len(), 1);
        let [from, to] = lines[0].map(|end| end.place.coords);
        // Centres of cells from 4.25 to 6.75 m, a metre more at each end.
        assert!((from.x - 3.25).abs() < 1e-9 && (to.x - 7.75).abs() < 1e-9, "{from} {to}");
        assert!((from.y - 11.0).abs() < 1e-9 && (from.z - 7.0).abs() < 1e-12);
    }

    #[test]
    fn every_cell_of_a_wide_gap_is_looked_at_from_nearly_above() {
        let rect = Rect { x_min_m: 2.0, y_min_m: 1.0, x_max_m: 5.0, y_max_m: 19.0 };
        for yaw_rad in [0.0, 0.7, -2.0] {
            let gap = gap(rect);
            let lines = lines(&gap, &GRID, &settings(yaw_rad));
            for cell in &gap.cells {
                let (x, y) = GRID.centre_m(*cell);
                let off_m = lines
                    .iter()
                    .map(|[from, to]| {
                        let (a, b) = (from.place.coords.xy(), to.place.coords.xy());
                        let way = b - a;
                        let share = (Vector2::new(x, y) - a).dot(&way) / way.norm_squared();
                        (Vector2::new(x, y) - (a + way * share.clamp(0.0, 1.0))).norm()
                    })
                    .fold(f64::INFINITY, f64::min);
                // 5.5 m over the ground, and the half cell that a centre stands for.
                assert!(off_m <= 5.5 * LOOK_RAD.tan() + 0.26, "{yaw_rad}: {x} {y}: {off_m}");
            }
        }
    }

    #[test]
    fn passes_are_flown_from_their_nearer_end() {
        let at = |x: f64| Waypoint { place: Point::new(x, 0.0, 7.0), yaw_rad: 0.0 };
        let way = ordered(vec![vec![at(9.0), at(8.0)], vec![at(5.0), at(3.0)]], &at(0.0));
        let xs: Vec<f64> = way.iter().map(|waypoint| waypoint.place.coords.x).collect();
        assert_eq!(xs, [3.0, 5.0, 8.0, 9.0]);
        assert!(ordered(Vec::new(), &at(0.0)).is_empty());
    }
}
