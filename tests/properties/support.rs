//! A small hall with tags, and the brain's settings for it.

use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::geometry::{Body, Camera, Hall, Lidar, Point, Rotation, Transform};
use stockpilot::localization;
use stockpilot::localization::camera_model::{CameraModel, Lens};
use stockpilot::localization::filter::ImuNoise;
use stockpilot::localization::marker_map::MarkerMap;
use stockpilot::localization::vision_fix;
use stockpilot::mapping::projection::LidarMount;
use stockpilot::mapping::region::{Rect, Region};
use stockpilot::mapping::{self, field_map, grid_map, kalman_grid};
use stockpilot::messages::{CameraId, ScanCorrection, TagDetection, TagDetections, TagFamily};
use stockpilot::mission;
use stockpilot::pilot::Settings;
use stockpilot::planning::{self, PlannerKind};
use stockpilot::time::{Mono, Stamp};

pub(crate) fn at_ns(nanos: i64) -> Stamp<Mono> {
    Stamp::from_nanos(nanos)
}

pub(crate) fn at_s(seconds: f64) -> Stamp<Mono> {
    Stamp::ZERO.plus(Duration::from_secs_f64(seconds))
}

/// A camera that looks along the body's x axis, a little distorted.
pub(crate) fn camera() -> CameraModel {
    CameraModel {
        width_px: 1280,
        height_px: 800,
        fx_px: 640.0,
        fy_px: 640.0,
        cx_px: 640.0,
        cy_px: 400.0,
        lens: Lens::radial_tangential([-0.1, 0.01], [0.0005, -0.0003]),
        readout: Duration::ZERO,
        body_from_camera: Transform::new(
            Rotation::<Body, Camera>::from_euler_rad(
                -std::f64::consts::FRAC_PI_2,
                0.0,
                -std::f64::consts::FRAC_PI_2,
            ),
            Point::new(0.1, 0.0, 0.02),
        ),
    }
}

/// Twelve tags of half a metre on the wall at x = 9 m.
pub(crate) fn marker_map() -> MarkerMap {
    let mut map = MarkerMap::default();
    for id in 0..12_u32 {
        let (y, z) = (f64::from(id % 4) * 1.5 - 1.0, f64::from(id / 4) * 1.5);
        let corners = [(0.0, 0.0), (-0.5, 0.0), (-0.5, 0.5), (0.0, 0.5)]
            .map(|(dy, dz)| Point::new(9.0, y + dy, z + dz));
        map.insert(TagFamily::Tag36h11, id, corners).expect("a square");
    }
    map
}

/// What the camera sees from a pose, without noise.
pub(crate) fn frame(pose: &Transform<Hall, Body>, captured: Stamp<Mono>) -> TagDetections {
    let camera = camera();
    let camera_from_hall = (*pose * camera.body_from_camera).inverse();
    let map = marker_map();
    let seen = map.iter().filter_map(|(family, id, corners)| {
        let mut corners_px = [[0.0; 2]; 4];
        for (pixel, corner) in corners_px.iter_mut().zip(corners) {
            let (p, _) = camera.project(&(camera_from_hall * *corner))?;
            camera.contains(&p, 0.0).then_some(())?;
            *pixel = p.into();
        }
        Some(TagDetection { id, family, corners_px, decision_margin: 50.0 })
    });
    TagDetections {
        captured_at: captured,
        received_at: captured.plus(Duration::from_millis(60)),
        camera: CameraId(0),
        tags: seen.collect(),
        points: Vec::new(),
    }
}

pub(crate) fn lidar_mount() -> LidarMount {
    LidarMount {
        body_from_lidar: Transform::<Body, Lidar>::new(
            Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
            Point::from_coords(Vector3::new(0.0, 0.0, -0.05)),
        ),
        range_sigma_m: 0.012,
        angle_sigma_rad: 0.002,
        min_range_m: 0.15,
        max_range_m: 12.0,
        blind_sectors_rad: Vec::new(),
    }
}

/// Settings of a hall of 4 m × 4 m at the height of 2.5 m.
pub(crate) fn settings() -> Settings {
    let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 4.0, y_max_m: 4.0 };
    let region =
        Region { bounds, exclusions: Vec::new(), exclusion_margin_m: 0.1, bays: Vec::new() };
    let grid = kalman_grid::Settings::default();
    Settings {
        localization: localization::Settings {
            cameras: vec![camera()],
            marker_map: marker_map(),
            vision: vision_fix::Settings::default(),
            update: localization::Update::Tight,
            pad: None,
            capture_sigma_s: 0.002,
            imu_noise: ImuNoise::default(),
            ring_span: Duration::from_secs(1),
            lost_after: Duration::from_millis(500),
            lost_sigma_m: 0.5,
        },
        mapping: mapping::Settings {
            method: mapping::Method::MaternField,
            region,
            cell_m: 0.25,
            base_height_m: 0.0,
            obstacles: Vec::new(),
            below_base_m: 0.5,
            max_height_m: 2.0,
            lidar: lidar_mount(),
            grid: grid_map::Settings { kalman_grid: grid, ..Default::default() },
            field: field_map::Settings::default(),
            max_position_sigma_m: 0.3,
        },
        planning: planning::Settings {
            planner: PlannerKind::SquareWave,
            n_steps: 12,
            height_m: 2.5,
            yaw_rad: 0.0,
            leg_spacing_m: Some(2.0),
            nominal_height_m: 0.5,
            swath_half_angle_rad: 0.8,
            ..planning::Settings::over(bounds)
        },
        mission: mission::Settings::default(),
        solve_interval: Duration::from_secs(2),
        scan_correction: ScanCorrection::default(),
        report_interval: Duration::from_millis(500),
    }
}
