use super::*;
use crate::geometry::Rotation;
use crate::stats::{Noise, SeedBook};
use nalgebra::Vector3;

/// A wide, visibly distorted camera, mounted askew.
pub(crate) fn distorted_camera() -> CameraModel {
    CameraModel {
        width_px: 1280,
        height_px: 800,
        fx_px: 640.0,
        fy_px: 642.0,
        cx_px: 645.0,
        cy_px: 396.0,
        lens: Lens::radial_tangential([-0.12, 0.02], [0.001, -0.0007]),
        readout: Duration::ZERO,
        body_from_camera: Transform::new(
            // A camera that looks along body x: z_c = x_b, x_c = −y_b, y_c = −z_b; then tilted.
            Rotation::from_euler_rad(0.02, 0.2, -0.1)
                * Rotation::<Body, Camera>::from_euler_rad(
                    -std::f64::consts::FRAC_PI_2,
                    0.0,
                    -std::f64::consts::FRAC_PI_2,
                ),
            Point::new(0.1, 0.02, -0.03),
        ),
    }
}

/// The same camera behind a lens of 180° and more.
pub(crate) fn fisheye_camera() -> CameraModel {
    CameraModel {
        fx_px: 330.0,
        fy_px: 331.0,
        lens: Lens::fisheye([-0.021, 0.013, -0.008, 0.0015]),
        ..distorted_camera()
    }
}

/// Coefficients as calibrations of real cameras give them: a webcam and a Kinect (rational).
fn cameras() -> Vec<CameraModel> {
    let with = |lens| CameraModel { lens, ..distorted_camera() };
    let plumb_bob = [-0.28, 0.09, -0.013, 0.0, 0.0, 0.0];
    let rational = [0.5285, -2.6212, 1.5164, 0.4097, -2.4446, 1.4430];
    vec![
        with(Lens::pinhole()),
        distorted_camera(),
        with(Lens::RadialTangential(RadialTangential::new(plumb_bob, [0.0011, -0.0008]))),
        with(Lens::RadialTangential(RadialTangential::new(rational, [-0.0004, 0.0003]))),
        fisheye_camera(),
        CameraModel { lens: Lens::fisheye([0.0; 4]), ..fisheye_camera() },
    ]
}

/// Up to how far from the axis the camera is tried, rad.
fn reach_rad(camera: &CameraModel) -> f64 {
    match &camera.lens {
        Lens::RadialTangential(lens) => lens.max_radius().atan().min(1.1) - 0.02,
        Lens::Fisheye(lens) => lens.max_angle_rad() - 0.02,
    }
}

/// A point anywhere in the lens's view, from half a metre to 30 m away.
fn drawn_point(camera: &CameraModel, noise: &mut Noise) -> Point<Camera> {
    let angle = reach_rad(camera) * noise.uniform();
    let around = noise.between(-3.1, 3.1);
    let direction =
        Vector3::new(angle.sin() * around.cos(), angle.sin() * around.sin(), angle.cos());
    Point::from_coords(direction * noise.between(0.5, 30.0))
}

#[test]
fn projection_jacobians_match_central_differences() {
    let mut noise = SeedBook::new(3).stream("points");
    for (k, camera) in cameras().iter().enumerate() {
        for _ in 0..300 {
            let p = drawn_point(camera, &mut noise);
            let (_, jacobian) = camera.project(&p).expect("in view");
            for axis in 0..3 {
                let step = Vector3::ith(axis, 1e-5 * p.coords.norm());
                let at = |d| camera.project(&Point::from_coords(p.coords + d)).expect("in view").0;
                let numeric = (at(step) - at(-step)) / (2.0 * step[axis]);
                let analytic: Vector2<f64> = jacobian.column(axis).into();
                // Rounding of pixels near 1e3 in a step of 1e-5 distances: 1e-8 of the scale.
                let scale = 1000.0 / p.coords.norm() + analytic.norm();
                let gap = (numeric - analytic).norm() / scale;
                assert!(gap < 1e-7, "camera {k}, axis {axis} at {p:?}: {numeric} {analytic}");
            }
        }
    }
}

#[test]
fn the_fisheye_jacobian_is_smooth_through_the_axis() {
    let camera = fisheye_camera();
    for offset_m in [0.0, 1e-7, 9.9e-5, 1.01e-4, 1e-3] {
        let p = Point::<Camera>::new(3.0 * offset_m, -2.0 * offset_m, 2.0);
        let (_, jacobian) = camera.project(&p).expect("in view");
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-4);
            let at = |d| camera.project(&Point::from_coords(p.coords + d)).expect("in view").0;
            let numeric = (at(step) - at(-step)) / 2e-4;
            let analytic: Vector2<f64> = jacobian.column(axis).into();
            assert!((numeric - analytic).norm() < 2e-6, "offset {offset_m}, axis {axis}");
        }
    }
}

#[test]
fn unprojection_undoes_projection() {
    let mut noise = SeedBook::new(4).stream("points");
    for (k, camera) in cameras().iter().enumerate() {
        for _ in 0..300 {
            let p = drawn_point(camera, &mut noise);
            let (pixel, _) = camera.project(&p).expect("in view");
            let bearing = camera.bearing(&pixel).expect("invertible");
            assert!((bearing - p.coords.normalize()).norm() < 1e-9, "camera {k} at {p:?}");
            let (again, _) = camera.project(&Point::from_coords(bearing * 7.0)).expect("in view");
            assert!((again - pixel).norm() < 1e-7, "camera {k} at {p:?}");
        }
    }
}

#[test]
fn rational_distortion_agrees_with_a_calculation_by_hand() {
    let lens = RadialTangential::new([0.1, -0.2, 0.3, 0.4, 0.05, -0.01], [0.001, -0.002]);
    // x = 0.5, y = 0.25, s = 0.3125
    // above = 1 + 0.03125 − 0.01953125 + 0.0091552734375 = 1.0208740234375
    // below = 1 + 0.125 + 0.0048828125 − 0.00030517578125 = 1.12957763671875
    let q = 1.020_874_023_437_5 / 1.129_577_636_718_75;
    // 2 p₁ x y = 0.00025, p₂ (s + 2x²) = −0.001625, p₁ (s + 2y²) = 0.0004375, 2 p₂ x y = −0.0005
    let expected = Vector2::new(0.5 * q + 0.00025 - 0.001_625, 0.25 * q + 0.000_437_5 - 0.0005);
    let (image, _) = lens.image_of(&Vector3::new(1.0, 0.5, 2.0)).expect("valid");
    assert!((image - expected).norm() < 1e-15);
}

#[test]
fn fisheye_distortion_agrees_with_a_calculation_by_hand() {
    // On the +x axis at 45°: θ = π/4, x_d = θ (1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸), y_d = 0.
    let lens = Fisheye::new([0.1, -0.02, 0.003, -0.0004]);
    let t = std::f64::consts::FRAC_PI_4;
    let expected = t + 0.1 * t.powi(3) - 0.02 * t.powi(5) + 0.003 * t.powi(7) - 0.0004 * t.powi(9);
    let (image, _) = lens.image_of(&Vector3::new(3.0, 0.0, 3.0)).expect("valid");
    assert!((image - Vector2::new(expected, 0.0)).norm() < 1e-15);
    // Without coefficients the radius is the angle itself, also at 90°.
    let (image, _) = Fisheye::new([0.0; 4]).image_of(&Vector3::new(0.0, -2.0, 0.0)).expect("valid");
    assert!((image - Vector2::new(0.0, -std::f64::consts::FRAC_PI_2)).norm() < 1e-15);
}

#[test]
fn nothing_is_projected_beyond_the_validity_of_the_lens() {
    let sideways = |angle_deg: f64| {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        Point::<Camera>::new(5.0 * sin, 0.0, 5.0 * cos)
    };
    assert!(distorted_camera().project(&Point::new(0.0, 0.0, -1.0)).is_none(), "behind");
    assert!(distorted_camera().project(&Point::new(0.0, 0.0, 0.04)).is_none(), "inside the lens");
    let fisheye = CameraModel { lens: Lens::fisheye([0.0; 4]), ..fisheye_camera() };
    assert!(fisheye.project(&sideways(94.9)).is_some());
    assert!(fisheye.project(&sideways(95.1)).is_none());
    assert!(fisheye.project(&Point::new(0.0, 0.0, -1.0)).is_none(), "behind");
    // r (1 − 0.12 r²) stops growing at r = 1/√0.36 = 1.667; beyond, only k₃ lets it grow again.
    let folding = RadialTangential::new([-0.12, 0.0, 0.0005, 0.0, 0.0, 0.0], [0.0; 2]);
    let without_k3 = RadialTangential::new([-0.12, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]);
    assert!((without_k3.max_radius() - 1.0 / 0.36_f64.sqrt()).abs() < 1e-9);
    // 1 − 0.36 s + 0.0035 s³ (s = r²) vanishes there.
    let s = folding.max_radius().powi(2);
    assert!((1.0 - 0.36 * s + 0.0035 * s.powi(3)).abs() < 1e-8, "{s}");
    assert!(folding.image_of(&Vector3::new(3.9, 0.0, 1.0)).is_none(), "it grows again there");
    // θ (1 − 0.2 θ²) stops growing at θ = 1/√0.6.
    assert!((Fisheye::new([-0.2, 0.0, 0.0, 0.0]).max_angle_rad() - 1.290_994_449).abs() < 1e-8);
}

#[test]
fn pixels_outside_of_what_the_lens_shows_look_nowhere() {
    let far = Vector2::new(1e8, 400.0);
    for camera in [distorted_camera(), fisheye_camera()] {
        assert!(camera.bearing(&far).is_none());
        assert!(camera.bearing(&Vector2::new(f64::NAN, 0.0)).is_none());
    }
    // A fisheye pixel at 90° has a bearing, but no (X/Z, Y/Z).
    let fisheye = CameraModel { lens: Lens::fisheye([0.0; 4]), ..fisheye_camera() };
    let sideways = Vector2::new(645.0 + 330.0 * std::f64::consts::FRAC_PI_2, 396.0);
    assert!((fisheye.bearing(&sideways).expect("seen") - Vector3::x()).norm() < 1e-12);
    assert!(fisheye.unproject(&sideways).is_none());
}

#[test]
fn undistorted_axis_point_hits_the_principal_point() {
    for camera in cameras() {
        let (pixel, _) = camera.project(&Point::new(0.0, 0.0, 3.0)).expect("in view");
        assert!((pixel - Vector2::new(645.0, 396.0)).norm() < 1e-12);
    }
}

#[test]
fn rows_are_read_out_from_top_to_bottom_about_the_stamp() {
    let camera = CameraModel { readout: Duration::from_millis(20), ..distorted_camera() };
    // 800 rows: centres from 0.5 to 799.5.
    assert!((camera.row_offset_s(0.5) + 0.010).abs() < 1e-15);
    assert!((camera.row_offset_s(799.5) - 0.010).abs() < 1e-15);
    assert!(camera.row_offset_s(400.0).abs() < 1e-15);
    assert!(distorted_camera().row_offset_s(3.0).abs() < 1e-15, "global shutter");
}
