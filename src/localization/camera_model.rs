//! A pinhole camera with radial–tangential distortion, and where it is mounted.
//!
//! ```text
//! x = X/Z, y = Y/Z, r² = x² + y²
//! x_d = x (1 + k₁r² + k₂r⁴) + 2 p₁ x y + p₂ (r² + 2x²)
//! y_d = y (1 + k₁r² + k₂r⁴) + p₁ (r² + 2y²) + 2 p₂ x y
//! u = f_x x_d + c_x,  v = f_y y_d + c_y
//! ```
//! Source: Brown 1966, in the form of the `OpenCV` camera model.

use crate::geometry::{Body, Camera, Point, Transform};
use nalgebra::{Matrix2, Matrix2x3, Vector2};

/// Intrinsics and mounting of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraModel {
    /// Image width, px.
    pub width_px: u32,
    /// Image height, px.
    pub height_px: u32,
    /// Focal length along u, px.
    pub fx_px: f64,
    /// Focal length along v, px.
    pub fy_px: f64,
    /// Principal point u, px; the centre of the first pixel is at 0.5.
    pub cx_px: f64,
    /// Principal point v, px.
    pub cy_px: f64,
    /// Radial coefficients k₁, k₂.
    pub radial: [f64; 2],
    /// Tangential coefficients p₁, p₂.
    pub tangential: [f64; 2],
    /// Pose of the camera on the body.
    pub body_from_camera: Transform<Body, Camera>,
}

/// Points closer to the image plane than this are not projected, m.
const MIN_DEPTH_M: f64 = 0.05;

impl CameraModel {
    /// The pixel of a point, and its derivative by the point (2×3, px/m).
    ///
    /// `None` behind the camera, and where the distortion polynomial has folded back (a point
    /// far outside the image would land inside it).
    #[must_use]
    pub fn project(&self, p: &Point<Camera>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let depth = p.coords.z;
        if depth < MIN_DEPTH_M {
            return None;
        }
        let n = Vector2::new(p.coords.x / depth, p.coords.y / depth);
        let (distorted, by_n) = self.distort(&n);
        // The polynomial is a map of the plane only while it keeps orientation and grows outwards.
        if by_n.determinant() <= 0.0 || by_n.trace() <= 0.0 {
            return None;
        }
        let focal = Matrix2::new(self.fx_px, 0.0, 0.0, self.fy_px);
        let pixel = focal * distorted + Vector2::new(self.cx_px, self.cy_px);
        let n_by_p = Matrix2x3::new(1.0, 0.0, -n.x, 0.0, 1.0, -n.y) / depth;
        Some((pixel, focal * by_n * n_by_p))
    }

    /// True if the pixel lies in the image, at least `margin_px` from its border.
    #[must_use]
    pub fn contains(&self, pixel: &Vector2<f64>, margin_px: f64) -> bool {
        let inside =
            |value: f64, size: u32| value >= margin_px && value <= f64::from(size) - margin_px;
        inside(pixel.x, self.width_px) && inside(pixel.y, self.height_px)
    }

    /// The direction (X/Z, Y/Z) that a pixel looks along; `None` if the inversion diverges.
    #[must_use]
    pub fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let target =
            Vector2::new((pixel.x - self.cx_px) / self.fx_px, (pixel.y - self.cy_px) / self.fy_px);
        let mut n = target;
        for _ in 0..20 {
            let (distorted, by_n) = self.distort(&n);
            let step = by_n.try_inverse()? * (target - distorted);
            n += step;
            if step.norm() < 1e-12 {
                return Some(n);
            }
        }
        let residual = target - self.distort(&n).0;
        (residual.norm() < 1e-6).then_some(n)
    }

    /// Distorted coordinates and their derivative by the undistorted ones.
    fn distort(&self, n: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [k1, k2] = self.radial;
        let [p1, p2] = self.tangential;
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + k1 * r2 + k2 * r2 * r2;
        let radial_by_r2 = k1 + 2.0 * k2 * r2;
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * radial_by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
        let by_n = Matrix2::new(
            radial + 2.0 * x * x * radial_by_r2 + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * radial_by_r2 + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (distorted, by_n)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::Rotation;
    use crate::stats::SeedBook;

    /// A wide, visibly distorted camera, mounted askew.
    pub(crate) fn distorted_camera() -> CameraModel {
        CameraModel {
            width_px: 1280,
            height_px: 800,
            fx_px: 640.0,
            fy_px: 642.0,
            cx_px: 645.0,
            cy_px: 396.0,
            radial: [-0.12, 0.02],
            tangential: [0.001, -0.0007],
            body_from_camera: Transform::new(
                // A camera that looks along body x: z_c = x_b, x_c = −y_b, y_c = −z_b; then tilted.
                Rotation::from_euler_rad(0.02, 0.2, -0.1)
                    * Rotation::<Body, Camera>::from_euler_rad(
                        -std::f64::consts::FRAC_PI_2,
                        0.0,
                        -std::f64::consts::FRAC_PI_2,
                    ),
                Point::new(0.1, 0.02, -0.03),
            ),
        }
    }

    #[test]
    fn projection_jacobian_matches_central_difference() {
        let camera = distorted_camera();
        let mut noise = SeedBook::new(3).stream("points");
        for _ in 0..50 {
            let z = noise.between(1.0, 15.0);
            let p =
                Point::<Camera>::new(z * noise.between(-0.8, 0.8), z * noise.between(-0.5, 0.5), z);
            let (_, jacobian) = camera.project(&p).expect("in view");
            for axis in 0..3 {
                let step = nalgebra::Vector3::ith(axis, 1e-6);
                let at = |d| camera.project(&Point::from_coords(p.coords + d)).expect("in view").0;
                let numeric = (at(step) - at(-step)) / 2e-6;
                let analytic: Vector2<f64> = jacobian.column(axis).into();
                assert!((numeric - analytic).norm() < 1e-5, "axis {axis} at {p:?}");
            }
        }
    }

    #[test]
    fn unproject_undoes_project() {
        let camera = distorted_camera();
        let p = Point::<Camera>::new(2.1, -1.3, 4.0);
        let (pixel, _) = camera.project(&p).expect("in view");
        let n = camera.unproject(&pixel).expect("invertible");
        assert!((n - Vector2::new(2.1 / 4.0, -1.3 / 4.0)).norm() < 1e-9);
    }

    #[test]
    fn points_behind_the_camera_have_no_pixel() {
        assert!(distorted_camera().project(&Point::new(0.0, 0.0, -1.0)).is_none());
    }

    #[test]
    fn undistorted_axis_point_hits_the_principal_point() {
        let (pixel, _) = distorted_camera().project(&Point::new(0.0, 0.0, 3.0)).expect("in view");
        assert!((pixel - Vector2::new(645.0, 396.0)).norm() < 1e-12);
    }
}
