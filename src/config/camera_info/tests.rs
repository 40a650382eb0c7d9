use super::*;

/// As ROS `camera_calibration` writes it, shortened.
const ROS: &str = "image_width: 1280
image_height: 800
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [640.25, 0.0, 641.5, 0.0, 639.75, 398.25, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.31, 0.11, 0.0004, -0.0003, -0.02]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [610.0, 0.0, 641.0, 0.0, 0.0, 615.0, 398.0, 0.0, 0.0, 0.0, 1.0, 0.0]
";

/// As `OpenCV`'s `FileStorage` writes it: its own directive, tags, exponents of three digits.
const OPENCV: &str = "%YAML:1.0
---
calibration_time: \"Tue 12 May 2026 10:11:12\"
nframes: 31
image_width: 1280
image_height: 800
board_width: 9
fisheye_model: 1
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 3.3012500000000000e+002, 0., 6.4149999999999998e+02, 0.,
       3.3100000000000000e+02, 398.25, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ -2.1e-02, .013, -8.0000000000000002e-03, 1.5e-003 ]
avg_reprojection_error: 2.4e-01
";

fn error_of(from: &str, to: &str) -> CalibrationError {
    assert!(ROS.contains(from), "{from}");
    parse(&ROS.replace(from, to)).unwrap_err()
}

#[test]
fn a_ros_calibration_is_read_and_its_pixels_are_shifted_by_half() {
    let expected = Intrinsics {
        size_px: [1280, 800],
        focal_px: [640.25, 639.75],
        // The centre of the first pixel is (0, 0) there and (0.5, 0.5) here.
        principal_px: [642.0, 398.75],
        lens: LensName::RadialTangential,
        distortion: vec![-0.31, 0.11, 0.0004, -0.0003, -0.02],
    };
    assert_eq!(parse(ROS), Ok(expected));
}

#[test]
fn a_calibration_of_opencv_is_read_with_its_tags_and_directive() {
    let expected = Intrinsics {
        size_px: [1280, 800],
        focal_px: [330.125, 331.0],
        principal_px: [642.0, 398.75],
        lens: LensName::Fisheye,
        distortion: vec![-0.021, 0.013, -0.008, 0.0015],
    };
    assert_eq!(parse(OPENCV), Ok(expected.clone()));
    let ros_style = OPENCV.replace("fisheye_model: 1", "distortion_model: equidistant");
    assert_eq!(parse(&ros_style), Ok(expected));
}

#[test]
fn a_pixel_of_the_calibration_is_the_same_place_here() {
    // OpenCV: u = fx X/Z + cx with the first pixel's centre at 0, so the image's left border is
    // at −0.5; here it is at 0.
    let found = parse(ROS).unwrap();
    let u_opencv = 640.25 * 0.25 + 641.5;
    let u_here = found.focal_px[0] * 0.25 + found.principal_px[0];
    assert!((u_here - (u_opencv + 0.5)).abs() < 1e-12);
}

#[test]
fn the_rational_model_has_eight_coefficients_or_more_that_are_zero() {
    let with = |n: usize, data: &str| {
        let text = ROS.replace("plumb_bob", "rational_polynomial");
        let text = text.replace("cols: 5", &format!("cols: {n}"));
        parse(&text.replace("[-0.31, 0.11, 0.0004, -0.0003, -0.02]", data))
    };
    let eight = vec![0.5, -2.6, 0.0, 0.0, 1.5, 0.4, -2.4, 1.4];
    let found = with(8, "[0.5, -2.6, 0, 0, 1.5, 0.4, -2.4, 1.4]").unwrap();
    assert_eq!((found.lens, found.distortion), (LensName::RadialTangential, eight.clone()));
    let found = with(12, "[0.5, -2.6, 0, 0, 1.5, 0.4, -2.4, 1.4, 0, 0, 0, 0]").unwrap();
    assert_eq!(found.distortion, eight);
    let prism = with(12, "[0.5, -2.6, 0, 0, 1.5, 0.4, -2.4, 1.4, 0, 1e-3, 0, 0]");
    assert_eq!(prism, Err(CalibrationError::BeyondRational));
    assert!(matches!(with(5, "[0.5, -2.6, 0, 0, 1.5]"), Err(CalibrationError::WrongCount { .. })));
}

#[test]
fn each_fault_says_what_and_where() {
    use CalibrationError as E;
    assert_eq!(error_of("image_width: 1280\n", ""), E::Missing("image_width"));
    assert_eq!(error_of("image_height", "image_hight"), E::Missing("image_height"));
    assert_eq!(error_of("camera_matrix:", "matrix:"), E::Missing("camera_matrix.data"));
    assert_eq!(error_of("plumb_bob", "ftheta"), E::UnknownModel("ftheta".to_owned()));
    let count = error_of("[-0.31, 0.11, 0.0004, -0.0003, -0.02]", "[-0.31, 0.11, 0.0004]");
    assert_eq!(
        count.to_string(),
        "distortion_coefficients.data holds 3 numbers, 1 × 5 are expected"
    );
    let count = error_of("plumb_bob", "equidistant");
    assert_eq!(count.to_string(), "distortion_coefficients.data holds 5 numbers, 4 are expected");
    let text = ROS.replacen("  rows: 3\n", "", 1).replace("0.0, 0.0, 1.0]", "0.0, 1.0]");
    let count = parse(&text).unwrap_err();
    assert_eq!(count.to_string(), "camera_matrix.data holds 8 numbers, 9 are expected");
    assert_eq!(error_of("640.25", ".nan"), E::NotFinite("camera_matrix.data"));
    assert_eq!(error_of("-0.31", "-.inf"), E::NotFinite("distortion_coefficients.data"));
    assert_eq!(error_of("640.25, 0.0", "640.25, 1.5"), E::NotACameraMatrix);
    let mismatch = error_of("image_width: 1280", "image_width: 640");
    assert!(mismatch.to_string().contains("another size"), "{mismatch}");
    for (from, to) in [("1280", "-1280"), ("1280", "wide"), ("data: [640.25", "data: [[640.25")] {
        assert!(matches!(error_of(from, to), E::Yaml(_)), "{to}");
    }
}

#[test]
fn without_a_model_only_unmistakable_calibrations_are_taken() {
    let unnamed = ROS.replace("distortion_model: plumb_bob\n", "");
    assert_eq!(parse(&unnamed), parse(ROS), "five coefficients belong to plumb_bob alone");
    let four = unnamed.replace("cols: 5", "cols: 4").replace(", -0.02]", "]");
    assert_eq!(parse(&four), Err(CalibrationError::Missing("distortion_model")));
}
