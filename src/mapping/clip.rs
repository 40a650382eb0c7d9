//! The exact area and centroid of what polygons leave of a rectangle.
//!
//! ```text
//!    y ▲   ┌──────────────┐      Between two neighbouring events (corners, crossings of edges,
//!      │   │░░░░░╱        │      crossings with the upper and lower side) the length L(x) of the
//!      │   │░░░░╱    ▓▓▓▓▓│      section is linear in x, so two Gauss points integrate area and
//!      │   │░░░╱     ▓▓▓▓▓│      first moments exactly.
//!      │   └──────────────┘      ░ counts, ▓ is excluded
//!      └─────▲──▲──────▲──▶ x
//! ```
//! Concave polygons, and any number that overlap, need no special case: a section is a list of
//! intervals, and lists are cut and subtracted in one dimension.
//!
//! Checked: `parts_equal_brute_force`, and `bays_add_up_to_their_polygons` in `tests/properties`.

use super::polygon::{Place, Polygon};
use super::rect::Rect;

/// A part of the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Its area, m².
    pub area_m2: f64,
    /// Its centroid, m; of an empty part the middle of the rectangle it was looked for in.
    pub centroid_m: Place,
}

/// What of `cell` lies in all of `inside` and in none of `outside`.
#[must_use]
pub fn part_of(cell: &Rect, inside: &[&Polygon], outside: &[&Polygon]) -> Part {
    // Relative to the corner: hall coordinates may be large against a cell.
    let origin = (cell.x_min_m, cell.y_min_m);
    let (width_m, depth_m) = cell.size_m();
    let relative = |polygons: &[&Polygon]| -> Vec<Vec<(Place, Place)>> {
        let shift = |p: Place| (p.0 - origin.0, p.1 - origin.1);
        polygons.iter().map(|p| p.edges().map(|(a, b)| (shift(a), shift(b))).collect()).collect()
    };
    let (inside, outside) = (relative(inside), relative(outside));
    let edges: Vec<_> = inside.iter().chain(&outside).flatten().copied().collect();
    let events = events(&edges, width_m, depth_m);

    let (mut area, mut moment_x, mut moment_y) = (0.0, 0.0, 0.0);
    for ends in events.windows(2) {
        let (middle, half) = (0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]));
        for x in [middle - half * GAUSS, middle + half * GAUSS] {
            for (low, high) in section(x, depth_m, &inside, &outside) {
                let share = half * (high - low);
                area += share;
                moment_x += share * x;
                moment_y += share * 0.5 * (low + high);
            }
        }
    }
    let centre = if area > 0.0 {
        (moment_x / area, moment_y / area)
    } else {
        (0.5 * width_m, 0.5 * depth_m)
    };
    Part { area_m2: area, centroid_m: (origin.0 + centre.0, origin.1 + centre.1) }
}

/// Place of the two Gauss points on [−1, 1], 1/√3.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// Where the length of the section may change its slope, in order, from 0 to `width_m`.
fn events(edges: &[(Place, Place)], width_m: f64, depth_m: f64) -> Vec<f64> {
    let near: Vec<_> = edges
        .iter()
        .copied()
        .filter(|(a, b)| {
            a.0.min(b.0) <= width_m
                && a.0.max(b.0) >= 0.0
                && a.1.min(b.1) <= depth_m
                && a.1.max(b.1) >= 0.0
        })
        .collect();
    let mut events = vec![0.0, width_m];
    for (i, &(a, b)) in near.iter().enumerate() {
        events.extend([a.0, b.0]);
        for y in [0.0, depth_m] {
            if (a.1 > y) != (b.1 > y) {
                events.push(a.0 + (y - a.1) / (b.1 - a.1) * (b.0 - a.0));
            }
        }
        events.extend(near[..i].iter().filter_map(|&(c, d)| crossing_x(a, b, c, d)));
    }
    events.retain(|x| (0.0..=width_m).contains(x));
    events.sort_by(f64::total_cmp);
    events
}

/// The x where two segments cross, if they do and are not parallel.
fn crossing_x(a: Place, b: Place, c: Place, d: Place) -> Option<f64> {
    let (ab, cd) = ((b.0 - a.0, b.1 - a.1), (d.0 - c.0, d.1 - c.1));
    let det = ab.0 * cd.1 - ab.1 * cd.0;
    let along = ((c.0 - a.0) * cd.1 - (c.1 - a.1) * cd.0) / det;
    // A little too many events do no harm; one too few would.
    let is_on_it = det != 0.0 && (-1e-9..=1.0 + 1e-9).contains(&along);
    is_on_it.then_some(a.0 + along * ab.0)
}

type Intervals = Vec<(f64, f64)>;

/// The intervals of y at x that lie in the cell, in all of `inside` and in none of `outside`.
fn section(
    x: f64,
    depth_m: f64,
    inside: &[Vec<(Place, Place)>],
    outside: &[Vec<(Place, Place)>],
) -> Intervals {
    let kept = inside
        .iter()
        .fold(vec![(0.0, depth_m)], |kept, polygon| common(&kept, &section_of(x, polygon)));
    outside.iter().fold(kept, |kept, polygon| {
        if kept.is_empty() { kept } else { without(kept, &section_of(x, polygon)) }
    })
}

/// The intervals of y at x inside one polygon.
fn section_of(x: f64, edges: &[(Place, Place)]) -> Intervals {
    let mut crossings: Vec<f64> = edges
        .iter()
        .filter(|(a, b)| (a.0 > x) != (b.0 > x))
        .map(|(a, b)| a.1 + (x - a.0) / (b.0 - a.0) * (b.1 - a.1))
        .collect();
    crossings.sort_by(f64::total_cmp);
    crossings.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect()
}

fn common(kept: &[(f64, f64)], other: &[(f64, f64)]) -> Intervals {
    let pairs = kept.iter().flat_map(|a| other.iter().map(move |b| (a.0.max(b.0), a.1.min(b.1))));
    pairs.filter(|(low, high)| low < high).collect()
}

fn without(kept: Intervals, taken: &[(f64, f64)]) -> Intervals {
    taken.iter().fold(kept, |kept, hole| {
        kept.iter()
            .flat_map(|a| [(a.0, a.1.min(hole.0)), (a.0.max(hole.1), a.1)])
            .filter(|(low, high)| low < high)
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::{Noise, SeedBook};

    /// A star-shaped polygon, concave in general, around the middle of the cell 3–4 × −2–−1.
    fn star(noise: &mut Noise, n: u32) -> Polygon {
        let centre = (noise.between(2.7, 4.3), noise.between(-2.3, -0.7));
        let corners: Vec<Place> = (0..n)
            .map(|k| {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(n);
                let radius = noise.between(0.1, 1.3);
                (centre.0 + radius * angle.cos(), centre.1 + radius * angle.sin())
            })
            .collect();
        Polygon::new(&corners).expect("a star is simple")
    }

    const CELL: Rect = Rect { x_min_m: 3.0, y_min_m: -2.0, x_max_m: 4.0, y_max_m: -1.0 };

    #[test]
    fn parts_equal_brute_force() {
        let mut noise = SeedBook::new(5).stream("stars");
        for case in 0..25 {
            let stars: Vec<Polygon> = (0..4).map(|k| star(&mut noise, 3 + 2 * k)).collect();
            let (inside, outside) = ([&stars[0], &stars[2]], [&stars[1], &stars[3]]);
            let part = part_of(&CELL, &inside, &outside);
            let (mut n_in, mut sum_x, mut sum_y) = (0.0, 0.0, 0.0);
            let n = 250;
            for i in 0..n {
                for j in 0..n {
                    let x = 3.0 + (f64::from(i) + 0.5) / f64::from(n);
                    let y = -2.0 + (f64::from(j) + 0.5) / f64::from(n);
                    if inside.iter().all(|p| p.contains(x, y))
                        && !outside.iter().any(|p| p.contains(x, y))
                    {
                        n_in += 1.0;
                        sum_x += x;
                        sum_y += y;
                    }
                }
            }
            let area_m2 = n_in / f64::from(n * n);
            // Counting points errs by about (border length / spacing)^½ points; 1e-3 is 60 points.
            assert!((part.area_m2 - area_m2).abs() < 1e-3, "case {case}: {part:?}, {area_m2}");
            if area_m2 > 0.05 {
                assert!((part.centroid_m.0 - sum_x / n_in).abs() < 5e-3, "case {case}");
                assert!((part.centroid_m.1 - sum_y / n_in).abs() < 5e-3, "case {case}");
            }
        }
    }

    #[test]
    fn a_triangle_over_a_corner_has_its_known_area_and_centroid() {
        // Half a square of edge 1 cut off by x + y = 2.5 in cell coordinates shifted by (3, −2).
        let triangle = Polygon::new(&[(3.5, -1.0), (4.0, -1.5), (9.0, 9.0)]).expect("simple");
        let part = part_of(&CELL, &[&triangle], &[]);
        // The corner triangle (3.5, −1), (4, −1.5), (4, −1): area 1/8, centroid the mean.
        assert!((part.area_m2 - 0.125).abs() < 1e-14);
        assert!((part.centroid_m.0 - 11.5 / 3.0).abs() < 1e-13);
        assert!((part.centroid_m.1 + 3.5 / 3.0).abs() < 1e-13);
    }

    #[test]
    fn far_from_the_origin_nothing_is_lost() {
        let far = |x: f64, y: f64| (x + 9_000.0, y - 8_000.0);
        let triangle = Polygon::new(&[far(0.0, 0.0), far(0.25, 0.0), far(0.0, 0.25)]).expect("ok");
        let cell =
            Rect { x_min_m: 9_000.0, y_min_m: -8_000.0, x_max_m: 9_000.25, y_max_m: -7_999.75 };
        assert!((part_of(&cell, &[&triangle], &[]).area_m2 - 0.031_25).abs() < 1e-12);
    }
}
