//! The cameras of the configuration.

use super::camera_info;
use super::convert::{invalid, mount, seconds, within};
use super::error::ConfigError;
use super::file::MountSection;
use super::images::ImagesSection;
use crate::geometry::{Body, Camera, Rotation, Transform};
use crate::localization::camera_model::{CameraModel, Fisheye, Lens, RadialTangential};
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};

/// Which lens a camera has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LensName {
    /// Radial and tangential distortion: k1, k2, p1, p2, k3, k4, k5, k6 in the order of `OpenCV`.
    #[default]
    RadialTangential,
    /// Kannala–Brandt: k1, k2, k3, k4.
    Fisheye,
}

/// One camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSection {
    /// A calibration in the form of `OpenCV` or ROS (`camera_info` YAML), beside this file; it
    /// stands for the five keys below. In the effective configuration it has been read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration_file: Option<PathBuf>,
    /// Width and height, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_px: Option<[u32; 2]>,
    /// Focal lengths along u and v, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<[f64; 2]>,
    /// Principal point, px; the centre of the first pixel is at 0.5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub principal_px: Option<[f64; 2]>,
    /// Which lens.
    #[serde(default)]
    pub lens: LensName,
    /// Its coefficients: four, five or eight, for a fisheye four.
    #[serde(default = "no_distortion")]
    pub distortion: Vec<f64>,
    /// Time from the readout of the first row to that of the last, s; 0 for a global shutter.
    #[serde(default)]
    pub readout_s: f64,
    /// Where its pictures come from, if stockpilot finds the tags itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub images: Option<ImagesSection>,
    /// Where it is bolted; at 0, 0, 0 degrees it looks forward with an upright image, and
    /// positive pitch looks down.
    pub mount: MountSection,
}

fn no_distortion() -> Vec<f64> {
    vec![0.0; 4]
}

/// What a calibration finds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Intrinsics {
    /// Width and height, px.
    pub(super) size_px: [u32; 2],
    /// Focal lengths along u and v, px.
    pub(super) focal_px: [f64; 2],
    /// Principal point, px; the centre of the first pixel is at 0.5.
    pub(super) principal_px: [f64; 2],
    /// Which lens.
    pub(super) lens: LensName,
    /// Its coefficients.
    pub(super) distortion: Vec<f64>,
}

impl CameraSection {
    /// The camera with what stands in its calibration file in place of the file's name.
    pub(super) fn with_file_read(
        mut self,
        index: usize,
        directory: &Path,
    ) -> Result<Self, ConfigError> {
        let Some(name) = self.calibration_file.take() else { return Ok(self) };
        let has_own = self.focal_px.is_some()
            || self.principal_px.is_some()
            || self.lens != LensName::default()
            || self.distortion != no_distortion();
        if has_own {
            let message = "says the same as focal_px, principal_px, lens and distortion: give one";
            return Err(invalid(&key(index, "calibration_file"), message));
        }
        let path = directory.join(name);
        let text = std::fs::read_to_string(&path)
            .map_err(|source| ConfigError::Unreadable { path: path.clone(), source })?;
        let refuse = |message: String| ConfigError::File { path: path.clone(), message };
        let found = camera_info::parse(&text).map_err(|fault| refuse(fault.to_string()))?;
        if let Some([width, height]) = self.size_px.filter(|size_px| *size_px != found.size_px) {
            let [found_width, found_height] = found.size_px;
            return Err(refuse(format!(
                "image_width and image_height are {found_width} and {found_height} px, {} says \
                 {width} and {height} px",
                key(index, "size_px"),
            )));
        }
        self.size_px = Some(found.size_px);
        self.focal_px = Some(found.focal_px);
        self.principal_px = Some(found.principal_px);
        self.lens = found.lens;
        self.distortion = found.distortion;
        Ok(self)
    }

    /// The intrinsics, checked.
    pub(super) fn intrinsics(&self, index: usize) -> Result<Intrinsics, ConfigError> {
        let key = |name: &str| key(index, name);
        if self.calibration_file.is_some() {
            let message = "can only be read with the file that names it";
            return Err(invalid(&key("calibration_file"), message));
        }
        let missing = |name| invalid(&key(name), "is missing; calibration_file would give it");
        let size_px = self.size_px.ok_or_else(|| missing("size_px"))?;
        let focal_px = self.focal_px.ok_or_else(|| missing("focal_px"))?;
        let principal_px = self.principal_px.ok_or_else(|| missing("principal_px"))?;
        for size in size_px {
            within(&key("size_px"), f64::from(size), (16.0, 20_000.0), "px")?;
        }
        for focal in focal_px {
            within(&key("focal_px"), focal, (10.0, 100_000.0), "px")?;
        }
        for (principal, size) in principal_px.into_iter().zip(size_px) {
            within(&key("principal_px"), principal, (0.0, f64::from(size)), "px")?;
        }
        for coefficient in &self.distortion {
            within(&key("distortion"), *coefficient, (-100.0, 100.0), "")?;
        }
        let distortion = self.distortion.clone();
        Ok(Intrinsics { size_px, focal_px, principal_px, lens: self.lens, distortion })
    }

    /// The camera as the localisation knows it.
    pub(super) fn model(&self, index: usize) -> Result<CameraModel, ConfigError> {
        let intrinsics = self.intrinsics(index)?;
        let [width_px, height_px] = intrinsics.size_px;
        let readout = seconds(&key(index, "readout_s"), self.readout_s, (0.0, 0.2))?;
        let forward: Transform<Body, Body> = mount(&key(index, "mount"), &self.mount)?;
        // z_c = forward, x_c = right = −left, y_c = down = −up.
        let looking_forward = Rotation::<Body, Camera>::from_euler_rad(-FRAC_PI_2, 0.0, -FRAC_PI_2);
        let model = CameraModel {
            width_px,
            height_px,
            fx_px: intrinsics.focal_px[0],
            fy_px: intrinsics.focal_px[1],
            cx_px: intrinsics.principal_px[0],
            cy_px: intrinsics.principal_px[1],
            lens: lens(index, intrinsics.lens, &intrinsics.distortion)?,
            readout,
            body_from_camera: Transform::new(forward.rotation * looking_forward, forward.origin),
        };
        check_view(index, &model)?;
        Ok(model)
    }
}

fn key(index: usize, name: &str) -> String {
    format!("cameras[{index}].{name}")
}

fn lens(index: usize, name: LensName, distortion: &[f64]) -> Result<Lens, ConfigError> {
    let refuse = |expected: &str| {
        let message = format!("has {} coefficients, this lens takes {expected}", distortion.len());
        invalid(&key(index, "distortion"), message)
    };
    match name {
        LensName::RadialTangential => {
            let mut k = [0.0; 8];
            if ![4, 5, 8].contains(&distortion.len()) {
                return Err(refuse("k1, k2, p1, p2 [, k3 [, k4, k5, k6]]"));
            }
            k[..distortion.len()].copy_from_slice(distortion);
            let [k1, k2, p1, p2, k3, k4, k5, k6] = k;
            let radial = [k1, k2, k3, k4, k5, k6];
            Ok(Lens::RadialTangential(RadialTangential::new(radial, [p1, p2])))
        }
        LensName::Fisheye => {
            let k: [f64; 4] = distortion.try_into().map_err(|_| refuse("k1, k2, k3, k4"))?;
            Ok(Lens::Fisheye(Fisheye::new(k)))
        }
    }
}

/// The lens must be valid at least half way to the corners of the picture, or the coefficients are
/// not of this camera.
fn check_view(index: usize, model: &CameraModel) -> Result<(), ConfigError> {
    let (width, height) = (f64::from(model.width_px), f64::from(model.height_px));
    let shows = |u: f64, v: f64| model.bearing(&nalgebra::Vector2::new(u * width, v * height));
    let is_sound = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]
        .into_iter()
        .all(|(u, v)| shows(u, v).is_some());
    if is_sound {
        return Ok(());
    }
    let message = "folds the picture half way to its corners: are these the coefficients of this \
                   lens and size?";
    Err(invalid(&key(index, "distortion"), message))
}

#[cfg(test)]
mod tests;
