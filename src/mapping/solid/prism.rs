//! Upright prisms: boxes, columns, walls, anything with a footprint and two heights.

use super::Aabb;
use super::segment::segments_m2;
use crate::mapping::polygon::{Place, Polygon, PolygonError};
use nalgebra::Vector3;

/// A polygon between two heights.
#[derive(Debug, Clone, PartialEq)]
pub struct Prism {
    footprint: Polygon,
    z_min_m: f64,
    z_max_m: f64,
    bounds: Aabb,
}

impl Prism {
    /// The prism over a footprint between two heights over the hall's zero, m, in either order.
    #[must_use]
    pub fn new(footprint: Polygon, z_m: (f64, f64)) -> Self {
        let (z_min_m, z_max_m) = (z_m.0.min(z_m.1), z_m.0.max(z_m.1));
        let plan = footprint.bounds();
        let bounds = Aabb {
            min_m: Vector3::new(plan.x_min_m, plan.y_min_m, z_min_m),
            max_m: Vector3::new(plan.x_max_m, plan.y_max_m, z_max_m),
        };
        Self { footprint, z_min_m, z_max_m, bounds }
    }

    /// A box around `centre_m` with edges `size_m`, turned by `yaw_rad` about the vertical.
    ///
    /// # Errors
    /// Sizes that leave no footprint.
    pub fn turned_box(
        centre_m: &Vector3<f64>,
        size_m: &Vector3<f64>,
        yaw_rad: f64,
    ) -> Result<Self, PolygonError> {
        let (sin, cos) = yaw_rad.sin_cos();
        let corner = |right: f64, up: f64| -> Place {
            let (x, y) = (0.5 * right * size_m.x, 0.5 * up * size_m.y);
            (centre_m.x + cos * x - sin * y, centre_m.y + sin * x + cos * y)
        };
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let footprint = Polygon::new(&corners.map(|(right, up)| corner(right, up)))?;
        let half_m = 0.5 * size_m.z;
        Ok(Self::new(footprint, (centre_m.z - half_m, centre_m.z + half_m)))
    }

    /// What it covers of the floor.
    #[must_use]
    pub const fn footprint(&self) -> &Polygon {
        &self.footprint
    }

    /// Its lowest and highest height, m.
    #[must_use]
    pub const fn heights_m(&self) -> (f64, f64) {
        (self.z_min_m, self.z_max_m)
    }

    /// The smallest box around it.
    #[must_use]
    pub const fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// Distance of a point, m; 0 inside.
    #[must_use]
    pub fn distance_m(&self, p: &Vector3<f64>) -> f64 {
        let off_m = (self.z_min_m - p.z).max(p.z - self.z_max_m).max(0.0);
        off_m.hypot(self.footprint.distance_m(p.x, p.y))
    }

    /// Distance of the straight way from `a` to `b`, m; 0 if it touches.
    ///
    /// Outside of the prism the nearest pair of points holds an end of the way or lies on an edge.
    #[must_use]
    pub fn way_distance_m(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        if self.is_cut(a, b) {
            return 0.0;
        }
        let ends_m = self.distance_m(a).min(self.distance_m(b));
        let edges_m2 = self
            .footprint
            .edges()
            .flat_map(|(p, q)| {
                let at = |(x, y): Place, z: f64| Vector3::new(x, y, z);
                let (low, high) = (self.z_min_m, self.z_max_m);
                [(at(p, low), at(q, low)), (at(p, high), at(q, high)), (at(p, low), at(p, high))]
            })
            .map(|(c, d)| segments_m2((a, b), (&c, &d)))
            .fold(f64::INFINITY, f64::min);
        ends_m.min(edges_m2.sqrt())
    }

    /// True if the way has a point in the prism: the part between the heights, seen from above.
    fn is_cut(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
        let climb_m = b.z - a.z;
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        if climb_m == 0.0 {
            if a.z < self.z_min_m || a.z > self.z_max_m {
                return false;
            }
        } else {
            let (s, t) = ((self.z_min_m - a.z) / climb_m, (self.z_max_m - a.z) / climb_m);
            (from, to) = (from.max(s.min(t)), to.min(s.max(t)));
            if from > to {
                return false;
            }
        }
        let plan = |share: f64| {
            let p = a.lerp(b, share);
            (p.x, p.y)
        };
        let (p, q) = (plan(from), plan(to));
        if p == q { self.footprint.contains(p.0, p.1) } else { self.footprint.cuts(p, q) }
    }
}
