//! The lens of wide cameras: the image radius is a polynomial of the angle to the axis.

use super::radial_tangential::bisected;
use nalgebra::{Matrix2x3, Vector2, Vector3};

/// Points closer to the centre of projection than this are not projected, m.
const MIN_DISTANCE_M: f64 = 0.05;
/// No fisheye lens is believed farther from its axis: 95°.
const MAX_ANGLE_RAD: f64 = 95.0 * std::f64::consts::PI / 180.0;
const ANGLE_STEP_RAD: f64 = 0.002;
/// Nearer to the axis (ρ/|Z|) the Jacobian comes from a series, which is exact to 1e-16 there.
const NEAR_AXIS: f64 = 1e-4;

/// Kannala–Brandt distortion.
///
/// ```text
/// ρ = √(X² + Y²), θ = atan2(ρ, Z)
/// θ_d = θ (1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸)
/// x_d = θ_d X/ρ, y_d = θ_d Y/ρ
/// ```
/// - `X, Y, Z`: the point in camera axes, m; Z may be a little negative
/// - `θ`: angle between the line of sight and the optical axis, rad
///
/// Valid from the axis to 95° or to the angle where `θ_d` stops growing, whichever is less.
/// Source: Kannala and Brandt 2006, eq. (6), in the form of the `OpenCV` fisheye model
/// (`equidistant` in ROS).
/// Checked: `projection_jacobians_match_central_differences`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fisheye {
    k: [f64; 4],
    /// Largest angle that is projected, rad.
    max_angle_rad: f64,
}

impl Fisheye {
    /// The lens with coefficients k₁ to k₄.
    #[must_use]
    pub fn new(k: [f64; 4]) -> Self {
        let unlimited = Self { k, max_angle_rad: MAX_ANGLE_RAD };
        Self { max_angle_rad: unlimited.fold_angle_rad(), ..unlimited }
    }

    /// k₁ to k₄.
    #[must_use]
    pub const fn coefficients(&self) -> [f64; 4] {
        self.k
    }

    /// The angle to the optical axis up to which the lens is valid, rad.
    #[must_use]
    pub const fn max_angle_rad(&self) -> f64 {
        self.max_angle_rad
    }

    fn fold_angle_rad(&self) -> f64 {
        let grows = |angle: f64| self.distorted(angle).1 > 0.0;
        let mut good = 0.0;
        while good < MAX_ANGLE_RAD {
            let next = good + ANGLE_STEP_RAD;
            if !grows(next) {
                return bisected(good, next, grows);
            }
            good = next;
        }
        MAX_ANGLE_RAD
    }

    /// `θ_d` and its derivative by `θ`.
    fn distorted(&self, angle: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.k;
        let s = angle * angle;
        let factor = 1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)));
        let slope = 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)));
        (angle * factor, slope)
    }

    /// Image coordinates of a point in camera axes and their derivative by it (2×3, 1/m).
    ///
    /// ```text
    /// m = e (X, Y), e = θ_d/ρ
    /// ∂e/∂X = X h, ∂e/∂Y = Y h, h = (θ_d′ Z/R² − e)/ρ², ∂e/∂Z = −θ_d′/R²
    /// ```
    /// - `R² = ρ² + Z²`
    pub(super) fn image_of(&self, p: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let rho2 = p.x * p.x + p.y * p.y;
        let rho = rho2.sqrt();
        let distance2 = rho2 + p.z * p.z;
        let angle = rho.atan2(p.z);
        let is_valid = distance2 >= MIN_DISTANCE_M * MIN_DISTANCE_M && angle <= self.max_angle_rad;
        if !is_valid {
            return None;
        }
        let (distorted, slope) = self.distorted(angle);
        // The angle is valid, so near the axis Z is positive.
        let (e, h) = if rho < NEAR_AXIS * p.z {
            // θ_d = t + (k₁ − 1/3) t³ + …,  t = ρ/Z
            let c = self.k[0] - 1.0 / 3.0;
            let t2 = rho2 / (p.z * p.z);
            ((1.0 + c * t2) / p.z, 2.0 * c / p.z.powi(3))
        } else {
            let e = distorted / rho;
            (e, (slope * p.z / distance2 - e) / rho2)
        };
        let e_by_z = -slope / distance2;
        let image = Vector2::new(p.x, p.y) * e;
        let by_p = Matrix2x3::new(
            e + p.x * p.x * h,
            p.x * p.y * h,
            p.x * e_by_z,
            p.x * p.y * h,
            e + p.y * p.y * h,
            p.y * e_by_z,
        );
        Some((image, by_p))
    }

    /// The unit vector that is seen at these image coordinates; Newton inside a shrinking bracket.
    pub(super) fn bearing_of(&self, image: &Vector2<f64>) -> Option<Vector3<f64>> {
        let target = image.norm();
        let (mut low, mut high) = (0.0, self.max_angle_rad);
        if target.is_nan() || target > self.distorted(high).0 {
            return None;
        }
        let mut angle = target.min(high);
        for _ in 0..60 {
            let (distorted, slope) = self.distorted(angle);
            if distorted > target {
                high = angle;
            } else {
                low = angle;
            }
            let newton = angle - (distorted - target) / slope;
            let next = if (low..=high).contains(&newton) { newton } else { 0.5 * (low + high) };
            let step = (next - angle).abs();
            angle = next;
            if step < 1e-14 {
                break;
            }
        }
        let (sin, cos) = angle.sin_cos();
        // sin θ/θ_d is 1 on the axis.
        let across = if target < 1e-12 { 1.0 } else { sin / target };
        Some(Vector3::new(image.x * across, image.y * across, cos))
    }
}
