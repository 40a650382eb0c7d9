use super::*;
use nalgebra::Vector2;

fn section() -> CameraSection {
    CameraSection {
        calibration_file: None,
        size_px: Some([1280, 800]),
        focal_px: Some([640.0, 641.0]),
        principal_px: Some([642.0, 398.0]),
        lens: LensName::RadialTangential,
        distortion: vec![-0.1, 0.02, 0.001, -0.002],
        readout_s: 0.012,
        images: None,
        mount: MountSection { position_m: [0.1, 0.0, 0.0], rotation_deg: [0.0, 10.0, 0.0] },
    }
}

fn refusal(camera: &CameraSection) -> String {
    camera.model(1).unwrap_err().to_string()
}

#[test]
fn coefficients_come_in_the_order_of_opencv() {
    let camera =
        CameraSection { distortion: vec![0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.6], ..section() };
    let Lens::RadialTangential(lens) = camera.model(0).unwrap().lens else { panic!("wrong lens") };
    assert_eq!(lens, RadialTangential::new([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.01, 0.02]));
    let fisheye = CameraSection { lens: LensName::Fisheye, ..section() }.model(0).unwrap();
    assert_eq!(fisheye.lens, Lens::fisheye([-0.1, 0.02, 0.001, -0.002]));
    assert!((fisheye.row_offset_s(799.5) - 0.006).abs() < 1e-12, "readout");
}

#[test]
fn each_fault_names_the_camera_and_the_key() {
    let missing = refusal(&CameraSection { focal_px: None, ..section() });
    assert!(missing.starts_with("cameras[1].focal_px: is missing"), "{missing}");
    let outside = refusal(&CameraSection { principal_px: Some([642.0, 801.0]), ..section() });
    assert_eq!(outside, "cameras[1].principal_px = 801 px is outside 0 to 800 px");
    let count = refusal(&CameraSection { distortion: vec![0.0; 6], ..section() });
    assert!(count.starts_with("cameras[1].distortion: has 6 coefficients"), "{count}");
    let fisheye = CameraSection { lens: LensName::Fisheye, distortion: vec![0.0; 5], ..section() };
    assert!(refusal(&fisheye).contains("k1, k2, k3, k4"));
    let broken = refusal(&CameraSection { distortion: vec![f64::NAN; 4], ..section() });
    assert!(broken.starts_with("cameras[1].distortion"), "{broken}");
    let slow = refusal(&CameraSection { readout_s: 0.3, ..section() });
    assert_eq!(slow, "cameras[1].readout_s = 0.3 s is outside 0 to 0.2 s");
    let folding = CameraSection { distortion: vec![-4.0, 0.0, 0.0, 0.0], ..section() };
    assert!(refusal(&folding).contains("folds"));
    let unread = CameraSection { calibration_file: Some("a.yaml".into()), ..section() };
    assert!(refusal(&unread).starts_with("cameras[1].calibration_file"));
}

const CALIBRATION: &str = "image_width: 1280
image_height: 800
camera_matrix: {rows: 3, cols: 3, data: [640, 0, 641.5, 0, 639, 398.25, 0, 0, 1]}
distortion_model: equidistant
distortion_coefficients: {rows: 1, cols: 4, data: [-0.02, 0.01, -0.005, 0.001]}
";

fn by_file() -> CameraSection {
    CameraSection {
        calibration_file: Some("camera.yaml".into()),
        size_px: None,
        focal_px: None,
        principal_px: None,
        distortion: no_distortion(),
        ..section()
    }
}

#[test]
fn a_calibration_file_stands_for_the_inline_values() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("camera.yaml"), CALIBRATION).unwrap();
    let read = by_file().with_file_read(0, directory.path()).unwrap();
    let inline = CameraSection {
        size_px: Some([1280, 800]),
        focal_px: Some([640.0, 639.0]),
        principal_px: Some([642.0, 398.75]),
        lens: LensName::Fisheye,
        distortion: vec![-0.02, 0.01, -0.005, 0.001],
        ..section()
    };
    assert_eq!(read, inline);
    let model = read.model(0).unwrap();
    // The axis is half a pixel to the right and below of OpenCV's numbers.
    let axis = model.bearing(&Vector2::new(642.0, 398.75)).unwrap();
    assert!((axis - nalgebra::Vector3::z()).norm() < 1e-12);
}

#[test]
fn faults_of_a_calibration_file_name_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("camera.yaml");
    let refusal =
        |camera: CameraSection| camera.with_file_read(2, directory.path()).unwrap_err().to_string();
    let absent = refusal(by_file());
    assert!(absent.contains("camera.yaml") && absent.starts_with("cannot read"), "{absent}");
    std::fs::write(&path, CALIBRATION).unwrap();
    let twice = refusal(CameraSection { focal_px: Some([640.0, 640.0]), ..by_file() });
    assert!(twice.starts_with("cameras[2].calibration_file"), "{twice}");
    let other = refusal(CameraSection { size_px: Some([640, 400]), ..by_file() });
    assert!(other.contains("camera.yaml: image_width"), "{other}");
    assert!(other.contains("cameras[2].size_px says 640 and 400"), "{other}");
    std::fs::write(&path, CALIBRATION.replace("equidistant", "pinhole")).unwrap();
    let unknown = refusal(by_file());
    assert!(unknown.contains("camera.yaml: distortion_model \"pinhole\""), "{unknown}");
}
