//! A base of triangles between measured points.

use super::base::BaseError;
use super::polygon::{Place, nearest_on};
use spade::{DelaunayTriangulation, Point2, Triangulation};

/// A surface of Delaunay triangles over points measured on the bare floor.
///
/// Outside of the points' hull the nearest point of the hull counts.
#[derive(Debug, Clone, PartialEq)]
pub struct TriangulatedBase {
    points_m: Vec<[f64; 3]>,
    triangles: Vec<[usize; 3]>,
    hull: Vec<[usize; 2]>,
    sigma_m: f64,
    point_sigma_m: f64,
}

/// Why points make no surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum TriangulationError {
    /// Too few points, or all on one line.
    #[error("{n_points} points span no triangle")]
    NoTriangle {
        /// How many there are.
        n_points: usize,
    },
    /// Two points stand at the same place.
    #[error("points {first} and {second} are at the same place")]
    SamePlace {
        /// The one, counted from 0.
        first: usize,
        /// The other.
        second: usize,
    },
    /// A coordinate that is infinite, no number, or beyond all measure.
    #[error("point {index} is not a finite place")]
    NotFinite {
        /// Which point.
        index: usize,
    },
}

impl TriangulatedBase {
    /// A surface over points x, y, z in the hall, m.
    ///
    /// - `sigma_m`: standard deviation of an error common to all points, m
    /// - `point_sigma_m`: standard deviation of every point's own error, m
    ///
    /// # Errors
    /// Points that span no triangles.
    pub fn new(
        points_m: Vec<[f64; 3]>,
        sigma_m: f64,
        point_sigma_m: f64,
    ) -> Result<Self, TriangulationError> {
        let is_good = |p: &[f64; 3]| p.iter().all(|value| value.abs() < 1e9);
        if let Some(index) = points_m.iter().position(|p| !is_good(p)) {
            return Err(TriangulationError::NotFinite { index });
        }
        let same = |i: usize, j: usize| points_m[i][..2] == points_m[j][..2];
        let pairs = (0..points_m.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
        if let Some((first, second)) = pairs.into_iter().find(|&(i, j)| same(i, j)) {
            return Err(TriangulationError::SamePlace { first, second });
        }
        let none = TriangulationError::NoTriangle { n_points: points_m.len() };
        let places = points_m.iter().map(|p| Point2::new(p[0], p[1])).collect();
        let mesh =
            DelaunayTriangulation::<Point2<f64>>::bulk_load_stable(places).map_err(|_| none)?;
        let triangles: Vec<[usize; 3]> =
            mesh.inner_faces().map(|face| face.vertices().map(|v| v.fix().index())).collect();
        if triangles.is_empty() {
            return Err(none);
        }
        let hull = mesh.convex_hull().map(|e| e.vertices().map(|v| v.fix().index())).collect();
        Ok(Self { points_m, triangles, hull, sigma_m, point_sigma_m })
    }

    /// Standard deviation of the error common to all points, m.
    #[must_use]
    pub const fn sigma_m(&self) -> f64 {
        self.sigma_m
    }

    /// Height at a place, m.
    #[must_use]
    pub fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.weights((x_m, y_m)).iter().map(|&(point, w)| w * self.points_m[point][2]).sum()
    }

    /// Variance of the height at a place without the common error, m².
    #[must_use]
    pub fn own_var_m2(&self, x_m: f64, y_m: f64) -> f64 {
        let squares: f64 = self.weights((x_m, y_m)).iter().map(|(_, w)| w * w).sum();
        squares * self.point_sigma_m.powi(2)
    }

    /// ∂V/∂z of every point with its standard deviation.
    pub(super) fn point_errors(&self, areas: &[(Place, f64)]) -> Vec<BaseError> {
        let mut errors = vec![(0.0, self.point_sigma_m); self.points_m.len()];
        for (place, area) in areas {
            for (point, weight) in self.weights(*place) {
                errors[point].0 -= weight * area;
            }
        }
        errors
    }

    fn place(&self, point: usize) -> Place {
        (self.points_m[point][0], self.points_m[point][1])
    }

    /// The points that make the height at a place, with their weights, which add up to 1.
    fn weights(&self, p: Place) -> [(usize, f64); 3] {
        self.triangles
            .iter()
            .find_map(|&[a, b, c]| {
                let weights = barycentric(p, self.place(a), self.place(b), self.place(c));
                let is_inside = weights.iter().all(|w| *w >= -1e-12);
                is_inside.then_some([(a, weights[0]), (b, weights[1]), (c, weights[2])])
            })
            .unwrap_or_else(|| self.weights_outside(p))
    }

    fn weights_outside(&self, p: Place) -> [(usize, f64); 3] {
        let mut best = (f64::INFINITY, [(0, 1.0), (0, 0.0), (0, 0.0)]);
        for &[a, b] in &self.hull {
            let (nearest, along) = nearest_on(p, self.place(a), self.place(b));
            let distance_m = (p.0 - nearest.0).hypot(p.1 - nearest.1);
            if distance_m < best.0 {
                best = (distance_m, [(a, 1.0 - along), (b, along), (a, 0.0)]);
            }
        }
        best.1
    }
}

/// The weights of a, b and c whose weighted mean is p.
fn barycentric(p: Place, a: Place, b: Place, c: Place) -> [f64; 3] {
    let cross =
        |o: Place, u: Place, v: Place| (u.0 - o.0) * (v.1 - o.1) - (u.1 - o.1) * (v.0 - o.0);
    let whole = cross(a, b, c);
    let (wa, wb) = (cross(p, b, c) / whole, cross(p, c, a) / whole);
    [wa, wb, 1.0 - wa - wb]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;

    #[test]
    fn a_plane_stays_a_plane_inside_and_the_hull_counts_outside() {
        let of = |x: f64, y: f64| 0.2 - 0.03 * x + 0.05 * y;
        let mut noise = SeedBook::new(3).stream("points");
        let mut points = vec![];
        for (x, y) in [(0.0, 0.0), (8.0, 0.0), (8.0, 5.0), (0.0, 5.0)] {
            points.push([x, y, of(x, y)]);
        }
        for _ in 0..30 {
            let (x, y) = (noise.between(0.1, 7.9), noise.between(0.1, 4.9));
            points.push([x, y, of(x, y)]);
        }
        let base = TriangulatedBase::new(points, 0.0, 0.01).expect("triangles");
        for _ in 0..200 {
            let (x, y) = (noise.between(0.0, 8.0), noise.between(0.0, 5.0));
            assert!((base.height_m(x, y) - of(x, y)).abs() < 1e-12, "({x}, {y})");
        }
        assert!((base.height_m(-3.0, 2.0) - of(0.0, 2.0)).abs() < 1e-12);
        assert!((base.height_m(9.0, 7.0) - of(8.0, 5.0)).abs() < 1e-12);
    }

    #[test]
    fn the_ridge_of_a_roof_is_met_between_its_points() {
        // Points off the ridge by 1 m on a grid of 1 m: Delaunay joins the ridge's points.
        let points = vec![
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 1.0],
            [4.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [2.0, 1.0, 1.0],
            [4.0, 1.0, 0.0],
        ];
        let base = TriangulatedBase::new(points, 0.0, 0.0).expect("triangles");
        assert!((base.height_m(2.0, 0.3) - 1.0).abs() < 1e-12);
        assert!((base.height_m(3.0, 0.7) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn points_without_a_triangle_are_refused() {
        let refused = |points: Vec<[f64; 3]>| TriangulatedBase::new(points, 0.0, 0.0).unwrap_err();
        let line = vec![[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 2.0, 5.0]];
        assert_eq!(refused(line), TriangulationError::NoTriangle { n_points: 3 });
        assert_eq!(refused(vec![]), TriangulationError::NoTriangle { n_points: 0 });
        let twice = vec![[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 5.0]];
        assert_eq!(refused(twice), TriangulationError::SamePlace { first: 0, second: 2 });
        let broken = vec![[0.0, 0.0, f64::NAN]];
        assert_eq!(refused(broken), TriangulationError::NotFinite { index: 0 });
    }
}
