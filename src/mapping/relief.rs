//! How much the ground rises and falls, beside what the configured σ expects, by what is seen of it.
//!
//! Heaps at the angle of repose are much smoother than a field of the configured σ and range, weathered ground is not. What is
//! hidden can only be guessed from what is seen, so the guess and its σ should be those of such ground. Every seen node is
//! predicted from eight nodes around it, a metre away, and how far that misses, in its own σ, says so:
//!
//! ```text
//! ĥ = Σ_k λ_k h_k,    v = σ² (1 − Σ_k λ_k r_k − μ),    R λ + μ 1 = r,  Σ_k λ_k = 1      (ordinary kriging)
//! a² = (n₀ + H² Σ (h − ĥ)²/v / m)/(n₀ + n/m)
//! ```
//! - `R`, `r`: Matérn correlation among the eight, and with the middle; `σ`: configured, m
//! - `n`: nodes that are predicted, `m`: how many of them tell the same; `n₀`: what the configured σ counts for
//! - `H`: ground is hidden behind crests, and is rougher than what is seen: `HIDDEN_TO_SEEN`
//!
//! A floor that is bare over large parts tells of no heap, and a cut face may be steeper than all that is seen: `a` has a
//! least value (`LEAST`).
//! Source: ordinary kriging, Cressie 1993, §3.2. Checked: `drawn_fields_have_the_ratio_of_their_sigma`,
//! `ground_beyond_a_wall_does_not_count`, `bare_floor_and_what_is_no_number_do_not_make_it_sure`; in whole by campaigns of the
//! simulator.

use super::matern_field::{Lattice, Prior};
use super::matern_kernel::matern_of;
use nalgebra::{SMatrix, SVector};

/// H: σ of hidden ground over that of seen ground.
///
/// Chosen so that on simulated alps, halls and heaps, surveys that leave ground hidden are off by about their σ.
const HIDDEN_TO_SEEN: f64 = 1.5;
/// Bounds of the ratio: a little more than smooth heaps have, for what is hidden may be a steeper face than any that is seen, and what no ground that was looked at exceeds.
const LEAST: f64 = 0.5;
const MOST: f64 = 1.5;
/// The ratio is told in steps: what follows from a prior is prepared for each.
const STEP: f64 = 0.05;
/// Distance of the nodes that predict, m.
const AROUND_M: f64 = 1.0;
/// `n₀`.
const CONFIGURED_COUNTS: f64 = 20.0;
/// The eight around a node, in units of their distance along the axes.
const AROUND: [[i32; 2]; 8] =
    [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

/// The ratio `a` of these heights, where they are known, between `LEAST` and `MOST`: 1 where nothing is.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "far less than 2^53 nodes")]
pub fn relief_ratio(lattice: &Lattice, prior: &Prior, heights_m: &[f64], is_known: &[bool]) -> f64 {
    let n_steps = steps(lattice.spacing_m());
    let Some((weights, var_m2)) = prediction(prior, n_steps as f64 * lattice.spacing_m()) else {
        return 1.0;
    };
    let (n_cols, n_rows) = lattice.size();
    let gaps = Gaps::new(lattice, is_known);
    let (mut sum, mut n) = (0.0, 0_u32);
    for row in n_steps..n_rows.saturating_sub(n_steps) {
        for col in n_steps..n_cols.saturating_sub(n_steps) {
            if !gaps.is_whole((col - n_steps, row - n_steps), 2 * n_steps + 1) {
                continue;
            }
            let height_m = |[x, y]: [i32; 2]| {
                let at = |middle: usize, by: i32| match by {
                    1 => middle + n_steps,
                    -1 => middle - n_steps,
                    _ => middle,
                };
                heights_m[at(row, y) * n_cols + at(col, x)]
            };
            let predicted_m: f64 = std::iter::zip(AROUND, weights)
                .map(|(place, weight)| weight * height_m(place))
                .sum();
            sum += (height_m([0, 0]) - predicted_m).powi(2) / var_m2;
            n += 1;
        }
    }
    let alike = (n_steps * n_steps) as f64;
    let sum = HIDDEN_TO_SEEN.powi(2) * sum;
    let ratio =
        ((CONFIGURED_COUNTS + sum / alike) / (CONFIGURED_COUNTS + f64::from(n) / alike)).sqrt();
    // Not `clamp` alone: what is no number must not look like smooth ground.
    if ratio.is_finite() { ((ratio / STEP).round() * STEP).clamp(LEAST, MOST) } else { MOST }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a few steps; a float cast to an integer saturates"
)]
fn steps(spacing_m: f64) -> usize {
    (AROUND_M / spacing_m).round().max(1.0) as usize
}

/// λ and v for nodes at this distance; `None` for a prior without a variance.
fn prediction(prior: &Prior, distance_m: f64) -> Option<([f64; 8], f64)> {
    let correlation = |a: [i32; 2], b: [i32; 2]| {
        let apart = f64::from(a[0] - b[0]).hypot(f64::from(a[1] - b[1]));
        matern_of(1.0, prior.kappa_per_m() * apart * distance_m)
    };
    // The last row and column have the weights add up to one.
    let is_sum = |k: usize| k == AROUND.len();
    let system = SMatrix::<f64, 9, 9>::from_fn(|i, j| match (is_sum(i), is_sum(j)) {
        (true, true) => 0.0,
        (false, false) => correlation(AROUND[i], AROUND[j]),
        _ => 1.0,
    });
    let right =
        SVector::<f64, 9>::from_fn(
            |i, _| {
                if is_sum(i) { 1.0 } else { correlation(AROUND[i], [0, 0]) }
            },
        );
    let solved = system.lu().solve(&right)?;
    let var_m2 = prior.sigma_m.powi(2) * (1.0 - solved.dot(&right));
    (var_m2 > 0.0).then(|| (std::array::from_fn(|k| solved[k]), var_m2))
}

/// How many nodes are unknown, or without a bond to a neighbour, in any rectangle.
struct Gaps {
    /// Counts of the rectangle from the first node up to here, one row and one column more than nodes.
    up_to: Vec<u32>,
    n_cols: usize,
}

impl Gaps {
    fn new(lattice: &Lattice, is_known: &[bool]) -> Self {
        let (n_cols, n_rows) = lattice.size();
        let mut up_to = vec![0; (n_cols + 1) * (n_rows + 1)];
        for row in 0..n_rows {
            let mut in_row = 0;
            for col in 0..n_cols {
                let node = row * n_cols + col;
                let is_gap = !is_known[node] || lattice.joined(node).count() < 4;
                in_row += u32::from(is_gap);
                up_to[(row + 1) * (n_cols + 1) + col + 1] =
                    up_to[row * (n_cols + 1) + col + 1] + in_row;
            }
        }
        Self { up_to, n_cols }
    }

    /// True if a square of nodes from this one on has none.
    fn is_whole(&self, (col, row): (usize, usize), width: usize) -> bool {
        let up_to = |col: usize, row: usize| self.up_to[row * (self.n_cols + 1) + col];
        let (end_col, end_row) = (col + width, row + width);
        up_to(end_col, end_row) + up_to(col, row) == up_to(end_col, row) + up_to(col, end_row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::matern_field::{Information, Solver, solve};
    use crate::messages::GridGeometry;
    use crate::stats::SeedBook;
    use std::sync::Arc;

    const PRIOR: Prior = Prior { range_m: 5.0, sigma_m: 1.0, mean_m: 1.5, mean_sigma_m: 0.0 };

    fn lattice(separates: impl Fn((f64, f64), (f64, f64)) -> bool) -> Lattice {
        let grid =
            GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 80, n_rows: 60 };
        Lattice::covering(&grid, 0.0, separates)
    }

    #[test]
    fn drawn_fields_have_the_ratio_of_their_sigma() {
        for (seed, ratio) in [(1, 0.45), (2, 0.7), (3, 0.9)] {
            let lattice = Arc::new(lattice(|_, _| false));
            let n = lattice.n_nodes();
            let drawn_of = Prior { sigma_m: ratio, ..PRIOR };
            let nothing = Information::new(&lattice);
            let solution =
                solve(&lattice, &drawn_of, &nothing, Solver::Direct, None).expect("solved");
            let mut noise = SeedBook::new(seed).stream("relief");
            let heights_m = solution.sample_m(&mut noise).expect("drawn");
            // The configured σ has its say; one node of sixteen tells by itself, so a few hundred: known within 5 to 7 %.
            let is = |found: f64, n_predicted: f64| {
                let n = n_predicted / 16.0;
                let expected = ((20.0 + 2.25 * n * ratio * ratio) / (20.0 + n)).sqrt();
                let off = (found - expected).abs();
                assert!(off < 0.15 * expected + 0.025, "seed {seed}: {found}, {expected}");
            };
            is(relief_ratio(&lattice, &PRIOR, &heights_m, &vec![true; n]), 72.0 * 52.0);
            let half: Vec<bool> = (0..n).map(|node| lattice.place_m(node).0 < 10.0).collect();
            is(relief_ratio(&lattice, &PRIOR, &heights_m, &half), 32.0 * 52.0);
            let of_none = relief_ratio(&lattice, &PRIOR, &heights_m, &vec![false; n]);
            assert!((of_none - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn ground_beyond_a_wall_does_not_count() {
        // Level ground on both sides of a wall at x = 10 m, 3 m higher on one.
        let heights_of = |lattice: &Lattice| -> Vec<f64> {
            let at = |node: usize| if lattice.place_m(node).0 < 10.0 { 0.0 } else { 3.0 };
            (0..lattice.n_nodes()).map(at).collect()
        };
        let parted = lattice(|a, b| (a.0 < 10.0) != (b.0 < 10.0));
        let known = vec![true; parted.n_nodes()];
        let level = relief_ratio(&parted, &PRIOR, &heights_of(&parted), &known);
        let open = lattice(|_, _| false);
        let with_a_step = relief_ratio(&open, &PRIOR, &heights_of(&open), &known);
        assert!(level < 0.51 && with_a_step > 0.6, "{level} {with_a_step}");
    }

    #[test]
    fn bare_floor_and_what_is_no_number_do_not_make_it_sure() {
        let lattice = lattice(|_, _| false);
        let known = vec![true; lattice.n_nodes()];
        let of = |height_m: f64| {
            relief_ratio(&lattice, &PRIOR, &vec![height_m; lattice.n_nodes()], &known)
        };
        assert!((of(0.2) - LEAST).abs() < 1e-12);
        assert!((of(f64::NAN) - MOST).abs() < 1e-12);
    }
}
