//! Solid things in the hall: what the vehicle must not touch, and whose echoes are no material.
//!
//! A solid is an upright [`Prism`] over any polygon (a box is one) or a [`Mesh`] of triangles. Both
//! answer the same two questions exactly: how far is a point, and how far is a straight way.
//!
//! ```text
//! a ball of radius r swept from a to b misses the solid  ⇔  distance(segment a b, solid) > r
//! ```
//! so a thin solid cannot be stepped over.

pub mod mesh;
pub mod prism;
mod segment;

pub use mesh::{Mesh, MeshError};
pub use prism::Prism;

use nalgebra::Vector3;
use std::sync::Arc;

/// A box along the hall's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Lowest corner, m.
    pub min_m: Vector3<f64>,
    /// Highest corner, m.
    pub max_m: Vector3<f64>,
}

impl Aabb {
    /// The smallest box around these places; inverted without any.
    #[must_use]
    pub fn around<'a>(places: impl IntoIterator<Item = &'a Vector3<f64>>) -> Self {
        let nothing = Self {
            min_m: Vector3::repeat(f64::INFINITY),
            max_m: Vector3::repeat(f64::NEG_INFINITY),
        };
        places
            .into_iter()
            .fold(nothing, |all, p| Self { min_m: all.min_m.inf(p), max_m: all.max_m.sup(p) })
    }

    /// The smallest box around both.
    #[must_use]
    pub fn merged(&self, other: &Self) -> Self {
        Self { min_m: self.min_m.inf(&other.min_m), max_m: self.max_m.sup(&other.max_m) }
    }

    /// Distance between two boxes, m; 0 where they overlap.
    #[must_use]
    pub fn gap_m(&self, other: &Self) -> f64 {
        let apart = (self.min_m - other.max_m).sup(&(other.min_m - self.max_m));
        apart.sup(&Vector3::zeros()).norm()
    }
}

/// Something solid.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// An upright prism; a box is one.
    Prism(Prism),
    /// Triangles.
    Mesh(Arc<Mesh>),
}

impl From<Prism> for Solid {
    fn from(prism: Prism) -> Self {
        Self::Prism(prism)
    }
}

impl From<Mesh> for Solid {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(Arc::new(mesh))
    }
}

impl Solid {
    /// The smallest box along the hall's axes around it.
    #[must_use]
    pub fn bounds(&self) -> &Aabb {
        match self {
            Self::Prism(prism) => prism.bounds(),
            Self::Mesh(mesh) => mesh.bounds(),
        }
    }

    /// Distance of a point in the hall, m, at most `reach_m`; 0 inside.
    ///
    /// A mesh has an inside only if it is closed.
    #[must_use]
    pub fn distance_m(&self, p: &Vector3<f64>, reach_m: f64) -> f64 {
        match self {
            Self::Prism(prism) => prism.distance_m(p).min(reach_m),
            Self::Mesh(mesh) => mesh.distance_m(p, reach_m),
        }
    }

    /// Distance of the straight way from `a` to `b`, m, at most `reach_m`; 0 if it touches.
    #[must_use]
    pub fn way_distance_m(&self, a: &Vector3<f64>, b: &Vector3<f64>, reach_m: f64) -> f64 {
        match self {
            Self::Prism(prism) => prism.way_distance_m(a, b).min(reach_m),
            Self::Mesh(mesh) => mesh.way_distance_m(a, b, reach_m),
        }
    }
}

/// The distance from a point to the nearest of several solids, m, at most `reach_m`.
#[must_use]
pub fn distance_m(solids: &[Solid], p: &Vector3<f64>, reach_m: f64) -> f64 {
    let here = Aabb { min_m: *p, max_m: *p };
    solids.iter().fold(reach_m, |nearest_m, solid| {
        if solid.bounds().gap_m(&here) >= nearest_m {
            return nearest_m;
        }
        solid.distance_m(p, nearest_m)
    })
}

/// The distance from a straight way to the nearest of several solids, m, at most `reach_m`.
#[must_use]
pub fn way_distance_m(solids: &[Solid], a: &Vector3<f64>, b: &Vector3<f64>, reach_m: f64) -> f64 {
    let around = Aabb { min_m: a.inf(b), max_m: a.sup(b) };
    solids.iter().fold(reach_m, |nearest_m, solid| {
        if solid.bounds().gap_m(&around) >= nearest_m {
            return nearest_m;
        }
        solid.way_distance_m(a, b, nearest_m)
    })
}

/// True if a solid stands in the straight line between two places.
#[must_use]
pub fn blocks_sight(solids: &[Solid], a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    // Any reach above zero asks the same question; a short one asks it fastest.
    const REACH_M: f64 = 1e-6;
    way_distance_m(solids, a, b, REACH_M) <= 0.0
}

#[cfg(test)]
mod tests;
