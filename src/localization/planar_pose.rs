//! A first pose from points in one plane, four or more, without any prior.
//!
//! A plane in space and its image are related by a homography, whose derivative gives the pose. The
//! same image is nearly explained by a second pose with the plane's normal mirrored about the line
//! of sight (the planar ambiguity); both are returned and the caller lets other points decide.
//!
//! Source: Collins and Bartoli 2014 (both poses from the homography's derivative); Schweighofer and
//! Pinz 2006 (the two minima of the planar problem).
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use crate::geometry::{Camera, Hall, Point, Rotation, Transform};
use nalgebra::{
    Isometry3, Matrix2, Matrix3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion,
    Vector2, Vector3,
};

/// Points farther from their common plane than this share of their spread lie in none.
const MAX_UNEVENNESS: f64 = 0.1;
/// Points spread less than this are one point, and a plane this narrow is a line, m.
const MIN_SPREAD_M: f64 = 1e-4;
/// Sights this far from their mean (cosine) have no picture in a camera that looks along it.
const MIN_COS_TO_MEAN: f64 = 0.05;

/// Both poses of the hall in the camera that explain the points; empty for degenerate input.
///
/// - `places`: the points in the hall, m
/// - `bearings`: the same points as unit vectors in camera axes
pub(super) fn camera_from_hall_candidates(
    places: &[Vector3<f64>],
    bearings: &[Vector3<f64>],
) -> Vec<Transform<Camera, Hall>> {
    let poses = plane_of(places).and_then(|hall_from_plane| {
        let plane_from_hall = hall_from_plane.inverse();
        let on_plane: Vec<Vector2<f64>> = places
            .iter()
            .map(|&place| (plane_from_hall * nalgebra::Point3::from(place)).xy().coords)
            .collect();
        Some((cameras_from_plane(&on_plane, bearings)?, plane_from_hall))
    });
    poses.map_or_else(Vec::new, |(cameras_from_plane, plane_from_hall)| {
        cameras_from_plane.map(|pose| transform_of(&(pose * plane_from_hall))).to_vec()
    })
}

/// The points' plane: x and y along their spread, origin in their middle. `None` if they lie in
/// no plane, or on a line.
fn plane_of(places: &[Vector3<f64>]) -> Option<Isometry3<f64>> {
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let n = places.len() as f64;
    let middle = places.iter().sum::<Vector3<f64>>() / n;
    let scatter: Matrix3<f64> =
        places.iter().map(|p| (p - middle) * (p - middle).transpose() / n).sum();
    let eigen = scatter.try_symmetric_eigen(f64::EPSILON, 100)?;
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [long, wide, thick] = order.map(|k| eigen.eigenvalues[k].max(0.0).sqrt());
    let is_plane = wide > MIN_SPREAD_M && wide > 1e-3 * long && thick < MAX_UNEVENNESS * wide;
    let axis = |k: usize| Vector3::from(eigen.eigenvectors.column(order[k]));
    let axes = Matrix3::from_columns(&[axis(0), axis(1), axis(0).cross(&axis(1))]);
    is_plane.then(|| Isometry3::from_parts(Translation3::from(middle), rotation_of(&axes)))
}

/// Both poses of a plane from the homography to its image.
///
/// In a camera that is turned towards the plane's origin (at distance `t_z`), the homography's
/// derivative there is the upper left of the rotation:
///
/// ```text
/// ∂(X/Z, Y/Z)/∂(x, y) = R₂₂/t_z,   σ_max(R₂₂) = 1,   r₃₁² = 1 − r₁₁² − r₂₁²,   …
/// ```
/// and the signs of r₃₁ and r₃₂ can both be turned: the two poses. The turn also lets the points
/// lie anywhere in the view of a fisheye lens.
fn cameras_from_plane(
    on_plane: &[Vector2<f64>],
    bearings: &[Vector3<f64>],
) -> Option<[Isometry3<f64>; 2]> {
    let sight = bearings.iter().sum::<Vector3<f64>>().try_normalize(1e-6)?;
    let turned_from_camera = UnitQuaternion::rotation_between(&sight, &Vector3::z())?;
    let directions: Option<Vec<Vector2<f64>>> = bearings
        .iter()
        .map(|bearing| {
            let b = turned_from_camera * bearing;
            (b.z > MIN_COS_TO_MEAN).then(|| b.xy() / b.z)
        })
        .collect();
    let homography = homography(on_plane, &directions?)?;
    // h₃₃ = 1: the origin's image is the third column.
    let to_origin = Vector3::from(homography.column(2));
    let exactly = UnitQuaternion::rotation_between(&to_origin, &Vector3::z())?;
    let turned = exactly.to_rotation_matrix().matrix() * homography;
    let slope = turned.fixed_view::<2, 2>(0, 0) / turned[(2, 2)];
    let rotations = rotations_from_slope(&slope.into_owned())?;
    let camera_from_turned = (exactly * turned_from_camera).inverse();
    let poses = rotations.map(|rotation| {
        let rotation = camera_from_turned * rotation;
        Isometry3::from_parts(Translation3::from(place_of(&rotation, on_plane, bearings)), rotation)
    });
    let mut numbers = poses
        .iter()
        .flat_map(|pose| pose.translation.vector.iter().chain(pose.rotation.coords.iter()));
    numbers.all(|c| c.is_finite()).then_some(poses)
}

/// The two rotations whose upper left is proportional to `slope`.
fn rotations_from_slope(slope: &Matrix2<f64>) -> Option<[UnitQuaternion<f64>; 2]> {
    let (half_trace, det) = (slope.norm_squared() / 2.0, slope.determinant());
    let largest2 = half_trace + (half_trace * half_trace - det * det).max(0.0).sqrt();
    if !(largest2.is_finite() && largest2 > 0.0) {
        return None;
    }
    let r = slope / largest2.sqrt();
    let (c1, c2) = (r.column(0), r.column(1));
    let r31 = (1.0 - c1.norm_squared()).max(0.0).sqrt();
    // The columns are orthogonal: r₃₁ r₃₂ = −(r₁₁ r₁₂ + r₂₁ r₂₂).
    let r32 = (1.0 - c2.norm_squared()).max(0.0).sqrt() * -c1.dot(&c2).signum();
    Some([1.0, -1.0].map(|sign| {
        let x = Vector3::new(c1.x, c1.y, sign * r31);
        let y = Vector3::new(c2.x, c2.y, sign * r32);
        rotation_of(&Matrix3::from_columns(&[x, y, x.cross(&y)]))
    }))
}

/// Where the plane's origin lies in the camera, given its rotation: least squares of
/// `b_k × (R X_k + t) = 0`.
fn place_of(
    rotation: &UnitQuaternion<f64>,
    on_plane: &[Vector2<f64>],
    bearings: &[Vector3<f64>],
) -> Vector3<f64> {
    let (mut AtA, mut Atb) = (Matrix3::zeros(), Vector3::zeros());
    for (place, bearing) in on_plane.iter().zip(bearings) {
        let across = Matrix3::identity() - bearing * bearing.transpose();
        AtA += across;
        Atb -= across * (rotation * place.push(0.0));
    }
    AtA.lu().solve(&Atb).unwrap_or_else(|| Vector3::repeat(f64::NAN))
}

fn rotation_of(axes: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*axes))
}

/// H with (X/Z, Y/Z, 1) ~ H (x, y, 1) on the plane, fixed by h₃₃ = 1: least squares over the
/// points, both sides scaled to unit spread.
fn homography(on_plane: &[Vector2<f64>], directions: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let (plane_scale, image_scale) = (spread(on_plane)?, spread(directions)?);
    let mut AtA = SMatrix::<f64, 8, 8>::zeros();
    let mut Atb = SVector::<f64, 8>::zeros();
    for (on_plane, direction) in on_plane.iter().zip(directions) {
        let ((x, y), n) =
            ((on_plane.x / plane_scale, on_plane.y / plane_scale), direction / image_scale);
        let row_u = SVector::<f64, 8>::from([x, y, 1.0, 0.0, 0.0, 0.0, -n.x * x, -n.x * y]);
        let row_v = SVector::<f64, 8>::from([0.0, 0.0, 0.0, x, y, 1.0, -n.y * x, -n.y * y]);
        AtA += row_u * row_u.transpose() + row_v * row_v.transpose();
        Atb += row_u * n.x + row_v * n.y;
    }
    let s = AtA.lu().solve(&Atb)?;
    let scaled = Matrix3::new(s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], 1.0);
    let image = Matrix3::from_diagonal(&Vector3::new(image_scale, image_scale, 1.0));
    let plane = Matrix3::from_diagonal(&Vector3::new(1.0 / plane_scale, 1.0 / plane_scale, 1.0));
    Some(image * scaled * plane)
}

/// Root mean square of the lengths.
fn spread(vectors: &[Vector2<f64>]) -> Option<f64> {
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let n = vectors.len() as f64;
    let spread = (vectors.iter().map(Vector2::norm_squared).sum::<f64>() / n).sqrt();
    (spread.is_finite() && spread > 1e-9).then_some(spread)
}

/// The other pose that nearly explains the picture of points in a plane: its normal mirrored about
/// the line of sight. `None` if the points lie in no plane.
pub(super) fn flipped(
    camera_from_hall: &Transform<Camera, Hall>,
    places: &[Vector3<f64>],
) -> Option<Transform<Camera, Hall>> {
    let hall_from_plane = plane_of(places)?;
    let translation = Translation3::from(camera_from_hall.origin.coords);
    let pose = Isometry3::from_parts(translation, *camera_from_hall.rotation.quaternion());
    Some(transform_of(&(mirrored(&(pose * hall_from_plane)) * hall_from_plane.inverse())))
}

fn transform_of(pose: &Isometry3<f64>) -> Transform<Camera, Hall> {
    let rotation = Rotation::from_quaternion(pose.rotation);
    Transform::new(rotation, Point::from_coords(pose.translation.vector))
}

/// The pose with the plane's normal mirrored about the line of sight.
fn mirrored(camera_from_plane: &Isometry3<f64>) -> Isometry3<f64> {
    let sight = camera_from_plane.translation.vector.normalize();
    let normal = camera_from_plane.rotation * Vector3::z();
    let mirrored_normal = sight * (2.0 * normal.dot(&sight)) - normal;
    let turn = UnitQuaternion::rotation_between(&normal, &mirrored_normal).unwrap_or_default();
    Isometry3::from_parts(camera_from_plane.translation, turn * camera_from_plane.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera that looks along +x of the hall from (1, 0.3, 2.8), turned a little.
    fn hall_from_camera() -> Transform<Hall, Camera> {
        Transform::new(Rotation::from_euler_rad(-1.5, 0.06, -1.52), Point::new(1.0, 0.3, 2.8))
    }

    fn tag() -> Vec<Vector3<f64>> {
        [(1.0, 2.0), (0.5, 2.0), (0.5, 2.5), (1.0, 2.5)]
            .map(|(y, z)| Vector3::new(8.0, y, z))
            .to_vec()
    }

    fn bearings(
        hall_from_camera: &Transform<Hall, Camera>,
        places: &[Vector3<f64>],
    ) -> Vec<Vector3<f64>> {
        let camera_from_hall = hall_from_camera.inverse();
        let sight = |place: &Vector3<f64>| (camera_from_hall * Point::from_coords(*place)).coords;
        places.iter().map(|place| sight(place).normalize()).collect()
    }

    /// How far the better of the two candidates misses.
    fn missed_m(hall_from_camera: &Transform<Hall, Camera>, places: &[Vector3<f64>]) -> f64 {
        let candidates = camera_from_hall_candidates(places, &bearings(hall_from_camera, places));
        assert_eq!(candidates.len(), 2);
        candidates
            .iter()
            .map(|pose| (pose.inverse().origin - hall_from_camera.origin).coords.norm())
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn exact_corners_give_the_exact_pose() {
        assert!(missed_m(&hall_from_camera(), &tag()) < 1e-6);
    }

    #[test]
    fn any_points_of_a_slanted_plane_give_the_exact_pose() {
        // On the plane x − 0.4 y + 0.3 z = 9.
        let places: Vec<Vector3<f64>> =
            [(0.0, 1.0), (2.0, 0.4), (-1.5, 3.0), (0.7, 4.4), (-0.8, -0.5), (1.9, 2.2)]
                .map(|(y, z)| Vector3::new(9.0 + 0.4 * y - 0.3 * z, y, z))
                .to_vec();
        assert!(missed_m(&hall_from_camera(), &places) < 1e-6);
        let mut uneven = places.clone();
        uneven[3].x += 3.0;
        let seen = bearings(&hall_from_camera(), &uneven);
        assert!(camera_from_hall_candidates(&uneven, &seen).is_empty(), "no plane");
    }

    #[test]
    fn a_tag_beside_a_wide_camera_gives_the_exact_pose() {
        const TURN_RAD: f64 = 1.6;
        // The tag stands at the border of a fisheye's view, some corners behind 90°.
        let turned = Transform::<Hall, Camera>::new(
            hall_from_camera().rotation
                * Rotation::<Camera, Camera>::from_euler_rad(0.0, TURN_RAD, 0.0),
            hall_from_camera().origin,
        );
        let seen = bearings(&turned, &tag());
        assert!(seen.iter().any(|bearing| bearing.z < 0.0) && seen.iter().any(|b| b.z > 0.0));
        assert!(missed_m(&turned, &tag()) < 1e-6);
    }

    #[test]
    fn corners_that_no_lens_makes_end_the_search() {
        for scale in [1e-200, 1e-8, 1e8, 1e100, 1e300] {
            let bearings = [(1.0, -3.0), (-2.0, 0.5), (0.3, 0.2), (-5.0, 4.0)]
                .map(|(u, v)| Vector3::new(u * scale, v, 1.0).normalize());
            for pose in camera_from_hall_candidates(&tag(), &bearings) {
                assert!(pose.origin.is_finite(), "{pose:?}");
            }
        }
    }

    #[test]
    fn points_on_a_point_or_a_line_give_nothing() {
        let point = [Vector3::new(8.0, 1.0, 2.0); 4];
        assert!(camera_from_hall_candidates(&point, &[Vector3::z(); 4]).is_empty());
        let line = [0.0, 1.0, 2.0, 3.5].map(|y| Vector3::new(8.0, y, 2.0 + 0.1 * y));
        let seen = bearings(&hall_from_camera(), &line);
        assert!(camera_from_hall_candidates(&line, &seen).is_empty());
    }
}
