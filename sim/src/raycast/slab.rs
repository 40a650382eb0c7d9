//! Rays and boxes, by the slab method (Kay and Kajiya 1986).

use super::{Ray, RayHit, Surface};
use crate::world::Cuboid;
use nalgebra::Vector3;
use stockpilot::geometry::Direction;

/// The part of a ray inside a box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    /// Where it enters, m; negative if it starts inside.
    pub(crate) enter_m: f64,
    /// The axis (0 to 2) of the face where it enters.
    pub(crate) enter_axis: usize,
    /// Where it leaves, m.
    pub(crate) leave_m: f64,
    /// The axis of the face where it leaves.
    pub(crate) leave_axis: usize,
}

/// The part of the ray's whole line inside the box; `None` if they miss each other.
pub(crate) fn span(ray: &Ray, cuboid: &Cuboid) -> Option<Span> {
    let mut span =
        Span { enter_m: f64::NEG_INFINITY, enter_axis: 0, leave_m: f64::INFINITY, leave_axis: 0 };
    for axis in 0..3 {
        let to_low_m = cuboid.min_m[axis] - ray.origin_m[axis];
        let to_high_m = cuboid.max_m[axis] - ray.origin_m[axis];
        if ray.inverse[axis].is_infinite() {
            // Parallel to this pair of faces: between them everywhere or nowhere.
            if to_low_m > 0.0 || to_high_m < 0.0 {
                return None;
            }
            continue;
        }
        let (a_m, b_m) = (to_low_m * ray.inverse[axis], to_high_m * ray.inverse[axis]);
        let (near_m, far_m) = if a_m < b_m { (a_m, b_m) } else { (b_m, a_m) };
        if near_m > span.enter_m {
            (span.enter_m, span.enter_axis) = (near_m, axis);
        }
        if far_m < span.leave_m {
            (span.leave_m, span.leave_axis) = (far_m, axis);
        }
    }
    (span.enter_m <= span.leave_m && span.leave_m >= 0.0).then_some(span)
}

/// Where a ray meets a solid box from outside; distance 0 from inside.
pub(crate) fn entry(ray: &Ray, cuboid: &Cuboid) -> Option<RayHit> {
    let span = span(ray, cuboid)?;
    Some(RayHit {
        distance_m: span.enter_m.max(0.0),
        normal: facing(ray, span.enter_axis),
        surface: Surface::InsideWall,
    })
}

/// Where a ray from inside a hollow box meets its shell.
pub(crate) fn exit(ray: &Ray, cuboid: &Cuboid) -> Option<RayHit> {
    let span = span(ray, cuboid).filter(|span| span.enter_m <= 0.0)?;
    Some(RayHit {
        distance_m: span.leave_m,
        normal: facing(ray, span.leave_axis),
        surface: Surface::Hall,
    })
}

/// The unit vector along an axis that points against the ray.
pub(crate) fn facing<F>(ray: &Ray, axis: usize) -> Direction<F> {
    Direction::from_coords(Vector3::ith(axis, -ray.direction[axis].signum()))
}
