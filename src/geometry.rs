//! Frames as types, and the transforms between them.
//!
//! | frame | axes |
//! | --- | --- |
//! | [`Hall`] | x, y horizontal, z up, right-handed, metres; origin from the marker map |
//! | [`Body`] | forward, left, up at the IMU |
//! | [`Camera`] | z along the optical axis, x right, y down |
//! | [`Tag`] | x right, y up, z out of its front; origin in its middle |
//! | [`Lidar`] | the scan plane is x–y, beam angle from x towards y |
//!
//! A transform is named by what it gives: `hall_from_body: Transform<Hall, Body>` takes body
//! coordinates to hall coordinates and is also the pose of the body in the hall. Inner names
//! meet in a product: `hall_from_body * body_from_lidar * p_lidar`.
//!
//! Perturbations of attitude are right-multiplicative small rotations in the body frame:
//! `R(δθ) = R · exp(δθ^)`. Every Jacobian in the crate keeps to it.
//!
//! What the types do not protect: two poses of the same pair of frames at different times, and a
//! hall frame that comes from another marker map.

mod rotation;
mod transform;

pub use rotation::{
    Rotation, exp_so3, log_so3, right_jacobian_inverse_so3, right_jacobian_so3, skew,
};
pub use transform::Transform;

use nalgebra::Vector3;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Add, Sub};

/// A coordinate frame; implemented by the closed list of markers in this module only.
pub trait Frame: sealed::Sealed + Copy + fmt::Debug + PartialEq + Send + Sync + 'static {}

mod sealed {
    pub trait Sealed {}
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct $name;
        impl sealed::Sealed for $name {}
        impl Frame for $name {}
    )+};
}

frames! {
    /// Fixed frame of the building: z up.
    Hall,
    /// Forward, left, up at the IMU.
    Body,
    /// z along the optical axis, x right, y down.
    Camera,
    /// Scan plane x–y, beam angle from x towards y.
    Lidar,
    /// x right and y up of the upright tag, z out of its front.
    Tag,
}

/// A place in frame `F`, m.
///
/// ```
/// use stockpilot::geometry::{Hall, Point};
/// let a = Point::<Hall>::new(1.0, 2.0, 3.0);
/// let b = Point::<Hall>::new(1.0, 2.0, 5.0);
/// assert_eq!((b - a).coords.z, 2.0);
/// ```
/// ```compile_fail
/// use stockpilot::geometry::{Body, Hall, Point};
/// let a = Point::<Hall>::new(1.0, 2.0, 3.0);
/// let b = Point::<Body>::new(1.0, 2.0, 5.0);
/// let _ = b - a;
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point<F> {
    /// x, y, z in the frame's axes, m.
    pub coords: Vector3<f64>,
    frame: PhantomData<F>,
}

/// A free vector (difference of points, velocity, acceleration) in the axes of `F`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction<F> {
    /// x, y, z in the frame's axes; the unit is the field's that holds it.
    pub coords: Vector3<f64>,
    frame: PhantomData<F>,
}

impl<F> Point<F> {
    /// The point at (x, y, z), m.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from_coords(Vector3::new(x, y, z))
    }

    /// The point with these coordinates, m.
    #[must_use]
    pub const fn from_coords(coords: Vector3<f64>) -> Self {
        Self { coords, frame: PhantomData }
    }

    /// The frame's origin.
    #[must_use]
    pub const fn origin() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }

    /// True if no coordinate is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.coords.iter().all(|c| c.is_finite())
    }
}

impl<F> Direction<F> {
    /// The vector (x, y, z).
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from_coords(Vector3::new(x, y, z))
    }

    /// The vector with these coordinates.
    #[must_use]
    pub const fn from_coords(coords: Vector3<f64>) -> Self {
        Self { coords, frame: PhantomData }
    }

    /// The zero vector.
    #[must_use]
    pub const fn zero() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }

    /// True if no coordinate is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.coords.iter().all(|c| c.is_finite())
    }
}

impl<F> Sub for Point<F> {
    type Output = Direction<F>;
    fn sub(self, from: Self) -> Direction<F> {
        Direction::from_coords(self.coords - from.coords)
    }
}

impl<F> Add<Direction<F>> for Point<F> {
    type Output = Self;
    fn add(self, step: Direction<F>) -> Self {
        Self::from_coords(self.coords + step.coords)
    }
}
