//! Places with an outline, and integrals over polygons.

use super::Region;

/// A part of the floor whose volume is of interest by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Bay {
    /// What people call it.
    pub name: String,
    /// Corners (x, y) of a polygon that does not cross itself, in either sense of rotation, m.
    pub outline_m: Vec<[f64; 2]>,
}

impl Bay {
    /// A bay with straight walls along the hall's axes.
    #[must_use]
    pub fn rectangle(name: &str, r: &Region) -> Self {
        let outline_m = vec![
            [r.x_min_m, r.y_min_m],
            [r.x_max_m, r.y_min_m],
            [r.x_max_m, r.y_max_m],
            [r.x_min_m, r.y_max_m],
        ];
        Self { name: name.to_owned(), outline_m }
    }

    /// Its area, m².
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        signed_area_m2(&self.outline_m).abs()
    }
}

/// The smallest rectangle around a polygon; `None` around nothing.
pub(super) fn bounds(outline_m: &[[f64; 2]]) -> Option<Region> {
    let points = outline_m.iter().map(|[x, y]| Region::new(*x, *y, *x, *y));
    points.reduce(|a, b| {
        Region::new(
            a.x_min_m.min(b.x_min_m),
            a.y_min_m.min(b.y_min_m),
            a.x_max_m.max(b.x_max_m),
            a.y_max_m.max(b.y_max_m),
        )
    })
}

/// Area of a polygon, m²: positive counter-clockwise.
pub(super) fn signed_area_m2(outline_m: &[[f64; 2]]) -> f64 {
    fan(outline_m).map(signed_triangle_m2).sum()
}

type Triangle = [[f64; 2]; 3];

/// Triangles from the first corner; with their signs they add up to any polygon.
fn fan(outline_m: &[[f64; 2]]) -> impl Iterator<Item = Triangle> {
    let sides = outline_m.windows(2).skip(1);
    sides.map(|side| [outline_m[0], side[0], side[1]])
}

fn signed_triangle_m2([a, b, c]: Triangle) -> f64 {
    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
}

/// The part of a polygon inside a rectangle (Sutherland and Hodgman 1974).
///
/// Where a concave polygon falls apart, its pieces hang together by edges along the border, which
/// have no area: integrals over the result are right.
pub(super) fn clipped(outline_m: &[[f64; 2]], to: &Region) -> Vec<[f64; 2]> {
    let borders =
        [(0, to.x_min_m, 1.0), (0, to.x_max_m, -1.0), (1, to.y_min_m, 1.0), (1, to.y_max_m, -1.0)];
    borders.into_iter().fold(outline_m.to_vec(), |polygon, (axis, border_m, inwards)| {
        let depth_m = |p: &[f64; 2]| inwards * (p[axis] - border_m);
        let mut kept = Vec::with_capacity(polygon.len() + 2);
        for (i, to) in polygon.iter().enumerate() {
            let from = &polygon[(i + polygon.len() - 1) % polygon.len()];
            let (from_m, to_m) = (depth_m(from), depth_m(to));
            if (from_m < 0.0) != (to_m < 0.0) {
                let share = from_m / (from_m - to_m);
                kept.push([0, 1].map(|k| from[k] + share * (to[k] - from[k])));
            }
            if to_m >= 0.0 {
                kept.push(*to);
            }
        }
        kept
    })
}

/// ∫ f dA over a polygon, positive counter-clockwise: each triangle of the fan halved `n_halvings`
/// times along its sides, then the rule of the midpoints of the sides, which is exact for
/// polynomials of degree 2.
pub(super) fn integral(
    outline_m: &[[f64; 2]],
    n_halvings: u32,
    f: &impl Fn(f64, f64) -> f64,
) -> f64 {
    fan(outline_m).map(|triangle| over_triangle(triangle, n_halvings, f)).sum()
}

fn over_triangle([a, b, c]: Triangle, n_halvings: u32, f: &impl Fn(f64, f64) -> f64) -> f64 {
    let middle = |p: [f64; 2], q: [f64; 2]| [0, 1].map(|k| f64::midpoint(p[k], q[k]));
    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
    if n_halvings == 0 {
        let sum = [ab, bc, ca].map(|[x, y]| f(x, y)).iter().sum::<f64>();
        return signed_triangle_m2([a, b, c]) * sum / 3.0;
    }
    let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
    parts.into_iter().map(|part| over_triangle(part, n_halvings - 1, f)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A concave arrow head.
    const ARROW: [[f64; 2]; 4] = [[0.0, 0.0], [4.0, 2.0], [0.0, 4.0], [2.0, 2.0]];

    #[test]
    fn a_concave_polygon_has_its_area_whole_and_in_pieces() {
        // Triangle (0,0), (4,2), (0,4) of area 8 less the notch (0,0), (2,2), (0,4) of area 4.
        assert!((signed_area_m2(&ARROW) - 4.0).abs() < 1e-12);
        let mut sum = 0.0;
        for i in 0..8 {
            for j in 0..8 {
                let (x, y) = (f64::from(i) * 0.5, f64::from(j) * 0.5);
                sum += signed_area_m2(&clipped(&ARROW, &Region::new(x, y, x + 0.5, y + 0.5)));
            }
        }
        assert!((sum - 4.0).abs() < 1e-12, "{sum}");
        assert!(clipped(&ARROW, &Region::new(5.0, 5.0, 6.0, 6.0)).is_empty());
    }

    #[test]
    fn quadratic_integrals_are_exact() {
        // ∫∫ x y over the triangle (0,0), (1,0), (0,1) is 1/24; clockwise it is negative.
        let triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let turned = [triangle[0], triangle[2], triangle[1]];
        for n_halvings in [0, 2] {
            let value = integral(&triangle, n_halvings, &|x, y| x * y);
            assert!((value - 1.0 / 24.0).abs() < 1e-15, "{value}");
            assert!((integral(&turned, n_halvings, &|x, y| x * y) + value).abs() < 1e-15);
        }
    }
}
