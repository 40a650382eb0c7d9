//! Rays and the bilinear height field.
//!
//! The ray is cut to the field's bounding box, then walks over its cells. Where a block of cells
//! lies below the ray, the whole block is stepped over; a block that may be hit is looked at more
//! closely, down to one cell, whose bilinear patch is solved as a quadratic in the distance.

use super::slab::{self, facing};
use super::{Ray, RayHit, Surface};
use crate::world::{Cuboid, HeightField};
use nalgebra::Vector3;
use stockpilot::geometry::Direction;

/// A step across a cell border, in cells: far below a millimetre, far above rounding.
const NUDGE: f64 = 1e-7;

/// A ray in units of cells across and up, with height and distance in m.
#[derive(Debug, Clone, Copy)]
struct GridRay {
    across: f64,
    up: f64,
    height_m: f64,
    across_per_m: f64,
    up_per_m: f64,
    climb: f64,
}

impl GridRay {
    fn new(ray: &Ray, field: &HeightField) -> Self {
        let (across, up) = field.grid_coords(ray.origin_m.x, ray.origin_m.y);
        Self {
            across,
            up,
            height_m: ray.origin_m.z,
            across_per_m: ray.direction.x / field.pitch_m(),
            up_per_m: ray.direction.y / field.pitch_m(),
            climb: ray.direction.z,
        }
    }

    fn height_at(&self, distance_m: f64) -> f64 {
        self.height_m + self.climb * distance_m
    }
}

/// Where a ray meets the material within `reach_m`; distance 0 from inside it.
pub(super) fn entry(ray: &Ray, field: &HeightField, reach_m: f64) -> Option<RayHit> {
    let bounds = Cuboid::over(&field.region(), 0.0, field.peak_m());
    let span = slab::span(ray, &bounds)?;
    let (start_m, end_m) = (span.enter_m.max(0.0), span.leave_m.min(reach_m));
    if start_m > end_m {
        return None;
    }
    let at_start = ray.at(start_m);
    if at_start.z < field.height_at(at_start.x, at_start.y) {
        // The cliff at the border of the field, or an origin inside the material.
        return Some(material(start_m, facing(ray, span.enter_axis)));
    }
    walk(&GridRay::new(ray, field), field, start_m, end_m)
}

fn material(distance_m: f64, normal: Direction<stockpilot::geometry::Hall>) -> RayHit {
    RayHit { distance_m, normal, surface: Surface::Material }
}

/// Steps over blocks and cells from `start_m` to `end_m`.
fn walk(ray: &GridRay, field: &HeightField, start_m: f64, end_m: f64) -> Option<RayHit> {
    let speed = ray.across_per_m.abs().max(ray.up_per_m.abs());
    let nudge_m = NUDGE / speed.max(1e-3);
    let mut level = field.top_level().min(2);
    let mut here_m = start_m;
    while here_m < end_m {
        let inside_m = here_m + nudge_m;
        let (col, row) = field
            .cell_of(ray.across + ray.across_per_m * inside_m, ray.up + ray.up_per_m * inside_m);
        let leave_m = block_exit_m(ray, level, col, row).clamp(inside_m, end_m.max(inside_m));
        let lowest_m = ray.height_at(here_m).min(ray.height_at(leave_m));
        if lowest_m > field.block_peak_m(level, col, row) {
            here_m = leave_m;
            level = (level + 1).min(field.top_level());
        } else if level > 0 {
            level -= 1;
        } else {
            if let Some(hit) = patch_hit(ray, field, (col, row), (here_m, leave_m)) {
                return Some(hit);
            }
            here_m = leave_m;
        }
    }
    None
}

/// Where the ray leaves the block of 2^level × 2^level cells around a cell, m.
fn block_exit_m(ray: &GridRay, level: usize, col: usize, row: usize) -> f64 {
    let exit_m = |start: f64, per_m: f64, cell: usize| {
        let block = cell >> level;
        let border = if per_m > 0.0 { (block + 1) << level } else { block << level };
        if per_m.abs() < 1e-12 { f64::INFINITY } else { (border as f64 - start) / per_m }
    };
    exit_m(ray.across, ray.across_per_m, col).min(exit_m(ray.up, ray.up_per_m, row))
}

/// Solves one patch between two distances.
///
/// ```text
/// f(s) = z(s) − h(u(s), v(s)) = q₀ + q₁ s + q₂ s²,   hit where f falls through zero
/// ```
/// - `s`: distance from the entry into the cell, m
fn patch_hit(
    ray: &GridRay,
    field: &HeightField,
    (col, row): (usize, usize),
    (enter_m, leave_m): (f64, f64),
) -> Option<RayHit> {
    let patch = field.patch(col, row);
    let u = ray.across + ray.across_per_m * enter_m - col as f64;
    let v = ray.up + ray.up_per_m * enter_m - row as f64;
    let q0 = ray.height_at(enter_m) - patch.height_m(u, v);
    let q1 = ray.climb
        - patch.b * ray.across_per_m
        - patch.c * ray.up_per_m
        - patch.d * (u * ray.up_per_m + v * ray.across_per_m);
    let q2 = -patch.d * ray.across_per_m * ray.up_per_m;
    let s = first_fall(q0, q1, q2, leave_m - enter_m)?;
    let (u, v) = (u + ray.across_per_m * s, v + ray.up_per_m * s);
    let slope = |rise_m: f64| -rise_m / field.pitch_m();
    let normal = Vector3::new(slope(patch.b + patch.d * v), slope(patch.c + patch.d * u), 1.0);
    Some(material(enter_m + s, Direction::from_coords(normal.normalize())))
}

/// The smallest s in 0 to `end` with `q₀ + q₁ s + q₂ s²` at or below zero; the value at 0 counts.
fn first_fall(q0: f64, q1: f64, q2: f64, end: f64) -> Option<f64> {
    if q0 <= 0.0 {
        return Some(0.0);
    }
    let discriminant = q1 * q1 - 4.0 * q2 * q0;
    if discriminant < 0.0 {
        return None;
    }
    // The two roots without cancellation; dividing by zero gives an infinity, which is no hit.
    let t = -0.5 * (q1 + discriminant.sqrt().copysign(q1));
    let in_cell = |s: f64| (0.0..=end + 1e-12).contains(&s);
    let roots = [t / q2, q0 / t].into_iter().filter(|s| in_cell(*s));
    roots.min_by(f64::total_cmp)
}
