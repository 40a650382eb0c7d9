//! One choice of a waypoint, and one piece of trajectory.

#![expect(clippy::expect_used, reason = "a bench stops where its premise fails")]

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;
use stockpilot::geometry::{Body, Camera, Point, Rotation, Transform};
use stockpilot::localization::camera_model::{CameraModel, Lens};
use stockpilot::localization::marker_map::MarkerMap;
use stockpilot::mapping::kalman_grid::{self, KalmanGrid};
use stockpilot::mapping::projection::LidarMount;
use stockpilot::mapping::region::Rect;
use stockpilot::messages::{GridGeometry, TagFamily};
use stockpilot::planning::free_space::FreeSpace;
use stockpilot::planning::greedy::ChooseWaypoint;
use stockpilot::planning::trajectory::{Knot, Limits, Trajectory};
use stockpilot::planning::{PlannerKind, Settings, Waypoint};
use stockpilot::time::Stamp;

fn settings() -> Settings {
    Settings {
        planner: PlannerKind::Greedy,
        n_steps: 50,
        height_m: 7.0,
        yaw_rad: 0.0,
        bounds: Rect { x_min_m: 1.0, y_min_m: 1.0, x_max_m: 19.0, y_max_m: 19.0 },
        leg_spacing_m: 5.0,
        step_radius_m: 2.0,
        candidate_spacing_m: 1.0,
        nominal_height_m: 1.5,
        swath_half_angle_rad: 0.87,
        min_fix_quality: 2.0,
        limits: Limits::default(),
    }
}

/// Tags of 0.6 m along the wall at x = 24 m.
fn marker_map() -> MarkerMap {
    let mut map = MarkerMap::default();
    for id in 0..30_u32 {
        let (y, z) = (f64::from(id % 15) * 1.6 - 1.0, 4.0 + f64::from(id / 15) * 2.5);
        let corners = [(0.0, 0.0), (-0.6, 0.0), (-0.6, 0.6), (0.0, 0.6)]
            .map(|(dy, dz)| Point::new(24.0, y + dy, z + dz));
        map.insert(TagFamily::Tag36h11, id, corners).expect("a square");
    }
    map
}

fn camera() -> CameraModel {
    let quarter = std::f64::consts::FRAC_PI_2;
    CameraModel {
        width_px: 1280,
        height_px: 800,
        fx_px: 640.0,
        fy_px: 640.0,
        cx_px: 640.0,
        cy_px: 400.0,
        lens: Lens::pinhole(),
        readout: Duration::ZERO,
        body_from_camera: Transform::new(
            Rotation::<Body, Camera>::from_euler_rad(-quarter, 0.0, -quarter),
            Point::origin(),
        ),
    }
}

fn greedy_choice(c: &mut Criterion) {
    let settings = settings();
    let free_space = FreeSpace::evaluate(&settings, &[camera()], &marker_map(), 0.5);
    let from = Waypoint { place: Point::new(10.0, 10.0, 7.0), yaw_rad: 0.0 };
    let geometry =
        GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 80, n_rows: 80 };
    let choice = ChooseWaypoint {
        belief: KalmanGrid::new(geometry, kalman_grid::Settings::default()),
        pending: vec![from],
        free_space: Arc::new(free_space),
        lidar: LidarMount {
            body_from_lidar: Transform::new(
                Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
                Point::origin(),
            ),
            range_sigma_m: 0.012,
            angle_sigma_rad: 0.002,
            min_range_m: 0.15,
            max_range_m: 12.0,
            blind_sectors_rad: Vec::new(),
        },
        cell_areas_m2: vec![0.0625; 6400].into(),
        settings,
    };
    let chosen = choice.run().expect("a waypoint");
    let step_m = chosen.distance_m(&from);
    assert!((0.5..=2.0 + 1e-6).contains(&step_m), "{step_m} m");
    let mut group = c.benchmark_group("greedy");
    group.sample_size(10);
    group.bench_function("choice_80x80", |b| b.iter(|| black_box(&choice).run()));
    group.finish();
}

/// A step of a survey: the present motion, four waypoints, one of them new.
fn trajectory(c: &mut Criterion) {
    let limits = Limits::default();
    let waypoint = |x, y| Waypoint { place: Point::new(x, y, 7.0), yaw_rad: 0.0 };
    let waypoints =
        [waypoint(2.0, 0.0), waypoint(3.0, 1.0), waypoint(3.0, 3.0), waypoint(5.0, 3.0)];
    let from = Knot::at_rest(Vector3::new(0.0, 0.0, 7.0), 0.0);
    let through = |n: usize| Trajectory::through(Stamp::ZERO, &from, &waypoints[..n], &limits);
    let flown = through(3).expect("from rest");
    let at = Stamp::ZERO.plus(Duration::from_millis(1300));
    let replanned = flown.replanned(at, &waypoints, &limits, None).expect("a way");
    let off = replanned.knot_at(at).accel - flown.knot_at(at).accel;
    assert!(off.norm() < 1e-9 && replanned.n_waypoints() == 4);
    c.bench_function("trajectory_4_waypoints", |b| b.iter(|| through(black_box(4))));
    c.bench_function("trajectory_replanned_4_waypoints", |b| {
        b.iter(|| flown.replanned(black_box(at), &waypoints, &limits, None));
    });
}

criterion_group!(benches, greedy_choice, trajectory);
criterion_main!(benches);
