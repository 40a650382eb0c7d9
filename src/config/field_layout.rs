//! Field layouts of `WPILib`: tags by number and pose.
//!
//! ```json
//! {"tags": [{"ID": 1, "pose": {
//!    "translation": {"x": 15.08, "y": 0.25, "z": 1.36},
//!    "rotation": {"quaternion": {"W": 0.5, "X": 0.0, "Y": 0.0, "Z": 0.866}}}}],
//!  "field": {"length": 16.54, "width": 8.21}}
//! ```
//! The pose is that of the tag in the field: x out of the tag's front, z up along the upright tag,
//! so y points to the right for somebody who looks at the front. The field's axes are taken for the
//! hall's. A layout tells neither family nor size of its tags.
//!
//! Source: `WPILib` `AprilTagFieldLayout`, and `PhotonVision`'s page on coordinate systems.

use super::markers::TagSection;
use crate::geometry::{Body, Hall, Point, Rotation, Transform};
use nalgebra::{Quaternion, Unit};
use serde::Deserialize;

/// A quaternion this much longer or shorter than 1 is a mistake, not rounding.
const UNIT_TOLERANCE: f64 = 1e-3;

/// What is wrong with a layout.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum LayoutError {
    /// Not the JSON that is expected.
    #[error("not a field layout: {0}")]
    Json(String),
    /// A quaternion that is no rotation.
    #[error("tag {id} has a quaternion of length {length}, a rotation's is 1")]
    NotUnit {
        /// The tag.
        id: u32,
        /// Length of its quaternion.
        length: f64,
    },
    /// Without tags it is of no use.
    #[error("the layout holds no tags")]
    Empty,
}

#[derive(Deserialize)]
struct Layout {
    tags: Vec<LayoutTag>,
}

#[derive(Deserialize)]
struct LayoutTag {
    #[serde(rename = "ID")]
    id: u32,
    pose: LayoutPose,
}

#[derive(Deserialize)]
struct LayoutPose {
    translation: Translation,
    rotation: LayoutRotation,
}

#[derive(Deserialize)]
struct Translation {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize)]
struct LayoutRotation {
    quaternion: LayoutQuaternion,
}

#[derive(Deserialize)]
#[serde(rename_all = "UPPERCASE")]
struct LayoutQuaternion {
    w: f64,
    x: f64,
    y: f64,
    z: f64,
}

/// Reads a layout whose tags are of this family and size.
///
/// # Errors
/// What is wrong with it, and with which tag.
pub(super) fn parse(text: &str, family: &str, edge_m: f64) -> Result<Vec<TagSection>, LayoutError> {
    let layout: Layout =
        serde_json::from_str(text).map_err(|error| LayoutError::Json(error.to_string()))?;
    if layout.tags.is_empty() {
        return Err(LayoutError::Empty);
    }
    layout
        .tags
        .into_iter()
        .map(|tag| {
            let corners_m = corners_m(&tag, edge_m)?;
            Ok(TagSection { family: family.to_owned(), id: tag.id, corners_m, faces_away: false })
        })
        .collect()
}

/// Lower left, lower right, upper right, upper left, seen from the front.
fn corners_m(tag: &LayoutTag, edge_m: f64) -> Result<[[f64; 3]; 4], LayoutError> {
    let q = &tag.pose.rotation.quaternion;
    let quaternion = Quaternion::new(q.w, q.x, q.y, q.z);
    let length = quaternion.norm();
    if !((1.0 - UNIT_TOLERANCE)..=(1.0 + UNIT_TOLERANCE)).contains(&length) {
        return Err(LayoutError::NotUnit { id: tag.id, length });
    }
    let p = &tag.pose.translation;
    // The tag is a body whose axes are out of the front, right for the onlooker, up.
    let hall_from_tag = Transform::<Hall, Body>::new(
        Rotation::from_quaternion(Unit::new_normalize(quaternion)),
        Point::new(p.x, p.y, p.z),
    );
    let half_m = 0.5 * edge_m;
    let corner = |right: f64, up: f64| {
        (hall_from_tag * Point::new(0.0, right * half_m, up * half_m)).coords.into()
    };
    Ok([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
}

#[cfg(test)]
mod tests;
