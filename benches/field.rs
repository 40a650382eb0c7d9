//! The Matérn field: rows added, exact and iterative solves, fully and half covered, cold and warm.
//!
//! `cargo bench --bench field -- --quick` is enough for figures to a few percent.

#![expect(clippy::expect_used, reason = "a bench stops where its premise fails")]

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::sync::Arc;
use stockpilot::mapping::matern_field::{
    Information, Lattice, Prior, Row, Solution, Solver, solve,
};
use stockpilot::messages::GridGeometry;
use stockpilot::stats::SeedBook;

const CELL_M: f64 = 0.25;
const PRIOR: Prior = Prior { range_m: 4.0, sigma_m: 0.8, mean_m: 1.5, mean_sigma_m: 2.0 };
const ITERATIVE: Solver = Solver::LIVE;

fn lattice(n: usize) -> Arc<Lattice> {
    let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: CELL_M, n_cols: n, n_rows: n };
    Arc::new(Lattice::covering(&grid, PRIOR.padding_m(), |_, _| false))
}

/// Eight hits a cell up to `share` of the width, 3 cm each, on a surface with hills.
fn seen(lattice: &Lattice, share: f64, n_hits: u32) -> Information {
    let mut information = Information::new(lattice);
    let mut noise = SeedBook::new(4).stream("field bench");
    let grid = lattice.grid();
    let (x_max_m, _) = grid.max_corner_m();
    for cell in 0..grid.n_cells() {
        let (x_m, y_m) = grid.centre_m(cell);
        if x_m > share * x_max_m {
            continue;
        }
        for _ in 0..n_hits {
            let x_m = x_m + noise.between(-0.5, 0.5) * CELL_M;
            let y_m = y_m + noise.between(-0.5, 0.5) * CELL_M;
            let z = 1.5 + (x_m / 2.0).sin() * (y_m / 3.0).cos() + 0.03 * noise.normal();
            let row = lattice.row_at(x_m, y_m).expect("on the lattice");
            assert!(information.add(&row, z, 1.0 / 9e-4));
        }
    }
    information
}

fn rows(c: &mut Criterion) {
    let lattice = lattice(80);
    let mut noise = SeedBook::new(1).stream("rows");
    // Scans sweep across the map: neighbours in time are neighbours in place.
    let hits: Vec<(f64, f64, f64)> = (0..10_000_u32)
        .map(|k| {
            let along = f64::from(k % 500) / 500.0;
            (20.0 * along, 0.04 * f64::from(k / 500) + noise.uniform(), noise.uniform())
        })
        .collect();
    let prepared: Vec<Row> =
        hits.iter().map(|(x, y, _)| lattice.row_at(*x, *y).expect("inside")).collect();
    let mut group = c.benchmark_group("field/rows");
    group.throughput(Throughput::Elements(hits.len() as u64));
    let mut information = Information::new(&lattice);
    group.bench_function("add", |b| {
        b.iter(|| {
            for (row, (_, _, z)) in prepared.iter().zip(&hits) {
                black_box(information.add(row, *z, 900.0));
            }
        });
    });
    group.bench_function("row_at_and_add", |b| {
        b.iter(|| {
            for (x_m, y_m, z) in &hits {
                if let Some(row) = lattice.row_at(*x_m, *y_m) {
                    black_box(information.add(&row, *z, 900.0));
                }
            }
        });
    });
    group.finish();
}

/// Heights and the variance of the volume: the work of one update.
fn update(
    lattice: &Arc<Lattice>,
    information: &Information,
    solver: Solver,
    warm: Option<(&[f64], &[f64])>,
    w: &[f64],
) -> (Solution, f64) {
    let solution = solve(lattice, &PRIOR, information, solver, warm.map(|warm| warm.0));
    let solution = solution.expect("solved");
    let adjoint = solution.adjoint(w, warm.map(|warm| warm.1)).expect("solved");
    (solution, adjoint.var)
}

fn solves(c: &mut Criterion) {
    let mut group = c.benchmark_group("field/solve");
    group.sample_size(10);
    for n in [100, 300, 1000] {
        let lattice = lattice(n);
        let w = lattice.from_cells(&vec![CELL_M * CELL_M; n * n]);
        for (coverage, share) in [("full", 1.0), ("half", 0.5)] {
            let information = seen(&lattice, share, 8);
            let before = seen(&lattice, share - 0.02, 8);
            if n < 1000 {
                // The first solve finds the pattern.
                assert!(update(&lattice, &information, Solver::Direct, None, &w).1 > 0.0);
                group.bench_function(BenchmarkId::new(format!("exact_{coverage}"), n), |b| {
                    b.iter(|| update(&lattice, &information, Solver::Direct, None, &w));
                });
            }
            group.bench_function(BenchmarkId::new(format!("cold_{coverage}"), n), |b| {
                b.iter(|| update(&lattice, &information, ITERATIVE, None, &w));
            });
            let earlier = solve(&lattice, &PRIOR, &before, ITERATIVE, None).expect("solved");
            let q = earlier.adjoint(&w, None).expect("solved").q;
            let warm = Some((earlier.height_m(), q.as_slice()));
            group.bench_function(BenchmarkId::new(format!("warm_{coverage}"), n), |b| {
                b.iter(|| update(&lattice, &information, ITERATIVE, warm, &w));
            });
        }
    }
    group.finish();
}

fn variances(c: &mut Criterion) {
    let mut group = c.benchmark_group("field/marginals");
    group.sample_size(10);
    for n in [100, 300] {
        let lattice = lattice(n);
        let information = seen(&lattice, 0.5, 8);
        let solved = solve(&lattice, &PRIOR, &information, Solver::Direct, None).expect("solved");
        group.bench_function(BenchmarkId::new("exact", n), |b| {
            b.iter_batched(|| (), |()| solved.marginal_var_m2(), BatchSize::LargeInput);
        });
    }
    group.finish();
}

criterion_group!(benches, rows, solves, variances);
criterion_main!(benches);
