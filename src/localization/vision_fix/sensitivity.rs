//! What an error in the map does to a fix.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::inverse_if_well_posed;
use super::least_squares::Reprojector;
use crate::geometry::{Body, Hall, Transform};
use crate::localization::camera_model::CameraModel;
use crate::localization::marker_map::MarkerMap;
use crate::messages::{TagFamily, TagSensitivity};
use nalgebra::{Matrix6, Matrix6x3};

/// The derivative of the least-squares pose by the place of each tag that it was found from.
///
/// Moved tags move the predicted pixels, and the pose gives way:
///
/// ```text
/// Jᵀ (P̄ − P_im(χ̂, P)) = 0 at the minimum, so
/// ∂χ̂/∂P_tag = −(JᵀJ)⁻¹ Σ_k J_kᵀ ∂P_im,k/∂P                 6×3
/// ```
/// - `k`: the corners of the tag; `J`: over the corners of all used tags
/// - `P_im,k`: the pixel predicted from the mapped place
///
/// If all tags move together, the position moves with them: the derivatives' upper halves add up
/// to the identity, their lower halves to zero. The noise of the corners, being equal, cancels.
/// Tags that are not in the map, or not in front of the camera, are left out; empty if the rest
/// does not determine a pose.
/// Checked: `sensitivity_equals_that_of_a_fix_in_a_moved_map`.
#[must_use]
pub fn tag_sensitivity(
    camera: &CameraModel,
    map: &MarkerMap,
    tags_used: &[(TagFamily, u32)],
    hall_from_body: &Transform<Hall, Body>,
) -> Vec<TagSensitivity> {
    let reprojector = Reprojector::new(camera, hall_from_body);
    let mut JtJ = Matrix6::zeros();
    let mut pulls = Vec::with_capacity(tags_used.len());
    for &(family, id) in tags_used {
        let Some((tag_idx, corners)) = map.index(family, id).zip(map.corners(family, id)) else {
            continue;
        };
        let mut pull = Matrix6x3::zeros();
        for (_, J) in corners.iter().filter_map(|corner| reprojector.reproject(corner)) {
            JtJ += J.transpose() * J;
            pull += J.transpose() * Reprojector::by_place(&J);
        }
        pulls.push((tag_idx, pull));
    }
    let Some(inverse) = inverse_if_well_posed(&JtJ) else { return Vec::new() };
    pulls
        .into_iter()
        .map(|(tag_idx, pull)| TagSensitivity { tag_idx, pose_by_place: -inverse * pull })
        .collect()
}
