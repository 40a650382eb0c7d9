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
use stockpilot::mapping::polygon::Polygon;
use stockpilot::mapping::projection::LidarMount;
use stockpilot::mapping::region::Rect;
use stockpilot::mapping::solid::{Mesh, Prism, Solid};
use stockpilot::messages::{GridGeometry, TagFamily};
use stockpilot::planning::free_space::FreeSpace;
use stockpilot::planning::greedy::ChooseWaypoint;
use stockpilot::planning::space::SpaceSettings;
use stockpilot::planning::trajectory::{Knot, Limits, Segment};
use stockpilot::planning::way::{Demand, way_within};
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
        space: SpaceSettings::default(),
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

fn trajectory(c: &mut Criterion) {
    let limits = Limits::default();
    let from = Knot {
        position: Vector3::new(1.0, 2.0, 7.0),
        velocity: Vector3::new(1.2, -0.3, 0.0),
        accel: Vector3::new(0.2, 0.1, 0.0),
    };
    let to = Knot {
        position: Vector3::new(3.0, 2.5, 7.0),
        velocity: Vector3::new(1.0, 1.0, 0.0),
        accel: Vector3::zeros(),
    };
    let segment = Segment::between(Stamp::ZERO, &from, &to, &limits);
    let ends_there = |s: &Segment| (s.end().position - to.position).norm() < 1e-12;
    assert!(segment.as_ref().is_some_and(|s| ends_there(s) && s.duration_s() < 10.0));
    c.bench_function("trajectory_segment", |b| {
        b.iter(|| Segment::between(Stamp::ZERO, black_box(&from), black_box(&to), &limits));
    });
}

/// A hall of 24 m × 24 m × 10 m with nine columns and a ball of 320 triangles.
fn free_space() -> FreeSpace {
    let square = |from: f64, to: f64| {
        Polygon::from(Rect { x_min_m: from, y_min_m: from, x_max_m: to, y_max_m: to })
    };
    let mut obstacles: Vec<Solid> = Vec::new();
    for i in 0..3_u32 {
        for j in 0..3_u32 {
            let centre = Vector3::new(3.5 + 6.5 * f64::from(i), 3.5 + 6.5 * f64::from(j), 5.0);
            let size = Vector3::new(0.4, 0.4, 10.0);
            obstacles.push(Prism::turned_box(&centre, &size, 0.3).expect("a box").into());
        }
    }
    let around = |k: u32, n: u32| (f64::from(k) / f64::from(n) * std::f64::consts::TAU).sin_cos();
    let at = |i: u32, j: u32| {
        let ((sin_u, cos_u), (sin_v, cos_v)) = (around(i, 16), around(j, 20));
        Vector3::new(10.0, 17.0, 8.5) + 0.5 * Vector3::new(cos_u * cos_v, cos_u * sin_v, sin_u)
    };
    let cells = (0..8).flat_map(|i| (0..20).map(move |j| (i + 12, j)));
    let halves = cells.flat_map(|(i, j)| {
        let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
        [[a, b, c], [a, c, d]]
    });
    obstacles.push(Mesh::new(halves.collect()).expect("triangles").into());
    let space = SpaceSettings {
        walls: Some(square(-2.0, 22.0)),
        ceiling_m: Some(10.0),
        highest_surface_m: Some(5.0),
        obstacles,
        ..SpaceSettings::default()
    };
    let settings = Settings { space, ..settings() };
    FreeSpace::evaluate(&settings, &[camera()], &marker_map(), 0.5)
}

fn free(c: &mut Criterion) {
    let space = free_space();
    let axes = *space.quality().axes();
    let mut group = c.benchmark_group("free_space");
    group.sample_size(10);
    println!("{} nodes", axes.n_nodes());
    group.bench_function("node", |b| {
        let pose = axes.waypoint(axes.index([12, 12, 1, 0])).level_pose();
        b.iter(|| space.quality().sensing().fix_cov(black_box(&pose)));
    });
    group.bench_function("grid_25x25x4x8", |b| {
        b.iter(|| free_space().quality().fill(0, 1));
    });
    space.quality().fill(0, 1);
    let at = |x: f64, y: f64, yaw_rad: f64| Waypoint { place: Point::new(x, y, 7.3), yaw_rad };
    let (from, to) = (at(2.6, 5.2, 0.1), at(4.4, 4.4, 0.1));
    assert!(space.is_free(&from) && space.is_way_free(&from, &to), "beside a column");
    group.bench_function("is_free", |b| b.iter(|| space.is_free(black_box(&from))));
    group.bench_function("is_way_free_2m", |b| {
        b.iter(|| space.is_way_free(black_box(&from), black_box(&to)));
    });
    let past_ball = (at(9.0, 15.6, 0.0), at(11.0, 15.6, 0.0));
    group.bench_function("is_way_free_2m_past_mesh", |b| {
        b.iter(|| space.is_way_free(black_box(&past_ball.0), black_box(&past_ball.1)));
    });
    group.bench_function("fix_cov", |b| b.iter(|| space.fix_cov(black_box(&from))));
    let (start, end) = (at(0.0, 3.5, 0.0), at(19.0, 16.5, 0.0));
    assert!(way_within(&space, &start, &end, Demand::Clear).is_some_and(|way| way.len() > 1));
    group.bench_function("way_through_columns", |b| {
        b.iter(|| way_within(&space, black_box(&start), black_box(&end), Demand::Clear));
    });
    let shut_in = Waypoint { place: Point::new(3.5, 3.5, 7.0), yaw_rad: 0.0 };
    assert!(way_within(&space, &start, &shut_in, Demand::Clear).is_none());
    group.bench_function("no_way", |b| {
        b.iter(|| way_within(&space, black_box(&start), black_box(&shut_in), Demand::Clear));
    });
    group.finish();
}

criterion_group!(benches, greedy_choice, trajectory, free);
criterion_main!(benches);
