//! Camera calibrations as `OpenCV` and ROS write them.
//!
//! ```yaml
//! image_width: 1280
//! image_height: 800
//! camera_matrix: {rows: 3, cols: 3, data: [fx, 0, cx, 0, fy, cy, 0, 0, 1]}
//! distortion_model: plumb_bob     # or rational_polynomial, equidistant, fisheye
//! distortion_coefficients: {rows: 1, cols: 5, data: [k1, k2, p1, p2, k3]}
//! ```
//! All other keys are ignored. `OpenCV`'s own calibration programs write no `distortion_model`;
//! then `fisheye_model` decides, or the number of coefficients where only one model has it.
//!
//! Sources: ROS `sensor_msgs/CameraInfo` and `camera_calibration_parsers`; `OpenCV`'s
//! `calib3d` documentation. In both, the centre of the first pixel is at (0, 0); here it is at
//! (0.5, 0.5), so half a pixel is added to the principal point.

use super::cameras::{Intrinsics, LensName};
use serde::Deserialize;

/// What is wrong with a calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum CalibrationError {
    /// Not YAML, or a value of the wrong type.
    #[error("not a camera calibration: {0}")]
    Yaml(String),
    /// A key is missing.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A list has the wrong length.
    #[error("{key} holds {got} numbers, {expected} are expected")]
    WrongCount {
        /// Its key.
        key: &'static str,
        /// Numbers in the list.
        got: usize,
        /// What is expected.
        expected: String,
    },
    /// A number is NaN or infinite.
    #[error("{0} holds a number that is not finite")]
    NotFinite(&'static str),
    /// The matrix is not that of a camera with square-set pixels.
    #[error("camera_matrix.data is not of the form fx, 0, cx, 0, fy, cy, 0, 0, 1")]
    NotACameraMatrix,
    /// The principal point lies outside of the image, so matrix and size do not fit.
    #[error(
        "the principal point ({cx}, {cy}) px lies outside of the image of {width} × {height} px: \
         was it calibrated at another size?"
    )]
    SizeMismatch {
        /// Column, px.
        cx: f64,
        /// Row, px.
        cy: f64,
        /// `image_width`, px.
        width: u32,
        /// `image_height`, px.
        height: u32,
    },
    /// The distortion model is not known here.
    #[error("distortion_model {0:?} is not plumb_bob, rational_polynomial, equidistant or fisheye")]
    UnknownModel(String),
    /// Coefficients of the thin prism or tilted sensor model are not zero.
    #[error("distortion_coefficients.data bends the picture in ways beyond k1 … k6, p1, p2")]
    BeyondRational,
}

#[derive(Deserialize)]
struct CameraInfo {
    image_width: Option<u32>,
    image_height: Option<u32>,
    distortion_model: Option<String>,
    fisheye_model: Option<f64>,
    camera_matrix: Option<MatrixData>,
    distortion_coefficients: Option<MatrixData>,
}

#[derive(Deserialize)]
struct MatrixData {
    rows: Option<usize>,
    cols: Option<usize>,
    data: Option<Vec<f64>>,
}

/// Where the centre of the first pixel lies, seen from `OpenCV`'s origin, px.
const HALF_PIXEL: f64 = 0.5;

/// Reads a calibration.
///
/// # Errors
/// What is wrong with it, and under which key.
pub(super) fn parse(text: &str) -> Result<Intrinsics, CalibrationError> {
    // OpenCV begins its files with a directive that YAML does not know.
    let text = match text.split_once('\n') {
        Some((first, rest)) if first.trim_end().starts_with("%YAML:") => rest,
        _ => text,
    };
    let info: CameraInfo =
        serde_saphyr::from_str(text).map_err(|error| CalibrationError::Yaml(error.to_string()))?;
    let width = info.image_width.ok_or(CalibrationError::Missing("image_width"))?;
    let height = info.image_height.ok_or(CalibrationError::Missing("image_height"))?;
    let matrix = numbers(info.camera_matrix, "camera_matrix.data")?;
    let (focal_px, [cx, cy]) = from_matrix(&matrix)?;
    let is_inside = (0.0..f64::from(width)).contains(&cx) && (0.0..f64::from(height)).contains(&cy);
    if !is_inside {
        return Err(CalibrationError::SizeMismatch { cx, cy, width, height });
    }
    let coefficients = numbers(info.distortion_coefficients, "distortion_coefficients.data")?;
    let model = info.distortion_model.as_deref();
    let (lens, distortion) = distortion(model, info.fisheye_model, coefficients)?;
    Ok(Intrinsics {
        size_px: [width, height],
        focal_px,
        principal_px: [cx + HALF_PIXEL, cy + HALF_PIXEL],
        lens,
        distortion,
    })
}

/// The finite numbers of a matrix, as many as its rows and columns say.
fn numbers(matrix: Option<MatrixData>, key: &'static str) -> Result<Vec<f64>, CalibrationError> {
    let matrix = matrix.ok_or(CalibrationError::Missing(key))?;
    let data = matrix.data.ok_or(CalibrationError::Missing(key))?;
    if let (Some(rows), Some(cols)) = (matrix.rows, matrix.cols)
        && rows.checked_mul(cols) != Some(data.len())
    {
        let expected = format!("{rows} × {cols}");
        return Err(CalibrationError::WrongCount { key, got: data.len(), expected });
    }
    if data.iter().any(|number| !number.is_finite()) {
        return Err(CalibrationError::NotFinite(key));
    }
    Ok(data)
}

/// Focal lengths and principal point in `OpenCV`'s pixels.
fn from_matrix(matrix: &[f64]) -> Result<([f64; 2], [f64; 2]), CalibrationError> {
    let wrong_count = |_| CalibrationError::WrongCount {
        key: "camera_matrix.data",
        got: matrix.len(),
        expected: "9".to_owned(),
    };
    let [fx, skew, cx, zero, fy, cy, bottom @ ..]: [f64; 9] =
        matrix.try_into().map_err(wrong_count)?;
    let is_close = |a: f64, b: f64| (a - b).abs() < 1e-9;
    let has_form = is_close(skew, 0.0)
        && is_close(zero, 0.0)
        && bottom.iter().zip([0.0, 0.0, 1.0]).all(|(a, b)| is_close(*a, b));
    if has_form { Ok(([fx, fy], [cx, cy])) } else { Err(CalibrationError::NotACameraMatrix) }
}

fn distortion(
    model: Option<&str>,
    fisheye_model: Option<f64>,
    coefficients: Vec<f64>,
) -> Result<(LensName, Vec<f64>), CalibrationError> {
    let n = coefficients.len();
    let lens = match (model, fisheye_model) {
        (Some("plumb_bob" | "rational_polynomial"), _) => LensName::RadialTangential,
        (Some("equidistant" | "fisheye"), _) => LensName::Fisheye,
        (Some(unknown), _) => return Err(CalibrationError::UnknownModel(unknown.to_owned())),
        (None, Some(flag)) if flag > 0.5 => LensName::Fisheye,
        (None, Some(_)) => LensName::RadialTangential,
        // Only these lengths belong to one model alone.
        (None, None) if n >= 5 => LensName::RadialTangential,
        (None, None) => return Err(CalibrationError::Missing("distortion_model")),
    };
    let allowed: &[usize] = match (lens, model) {
        (LensName::Fisheye, _) => &[4],
        (LensName::RadialTangential, Some("plumb_bob")) => &[4, 5],
        (LensName::RadialTangential, Some(_)) => &[8, 12, 14],
        (LensName::RadialTangential, None) => &[4, 5, 8, 12, 14],
    };
    if !allowed.contains(&n) {
        let expected = allowed.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ");
        let key = "distortion_coefficients.data";
        return Err(CalibrationError::WrongCount { key, got: n, expected });
    }
    if coefficients.iter().skip(8).any(|c| c.abs() > 0.0) {
        return Err(CalibrationError::BeyondRational);
    }
    Ok((lens, coefficients.into_iter().take(8).collect()))
}

#[cfg(test)]
mod tests;
