//! From a beam to a hit point with its covariance.
//!
//! ```text
//! z^m = p + R (t + R_l u(α) d),   u(α) = (cos α, sin α, 0)
//! Σ^m = J_χ Σ^χ J_χᵀ + J_α σ_α² J_αᵀ + J_d σ_d² J_dᵀ                         3×3
//! J_χ = [ I₃   −R (t + R_l u d)^ ],   J_α = R R_l u′ d,   J_d = R R_l u
//! ```
//! - `p`, `R`: pose of the body in the hall at the beam's own time
//! - `t`, `R_l`: pose of the LiDAR on the body
//! - `Σ^χ`: covariance of the pose error, 6×6, attitude on the right in body axes
//!
//! Source: Balula et al. 2023, section 4.
//! Checked: `projection_jacobians_match_central_difference`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use crate::geometry::{Body, Hall, Lidar, Point, Transform, skew};
use crate::messages::Beam;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3};

/// The LiDAR as it is bolted to the body, and how well it measures.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarMount {
    /// Pose of the LiDAR on the body.
    pub body_from_lidar: Transform<Body, Lidar>,
    /// Standard deviation of a range, m.
    pub range_sigma_m: f64,
    /// Standard deviation of a beam's direction in the scan plane, rad.
    pub angle_sigma_rad: f64,
    /// Shorter returns are not trusted, m.
    pub min_range_m: f64,
    /// Longer returns are not trusted, m.
    pub max_range_m: f64,
    /// Sectors [from, to] of the beam angle that the own body hides, rad, inside (−π, π].
    pub blind_sectors_rad: Vec<(f64, f64)>,
}

impl LidarMount {
    /// True if the own body is in this direction.
    #[must_use]
    pub fn is_blind(&self, angle_rad: f64) -> bool {
        self.blind_sectors_rad.iter().any(|&(from, to)| from <= angle_rad && angle_rad <= to)
    }
}

/// A measured point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Where it is.
    pub place: Point<Hall>,
    /// Covariance of its error in hall axes, m², 3×3.
    pub cov_m2: Matrix3<f64>,
}

/// Projects one beam that returned.
#[must_use]
pub fn project(
    mount: &LidarMount,
    beam: &Beam,
    hall_from_body: &Transform<Hall, Body>,
    pose_cov: &Matrix6<f64>,
) -> Hit {
    let (angle, range_m) = (f64::from(beam.angle_rad), f64::from(beam.range_m));
    let (sin, cos) = angle.sin_cos();
    let R_l = mount.body_from_lidar.rotation.matrix();
    let along_body = R_l * Vector3::new(cos, sin, 0.0);
    let across_body = R_l * Vector3::new(-sin, cos, 0.0);
    let p_body = mount.body_from_lidar.origin.coords + along_body * range_m;

    let R = hall_from_body.rotation.matrix();
    let mut J_pose = Matrix3x6::zeros();
    J_pose.fixed_columns_mut::<3>(0).fill_with_identity();
    J_pose.fixed_columns_mut::<3>(3).copy_from(&(-R * skew(&p_body)));
    let J_angle = R * across_body * range_m;
    let J_range = R * along_body;

    let cov_m2 = J_pose * pose_cov * J_pose.transpose()
        + J_angle * J_angle.transpose() * mount.angle_sigma_rad.powi(2)
        + J_range * J_range.transpose() * mount.range_sigma_m.powi(2);
    Hit { place: Point::from_coords(R * p_body + hall_from_body.origin.coords), cov_m2 }
}

/// Variance of the height that a hit reports, as the paper prints it, m².
///
/// ```text
/// Σ^m_(z) = [σ_t σ_t 1] Σ^m [σ_t σ_t 1]ᵀ
/// ```
/// - `σ_t`: standard deviation of the terrain's slope, no unit
///
/// The cross terms keep a fixed sign although the sign of the slope is unknown.
#[must_use]
pub fn height_var_as_printed_m2(cov_m2: &Matrix3<f64>, slope_sigma: f64) -> f64 {
    let g = Vector3::new(slope_sigma, slope_sigma, 1.0);
    (g.transpose() * cov_m2 * g).x.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;

    fn mount() -> LidarMount {
        LidarMount {
            body_from_lidar: Transform::new(
                Rotation::from_euler_rad(0.03, 1.5, -0.05),
                Point::new(0.08, -0.01, -0.06),
            ),
            range_sigma_m: 0.01,
            angle_sigma_rad: 0.004,
            min_range_m: 0.1,
            max_range_m: 12.0,
            blind_sectors_rad: vec![(2.5, 3.2)],
        }
    }

    fn pose() -> Transform<Hall, Body> {
        Transform::new(Rotation::from_euler_rad(0.15, -0.1, 0.9), Point::new(4.0, 7.0, 6.8))
    }

    fn beam(angle_rad: f32, range_m: f32) -> Beam {
        Beam { offset_ns: 0, angle_rad, range_m, intensity: 200 }
    }

    #[test]
    fn a_level_beam_straight_down_hits_the_floor_below() {
        let mount = LidarMount {
            body_from_lidar: Transform::new(
                Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
                Point::origin(),
            ),
            ..mount()
        };
        let pose = Transform::new(Rotation::identity(), Point::new(1.0, 2.0, 7.0));
        let hit = project(&mount, &beam(0.0, 7.0), &pose, &Matrix6::zeros());
        assert!((hit.place.coords - Vector3::new(1.0, 2.0, 0.0)).norm() < 1e-6);
        // Positive beam angles look to the left (+y).
        let left = project(&mount, &beam(0.5, 7.0), &pose, &Matrix6::zeros());
        assert!(left.place.coords.y > 2.0);
    }

    #[test]
    fn projection_jacobians_match_central_difference() {
        // Σ^m of a unit variance in one source alone is the outer product of its Jacobian column.
        let zero_mount = LidarMount { range_sigma_m: 0.0, angle_sigma_rad: 0.0, ..mount() };
        let b = beam(0.4, 6.2);
        let place = |pose: &Transform<Hall, Body>, angle: f32, range: f32| {
            project(&zero_mount, &beam(angle, range), pose, &Matrix6::zeros()).place.coords
        };
        for k in 0..6 {
            let mut cov = Matrix6::zeros();
            cov[(k, k)] = 1.0;
            let analytic = project(&zero_mount, &b, &pose(), &cov).cov_m2;
            let mut step = [0.0; 6];
            step[k] = 1e-6;
            let shifted = |sign: f64| {
                let s = step.map(|v| v * sign);
                let moved = pose()
                    .perturbed(&Vector3::new(s[0], s[1], s[2]), &Vector3::new(s[3], s[4], s[5]));
                place(&moved, b.angle_rad, b.range_m)
            };
            let column = (shifted(1.0) - shifted(-1.0)) / 2e-6;
            assert!(
                (analytic - column * column.transpose()).norm() < 1e-6 * (1.0 + analytic.norm())
            );
        }
        // Angle and range step in single precision, hence the wide step and tolerance.
        let only_range = LidarMount { range_sigma_m: 1.0, angle_sigma_rad: 0.0, ..mount() };
        let analytic = project(&only_range, &b, &pose(), &Matrix6::zeros()).cov_m2;
        let column = (place(&pose(), 0.4, 6.3) - place(&pose(), 0.4, 6.1)) / 0.2;
        assert!((analytic - column * column.transpose()).norm() < 1e-4);
        let only_angle = LidarMount { range_sigma_m: 0.0, angle_sigma_rad: 1.0, ..mount() };
        let analytic = project(&only_angle, &b, &pose(), &Matrix6::zeros()).cov_m2;
        let column = (place(&pose(), 0.41, 6.2) - place(&pose(), 0.39, 6.2)) / 0.02;
        assert!((analytic - column * column.transpose()).norm() < 2e-4 * analytic.norm());
    }

    #[test]
    fn printed_height_variance_keeps_its_cross_terms() {
        // σ_t = 0.5, Σ = [[1, .2, .1], [.2, 2, .3], [.1, .3, 3]]:
        // .25·1 + .25·2 + 3 + 2(.25·.2 + .5·.1 + .5·.3) = 4.25
        let cov = Matrix3::new(1.0, 0.2, 0.1, 0.2, 2.0, 0.3, 0.1, 0.3, 3.0);
        assert!((height_var_as_printed_m2(&cov, 0.5) - 4.25).abs() < 1e-12);
    }

    #[test]
    fn blind_sectors_are_closed() {
        assert!(mount().is_blind(2.5) && mount().is_blind(3.0) && !mount().is_blind(2.4));
    }
}
