//! How time, work and memory of the field's solvers grow with the map: a table and its slopes.
//!
//! `cargo bench --bench growth` prints for maps of 100² to 1000² cells, fully and half covered, what an
//! update from nothing (heights and the adjoint of the volume) takes: steps, time, and the largest heap
//! meanwhile, beside what the map itself holds. A slope of 1 in the logarithms of cells and time is growth
//! in proportion; n log n would be 1.1 between 100² and 800².

#![expect(clippy::expect_used, clippy::print_stdout, reason = "a table for people, or a stop")]

use peak_alloc::PeakAlloc;
use std::sync::Arc;
use std::time::Duration;
use stockpilot::mapping::matern_field::{Information, Lattice, Prior, Solver, solve};
use stockpilot::messages::GridGeometry;
use stockpilot::stats::SeedBook;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

const CELL_M: f64 = 0.25;
const PRIOR: Prior = Prior { range_m: 4.0, sigma_m: 0.8, mean_m: 1.5, mean_sigma_m: 2.0 };

/// What one update took.
struct Update {
    n_steps: usize,
    time: Duration,
    /// Held meanwhile beyond the map, bytes.
    peak_bytes: usize,
}

/// The lattice and its data, with eight hits a cell up to `share` of the width.
fn map(n: usize, share: f64) -> (Arc<Lattice>, Information) {
    let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: CELL_M, n_cols: n, n_rows: n };
    let lattice = Arc::new(Lattice::covering(&grid, PRIOR.padding_m(), |_, _| false));
    let mut information = Information::new(&lattice);
    let mut noise = SeedBook::new(4).stream("growth");
    let (x_max_m, _) = grid.max_corner_m();
    for cell in 0..grid.n_cells() {
        let (x_m, y_m) = grid.centre_m(cell);
        if x_m > share * x_max_m {
            continue;
        }
        for _ in 0..8 {
            let x_m = x_m + noise.between(-0.5, 0.5) * CELL_M;
            let y_m = y_m + noise.between(-0.5, 0.5) * CELL_M;
            let z = 1.5 + (x_m / 2.0).sin() * (y_m / 3.0).cos() + 0.03 * noise.normal();
            let row = lattice.row_at(x_m, y_m).expect("on the lattice");
            assert!(information.add(&row, z, 1.0 / 9e-4));
        }
    }
    (lattice, information)
}

#[expect(clippy::disallowed_methods, reason = "a bench looks at the clock")]
fn update(lattice: &Arc<Lattice>, information: &Information, solver: Solver, w: &[f64]) -> Update {
    let before = HEAP.current_usage();
    HEAP.reset_peak_usage();
    let began = std::time::Instant::now();
    let solution = solve(lattice, &PRIOR, information, solver, None).expect("solved");
    let adjoint = solution.adjoint(w, None).expect("solved");
    let time = began.elapsed();
    assert!(adjoint.var > 0.0);
    let peak_bytes = HEAP.peak_usage().saturating_sub(before);
    Update { n_steps: solution.n_steps() + adjoint.n_steps, time, peak_bytes }
}

/// The fastest of some updates; what all of them keep (prior, pattern) is made by the first.
fn best(lattice: &Arc<Lattice>, information: &Information, solver: Solver, w: &[f64]) -> Update {
    let first = update(lattice, information, solver, w);
    let n_more = if lattice.n_nodes() > 300_000 { 2 } else { 9 };
    (0..n_more).map(|_| update(lattice, information, solver, w)).fold(first, |best, next| Update {
        time: best.time.min(next.time),
        peak_bytes: best.peak_bytes.max(next.peak_bytes),
        ..best
    })
}

/// Slope of the logarithm of `value` over that of the cells, between the first and the last.
#[expect(clippy::cast_precision_loss, reason = "counts and bytes, for people")]
fn slope(of: &[(usize, f64)]) -> f64 {
    let [(n_first, first), .., (n_last, last)] = of else { return f64::NAN };
    (last / first).ln() / (*n_last as f64 / *n_first as f64).ln()
}

#[expect(clippy::cast_precision_loss, reason = "counts and bytes, for people")]
fn main() {
    println!("cells    covered  solver     steps    ms        bytes/cell: map  update");
    for (coverage, share) in [("full", 1.0), ("half", 0.5)] {
        let (mut times, mut bytes, mut works) = (Vec::new(), Vec::new(), Vec::new());
        for n in [100, 200, 300, 400, 800, 1000] {
            let empty = HEAP.current_usage();
            let (lattice, information) = map(n, share);
            let n_cells = n * n;
            let of_map = (HEAP.current_usage() - empty) as f64 / n_cells as f64;
            let w = lattice.from_cells(&vec![CELL_M * CELL_M; n_cells]);
            // The exact factor of 1000² takes gigabytes and is not meant for it.
            let solvers: &[_] = if n <= 400 {
                &[("iterative", Solver::LIVE), ("exact", Solver::Direct)]
            } else {
                &[("iterative", Solver::LIVE)]
            };
            for (name, solver) in solvers {
                let done = best(&lattice, &information, *solver, &w);
                let ms = 1e3 * done.time.as_secs_f64();
                let per_cell = done.peak_bytes as f64 / n_cells as f64;
                let size = format!("{n}²");
                println!(
                    "{size:8} {coverage:8} {name:10} {:5} {ms:8.1} {of_map:20.0} {per_cell:8.0}",
                    done.n_steps
                );
                if *name == "iterative" && n <= 800 {
                    times.push((n_cells, ms));
                    bytes.push((n_cells, done.peak_bytes as f64));
                    works.push((n_cells, (done.n_steps * lattice.n_nodes()) as f64));
                }
            }
        }
        let (time, memory, work) = (slope(&times), slope(&bytes), slope(&works));
        println!(
            "slopes 100² to 800², {coverage}: time {time:.2} memory {memory:.2} work {work:.2}"
        );
    }
}
