//! A first pose from the four corners of one tag, without any prior.
//!
//! A square in space and its image are related by a homography, whose columns give the pose. The
//! same image is nearly explained by a second pose with the tag's normal mirrored about the line
//! of sight (the planar ambiguity); both are returned and the caller lets other points decide.
//!
//! Source: Zhang 2000, section 3.1 (pose from a homography); Schweighofer and Pinz 2006 (the two
//! minima of the planar problem).

use crate::geometry::{Camera, Hall, Point, Rotation, Transform};
use nalgebra::{
    Isometry3, Matrix3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// Both poses of the hall in the camera that explain one tag; empty for degenerate input.
///
/// - `corners`: lower left, lower right, upper right, upper left of the tag in the hall
/// - `directions`: the same corners as (X/Z, Y/Z) in the camera
pub(super) fn camera_from_hall_candidates(
    corners: &[Point<Hall>; 4],
    directions: &[Vector2<f64>; 4],
) -> Vec<Transform<Camera, Hall>> {
    let half_edge_m = (corners[1] - corners[0]).coords.norm() / 2.0;
    let poses = hall_from_tag(corners).zip(camera_from_tag(half_edge_m, directions));
    poses.map_or_else(Vec::new, |(hall_from_tag, camera_from_tag)| {
        [camera_from_tag, mirrored(&camera_from_tag)]
            .map(|pose| pose * hall_from_tag.inverse())
            .map(|pose| {
                Transform::new(
                    Rotation::from_quaternion(pose.rotation),
                    Point::from_coords(pose.translation.vector),
                )
            })
            .to_vec()
    })
}

/// The tag's own axes in the hall: x right, y up, z out of its front, origin in its middle.
fn hall_from_tag(corners: &[Point<Hall>; 4]) -> Option<Isometry3<f64>> {
    let right = (corners[1] - corners[0]).coords.try_normalize(1e-6)?;
    let out = right.cross(&(corners[3] - corners[0]).coords).try_normalize(1e-6)?;
    let axes = Matrix3::from_columns(&[right, out.cross(&right), out]);
    let middle = corners.iter().map(|c| c.coords).sum::<Vector3<f64>>() / 4.0;
    Some(Isometry3::from_parts(Translation3::from(middle), rotation_of(&axes)))
}

/// The pose of a square of known size from the homography of its plane to the image.
fn camera_from_tag(half_edge_m: f64, directions: &[Vector2<f64>; 4]) -> Option<Isometry3<f64>> {
    let homography = homography(half_edge_m, directions)?;
    let (h1, h2, h3) = (homography.column(0), homography.column(1), homography.column(2));
    let scale = 2.0 / (h1.norm() + h2.norm());
    // The tag stands in front of the camera.
    let scale = if h3.z < 0.0 { -scale } else { scale };
    let (r1, r2, t): (Vector3<f64>, Vector3<f64>, Vector3<f64>) =
        ((h1 * scale), (h2 * scale), (h3 * scale));
    let pose = Isometry3::from_parts(Translation3::from(t), rotation_near(&r1, &r2)?);
    let mut numbers = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
    numbers.all(|c| c.is_finite()).then_some(pose)
}

/// The rotation with its x axis along `r1` and its y axis in the half plane of `r2`.
///
/// In closed form: iterations to the nearest rotation need not end on corners that no lens makes.
fn rotation_near(r1: &Vector3<f64>, r2: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let x = r1.try_normalize(1e-12)?;
    let z = x.cross(r2).try_normalize(1e-12)?;
    Some(rotation_of(&Matrix3::from_columns(&[x, z.cross(&x), z])))
}

fn rotation_of(axes: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*axes))
}

/// H with (X/Z, Y/Z, 1) ~ H (x, y, 1) on the tag's plane, fixed by h₃₃ = 1.
fn homography(half_edge_m: f64, directions: &[Vector2<f64>; 4]) -> Option<Matrix3<f64>> {
    let h = half_edge_m;
    let plane = [(-h, -h), (h, -h), (h, h), (-h, h)];
    let mut equations = SMatrix::<f64, 8, 8>::zeros();
    let mut rhs = SVector::<f64, 8>::zeros();
    for (k, ((x, y), n)) in plane.into_iter().zip(directions).enumerate() {
        let row_u = [x, y, 1.0, 0.0, 0.0, 0.0, -n.x * x, -n.x * y];
        let row_v = [0.0, 0.0, 0.0, x, y, 1.0, -n.y * x, -n.y * y];
        equations.row_mut(2 * k).copy_from_slice(&row_u);
        equations.row_mut(2 * k + 1).copy_from_slice(&row_v);
        rhs[2 * k] = n.x;
        rhs[2 * k + 1] = n.y;
    }
    let s = equations.lu().solve(&rhs)?;
    Some(Matrix3::new(s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], 1.0))
}

/// The pose with the tag's normal mirrored about the line of sight.
fn mirrored(camera_from_tag: &Isometry3<f64>) -> Isometry3<f64> {
    let sight = camera_from_tag.translation.vector.normalize();
    let normal = camera_from_tag.rotation * Vector3::z();
    let mirrored_normal = sight * (2.0 * normal.dot(&sight)) - normal;
    let turn = UnitQuaternion::rotation_between(&normal, &mirrored_normal).unwrap_or_default();
    Isometry3::from_parts(camera_from_tag.translation, turn * camera_from_tag.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_corners_give_the_exact_pose() {
        let corners = [
            Point::<Hall>::new(8.0, 1.0, 2.0),
            Point::new(8.0, 0.5, 2.0),
            Point::new(8.0, 0.5, 2.5),
            Point::new(8.0, 1.0, 2.5),
        ];
        // A camera that looks along +x of the hall from (1, 0.3, 2.8), turned a little.
        let hall_from_camera = Transform::<Hall, Camera>::new(
            Rotation::from_euler_rad(-1.5, 0.06, -1.52),
            Point::new(1.0, 0.3, 2.8),
        );
        let directions = corners.map(|corner| {
            let p = (hall_from_camera.inverse() * corner).coords;
            Vector2::new(p.x / p.z, p.y / p.z)
        });
        let candidates = camera_from_hall_candidates(&corners, &directions);
        let best = candidates
            .iter()
            .map(|pose| (pose.inverse().origin - hall_from_camera.origin).coords.norm())
            .fold(f64::INFINITY, f64::min);
        assert_eq!(candidates.len(), 2);
        assert!(best < 1e-6, "missed by {best} m");
    }

    #[test]
    fn corners_that_no_lens_makes_end_the_search() {
        let corners = [
            Point::<Hall>::new(8.0, 1.0, 2.0),
            Point::new(8.0, 0.5, 2.0),
            Point::new(8.0, 0.5, 2.5),
            Point::new(8.0, 1.0, 2.5),
        ];
        for scale in [1e-200, 1e-8, 1e8, 1e100, 1e300] {
            let directions = [(1.0, -3.0), (-2.0, 0.5), (0.3, 0.2), (-5.0, 4.0)]
                .map(|(u, v)| Vector2::new(u * scale, v));
            for pose in camera_from_hall_candidates(&corners, &directions) {
                assert!(pose.origin.is_finite(), "{pose:?}");
            }
        }
    }

    #[test]
    fn a_tag_shrunk_to_a_point_gives_nothing() {
        let corners = [Point::<Hall>::new(8.0, 1.0, 2.0); 4];
        assert!(camera_from_hall_candidates(&corners, &[Vector2::new(0.1, 0.1); 4]).is_empty());
    }
}
