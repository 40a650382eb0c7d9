//! Beams into cells, and cells into a surface.

#![expect(clippy::expect_used, reason = "a bench stops where its premise fails")]

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Matrix6, SMatrix, Vector3};
use std::hint::black_box;
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::mapping::kalman_grid::{self, KalmanGrid};
use stockpilot::mapping::projection::LidarMount;
use stockpilot::mapping::region::{Rect, Region};
use stockpilot::mapping::sparse_gp::{Cut, Posterior, Settings};
use stockpilot::mapping::{self, Mapper, Method, SolveSurface};
use stockpilot::messages::{Beam, GridGeometry, PoseError, Scan};
use stockpilot::time::{Mono, Stamp};

const GP: Settings = Settings {
    smoothness_nu: 1.5,
    length_scale_m: 0.5,
    reach: 1.5,
    sigma_m: 1.0,
    mean_m: 1.5,
    cut: Cut::Taper,
};

fn mapper(method: Method) -> Mapper {
    let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 20.0, y_max_m: 20.0 };
    Mapper::new(mapping::Settings {
        method,
        region: Region {
            bounds,
            exclusions: Vec::new(),
            exclusion_margin_m: 0.1,
            bays: Vec::new(),
        },
        cell_m: 0.25,
        base_height_m: 0.0,
        obstacles: Vec::new(),
        below_base_m: 0.5,
        max_height_m: 5.0,
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
        grid: mapping::grid_map::Settings::default(),
        field: mapping::field_map::Settings::default(),
        max_position_sigma_m: 0.3,
    })
}

/// 450 beams within 50° of straight down from 7 m, every one on the floor.
#[expect(clippy::cast_possible_truncation, reason = "beams are single precision")]
fn scan() -> Scan {
    let beam = |k: u32| {
        let angle_rad = (f64::from(k) / 449.0 - 0.5) * 1.7;
        let range_m = 6.9 / angle_rad.cos();
        Beam {
            offset_ns: k * 200_000,
            angle_rad: angle_rad as f32,
            range_m: range_m as f32,
            intensity: 200,
        }
    };
    Scan { start: Stamp::ZERO, beams: (0..450).map(beam).collect() }
}

fn pose_error(at: Stamp<Mono>, _: Option<Stamp<Mono>>) -> Option<PoseError> {
    Some(PoseError {
        at,
        cov: SMatrix::identity() * 4e-4,
        from_previous: SMatrix::identity() * 0.9,
        velocity_mps: Vector3::zeros(),
        rate_radps: Vector3::zeros(),
        tags: Vec::new(),
    })
}

fn beams(c: &mut Criterion) {
    let scan = scan();
    let pose = Transform::<Hall, Body>::new(
        Rotation::from_euler_rad(0.02, -0.03, 0.4),
        Point::new(10.0, 10.0, 7.0),
    );
    let pose_at = |_| Some((pose, Matrix6::from_diagonal_element(4e-4)));
    let mut group = c.benchmark_group("mapper");
    group.throughput(Throughput::Elements(450));
    for (name, method) in [
        ("insert_450_beams", Method::KalmanGrid),
        ("insert_450_beams_with_field", Method::MaternField),
    ] {
        let fresh = mapper(method);
        let mut once = fresh.clone();
        once.insert(&scan, pose_at, pose_error);
        assert_eq!(once.counts().used, 450);
        group.bench_function(name, |b| {
            b.iter_batched_ref(
                || fresh.clone(),
                |mapper| mapper.insert(black_box(&scan), pose_at, pose_error),
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

/// All beams of a flight added up on the field, as every round of a solve does anew; `insert_450_beams_with_field`
/// only keeps them.
fn gather(c: &mut Criterion) {
    const N_TURNS: u32 = 40;
    let mut mapper = mapper(Method::MaternField);
    for turn in 0..N_TURNS {
        let start = Stamp::from_nanos(100_000_000 * i64::from(turn));
        let pose = Transform::<Hall, Body>::new(
            Rotation::from_euler_rad(0.02, -0.03, 0.4),
            Point::new(5.0 + 0.25 * f64::from(turn), 10.0, 7.0),
        );
        let pose_at = |_| Some((pose, Matrix6::from_diagonal_element(4e-4)));
        mapper.insert(&Scan { start, ..scan() }, pose_at, pose_error);
    }
    let n_beams = u64::from(N_TURNS) * 450;
    assert_eq!(mapper.counts().used, n_beams);
    let at = Stamp::from_nanos(10_000_000_000);
    let solved = mapper.snapshot(at, false).run().expect("solved");
    mapper.absorb(&solved);
    let SolveSurface::MaternField(work) = mapper.snapshot(at, false) else {
        unreachable!("the mapper keeps a field")
    };
    let (info, n_refused) = work.added_up();
    assert!(n_refused == 0 && (0..info.n_nodes()).any(|node| info.info_per_m2(node) > 0.0));
    let mut group = c.benchmark_group("field");
    group.throughput(Throughput::Elements(n_beams));
    group.bench_function("gather_40_turns", |b| b.iter(|| black_box(&work).added_up()));
    group.finish();
}

/// A square grid whose cells know their height in stripes.
fn cells(n: usize) -> (GridGeometry, Vec<f64>, Vec<f64>) {
    let geometry = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: n, n_rows: n };
    let grid = KalmanGrid::new(geometry, kalman_grid::Settings::default());
    let var_m2 = grid
        .var_m2()
        .iter()
        .enumerate()
        .map(|(k, prior)| if k / n % 20 < 10 { 0.01 } else { *prior })
        .collect();
    (geometry, grid.mean_m().to_vec(), var_m2)
}

fn surface(c: &mut Criterion) {
    let mut group = c.benchmark_group("sparse_gp");
    group.sample_size(10);
    for n in [80, 160] {
        let (geometry, mean_m, var_m2) = cells(n);
        let areas_m2 = vec![geometry.cell_area_m2(); geometry.n_cells()];
        let solve = || Posterior::new(&geometry, &mean_m, &var_m2, &GP).expect("positive definite");
        let variance = solve().sum_var(&areas_m2);
        let prior: f64 = areas_m2.iter().map(|area| area * GP.sigma_m).sum();
        assert!(variance > 0.0 && variance < prior * prior);
        assert!(solve().marginal_var_m2().iter().all(|var| *var <= GP.sigma_m.powi(2) + 1e-9));
        group.bench_function(BenchmarkId::new("sum_only", n), |b| {
            b.iter(|| solve().sum_var(black_box(&areas_m2)));
        });
        group.bench_function(BenchmarkId::new("with_marginals", n), |b| {
            b.iter(|| {
                let posterior = solve();
                (posterior.sum_var(black_box(&areas_m2)), posterior.marginal_var_m2())
            });
        });
    }
    group.finish();
}

criterion_group!(benches, beams, gather, surface);
criterion_main!(benches);
