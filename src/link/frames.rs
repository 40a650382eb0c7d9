//! Between this program's axes and MAVLink's, in both directions.
//!
//! Both pairs differ by half a turn about x, which is its own inverse:
//! `(x, y, z) → (x, −y, −z)`.

use crate::geometry::{Body, Hall, Rotation};
use nalgebra::{Matrix3, Vector3};

/// NED coordinates of Hall coordinates, FRD of Body, and back.
pub(crate) fn half_turned(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.y, -v.z)
}

/// The matrix of [`half_turned`].
pub(crate) fn half_turn() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
}

/// (w, x, y, z) of the rotation that takes FRD to NED.
///
/// ```text
/// R_ned_frd = D R_hall_body D,  D = diag(1, −1, −1)   ⇒   q = (w, x, −y, −z)
/// ```
pub(crate) fn ned_from_frd_wxyz(hall_from_body_rot: &Rotation<Hall, Body>) -> [f64; 4] {
    let q = hall_from_body_rot.quaternion();
    [q.w, q.i, -q.j, -q.k]
}

/// The attitude of MAVLink's quaternion; `None` if it is not one.
pub(crate) fn hall_from_body_rot(ned_from_frd_wxyz: [f64; 4]) -> Option<Rotation<Hall, Body>> {
    let [w, x, y, z] = ned_from_frd_wxyz;
    Rotation::from_wxyz(w, x, -y, -z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Direction;

    #[test]
    fn a_climbing_left_turn_changes_signs_as_by_hand() {
        // Heading 30° to the left of hall x, nose 20° up: forward points to
        // (cos 20° cos 30°, cos 20° sin 30°, sin 20°) = (0.813798, 0.469846, 0.342020) in z-up
        // axes, so north 0.813798, east −0.469846, down −0.342020.
        let rotation = Rotation::<Hall, Body>::from_euler_rad(
            0.0,
            (-20_f64).to_radians(), // z-up axes: positive pitch is nose down
            30_f64.to_radians(),
        );
        let forward = rotation * Direction::<Body>::new(1.0, 0.0, 0.0);
        assert!((forward.coords - Vector3::new(0.813_798, 0.469_846, 0.342_020)).norm() < 1e-6);
        let [w, x, y, z] = ned_from_frd_wxyz(&rotation);
        let q = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        let forward_ned = q * Vector3::x();
        assert!((forward_ned - Vector3::new(0.813_798, -0.469_846, -0.342_020)).norm() < 1e-6);
        // MAVLink's Euler angles: yaw −30° (to the left), pitch +20° (nose up), roll 0.
        let (roll, pitch, yaw) = q.euler_angles();
        assert!(roll.abs() < 1e-9);
        assert!((pitch - 20_f64.to_radians()).abs() < 1e-9);
        assert!((yaw + 30_f64.to_radians()).abs() < 1e-9);
    }

    #[test]
    fn attitude_comes_back() {
        let rotation = Rotation::<Hall, Body>::from_euler_rad(0.7, -0.4, 2.9);
        let back = hall_from_body_rot(ned_from_frd_wxyz(&rotation));
        assert!(back.is_some_and(|back| back.minus(&rotation).norm() < 1e-12));
        assert!(hall_from_body_rot([f64::NAN, 0.0, 0.0, 0.0]).is_none());
    }
}
