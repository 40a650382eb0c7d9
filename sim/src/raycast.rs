//! Where a beam ends in the true hall.
//!
//! One cast asks, in this order: where the beam leaves the hall's box (and, through an opening, where
//! it meets the ground outside), which inside wall, obstacle or guest is in front of that, and where it meets
//! the material in front of all. Each answer shortens the beam for the next question. Intersections
//! are closed forms, so a hit is exact to rounding.

mod slab;
mod terrain;

use crate::world::{Cuboid, World};
use nalgebra::Vector3;
use stockpilot::geometry::{Direction, Hall, Point};

/// What a beam hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// The material.
    Material,
    /// A wall of a bay.
    InsideWall,
    /// A column, a bridge or the like.
    Obstacle,
    /// Floor, wall or ceiling of the hall.
    Hall,
    /// Something that stands or drives in the hall for a while.
    Guest,
    /// The ground outside, through an opening of the hall.
    Outside,
    /// A grain in the air; no [`cast`] gives it.
    Dust,
}

/// The end of a beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Length of the beam, m.
    pub distance_m: f64,
    /// Unit normal of the surface, towards the free side.
    pub normal: Direction<Hall>,
    /// What was hit.
    pub surface: Surface,
}

/// A half line; `direction` has length 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin_m: Vector3<f64>,
    pub(crate) direction: Vector3<f64>,
    /// 1 over each component of the direction; infinite where that is zero.
    pub(crate) inverse: Vector3<f64>,
}

impl Ray {
    fn new(origin: &Point<Hall>, direction: &Direction<Hall>) -> Self {
        let direction = direction.coords;
        Self { origin_m: origin.coords, direction, inverse: direction.map(f64::recip) }
    }

    pub(crate) fn at(&self, distance_m: f64) -> Vector3<f64> {
        self.origin_m + self.direction * distance_m
    }
}

/// The first surface that a half line from inside the hall meets.
///
/// `direction` has length 1. `None` if nothing is nearer than `max_range_m`, or if the origin is
/// outside of the hall. An origin inside a solid gives a distance of 0.
#[must_use]
pub fn cast(
    world: &World,
    origin: &Point<Hall>,
    direction: &Direction<Hall>,
    max_range_m: f64,
) -> Option<RayHit> {
    let ray = Ray::new(origin, direction);
    let shell = slab::exit(&ray, &world.hall)?;
    let mut nearest = if is_open(world, &ray, &shell) { outside(&ray) } else { Some(shell) };
    let of = |solids: &[Cuboid], surface: Surface| {
        let hits = solids.iter().filter_map(|solid| slab::entry(&ray, solid));
        let nearest = hits.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        nearest.map(|hit| RayHit { surface, ..hit })
    };
    let obstacle = of(&world.obstacles, Surface::Obstacle);
    let guest = of(&world.guests, Surface::Guest);
    for hit in [inside_wall(world, &ray), obstacle, guest].into_iter().flatten() {
        if nearest.is_none_or(|nearest| hit.is_before(&nearest)) {
            nearest = Some(hit);
        }
    }
    // Material lies inside of the hall.
    let reach_m = nearest.map_or(shell.distance_m, |hit| hit.distance_m).min(max_range_m);
    if let Some(hit) = terrain::entry(&ray, &world.terrain, reach_m.min(shell.distance_m)) {
        nearest = Some(hit);
    }
    nearest.filter(|hit| hit.distance_m <= max_range_m)
}

/// True if the beam leaves the hall through an opening.
fn is_open(world: &World, ray: &Ray, shell: &RayHit) -> bool {
    if world.openings.is_empty() {
        return false;
    }
    let exit_m = ray.at(shell.distance_m);
    world.openings.iter().any(|opening| opening.distance_m(&exit_m) < 1e-6)
}

/// Where a beam from an opening meets the level ground outside; `None` towards the sky.
fn outside(ray: &Ray) -> Option<RayHit> {
    let distance_m = (crate::world::OUTSIDE_M - ray.origin_m.z) * ray.inverse.z;
    let normal = Direction::new(0.0, 0.0, 1.0);
    (ray.direction.z < 0.0).then_some(RayHit { distance_m, normal, surface: Surface::Outside })
}

impl RayHit {
    fn is_before(&self, other: &Self) -> bool {
        self.distance_m < other.distance_m
    }
}

fn inside_wall(world: &World, ray: &Ray) -> Option<RayHit> {
    slab::entry(ray, &world.walls_bounds?)?;
    let hits = world.walls_inside.iter().filter_map(|wall| slab::entry(ray, wall));
    hits.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

#[cfg(test)]
mod tests;
