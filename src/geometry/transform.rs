//! Rigid transforms between frames.

use super::{Frame, Point, Rotation};
use nalgebra::Vector3;
use std::ops::Mul;

/// Takes `From` coordinates to `To` coordinates; also the pose of `From` in `To`.
///
/// ```
/// use stockpilot::geometry::{Body, Hall, Lidar, Point, Rotation, Transform};
/// let hall_from_body = Transform::<Hall, Body>::new(
///     Rotation::from_euler_rad(0.0, 0.0, std::f64::consts::FRAC_PI_2),
///     Point::new(1.0, 0.0, 5.0),
/// );
/// let body_from_lidar =
///     Transform::<Body, Lidar>::new(Rotation::identity(), Point::new(0.1, 0.0, -0.05));
/// let p_hall = hall_from_body * body_from_lidar * Point::<Lidar>::new(2.0, 0.0, 0.0);
/// // 2.1 m ahead of the body, which looks along +y of the hall.
/// assert!((p_hall.coords.y - 2.1).abs() < 1e-12);
/// ```
/// ```compile_fail
/// use stockpilot::geometry::{Body, Hall, Lidar, Point, Transform};
/// fn wrong(hall_from_body: Transform<Hall, Body>, p_lidar: Point<Lidar>) -> Point<Hall> {
///     hall_from_body * p_lidar
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform<To, From> {
    /// Turns the axes of `From` into those of `To`.
    pub rotation: Rotation<To, From>,
    /// The origin of `From` in `To`, m.
    pub origin: Point<To>,
}

impl<To: Frame, From: Frame> Transform<To, From> {
    /// The transform with this rotation, and with the origin of `From` at `origin`.
    #[must_use]
    pub const fn new(rotation: Rotation<To, From>, origin: Point<To>) -> Self {
        Self { rotation, origin }
    }

    /// Both frames coincide.
    #[must_use]
    pub fn identity() -> Self {
        Self::new(Rotation::identity(), Point::origin())
    }

    /// The way back.
    #[must_use]
    pub fn inverse(&self) -> Transform<From, To> {
        let rotation = self.rotation.inverse();
        let origin = rotation.quaternion() * -self.origin.coords;
        Transform::new(rotation, Point::from_coords(origin))
    }

    /// Moved by δp (in the axes of `To`, m) and turned by δθ (in the axes of `From`, rad).
    #[must_use]
    pub fn perturbed(&self, delta_m: &Vector3<f64>, delta_rad: &Vector3<f64>) -> Self {
        Self::new(
            self.rotation.perturbed(delta_rad),
            Point::from_coords(self.origin.coords + delta_m),
        )
    }
}

impl<To: Frame, Mid: Frame, From: Frame> Mul<Transform<Mid, From>> for Transform<To, Mid> {
    type Output = Transform<To, From>;
    fn mul(self, rhs: Transform<Mid, From>) -> Transform<To, From> {
        let origin = self * rhs.origin;
        Transform::new(self.rotation * rhs.rotation, origin)
    }
}

impl<To: Frame, From: Frame> Mul<Point<From>> for Transform<To, From> {
    type Output = Point<To>;
    fn mul(self, rhs: Point<From>) -> Point<To> {
        Point::from_coords(self.rotation.quaternion() * rhs.coords + self.origin.coords)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Body, Hall, Lidar};

    fn awkward_pose() -> Transform<Hall, Body> {
        Transform::new(Rotation::from_euler_rad(0.2, -0.5, 2.2), Point::new(4.0, -1.5, 6.0))
    }

    #[test]
    fn inverse_undoes_the_transform() {
        let pose = awkward_pose();
        let p = Point::<Body>::new(0.3, 0.7, -2.0);
        let back = pose.inverse() * (pose * p);
        assert!((back.coords - p.coords).norm() < 1e-12);
    }

    #[test]
    fn product_equals_applying_one_after_the_other() {
        let hall_from_body = awkward_pose();
        let body_from_lidar = Transform::<Body, Lidar>::new(
            Rotation::from_euler_rad(1.1, 0.3, -0.4),
            Point::new(0.1, 0.02, -0.06),
        );
        let p = Point::<Lidar>::new(3.0, -1.0, 0.0);
        let joint = (hall_from_body * body_from_lidar) * p;
        let stepwise = hall_from_body * (body_from_lidar * p);
        assert!((joint.coords - stepwise.coords).norm() < 1e-12);
    }
}
