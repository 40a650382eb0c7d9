//! NED and FRD against `Hall` and `Body`, and the widths of numbers on the wire.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// (x, −y, −z): `Hall` to NED, `Body` to FRD, and back.
pub(super) fn flipped(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.y, -v.z)
}

/// The quaternion w, x, y, z of a message; `None` if it is not finite or has no length.
pub(super) fn quaternion_from_wire(q: &[f32; 4]) -> Option<UnitQuaternion<f64>> {
    let [w, x, y, z] = q.map(f64::from);
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    (norm.is_finite() && norm > 1e-6).then(|| UnitQuaternion::new_normalize(quaternion))
}

/// The quaternion as w, x, y, z of a message.
pub(super) fn wire_quaternion(q: &UnitQuaternion<f64>) -> [f32; 4] {
    [single(q.w), single(q.i), single(q.j), single(q.k)]
}

/// Single precision, as messages carry it.
#[expect(clippy::cast_possible_truncation, reason = "the wire holds single precision")]
pub(super) const fn single(value: f64) -> f32 {
    value as f32
}

/// The nearest whole number inside ±2^62.
#[expect(clippy::cast_possible_truncation, reason = "clamped before the cast")]
pub(super) fn whole(value: f64) -> i64 {
    const LIMIT: f64 = 4.6e18;
    if value.is_nan() { 0 } else { value.round().clamp(-LIMIT, LIMIT) as i64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flipping_axes_conjugates_the_rotation() {
        let hall_from_body = UnitQuaternion::from_euler_angles(0.2, -0.5, 2.2);
        let q = hall_from_body.quaternion();
        let ned_from_frd = UnitQuaternion::new_normalize(Quaternion::new(q.w, q.i, -q.j, -q.k));
        let v = Vector3::new(0.3, -1.2, 0.7);
        let direct = flipped(&(hall_from_body * v));
        assert!((ned_from_frd * flipped(&v) - direct).norm() < 1e-12);
    }
}
