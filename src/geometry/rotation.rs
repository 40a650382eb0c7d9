//! Rotations between frames, and the exponential map of SO(3).

use super::{Direction, Frame};
use nalgebra::{Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};
use std::marker::PhantomData;
use std::ops::Mul;

/// Takes vectors in the axes of `From` to the axes of `To`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation<To, From> {
    quaternion: UnitQuaternion<f64>,
    frames: PhantomData<(To, From)>,
}

impl<To: Frame, From: Frame> Rotation<To, From> {
    /// The rotation given by a unit quaternion (Hamilton, w first in print).
    #[must_use]
    pub const fn from_quaternion(quaternion: UnitQuaternion<f64>) -> Self {
        Self { quaternion, frames: PhantomData }
    }

    /// Equal axes.
    #[must_use]
    pub fn identity() -> Self {
        Self::from_quaternion(UnitQuaternion::identity())
    }

    /// Rotation by yaw about z, then pitch about the new y, then roll about the new x, rad.
    #[must_use]
    pub fn from_euler_rad(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Self {
        Self::from_quaternion(UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad))
    }

    /// The rotation whose columns are the axes of `From` in `To`.
    ///
    /// The nearest rotation is taken, so rounding in the matrix does no harm. A matrix far from
    /// any rotation gives some rotation, in bounded time.
    #[must_use]
    pub fn from_matrix(matrix: &Matrix3<f64>) -> Self {
        const MAX_ITERATIONS: usize = 100;
        let guess = UnitQuaternion::identity();
        let nearest = UnitQuaternion::from_matrix_eps(matrix, f64::EPSILON, MAX_ITERATIONS, guess);
        Self::from_quaternion(nearest)
    }

    /// The rotation with quaternion (w, x, y, z); `None` if it is not finite or has no length.
    #[must_use]
    pub fn from_wxyz(w: f64, x: f64, y: f64, z: f64) -> Option<Self> {
        let quaternion = Quaternion::new(w, x, y, z);
        let norm = quaternion.norm();
        (norm.is_finite() && norm > 1e-6)
            .then(|| Self::from_quaternion(Unit::new_normalize(quaternion)))
    }

    /// The unit quaternion.
    #[must_use]
    pub const fn quaternion(&self) -> &UnitQuaternion<f64> {
        &self.quaternion
    }

    /// The 3×3 matrix R with `v_to = R v_from`.
    #[must_use]
    pub fn matrix(&self) -> Matrix3<f64> {
        self.quaternion.to_rotation_matrix().into_inner()
    }

    /// (roll, pitch, yaw), rad, in the order of [`Self::from_euler_rad`].
    #[must_use]
    pub fn euler_rad(&self) -> (f64, f64, f64) {
        self.quaternion.euler_angles()
    }

    /// Yaw of the x axis of `From` in the x–y plane of `To`, rad.
    #[must_use]
    pub fn yaw_rad(&self) -> f64 {
        self.euler_rad().2
    }

    /// The way back.
    #[must_use]
    pub fn inverse(&self) -> Rotation<From, To> {
        Rotation::from_quaternion(self.quaternion.inverse())
    }

    /// `R · exp(δθ^)`: turned by a small rotation given in the axes of `From`, rad.
    #[must_use]
    pub fn perturbed(&self, delta_rad: &Vector3<f64>) -> Self {
        Self::from_quaternion(self.quaternion * exp_so3(delta_rad))
    }

    /// The δθ with `self = reference.perturbed(δθ)`, rad, in the axes of `From`.
    #[must_use]
    pub fn minus(&self, reference: &Self) -> Vector3<f64> {
        log_so3(&(reference.quaternion.inverse() * self.quaternion))
    }
}

impl<To: Frame, Mid: Frame, From: Frame> Mul<Rotation<Mid, From>> for Rotation<To, Mid> {
    type Output = Rotation<To, From>;
    fn mul(self, rhs: Rotation<Mid, From>) -> Rotation<To, From> {
        Rotation::from_quaternion(self.quaternion * rhs.quaternion)
    }
}

impl<To: Frame, From: Frame> Mul<Direction<From>> for Rotation<To, From> {
    type Output = Direction<To>;
    fn mul(self, rhs: Direction<From>) -> Direction<To> {
        Direction::from_coords(self.quaternion * rhs.coords)
    }
}

/// The matrix v^ with `v^ w = v × w`.
#[must_use]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// Rotation by the vector `rotation_rad` (axis times angle).
#[must_use]
pub fn exp_so3(rotation_rad: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(*rotation_rad)
}

/// The rotation vector (axis times angle, at most π) of a rotation.
#[must_use]
pub fn log_so3(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    rotation.scaled_axis()
}

/// The right Jacobian of SO(3).
///
/// ```text
/// exp((φ + δ)^) ≈ exp(φ^) exp((J_r(φ) δ)^)
/// J_r(φ) = I − (1 − cos φ)/φ² φ^ + (φ − sin φ)/φ³ φ^²
/// ```
/// Source: Solà, Deray, Atchuthan 2018, "A micro Lie theory", eq. (143).
#[must_use]
pub fn right_jacobian_so3(phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let phi_hat = skew(phi);
    // Below this angle the closed form loses digits; the series is exact to 1e-17 there.
    let (a, b) = if angle < 1e-4 {
        (0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0)
    } else {
        ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / angle.powi(3))
    };
    Matrix3::identity() - phi_hat * a + phi_hat * phi_hat * b
}

/// The inverse of the right Jacobian of SO(3), for |φ| < π.
///
/// ```text
/// J_r⁻¹(φ) = I + ½ φ^ + (1/φ² − (1 + cos φ)/(2 φ sin φ)) φ^²
/// ```
/// Source: Solà, Deray, Atchuthan 2018, "A micro Lie theory", eq. (144).
#[must_use]
pub fn right_jacobian_inverse_so3(phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let phi_hat = skew(phi);
    let c = if angle < 1e-4 {
        1.0 / 12.0 + angle * angle / 720.0
    } else {
        1.0 / (angle * angle) - (1.0 + angle.cos()) / (2.0 * angle * angle.sin())
    };
    Matrix3::identity() + phi_hat * 0.5 + phi_hat * phi_hat * c
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Body, Hall};

    const AWKWARD: [[f64; 3]; 4] =
        [[0.3, -0.8, 1.1], [1e-6, 2e-6, -1e-6], [-2.0, 0.4, 0.9], [0.0, 0.0, 3.0]];

    #[test]
    fn yaw_turns_forward_to_the_left() {
        // A body yawed by 90° in a z-up hall looks along +y.
        let hall_from_body = Rotation::<Hall, Body>::from_euler_rad(0.0, 0.0, 90_f64.to_radians());
        let forward = hall_from_body * Direction::<Body>::new(1.0, 0.0, 0.0);
        assert!((forward.coords - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn right_jacobian_matches_central_difference() {
        for phi in AWKWARD.map(Vector3::from) {
            let step = 1e-6;
            for axis in 0..3 {
                let delta = Vector3::ith(axis, step);
                let plus = log_so3(&(exp_so3(&phi).inverse() * exp_so3(&(phi + delta))));
                let minus = log_so3(&(exp_so3(&phi).inverse() * exp_so3(&(phi - delta))));
                let numeric = (plus - minus) / (2.0 * step);
                let analytic: Vector3<f64> = right_jacobian_so3(&phi).column(axis).into();
                assert!((numeric - analytic).norm() < 1e-8, "φ {phi:?} axis {axis}");
            }
        }
    }

    #[test]
    fn right_jacobian_inverse_is_its_inverse() {
        for phi in AWKWARD.map(Vector3::from) {
            let product = right_jacobian_so3(&phi) * right_jacobian_inverse_so3(&phi);
            assert!((product - Matrix3::identity()).norm() < 1e-9, "φ {phi:?}");
        }
    }

    #[test]
    fn perturbation_and_difference_undo_each_other() {
        for phi in AWKWARD.map(Vector3::from) {
            let reference = Rotation::<Hall, Body>::from_euler_rad(0.7, -0.4, 2.9);
            let delta = phi * 0.5;
            assert!((reference.perturbed(&delta).minus(&reference) - delta).norm() < 1e-9);
        }
    }

    #[test]
    fn broken_quaternions_are_refused() {
        assert!(Rotation::<Hall, Body>::from_wxyz(0.0, 0.0, 0.0, 0.0).is_none());
        assert!(Rotation::<Hall, Body>::from_wxyz(f64::NAN, 0.0, 0.0, 1.0).is_none());
        assert!(Rotation::<Hall, Body>::from_wxyz(2.0, 0.0, 0.0, 0.0).is_some());
    }
}
