//! Conditions against the truncated normal's closed form, and against Gibbs sampling.

use super::*;
use crate::mapping::matern_field::{Lattice, Prior, Solver, solve};
use crate::messages::GridGeometry;
use crate::stats::{Noise, SeedBook};
use std::sync::Arc;

#[test]
fn the_hazard_matches_published_values_and_its_bounds() {
    // Abramowitz and Stegun 1964, table 26.1: φ and Φ at 0, 1 and −1.
    let phi = [0.398_942_28, 0.241_970_72, 0.241_970_72];
    for (z, density, below) in
        [(0.0, phi[0], 0.5), (1.0, phi[1], 0.841_344_75), (-1.0, phi[2], 0.158_655_25)]
    {
        assert!((hazard(z) - density / below).abs() < 1e-6, "z = {z}");
    }
    // For x = −z > 0: x < hazard < (x + √(x² + 4))/2 (Birnbaum 1942).
    for x in [1.0_f64, 5.0, 20.0, 24.99, 25.01, 60.0, 1e4] {
        let h = hazard(-x);
        assert!(x < h && h < 0.5 * (x + (x * x + 4.0).sqrt()) * (1.0 + 1e-12), "x = {x}: {h}");
    }
}

#[test]
fn a_single_condition_is_the_truncated_normal() {
    // N(2, 0.5²) below 1.8, edge sharp: α = −0.4, φ(α)/Φ(α) = 0.368270/0.344578 = 1.068757.
    let (mean_m, var_m2, ceiling_m) = (2.0, 0.25, 1.8);
    let none = Site { node: 0, info_per_m2: 0.0, info_height_per_m: 0.0 };
    let site = none.aim(mean_m, var_m2, ceiling_m, 0.0).expect("a variance is left");
    let info = 1.0 / var_m2 + site.info_per_m2;
    let mean = (mean_m / var_m2 + site.info_height_per_m) / info;
    assert!((mean - (2.0 - 0.5 * 1.068_757)).abs() < 1e-5, "{mean}");
    // Variance of the truncated normal: σ² (1 − α λ − λ²) with α = −0.4, λ = 1.068757.
    let var = 0.25 * (1.0 + 0.4 * 1.068_757 - 1.068_757_f64.powi(2));
    assert!((1.0 / info - var).abs() < 1e-5, "{} {var}", 1.0 / info);
    // Once there, the site stays: the cavity is the same.
    let again = site.aim(mean, 1.0 / info, ceiling_m, 0.0).expect("a variance is left");
    assert!((again.info_per_m2 - site.info_per_m2).abs() < 1e-9);
    // A ceiling far above says nothing.
    let free = none.aim(mean_m, var_m2, 12.0, 0.02).expect("a variance is left");
    assert!(free.info_per_m2 < 1e-9);
}

/// A field of 9 × 6 nodes, seen on both sides of a valley, with a ceiling over it.
struct Valley {
    lattice: Arc<Lattice>,
    information: Information,
    /// Height and softness, m.
    ceilings: Vec<Option<(f64, f64)>>,
}

const PRIOR: Prior = Prior { range_m: 4.0, sigma_m: 0.8, mean_m: 1.5, mean_sigma_m: 0.0 };
/// In turns: under rays, and between them.
const SOFTNESS_M: [f64; 2] = [0.03, 0.12];

impl Valley {
    fn new() -> Self {
        let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 7, n_rows: 4 };
        let lattice = Arc::new(Lattice::covering(&grid, 0.5, |_, _| false));
        let mut information = Information::new(&lattice);
        let mut ceilings = vec![None; lattice.n_nodes()];
        for (node, ceiling) in ceilings.iter_mut().enumerate() {
            let (x_m, y_m) = lattice.place_m(node);
            if (0.5..3.0).contains(&x_m) {
                // The ray from the crest at x = 0.25, 2.2 m high, to the hit at 3.25, 1.3 m high.
                *ceiling = Some((2.2 - 0.3 * (x_m - 0.25), SOFTNESS_M[node % 2]));
            } else if let Some(row) = lattice.row_at(x_m, y_m) {
                let height_m = if x_m < 1.0 { 2.2 } else { 1.3 };
                information.add(&row, height_m, 1.0 / 0.02_f64.powi(2));
            }
        }
        Self { lattice, information, ceilings }
    }

    /// Mean and variance by the conditions, and the conditions.
    fn by_conditions(&self) -> (Vec<f64>, Vec<f64>, HiddenGround) {
        let mut hidden = HiddenGround::default();
        for _ in 0..60 {
            let mut info = self.information.clone();
            hidden.add_to(&mut info);
            let solution =
                solve(&self.lattice, &PRIOR, &info, Solver::Direct, None).expect("solved");
            let var_m2 = solution.marginal_var_m2().expect("exact");
            let (next, step) =
                hidden.renewed(solution.height_m(), &var_m2, |node| self.ceilings[node]);
            if step < 1e-6 {
                return (solution.height_m().to_vec(), var_m2, hidden);
            }
            hidden = next;
        }
        panic!("not settled");
    }

    /// The precision without conditions by its definition, columns from unit loads.
    fn precision(&self) -> nalgebra::DMatrix<f64> {
        let solution =
            solve(&self.lattice, &PRIOR, &self.information, Solver::Direct, None).expect("solved");
        let n = self.lattice.n_nodes();
        let column = |k: usize| {
            let mut unit = vec![0.0; n];
            unit[k] = 1.0;
            nalgebra::DVector::from_vec(solution.adjoint(&unit, None).expect("solved").q)
        };
        let columns: Vec<_> = (0..n).map(column).collect();
        nalgebra::DMatrix::from_columns(&columns).try_inverse().expect("regular")
    }
}

/// A draw of N(mean, σ²) weighted by Φ((u − h)/s), by rejection: h passes if it is below u + s ε.
fn draw_below(noise: &mut Noise, mean_m: f64, sigma_m: f64, (u_m, s_m): (f64, f64)) -> f64 {
    loop {
        let h = mean_m + sigma_m * noise.normal();
        if h < u_m + s_m * noise.normal() {
            return h;
        }
    }
}

#[test]
fn conditions_match_gibbs_sampling() {
    let valley = Valley::new();
    let (mean_m, var_m2, hidden) = valley.by_conditions();
    let n = valley.lattice.n_nodes();
    let precision = valley.precision();
    let plain = solve(&valley.lattice, &PRIOR, &valley.information, Solver::Direct, None)
        .expect("solved")
        .height_m()
        .to_vec();
    let mut noise = SeedBook::new(11).stream("gibbs");
    let mut h = mean_m.clone();
    let w: Vec<f64> = valley.ceilings.iter().map(|c| f64::from(u8::from(c.is_some()))).collect();
    let (mut sum, mut sum_v, mut sum_vv) = (vec![0.0; n], 0.0, 0.0);
    let n_sweeps = 60_000;
    for _ in 0..n_sweeps {
        for i in 0..n {
            // Given the others: mean = plain_i − Σ_{j≠i} P_ij (h_j − plain_j)/P_ii.
            let pull: f64 =
                (0..n).filter(|j| *j != i).map(|j| precision[(i, j)] * (h[j] - plain[j])).sum();
            let m = plain[i] - pull / precision[(i, i)];
            let sigma = precision[(i, i)].recip().sqrt();
            h[i] = match valley.ceilings[i] {
                Some(ceiling) => draw_below(&mut noise, m, sigma, ceiling),
                None => m + sigma * noise.normal(),
            };
        }
        sum.iter_mut().zip(&h).for_each(|(s, h)| *s += h);
        let v: f64 = std::iter::zip(&w, &h).map(|(w, h)| w * h).sum();
        sum_v += v;
        sum_vv += v * v;
    }
    let n_sweeps = f64::from(n_sweeps);
    let mut deepest_m = 0.0_f64;
    for node in (0..n).filter(|node| valley.ceilings[*node].is_some()) {
        let sampled = sum[node] / n_sweeps;
        let sigma = var_m2[node].sqrt();
        // The chain's own error is about 0.02 σ; expectation propagation is not exact.
        assert!(
            (mean_m[node] - sampled).abs() < 0.06 * sigma,
            "{node}: {} {sampled}",
            mean_m[node]
        );
        deepest_m = deepest_m.max(plain[node] - sampled);
    }
    assert!(deepest_m > 0.2, "the conditions do nothing here: {deepest_m}");
    // And the variance of the sum, which the budget is after.
    let var_sampled = sum_vv / n_sweeps - (sum_v / n_sweeps).powi(2);
    let mut info = valley.information.clone();
    hidden.add_to(&mut info);
    let solution = solve(&valley.lattice, &PRIOR, &info, Solver::Direct, None).expect("solved");
    let adjoint = solution.adjoint(&w, None).expect("solved");
    let ratio = adjoint.var / var_sampled;
    // Expectation propagation is known to be a little too sure where conditions overlap.
    assert!((0.8..1.1).contains(&ratio), "{ratio}");
    // Its account adds up: prior, hits, conditions.
    let hits = adjoint.var - adjoint.prior_var - hidden.var_m6(&adjoint.q);
    assert!(hits > 0.0 && hits < 0.5 * adjoint.var, "{hits} of {}", adjoint.var);
}

#[test]
fn conditions_follow_what_is_hidden() {
    let valley = Valley::new();
    let (_, _, hidden) = valley.by_conditions();
    assert!(!hidden.sites.is_empty());
    let left = valley.lattice.size().0 / 2;
    let kept = hidden.among(|node| node % valley.lattice.size().0 < left);
    assert!(!kept.sites.is_empty() && kept.sites.len() < hidden.sites.len());
    // Seen now: its condition goes.
    let (mean_m, var_m2) = (vec![1.0; 54], vec![0.1; 54]);
    assert_eq!(hidden.renewed(&mean_m, &var_m2, |_| None), (HiddenGround::default(), 0.0));
    // Nothing to be known.
    let broken = vec![f64::NAN; 54];
    let (none, step) = hidden.renewed(&broken, &var_m2, |node| valley.ceilings[node]);
    assert_eq!((none, step), (HiddenGround::default(), 0.0));
}
