//! The lens of ordinary cameras: radial and tangential distortion of the pinhole's picture.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

/// Points closer to the image plane than this are not projected, m.
const MIN_DEPTH_M: f64 = 0.05;
/// No radial–tangential lens is believed farther from its axis: tan 85°.
const MAX_RADIUS: f64 = 11.43;
const RADIUS_STEP: f64 = 0.01;

/// Radial and tangential distortion, polynomial or rational.
///
/// ```text
/// x = X/Z, y = Y/Z, s = x² + y²
/// q = (1 + k₁s + k₂s² + k₃s³) / (1 + k₄s + k₅s² + k₆s³)
/// x_d = q x + 2 p₁ x y + p₂ (s + 2x²)
/// y_d = q y + p₁ (s + 2y²) + 2 p₂ x y
/// ```
/// - `X, Y, Z`: the point in camera axes, m
///
/// Valid from the axis to the radius where `r q(r²)` stops growing: beyond it a point far outside
/// the picture would land inside it.
/// Source: Brown 1966, in the form of the `OpenCV` camera model (`plumb_bob` with k₄ = k₅ = k₆ = 0,
/// `rational_polynomial`).
/// Checked: `projection_jacobians_match_central_differences`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadialTangential {
    radial: [f64; 6],
    tangential: [f64; 2],
    /// Largest undistorted radius that is projected.
    max_radius: f64,
}

impl RadialTangential {
    /// The lens with radial coefficients k₁ to k₆ and tangential ones p₁, p₂.
    #[must_use]
    pub fn new(radial: [f64; 6], tangential: [f64; 2]) -> Self {
        let unlimited = Self { radial, tangential, max_radius: MAX_RADIUS };
        Self { max_radius: unlimited.fold_radius(), ..unlimited }
    }

    /// k₁ to k₆.
    #[must_use]
    pub const fn radial(&self) -> [f64; 6] {
        self.radial
    }

    /// p₁, p₂.
    #[must_use]
    pub const fn tangential(&self) -> [f64; 2] {
        self.tangential
    }

    /// The undistorted radius (tangent of the angle to the axis) up to which the lens is valid.
    #[must_use]
    pub const fn max_radius(&self) -> f64 {
        self.max_radius
    }

    /// The radius where the distorted one stops growing; [`MAX_RADIUS`] if it never does.
    fn fold_radius(&self) -> f64 {
        let grows = |r: f64| {
            let (q, q_by_s) = self.radial_factor(r * r);
            // d(r q)/dr = q + 2 r² dq/ds; a rational factor changes its sign only through a pole.
            q > 0.0 && q + 2.0 * r * r * q_by_s > 0.0
        };
        let mut good = 0.0;
        while good < MAX_RADIUS {
            let next = good + RADIUS_STEP;
            if !grows(next) {
                return bisected(good, next, grows);
            }
            good = next;
        }
        MAX_RADIUS
    }

    /// The factor `q` and its derivative by `s`.
    fn radial_factor(&self, s: f64) -> (f64, f64) {
        let [k1, k2, k3, k4, k5, k6] = self.radial;
        let above = 1.0 + s * (k1 + s * (k2 + s * k3));
        let below = 1.0 + s * (k4 + s * (k5 + s * k6));
        let above_by_s = k1 + s * (2.0 * k2 + s * 3.0 * k3);
        let below_by_s = k4 + s * (2.0 * k5 + s * 3.0 * k6);
        let q = above / below;
        (q, (above_by_s - q * below_by_s) / below)
    }

    /// Image coordinates of a point in camera axes and their derivative by it (2×3, 1/m).
    pub(super) fn image_of(&self, p: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        if p.z < MIN_DEPTH_M {
            return None;
        }
        let n = Vector2::new(p.x / p.z, p.y / p.z);
        let (distorted, by_n) = self.distorted(&n)?;
        let n_by_p = Matrix2x3::new(1.0, 0.0, -n.x, 0.0, 1.0, -n.y) / p.z;
        Some((distorted, by_n * n_by_p))
    }

    /// The unit vector that is seen at these image coordinates.
    pub(super) fn bearing_of(&self, image: &Vector2<f64>) -> Option<Vector3<f64>> {
        let mut n = *image;
        let reach = 0.999 * self.max_radius;
        for _ in 0..30 {
            // A first guess outside of the valid radius starts at its border.
            n *= (reach / n.norm()).min(1.0);
            let (distorted, by_n) = self.distorted(&n)?;
            let step = by_n.try_inverse()? * (image - distorted);
            n += step;
            if step.norm() < 1e-13 {
                break;
            }
        }
        let residual = image - self.distorted(&n)?.0;
        (residual.norm() < 1e-9).then(|| Vector3::new(n.x, n.y, 1.0).normalize())
    }

    /// Distorted coordinates and their derivative by the undistorted ones.
    fn distorted(&self, n: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let [p1, p2] = self.tangential;
        let (x, y) = (n.x, n.y);
        let s = x * x + y * y;
        if s.is_nan() || s > self.max_radius * self.max_radius {
            return None;
        }
        let (q, q_by_s) = self.radial_factor(s);
        let distorted = Vector2::new(
            x * q + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
            y * q + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * q_by_s + 2.0 * p1 * x + 2.0 * p2 * y;
        let by_n = Matrix2::new(
            q + 2.0 * x * x * q_by_s + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            q + 2.0 * y * y * q_by_s + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        // The tangential part may fold a little earlier than the radial one.
        (by_n.determinant() > 0.0 && by_n.trace() > 0.0).then_some((distorted, by_n))
    }
}

/// The border between `good`, where the condition holds, and `bad`, where it does not.
pub(super) fn bisected(mut good: f64, mut bad: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..40 {
        let middle = 0.5 * (good + bad);
        if holds(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}
