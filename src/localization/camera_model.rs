//! A camera: its lens, and where it is mounted.
//!
//! ```text
//! u = f_x x_d + c_x,  v = f_y y_d + c_y
//! ```
//! - `x_d, y_d`: image coordinates, which the [`Lens`] makes of a point in camera axes
//!
//! Pixels follow one convention everywhere in this project: the centre of the first pixel is at
//! (0.5, 0.5). `OpenCV` puts it at (0, 0), so a principal point from there is half a pixel less.

mod fisheye;
mod radial_tangential;

pub use fisheye::Fisheye;
pub use radial_tangential::RadialTangential;

use crate::geometry::{Body, Camera, Point, Transform};
use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use std::time::Duration;

/// How a lens bends the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Ordinary lenses, to about 120° across.
    RadialTangential(RadialTangential),
    /// Wide lenses, to 190° across.
    Fisheye(Fisheye),
}

impl Lens {
    /// A lens without distortion.
    #[must_use]
    pub fn pinhole() -> Self {
        Self::radial_tangential([0.0; 2], [0.0; 2])
    }

    /// Radial coefficients k₁, k₂ and tangential ones p₁, p₂.
    #[must_use]
    pub fn radial_tangential([k1, k2]: [f64; 2], tangential: [f64; 2]) -> Self {
        Self::RadialTangential(RadialTangential::new([k1, k2, 0.0, 0.0, 0.0, 0.0], tangential))
    }

    /// Kannala–Brandt coefficients k₁ to k₄.
    #[must_use]
    pub fn fisheye(k: [f64; 4]) -> Self {
        Self::Fisheye(Fisheye::new(k))
    }

    fn image_of(&self, p: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        match self {
            Self::RadialTangential(lens) => lens.image_of(p),
            Self::Fisheye(lens) => lens.image_of(p),
        }
    }

    fn bearing_of(&self, image: &Vector2<f64>) -> Option<Vector3<f64>> {
        match self {
            Self::RadialTangential(lens) => lens.bearing_of(image),
            Self::Fisheye(lens) => lens.bearing_of(image),
        }
    }
}

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
    /// The lens.
    pub lens: Lens,
    /// Time from the readout of the first row to that of the last; zero for a global shutter.
    pub readout: Duration,
    /// Pose of the camera on the body.
    pub body_from_camera: Transform<Body, Camera>,
}

impl CameraModel {
    /// The pixel of a point, and its derivative by the point (2×3, px/m).
    ///
    /// `None` behind the camera, farther from the axis than the lens is valid, and where its
    /// distortion has folded back (a point far outside the image would land inside it).
    #[must_use]
    pub fn project(&self, p: &Point<Camera>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let (image, by_p) = self.lens.image_of(&p.coords)?;
        let focal = Matrix2::new(self.fx_px, 0.0, 0.0, self.fy_px);
        let pixel = focal * image + Vector2::new(self.cx_px, self.cy_px);
        Some((pixel, focal * by_p))
    }

    /// True if the pixel lies in the image, at least `margin_px` from its border.
    #[must_use]
    pub fn contains(&self, pixel: &Vector2<f64>, margin_px: f64) -> bool {
        let inside =
            |value: f64, size: u32| value >= margin_px && value <= f64::from(size) - margin_px;
        inside(pixel.x, self.width_px) && inside(pixel.y, self.height_px)
    }

    /// The unit vector in camera axes that a pixel looks along; `None` where the lens is not
    /// valid.
    #[must_use]
    pub fn bearing(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        self.lens.bearing_of(&Vector2::new(
            (pixel.x - self.cx_px) / self.fx_px,
            (pixel.y - self.cy_px) / self.fy_px,
        ))
    }

    /// The direction (X/Z, Y/Z) that a pixel looks along; `None` where the lens is not valid, and
    /// for pixels of a fisheye lens that look sideways or back.
    #[must_use]
    pub fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let bearing = self.bearing(pixel)?;
        (bearing.z > 1e-3).then(|| bearing.xy() / bearing.z)
    }

    /// When row `v_px` is exposed, relative to the frame's stamp, s.
    ///
    /// ```text
    /// Δt(v) = (v − H/2)/(H − 1) t_readout
    /// ```
    /// - `H`: rows of the image; `t_readout`: [`Self::readout`]
    ///
    /// A frame is stamped in the middle of the exposure of its middle row, so rows above it are
    /// earlier (negative) and rows below it later: the first row's centre, v = 0.5, is
    /// t_readout/2 early. Zero for a global shutter.
    #[must_use]
    pub fn row_offset_s(&self, v_px: f64) -> f64 {
        let n_rows = f64::from(self.height_px);
        (v_px - 0.5 * n_rows) / (n_rows - 1.0).max(1.0) * self.readout.as_secs_f64()
    }
}

#[cfg(test)]
pub(super) mod tests;
