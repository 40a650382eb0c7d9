//! A first pose from six or more points that do not lie in a plane, without any prior.
//!
//! ```text
//! b_k × (M X_k + m) = 0   for all k,   (M m) ∝ (R t)
//! ```
//! - `b_k`: unit vector to point k in camera axes, `X_k`: its place, `R`, `t`: the pose
//!
//! The twelve numbers of `(M m)` are the direction that these rows leave free (direct linear
//! transform); R is the rotation nearest to M.
//!
//! Source: Hartley and Zisserman 2004, section 7.1, with bearings in place of pixels.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use crate::geometry::{Camera, Hall, Point, Rotation, Transform, skew};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Each point gives two equations for eleven unknowns.
const MIN_POINTS: usize = 6;
/// Points flatter than this share of their spread lie in a plane, where the rows leave more free.
const MIN_THICKNESS: f64 = 0.01;

/// The pose of the hall in the camera; `None` for too few points, and for points in a plane.
///
/// - `places`: the points in the hall, m
/// - `bearings`: the same points as unit vectors in camera axes
pub(super) fn camera_from_hall(
    places: &[Vector3<f64>],
    bearings: &[Vector3<f64>],
) -> Option<Transform<Camera, Hall>> {
    if places.len() < MIN_POINTS {
        return None;
    }
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let n = places.len() as f64;
    let middle = places.iter().sum::<Vector3<f64>>() / n;
    let scatter: Matrix3<f64> =
        places.iter().map(|p| (p - middle) * (p - middle).transpose() / n).sum();
    let spread_m = scatter.trace().sqrt();
    if scatter.symmetric_eigenvalues().min() < (MIN_THICKNESS * spread_m).powi(2) {
        return None;
    }
    let centred = places.iter().map(|place| (place - middle) / spread_m);
    let free = free_direction(centred.zip(bearings))?;
    let M = Matrix3::from_row_slice(&[
        free[0], free[1], free[2], free[4], free[5], free[6], free[8], free[9], free[10],
    ]);
    let sign = M.determinant().signum();
    let svd = (M * sign).try_svd(true, true, f64::EPSILON, 100)?;
    let R = svd.u? * svd.v_t?;
    let scale = svd.singular_values.mean();
    let t = Vector3::new(free[3], free[7], free[11]) * (sign * spread_m / scale) - R * middle;
    let is_ahead =
        |(place, bearing): (&Vector3<f64>, &Vector3<f64>)| bearing.dot(&(R * place + t)) > 0.0;
    let n_ahead = places.iter().zip(bearings).filter(|&sight| is_ahead(sight)).count();
    let is_sound = t.iter().all(|c| c.is_finite()) && 2 * n_ahead > places.len();
    is_sound.then(|| Transform::new(Rotation::from_matrix(&R), Point::from_coords(t)))
}

/// The unit vector (rows of `(M m)`) that all rows `b × (M X + m)` come closest to annul.
fn free_direction<'a>(
    points: impl Iterator<Item = (Vector3<f64>, &'a Vector3<f64>)>,
) -> Option<SVector<f64, 12>> {
    let mut AtA = SMatrix::<f64, 12, 12>::zeros();
    for (place, bearing) in points {
        let homogeneous = place.push(1.0);
        let cross = skew(bearing);
        let mut A = SMatrix::<f64, 3, 12>::zeros();
        for (row, col) in (0..3).flat_map(|row| (0..3).map(move |col| (row, col))) {
            A.fixed_view_mut::<1, 4>(row, 4 * col)
                .copy_from(&(homogeneous.transpose() * cross[(row, col)]));
        }
        AtA += A.transpose() * A;
    }
    let eigen = AtA.try_symmetric_eigen(f64::EPSILON, 500)?;
    let smallest = eigen.eigenvalues.imin();
    Some(eigen.eigenvectors.column(smallest).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;

    #[test]
    fn exact_bearings_give_the_exact_pose() {
        let mut noise = SeedBook::new(8).stream("points");
        for run in 0..20 {
            let hall_from_camera = Transform::<Hall, Camera>::new(
                Rotation::from_euler_rad(
                    noise.between(-3.0, 3.0),
                    noise.between(-1.4, 1.4),
                    noise.between(-3.0, 3.0),
                ),
                Point::from_coords(noise.normal3() * 3.0),
            );
            // Ahead of the camera and beside it, as a fisheye sees them.
            let places: Vec<Vector3<f64>> = (0..7)
                .map(|_| {
                    let depth = noise.between(-0.3, 9.0);
                    let across = (noise.between(-4.0, 4.0), noise.between(-4.0, 4.0));
                    (hall_from_camera * Point::new(across.0, across.1, depth)).coords
                })
                .collect();
            let camera_from_hall_true = hall_from_camera.inverse();
            let bearings: Vec<Vector3<f64>> = places
                .iter()
                .map(|p| (camera_from_hall_true * Point::from_coords(*p)).coords.normalize())
                .collect();
            let found = camera_from_hall(&places, &bearings).expect("a pose");
            assert!(
                (found.inverse().origin - hall_from_camera.origin).coords.norm() < 1e-6,
                "{run}"
            );
            assert!(found.rotation.minus(&camera_from_hall_true.rotation).norm() < 1e-6, "{run}");
            let six = camera_from_hall(&places[..5], &bearings[..5]);
            assert!(six.is_none(), "five points leave it free");
        }
    }

    #[test]
    fn points_in_a_plane_give_nothing() {
        let places: Vec<Vector3<f64>> =
            (0..8_i32).map(|k| Vector3::new(5.0, f64::from(k % 3), f64::from(k / 3))).collect();
        let bearings: Vec<Vector3<f64>> = places.iter().map(Vector3::normalize).collect();
        assert!(camera_from_hall(&places, &bearings).is_none());
    }
}
