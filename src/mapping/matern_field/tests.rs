//! The field against dense algebra and closed forms.

mod dense;

use super::*;
use crate::messages::GridGeometry;
use crate::stats::SeedBook;
use dense::Dense;

fn square_grid(n: usize, cell_m: f64) -> GridGeometry {
    GridGeometry { x_min_m: -3.0, y_min_m: 1.5, cell_m, n_cols: n, n_rows: n }
}

const PRIOR: Prior = Prior { range_m: 2.0, sigma_m: 0.8, mean_m: 1.3, mean_sigma_m: 0.0 };

fn open(_: (f64, f64), _: (f64, f64)) -> bool {
    false
}

/// Hits anywhere on the grid, heights far from the mean, variances over two decades.
fn hits(grid: &GridGeometry, n: usize, seed: u64) -> Vec<((f64, f64), f64, f64)> {
    let mut noise = SeedBook::new(seed).stream("hits");
    let (x_max_m, y_max_m) = grid.max_corner_m();
    (0..n)
        .map(|_| {
            let place =
                (noise.between(grid.x_min_m, x_max_m), noise.between(grid.y_min_m, y_max_m));
            (place, noise.between(0.0, 3.0), 10.0_f64.powf(noise.between(-4.0, -2.0)))
        })
        .collect()
}

/// Solves with a few hits and compares mean, variances, volume variance and draws' covariance.
fn compare_with_dense(
    prior: &Prior,
    solver: Solver,
    walls: impl Fn((f64, f64), (f64, f64)) -> bool + Copy,
) {
    let grid = square_grid(20, 0.25);
    let lattice = Arc::new(Lattice::covering(&grid, 0.75, walls));
    let mut information = Information::new(&lattice);
    let mut dense = Dense::new(&grid, 3, prior, walls);
    let mut n_used = 0;
    for (place, z, var_m2) in hits(&grid, 250, 5) {
        // The left third stays unseen.
        if place.0 < -1.4 {
            continue;
        }
        // Nothing is seen from inside the wall.
        let Some(row) = lattice.row_at(place.0, place.1) else { continue };
        assert!(information.add(&row, z, 1.0 / var_m2));
        dense.observe(&row, z, var_m2);
        n_used += 1;
    }
    assert!(n_used > 100);
    let (mean_m, cov_m2) = dense.posterior();
    let solution = solve(&lattice, prior, &information, solver, None).expect("solved");
    let mut worst = 0.0_f64;
    for (ours, theirs) in solution.height_m().iter().zip(mean_m.iter()) {
        worst = worst.max((ours - theirs).abs() / theirs.abs().max(0.1));
    }
    assert!(worst < 1e-6, "mean differs by {worst:e}");

    let w = lattice.from_cells(&vec![grid.cell_area_m2(); grid.n_cells()]);
    let adjoint = solution.adjoint(&w, None).expect("solved");
    let w = nalgebra::DVector::from_vec(w);
    let volume_var = (w.transpose() * &cov_m2 * &w)[(0, 0)];
    assert!((adjoint.var / volume_var - 1.0).abs() < 1e-6, "{} {volume_var}", adjoint.var);
    // Data's share by its definition, Σ k² R with k = aᵀq/R.
    let data_var: f64 =
        dense.rows.iter().map(|(row, _, var_m2)| row.value(&adjoint.q).powi(2) / var_m2).sum();
    let sum = (adjoint.prior_var + data_var) / volume_var;
    assert!((sum - 1.0).abs() < 1e-6, "shares add up to {sum}");

    if solver == Solver::Direct {
        let var_m2 = solution.marginal_var_m2().expect("exact");
        for (node, ours) in var_m2.iter().enumerate() {
            assert!((ours / cov_m2[(node, node)] - 1.0).abs() < 1e-6, "node {node}");
        }
    }
}

/// A wall along x, with a gap at its left end.
fn wall(a: (f64, f64), b: (f64, f64)) -> bool {
    let bounds =
        crate::mapping::region::Rect { x_min_m: -2.2, x_max_m: 9.0, y_min_m: 3.1, y_max_m: 3.27 };
    bounds.cuts(a, b)
}

#[test]
fn posterior_equals_the_dense_gaussian_process() {
    compare_with_dense(&PRIOR, Solver::Direct, open);
}

#[test]
fn posterior_with_walls_and_unknown_level_equals_the_dense_one() {
    let prior = Prior { mean_sigma_m: 2.5, ..PRIOR };
    compare_with_dense(&prior, Solver::Direct, wall);
}

#[test]
fn iterative_posterior_equals_the_dense_one() {
    let prior = Prior { mean_sigma_m: 2.5, ..PRIOR };
    compare_with_dense(&prior, Solver::Iterative { residual_ratio: 1e-10 }, wall);
}

/// The field without data, and the covariance of every node with one of them.
fn prior_column(lattice: &Arc<Lattice>, prior: &Prior, node: usize) -> Vec<f64> {
    let information = Information::new(lattice);
    let solution = solve(lattice, prior, &information, Solver::Direct, None).expect("solved");
    let mut w = vec![0.0; lattice.n_nodes()];
    w[node] = 1.0;
    solution.adjoint(&w, None).expect("solved").q
}

#[test]
fn prior_matches_the_matern_closed_form() {
    // Grid of 12 m with 5 m around it; ρ = 4 m.
    let prior = Prior { range_m: 4.0, sigma_m: 0.7, mean_m: 0.0, mean_sigma_m: 0.0 };
    let grid = square_grid(60, 0.2);
    let lattice = Arc::new(Lattice::covering(&grid, 5.0, open));
    let middle_cell = 30 * 60 + 30;
    let middle = lattice.node_of_cell(middle_cell);
    let cov_m2 = prior_column(&lattice, &prior, middle);
    let var_m2 = prior.sigma_m * prior.sigma_m;
    assert!((cov_m2[middle] / var_m2 - 1.0).abs() < 0.03, "variance {}", cov_m2[middle] / var_m2);
    // Along x and along the diagonal, in cells.
    for (cols, rows) in [(3, 0), (0, 6), (10, 0), (7, 7), (20, 0), (14, 14), (28, 0)] {
        let node = lattice.node_of_cell(middle_cell + rows * 60 + cols);
        #[expect(clippy::cast_precision_loss, reason = "a few cells")]
        let distance_m = 0.2 * ((cols * cols + rows * rows) as f64).sqrt();
        let u = prior.kappa_per_m() * distance_m;
        let closed_form = u * puruspe::bessel::Kn(1, u);
        let ours = cov_m2[node] / cov_m2[middle];
        assert!((ours - closed_form).abs() < 0.01, "{distance_m} m: {ours}, not {closed_form}");
    }
}

#[test]
fn bessel_function_matches_published_values() {
    // Abramowitz and Stegun 1964, tables 9.8 and 9.9: K₁(0.5), K₁(1), K₁(2), K₁(5).
    for (x, published) in [
        (0.5, 1.656_441_120_0),
        (1.0, 0.601_907_230_2),
        (2.0, 0.139_865_881_8),
        (5.0, 0.004_044_613_4),
    ] {
        assert!((puruspe::bessel::Kn(1, x) / published - 1.0_f64).abs() < 1e-7, "K1({x})");
    }
}

#[test]
fn prior_variance_holds_at_edges_and_walls() {
    let prior = Prior { range_m: 3.0, sigma_m: 1.0, mean_m: 0.0, mean_sigma_m: 0.0 };
    let grid = square_grid(40, 0.25);
    let lattice = Arc::new(Lattice::covering(&grid, prior.padding_m(), wall));
    let information = Information::new(&lattice);
    let solution = solve(&lattice, &prior, &information, Solver::Direct, None).expect("solved");
    let var_m2 = lattice.on_cells(&solution.marginal_var_m2().expect("exact"));
    for (cell, var_m2) in var_m2.iter().enumerate() {
        let (x_m, y_m) = grid.centre_m(cell);
        let is_at_wall = x_m > -3.0 && (y_m - 3.2).abs() < 1.5;
        let bound = if is_at_wall { 0.4 } else { 0.05 };
        assert!((var_m2 - 1.0).abs() < bound, "cell {cell} at {x_m} {y_m}: {var_m2}");
    }
}

#[test]
fn draws_have_the_posterior_covariance() {
    let prior = Prior { mean_sigma_m: 1.5, ..PRIOR };
    let grid = square_grid(8, 0.4);
    let lattice = Arc::new(Lattice::covering(&grid, 0.4, open));
    let mut information = Information::new(&lattice);
    for ((x_m, y_m), z, var_m2) in hits(&grid, 12, 3) {
        let row = lattice.row_at(x_m, y_m).expect("on the lattice");
        information.add(&row, z, 1e-2 / var_m2);
    }
    let solution = solve(&lattice, &prior, &information, Solver::Direct, None).expect("solved");
    let w = lattice.from_cells(&(0..64).map(|k| f64::from(k % 5)).collect::<Vec<_>>());
    let var = solution.adjoint(&w, None).expect("solved").var;
    let mean = iterative::dot(&w, solution.height_m());
    let mut noise = SeedBook::new(11).stream("draws");
    let n = 4000;
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..n {
        let draw = solution.sample_m(&mut noise).expect("has a factor");
        let error = iterative::dot(&w, &draw) - mean;
        sum += error;
        squares += error * error;
    }
    // Standard errors: of the mean 1/√n = 0.016 σ, of the variance √(2/n) = 0.022; 4 of them each.
    assert!((sum / f64::from(n)).abs() < 0.064 * var.sqrt());
    assert!((squares / f64::from(n) / var - 1.0).abs() < 0.09, "{}", squares / f64::from(n) / var);
}

#[test]
fn merged_maps_equal_the_joint_one() {
    let grid = square_grid(12, 0.25);
    let lattice = Arc::new(Lattice::covering(&grid, 1.0, open));
    let [mut joint, mut first, mut second] = std::array::from_fn(|_| Information::new(&lattice));
    for (k, ((x_m, y_m), z, var_m2)) in hits(&grid, 200, 8).into_iter().enumerate() {
        let row = lattice.row_at(x_m, y_m).expect("on the lattice");
        joint.add(&row, z, 1.0 / var_m2);
        if k % 3 == 0 { &mut first } else { &mut second }.add(&row, z, 1.0 / var_m2);
    }
    first.merge(&second).expect("same lattice");
    let height_m = |data: &Information| {
        solve(&lattice, &PRIOR, data, Solver::Direct, None).expect("solved").height_m().to_vec()
    };
    for (a, b) in height_m(&joint).iter().zip(height_m(&first)) {
        assert!((a - b).abs() < 1e-10);
    }
    let other = Information::new(&Lattice::covering(&square_grid(11, 0.25), 1.0, open));
    assert!(first.merge(&other).is_err());
}

#[test]
fn rows_are_bilinear_and_do_not_look_through_walls() {
    let grid = square_grid(20, 0.25);
    let lattice = Lattice::covering(&grid, 0.75, wall);
    let mut n_cut = 0;
    for ((x_m, y_m), _, _) in hits(&grid, 2000, 2) {
        let Some(row) = lattice.row_at(x_m, y_m) else {
            assert!(wall((x_m, y_m), (x_m, y_m + 0.1)) || wall((x_m, y_m), (x_m, y_m - 0.1)));
            continue;
        };
        assert!((row.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let hides = |n: &u32| wall((x_m, y_m), lattice.place_m(*n as usize));
        if row.nodes.iter().any(hides) {
            n_cut += 1;
            let hidden = row.nodes.iter().zip(row.weights).filter(|(n, _)| hides(n));
            for (node, weight) in hidden {
                // The middle of a part of the square stands for the part, up to 1/64 m off.
                let sees_from = |dx_m: f64, dy_m: f64| {
                    !wall((x_m + dx_m, y_m + dy_m), lattice.place_m(*node as usize))
                };
                let is_seen_nearby = [-0.016, 0.016]
                    .iter()
                    .any(|dx| [-0.016, 0.016].iter().any(|dy| sees_from(*dx, *dy)));
                assert!(weight == 0.0 || is_seen_nearby, "{x_m} {y_m}: {weight}");
            }
        } else if row.weights.iter().all(|a| *a > 0.0) {
            let at = |axis: usize| {
                let place = |n: &u32| <[f64; 2]>::from(lattice.place_m(*n as usize))[axis];
                row.nodes.iter().zip(row.weights).map(|(n, a)| a * place(n)).sum::<f64>()
            };
            assert!((at(0) - x_m).abs() < 1e-9 && (at(1) - y_m).abs() < 1e-9);
        }
    }
    assert!(n_cut > 20);
    assert!(lattice.row_at(f64::NAN, 0.0).is_none());
    assert!(lattice.row_at(100.0, 2.0).is_none());
}

#[test]
fn what_is_not_sound_is_refused() {
    let grid = square_grid(5, 0.25);
    let lattice = Arc::new(Lattice::covering(&grid, 0.5, open));
    let mut information = Information::new(&lattice);
    let row = lattice.row_at(-2.5, 2.0).expect("on the lattice");
    assert!(!information.add(&row, f64::NAN, 1.0));
    assert!(!information.add(&row, 1.0, f64::INFINITY));
    assert!(!information.add(&row, 1.0, 0.0));
    assert_eq!(information, Information::new(&lattice));
    let prior = Prior { range_m: 0.0, ..PRIOR };
    let refused = solve(&lattice, &prior, &information, Solver::Direct, None);
    assert!(matches!(refused, Err(FieldError::Prior { .. })));
    let prior = Prior { mean_sigma_m: f64::INFINITY, ..PRIOR };
    let refused = solve(&lattice, &prior, &information, Solver::Direct, None);
    assert_eq!(refused.err(), Some(FieldError::NoLevel));
    information.add(&row, 4.0, 100.0);
    let solution = solve(&lattice, &prior, &information, Solver::Direct, None).expect("one hit");
    // A single hit and no other knowledge of the level: everything is expected at its height.
    assert!(solution.height_m().iter().all(|h| (h - 4.0).abs() < 1e-6));
}

#[test]
fn multigrid_needs_no_more_steps_on_larger_maps() {
    for (n, range_m) in [(30, 2.0), (60, 2.0), (60, 9.0)] {
        let prior = Prior { range_m, mean_sigma_m: 2.0, ..PRIOR };
        let grid = square_grid(n, 0.25);
        let lattice = Arc::new(Lattice::covering(&grid, 1.0, open));
        let mut information = Information::new(&lattice);
        for (place, z, var_m2) in hits(&grid, 6 * n * n, 21) {
            // Half of the map.
            if place.0 < grid.x_min_m + grid.max_corner_m().0 - place.0 {
                let row = lattice.row_at(place.0, place.1).expect("on the lattice");
                information.add(&row, z, 1.0 / var_m2);
            }
        }
        let solver = Solver::Iterative { residual_ratio: 1e-6 };
        let solution = solve(&lattice, &prior, &information, solver, None).expect("solved");
        assert!(solution.n_steps() <= 24, "{n}²: {} steps", solution.n_steps());
        let start = Some(solution.height_m());
        let again = solve(&lattice, &prior, &information, solver, start).expect("solved");
        assert!(again.n_steps() <= 1, "the start is not used: {}", again.n_steps());
    }
}

/// Steps for heights and adjoint of a map that is seen up to `share` of its width, and its nodes.
fn steps(n: usize, cell_m: f64, share: f64) -> (usize, usize) {
    let prior = Prior { mean_sigma_m: 2.0, range_m: 4.0, ..PRIOR };
    let grid = square_grid(n, cell_m);
    let lattice = Arc::new(Lattice::covering(&grid, prior.padding_m(), open));
    let mut information = Information::new(&lattice);
    let x_seen_m = grid.x_min_m + share * (grid.max_corner_m().0 - grid.x_min_m);
    for (place, z, var_m2) in hits(&grid, 3 * n * n, 21) {
        if place.0 < x_seen_m {
            let row = lattice.row_at(place.0, place.1).expect("on the lattice");
            assert!(information.add(&row, z, 1.0 / var_m2));
        }
    }
    let solver = Solver::Iterative { residual_ratio: 1e-6 };
    let solution = solve(&lattice, &prior, &information, solver, None).expect("solved");
    let w = lattice.from_cells(&vec![grid.cell_area_m2(); grid.n_cells()]);
    let adjoint = solution.adjoint(&w, None).expect("solved");
    (solution.n_steps() + adjoint.n_steps, lattice.n_nodes())
}

#[test]
fn work_of_the_iterative_solve_grows_no_faster_than_n_log_n() {
    // Larger maps of the same cells, and finer cells on the same map, which are harder; steps of Jacobi's
    // preconditioner would grow with the range in cells, four times from first to last of the latter.
    let larger = [(40, 0.25), (80, 0.25), (160, 0.25)];
    let finer = [(40, 0.25), (80, 0.125), (160, 0.0625)];
    for share in [1.0, 0.5] {
        for sizes in [larger, finer] {
            let [first, .., last] = sizes.map(|(n, cell_m)| {
                let (n_steps, n_nodes) = steps(n, cell_m, share);
                (n_steps * n_nodes, n_nodes)
            });
            let n_log_n = |n: usize| n as f64 * (n as f64).ln();
            let growth = last.0 as f64 / first.0 as f64;
            let bound = n_log_n(last.1) / n_log_n(first.1);
            // Steps are whole numbers near 20: half of one is 2.5 %.
            assert!(growth <= 1.03 * bound, "{growth} against {bound} at {share} of {sizes:?}");
        }
    }
}

#[test]
fn hyper_parameters_of_drawn_fields_are_found() {
    let truth = Prior { range_m: 2.0, sigma_m: 0.7, mean_m: 1.0, mean_sigma_m: 1.0 };
    let (nugget_m, white_m): (f64, f64) = (0.06, 0.02);
    let grid = square_grid(26, 0.25);
    let lattice = Arc::new(Lattice::covering(&grid, 0.75, open));
    let empty = Information::new(&lattice);
    let prior = solve(&lattice, &truth, &empty, Solver::Direct, None).expect("solved");
    let mut noise = SeedBook::new(17).stream("hyper-parameters");
    let n_fields = 3_u32;
    let mut logs = Vec::new();
    for field in 0..n_fields {
        let height_m = prior.sample_m(&mut noise).expect("has a factor");
        let sigma_m = nugget_m.hypot(white_m);
        let data: Vec<Datum> = hits(&grid, 800, u64::from(field))
            .into_iter()
            .map(|((x_m, y_m), _, _)| {
                let row = lattice.row_at(x_m, y_m).expect("on the lattice");
                let height_m = row.value(&height_m) + sigma_m * noise.normal();
                Datum { row, height_m, white_var_m2: white_m * white_m }
            })
            .collect();
        let start = Prior { range_m: 4.0, sigma_m: 1.5, ..truth };
        let found = estimate_prior(&lattice, &data, &start, 0.02).expect("estimated");
        logs.push([
            (found.range_m / truth.range_m).ln(),
            (found.sigma_m / truth.sigma_m).ln(),
            (found.nugget_m / nugget_m).ln(),
        ]);
    }
    // Fields of three ranges by three fix ρ and σ to about 20 %, the nugget to 4 %; three standard
    // errors of the mean of three.
    for (axis, bound) in [(0, 0.35), (1, 0.35), (2, 0.07)] {
        let mean = logs.iter().map(|log| log[axis]).sum::<f64>() / f64::from(n_fields);
        assert!(mean.abs() < bound, "parameter {axis}: {logs:?}");
    }
}

#[test]
fn marginal_likelihood_matches_the_dense_one() {
    let grid = square_grid(7, 0.4);
    let lattice = Arc::new(Lattice::covering(&grid, 0.4, open));
    let value = |prior: &Prior, nugget_m: f64| {
        let mut dense = Dense::new(&grid, 1, prior, open);
        let mut data = Vec::new();
        for ((x_m, y_m), height_m, white_var_m2) in hits(&grid, 40, 6) {
            let row = lattice.row_at(x_m, y_m).expect("on the lattice");
            dense.observe(&row, height_m, white_var_m2 + nugget_m * nugget_m);
            data.push(Datum { row, height_m, white_var_m2 });
        }
        let ours = estimate::minus_two_log_likelihood(&lattice, &data, prior, nugget_m);
        (ours.expect("evaluated"), dense.minus_two_log_likelihood())
    };
    let prior = Prior { mean_sigma_m: 1.2, ..PRIOR };
    for (range_m, sigma_m, nugget_m) in [(2.0, 0.8, 0.1), (1.3, 0.4, 0.03), (2.9, 1.7, 0.3)] {
        let (ours, dense) = value(&Prior { range_m, sigma_m, ..prior }, nugget_m);
        assert!((ours - dense).abs() < 1e-6 * dense.abs().max(1.0), "{ours}, not {dense}");
    }
}

#[test]
fn whole_cells_count_with_the_mean_of_the_fitted_surface() {
    let grid = square_grid(8, 0.5);
    // A wall cuts the columns 0 to 3 from 4 to 7.
    let wall = |a: (f64, f64), b: (f64, f64)| (a.0 + 1.0) * (b.0 + 1.0) < 0.0;
    let lattice = Lattice::covering(&grid, 0.5, wall);
    let area_m2 = grid.cell_area_m2();
    let mut of_cells = vec![0.0; grid.n_cells()];
    let mean = |of_cells: &[f64], h: &dyn Fn(f64, f64) -> f64| {
        let w = lattice.spread_over_cells(&lattice.from_cells(of_cells));
        let total: f64 = w.iter().sum();
        let sum: f64 = (0..lattice.n_nodes())
            .map(|node| (w[node], lattice.place_m(node)))
            .map(|(w, (x, y))| w * h(x, y))
            .sum();
        (sum / total, total)
    };
    // In the midst: least squares put nodes c²/6 below x², and a cell's mean is x² + c²/12.
    of_cells[grid.index(2, 4)] = area_m2;
    let (x, y) = grid.centre_m(grid.index(2, 4));
    let (found, total) = mean(&of_cells, &|x, y| x * x + 2.0 * y * y - 3.0 * 0.25 / 6.0);
    let expected = x * x + 2.0 * y * y + 3.0 * 0.25 / 12.0;
    assert!((found - expected).abs() < 1e-12 && (total - area_m2).abs() < 1e-15, "{found}");
    // Beside the wall: planes stay exact, and nothing of the other side counts.
    of_cells.fill(0.0);
    of_cells[grid.index(3, 4)] = area_m2;
    let (x, y) = grid.centre_m(grid.index(3, 4));
    let far = |x: f64, y: f64| if x < -1.0 { 0.3 * x - 0.7 * y } else { 1e6 };
    let (found, _) = mean(&of_cells, &far);
    assert!((found - (0.3 * x - 0.7 * y)).abs() < 1e-12, "{found}");
}

#[test]
fn a_node_in_a_wall_serves_the_ground_before_it() {
    // A wall from x = −1.8 to −1.4 m holds the centre −1.75 m, whose cell from −2 to −1.5 m has 0.2 m
    // of ground before the wall.
    let grid = square_grid(6, 0.5);
    let (from, to) = (-1.8, -1.4);
    let separates = |a: (f64, f64), b: (f64, f64)| a.0.min(b.0) < to && a.0.max(b.0) > from;
    let beside = |p: (f64, f64)| if (from..to).contains(&p.0) { (from - 0.01, p.1) } else { p };
    let hidden = Lattice::covering(&grid, 0.5, separates);
    let serving = Lattice::covering_beside_walls(&grid, 0.5, beside, separates);
    let node = serving.node_of_cell(grid.index(2, 3));
    let weight = |lattice: &Lattice| {
        let row = lattice.row_at(-1.85, 3.25).expect("inside");
        let own = row.nodes.iter().position(|n| *n as usize == node).expect("a corner");
        row.weights[own]
    };
    assert!(weight(&hidden).abs() < 1e-15 && weight(&serving) > 0.5);
}
