//! A pinhole with radial and tangential distortion.

use nalgebra::{Vector2, Vector3};

/// Intrinsics of a camera.
///
/// ```text
/// x = X/Z,  y = Y/Z,  r² = x² + y²,  q = 1 + k₁ r² + k₂ r⁴
/// u = f_x (q x + 2 p₁ x y + p₂ (r² + 2 x²)) + c_x
/// v = f_y (q y + p₁ (r² + 2 y²) + 2 p₂ x y) + c_y
/// ```
/// - `X, Y, Z`: a point in camera axes (right, down, ahead), m
/// - `u, v`: px right and down; the centre of the first pixel is at (0.5, 0.5)
///
/// Source: Brown 1966, in the form of `cv::projectPoints`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Width of the picture, px.
    pub width_px: u32,
    /// Height of the picture, px.
    pub height_px: u32,
    /// Focal length along u, px.
    pub fx_px: f64,
    /// Focal length along v, px.
    pub fy_px: f64,
    /// Principal point, u, px.
    pub cx_px: f64,
    /// Principal point, v, px.
    pub cy_px: f64,
    /// Radial distortion, r².
    pub k1: f64,
    /// Radial distortion, r⁴.
    pub k2: f64,
    /// Tangential distortion, vertical.
    pub p1: f64,
    /// Tangential distortion, horizontal.
    pub p2: f64,
}

impl Lens {
    /// 1280 × 800 px, 90° across, with the distortion of an ordinary wide lens.
    #[must_use]
    pub fn wide() -> Self {
        Self {
            width_px: 1280,
            height_px: 800,
            fx_px: 640.0,
            fy_px: 640.0,
            cx_px: 642.3,
            cy_px: 397.8,
            k1: -0.05,
            k2: 0.01,
            p1: 0.0004,
            p2: -0.0003,
        }
    }

    /// The pixel (u, v) of a point in camera axes; `None` behind the camera or so far beside the
    /// picture that the polynomial means nothing.
    #[must_use]
    pub fn project(&self, in_camera_m: &Vector3<f64>) -> Option<[f64; 2]> {
        const NEAREST_M: f64 = 0.05;
        if in_camera_m.z < NEAREST_M {
            return None;
        }
        let (x, y) = (in_camera_m.x / in_camera_m.z, in_camera_m.y / in_camera_m.z);
        let r2 = x * x + y * y;
        if r2 > self.largest_r2() {
            return None;
        }
        let radial = 1.0 + r2 * (self.k1 + r2 * self.k2);
        let bent_x = radial * x + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x);
        let bent_y = radial * y + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y;
        Some([self.fx_px * bent_x + self.cx_px, self.fy_px * bent_y + self.cy_px])
    }

    /// (X/Z, Y/Z) of what is seen at a pixel: the inverse of [`Self::project`], by iteration.
    ///
    /// `None` if it does not end, far outside of the picture.
    #[must_use]
    pub fn ray(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let bent =
            Vector2::new((pixel.x - self.cx_px) / self.fx_px, (pixel.y - self.cy_px) / self.fy_px);
        let mut ray = bent;
        for _ in 0..50 {
            let (x, y, r2) = (ray.x, ray.y, ray.norm_squared());
            let radial = 1.0 + r2 * (self.k1 + r2 * self.k2);
            let sideways = Vector2::new(
                2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
                self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
            );
            let next = (bent - sideways) / radial;
            let step = (next - ray).norm();
            ray = next;
            if step < 1e-12 {
                return Some(ray);
            }
        }
        None
    }

    /// r² a fifth outside of the corners of the picture without distortion.
    fn largest_r2(&self) -> f64 {
        let across = 0.5 * f64::from(self.width_px) / self.fx_px;
        let up = 0.5 * f64::from(self.height_px) / self.fy_px;
        1.44 * (across * across + up * up)
    }

    /// True inside the picture, at least `margin_px` from its border.
    #[must_use]
    pub fn contains(&self, [u_px, v_px]: [f64; 2], margin_px: f64) -> bool {
        let is_inside =
            |at: f64, size: u32| (margin_px..=f64::from(size) - margin_px).contains(&at);
        is_inside(u_px, self.width_px) && is_inside(v_px, self.height_px)
    }
}
