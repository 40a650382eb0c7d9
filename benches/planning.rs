//! One choice of a waypoint, whole plans, and one piece of trajectory.

#![expect(clippy::expect_used, reason = "a bench stops where its premise fails")]

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix6, SMatrix, Vector3};
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;
use stockpilot::geometry::{Body, Camera, Point, Rotation, Transform};
use stockpilot::localization::camera_model::{CameraModel, Lens};
use stockpilot::localization::marker_map::MarkerMap;
use stockpilot::mapping::kalman_grid::{self, KalmanGrid};
use stockpilot::mapping::polygon::Polygon;
use stockpilot::mapping::projection::LidarMount;
use stockpilot::mapping::region::{Rect, Region};
use stockpilot::mapping::solid::{Mesh, Prism, Solid};
use stockpilot::mapping::{self, Mapper, Method, field_map, grid_map};
use stockpilot::messages::{Beam, GridGeometry, PoseError, Scan, TagFamily};
use stockpilot::planning::free_space::FreeSpace;
use stockpilot::planning::planner::{Belief, PlanRequest};
use stockpilot::planning::space::SpaceSettings;
use stockpilot::planning::trajectory::{Knot, Limits, Trajectory};
use stockpilot::planning::way::{Demand, way_within};
use stockpilot::planning::{PlannerKind, Settings, Waypoint};
use stockpilot::time::Stamp;

fn settings(planner: PlannerKind, side_m: f64) -> Settings {
    let (low, high) = (1.0, side_m - 1.0);
    let bounds = Rect { x_min_m: low, y_min_m: low, x_max_m: high, y_max_m: high };
    Settings { planner, ..Settings::over(bounds) }
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

fn lidar() -> LidarMount {
    LidarMount {
        body_from_lidar: Transform::new(
            Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
            Point::origin(),
        ),
        range_sigma_m: 0.012,
        angle_sigma_rad: 0.002,
        min_range_m: 0.15,
        max_range_m: 12.0,
        blind_sectors_rad: Vec::new(),
    }
}

fn request(settings: Settings, belief: Belief, pending: Vec<Waypoint>) -> PlanRequest {
    let free_space = FreeSpace::evaluate(&settings, &[camera()], &marker_map(), 0.5);
    PlanRequest {
        n_waypoints: settings.n_steps,
        longest_m: None,
        over_home: None,
        free_space: Arc::new(free_space),
        lidar: lidar(),
        belief,
        volume_m3: 900.0,
        constant_var_m6: 0.0,
        accounted: None,
        current: Vec::new(),
        pending,
        settings,
    }
}

fn greedy_choice(c: &mut Criterion) {
    let from = Waypoint { place: Point::new(10.0, 10.0, 7.0), yaw_rad: 0.0 };
    let geometry =
        GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 80, n_rows: 80 };
    let belief = Belief::Grid {
        cells: Box::new(KalmanGrid::new(geometry, kalman_grid::Settings::default())),
        areas_m2: vec![0.0625; 6400].into(),
    };
    let choice = request(settings(PlannerKind::Greedy, 20.0), belief, vec![from]);
    let chosen = choice.run().waypoints[0];
    let step_m = chosen.distance_m(&from);
    assert!((0.5..=2.0 + 1e-6).contains(&step_m), "{step_m} m");
    let mut group = c.benchmark_group("greedy");
    group.sample_size(10);
    group.bench_function("choice_80x80", |b| b.iter(|| black_box(&choice).run()));
    group.finish();
}

/// A map of 25 m × 25 m in cells of 0.25 m, after the first 10 m of a flight along y = 8 m.
fn begun_map() -> Mapper {
    let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 25.0, y_max_m: 25.0 };
    let mut mapper = Mapper::new(mapping::Settings {
        method: Method::MaternField,
        region: Region {
            bounds,
            exclusions: Vec::new(),
            exclusion_margin_m: 0.0,
            bays: Vec::new(),
        },
        cell_m: 0.25,
        base_height_m: 0.0,
        obstacles: Vec::new(),
        below_base_m: 0.5,
        max_height_m: 5.0,
        lidar: lidar(),
        grid: grid_map::Settings::default(),
        field: field_map::Settings::default(),
        max_position_sigma_m: 0.2,
    });
    for turn in 0..50_u64 {
        let start = Stamp::ZERO.plus(Duration::from_millis(100 * turn));
        #[expect(clippy::cast_precision_loss, reason = "few turns")]
        let place = Point::new(0.2 * turn as f64, 8.0, 7.0);
        let pose = Transform::new(Rotation::identity(), place);
        #[expect(clippy::cast_possible_truncation, reason = "single precision on the wire")]
        let beams = (-80..=80)
            .map(|k| f64::from(k) * 0.014)
            .filter(|angle_rad| 5.5 / angle_rad.cos() < 12.0)
            .map(|angle_rad| Beam {
                offset_ns: 0,
                angle_rad: angle_rad as f32,
                range_m: (5.5 / angle_rad.cos()) as f32,
                intensity: 1,
            })
            .collect();
        let error = |at, _| {
            Some(PoseError {
                at,
                cov: SMatrix::identity() * 1e-5,
                from_previous: SMatrix::zeros(),
                velocity_mps: Vector3::zeros(),
                rate_radps: Vector3::zeros(),
                tags: Vec::new(),
            })
        };
        let pose_at = |_| Some((pose, Matrix6::identity() * 1e-5));
        mapper.insert(&Scan { start, beams }, pose_at, error);
    }
    let solved = mapper.snapshot(Stamp::ZERO, false).run().expect("solved");
    mapper.absorb(&solved);
    mapper
}

/// Plans over 100 × 100 cells: from nothing, anew while little is known, and the step that betters a plan under way.
fn horizon(c: &mut Criterion) {
    let mapper = begun_map();
    let belief = Belief::Field {
        field: Arc::new(mapper.coarse_field().expect("a prior")),
        surface: Box::new(mapper.snapshot(Stamp::ZERO, false)),
    };
    let settings = Settings {
        target_ratio: Some(0.01),
        sees_shadows: true,
        ..settings(PlannerKind::Horizon, 25.0)
    };
    let from = Waypoint { place: Point::new(10.0, 8.0, 7.0), yaw_rad: 0.0 };
    let whole = request(settings, belief, vec![from]);
    // The grid of the fix quality is evaluated here, once and for all.
    let plan = whole.run();
    let sure = plan.prediction.expect("a prediction").sigma_end_m3;
    assert!(sure <= 100.0, "σ^V {sure} m³ at the end of {plan:?}");
    let mut again = whole.clone();
    again.pending.extend(&plan.waypoints[..2]);
    again.current = plan.waypoints[2..].to_vec();
    assert!(!again.run().waypoints.is_empty());
    // So near to the target that the present plan is only bettered.
    let mut step = again.clone();
    let now_m3 = again.run().prediction.expect("a prediction").sigma_now_m3;
    step.settings.target_ratio = Some(now_m3 / (3.0 * step.volume_m3));
    assert!(!step.run().waypoints.is_empty());
    let mut group = c.benchmark_group("horizon");
    group.sample_size(10);
    group.bench_function("first_plan_100x100", |b| b.iter(|| black_box(&whole).run()));
    group.bench_function("replan_100x100", |b| b.iter(|| black_box(&again).run()));
    group.bench_function("step_100x100", |b| b.iter(|| black_box(&step).run()));
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
        walls: Some(square(-2.0, 25.0)),
        ceiling_m: Some(10.0),
        highest_surface_m: Some(5.0),
        obstacles,
        ..SpaceSettings::default()
    };
    let settings = Settings { space, ..settings(PlannerKind::Greedy, 20.0) };
    FreeSpace::evaluate(&settings, &[camera()], &marker_map(), 0.5)
}

fn free(c: &mut Criterion) {
    let space = free_space();
    let axes = *space.quality().axes();
    let mut group = c.benchmark_group("free_space");
    group.sample_size(10);
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

criterion_group!(benches, greedy_choice, horizon, trajectory, free);
criterion_main!(benches);
