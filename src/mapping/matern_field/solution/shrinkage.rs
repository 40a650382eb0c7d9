//! The prior's share of a variance, as the data show it.
//!
//! The estimate of Σ w h is off by what the prior pulls it: `−qᵀ Q0 x = −s (K q)ᵀ (K x)`. Before any data
//! K x is white, so the variance is `s |K q|²`, the prior's share of the adjoint. But data tell how rough the ground
//! really is, place by place: a floor hardly bends, a crest does. So K x is taken as the data leave it, and only from
//! block to block it is still taken as independent,
//!
//! ```text
//! Σ_b E[(a_bᵀ x)² | data],   a_b = s Kᵀ (K q on the nodes of block b)
//!   = Σ_b (a_bᵀ x̂)² + a_bᵀ Cov(x | data) a_b
//! ```
//! Where nothing was seen this is the prior's share; averaged over all fields of the prior it is that too,
//! whatever was seen. Blocks must be so large that the bends of one landform fall into one: half a practical range.
//! Source: the cluster-robust variance of Liang and Zeger 1986, with the posterior's expectation for
//! the residuals' squares.
//! Checked: `without_data_it_is_the_priors_share`, `over_fields_of_the_prior_it_is_the_priors_share`,
//! `smooth_ground_pulls_less`.

use super::{Adjoint, FieldError, Level, Method, Solution, dot};

/// Blocks with less of the prior's share than this keep it as it is.
const LEAST_SHARE: f64 = 1e-3;

impl Solution {
    /// The prior's share of an adjoint's variance as the data show it; what [`Adjoint::prior_var`] says
    /// for an iterative solution, which has no factor for the many solves.
    ///
    /// # Errors
    /// [`FieldError`] from a solve.
    pub fn shown_prior_var(&self, adjoint: &Adjoint) -> Result<f64, FieldError> {
        if matches!(self.system.method, Method::Iterative { .. }) {
            return Ok(adjoint.prior_var);
        }
        let scale = self.system.operator.scale;
        let (bent, of_level) = self.bent(&adjoint.q);
        let blocks = self.blocks();
        let n_blocks = blocks.iter().max().map_or(0, |last| last + 1);
        let mut own = vec![0.0; n_blocks];
        for (block, bend) in std::iter::zip(&blocks, &bent) {
            own[*block] += scale * bend * bend;
        }
        let least = LEAST_SHARE * own.iter().sum::<f64>();
        let mut var = of_level;
        for (block, own) in own.into_iter().enumerate() {
            var += if own > least { self.expected_pull(&bent, &blocks, block)? } else { own };
        }
        Ok(var)
    }

    /// K qₓ, and the level's part of the prior's share.
    fn bent(&self, q: &[f64]) -> (Vec<f64>, f64) {
        let operator = &self.system.operator;
        match &self.system.level {
            None => (operator.half(&self.lattice, q), 0.0),
            Some(Level { g, c, prior_info }) => {
                let q_level = c * dot(g, q);
                let q_field: Vec<f64> = q.iter().map(|q| q - q_level).collect();
                (operator.half(&self.lattice, &q_field), q_level * q_level * prior_info)
            }
        }
    }

    /// E[(a_bᵀ x)² | data] of one block.
    fn expected_pull(
        &self,
        bent: &[f64],
        blocks: &[usize],
        block: usize,
    ) -> Result<f64, FieldError> {
        let of_block =
            std::iter::zip(bent, blocks).map(|(b, of)| if *of == block { *b } else { 0.0 });
        let operator = &self.system.operator;
        let mut a = operator.half(&self.lattice, &of_block.collect::<Vec<_>>());
        a.iter_mut().for_each(|a| *a *= operator.scale);
        // x = h − mean − β 1, and β given h is c gᵀ(h − mean) with variance c.
        let mut of_level = 0.0;
        if let Some(Level { g, c, .. }) = &self.system.level {
            let sum: f64 = a.iter().sum();
            a.iter_mut().zip(g).for_each(|(a, g)| *a -= sum * c * g);
            of_level = sum * sum * c;
        }
        let mean_m = self.prior.mean_m;
        let pull: f64 = std::iter::zip(&a, &self.height_m).map(|(a, h)| a * (h - mean_m)).sum();
        let (cov_a, _) = self.system.solve(&a, None)?;
        Ok(pull * pull + dot(&a, &cov_a) + of_level)
    }

    /// The block of every node: squares of half a practical range.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few nodes, and positive"
    )]
    fn blocks(&self) -> Vec<usize> {
        let (n_cols, _) = self.lattice.size();
        let edge = (0.5 * self.prior.range_m / self.lattice.spacing_m()).round().max(1.0) as usize;
        let n_across = n_cols.div_ceil(edge);
        (0..self.lattice.n_nodes())
            .map(|node| (node / n_cols / edge) * n_across + node % n_cols / edge)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::{Information, Lattice, Prior, Solver, solve};
    use super::*;
    use crate::messages::GridGeometry;
    use crate::stats::SeedBook;
    use std::sync::Arc;

    const PRIOR: Prior = Prior { range_m: 2.0, sigma_m: 0.8, mean_m: 1.3, mean_sigma_m: 0.7 };

    fn lattice() -> Arc<Lattice> {
        let grid =
            GridGeometry { x_min_m: -1.0, y_min_m: 2.0, cell_m: 0.25, n_cols: 16, n_rows: 12 };
        Arc::new(Lattice::covering(&grid, 0.75, |_, _| false))
    }

    fn areas_m2(lattice: &Lattice) -> Vec<f64> {
        lattice.from_cells(&vec![0.0625; lattice.grid().n_cells()])
    }

    /// Hits of a surface at every third node of the left two thirds.
    fn seen(lattice: &Lattice, height_m: impl Fn(usize) -> f64) -> Information {
        let mut info = Information::new(lattice);
        for node in (0..lattice.n_nodes()).step_by(3) {
            let (x_m, y_m) = lattice.place_m(node);
            if x_m < 1.7
                && let Some(row) = lattice.row_at(x_m, y_m)
            {
                info.add(&row, height_m(node), 1e4);
            }
        }
        info
    }

    fn solved(lattice: &Arc<Lattice>, info: &Information) -> (Solution, Adjoint) {
        let solution = solve(lattice, &PRIOR, info, Solver::Direct, None).expect("solved");
        let adjoint = solution.adjoint(&areas_m2(lattice), None).expect("solved");
        (solution, adjoint)
    }

    #[test]
    fn without_data_it_is_the_priors_share() {
        let lattice = lattice();
        let (solution, adjoint) = solved(&lattice, &Information::new(&lattice));
        let shown = solution.shown_prior_var(&adjoint).expect("solved");
        assert!((shown / adjoint.prior_var - 1.0).abs() < 1e-9, "{shown} {}", adjoint.prior_var);
    }

    #[test]
    fn over_fields_of_the_prior_it_is_the_priors_share() {
        let lattice = lattice();
        let (nothing, _) = solved(&lattice, &Information::new(&lattice));
        let mut noise = SeedBook::new(4).stream("fields");
        let (n, mut sum, mut sum_squares, mut share) = (400, 0.0, 0.0, 0.0);
        for _ in 0..n {
            let truth = nothing.sample_m(&mut noise).expect("a factor");
            let errors: Vec<f64> = truth.iter().map(|_| 0.01 * noise.normal()).collect();
            let (solution, adjoint) = solved(&lattice, &seen(&lattice, |k| truth[k] + errors[k]));
            let shown = solution.shown_prior_var(&adjoint).expect("solved");
            sum += shown;
            sum_squares += shown * shown;
            share = adjoint.prior_var;
        }
        let n = f64::from(n);
        let (mean, scatter) = (sum / n, (sum_squares / n - (sum / n).powi(2)).sqrt());
        // Four standard errors of the mean.
        assert!((mean - share).abs() < 4.0 * scatter / n.sqrt(), "{mean} {share} ± {scatter}");
        assert!(scatter > 1e-3 * share, "the data show nothing");
    }

    #[test]
    fn smooth_ground_pulls_less() {
        let lattice = lattice();
        // A heap like a cosine, 3 m wide, seen everywhere.
        let height_m = |node: usize| {
            let (x, y) = lattice.place_m(node);
            1.0 + 0.4 * (1.0 + (1.05 * (x - 0.6)).cos() * (1.05 * (y - 3.5)).cos())
        };
        let mut info = Information::new(&lattice);
        for node in 0..lattice.n_nodes() {
            let (x_m, y_m) = lattice.place_m(node);
            if let Some(row) = lattice.row_at(x_m, y_m) {
                info.add(&row, height_m(node), 1e4);
            }
        }
        let (solution, adjoint) = solved(&lattice, &info);
        let shown = solution.shown_prior_var(&adjoint).expect("solved");
        assert!(shown < 0.5 * adjoint.prior_var, "{shown} {}", adjoint.prior_var);
        // The pull itself, from the truth: w(h − ĥ) without noise in the data.
        let w = areas_m2(&lattice);
        let truth: f64 = w.iter().enumerate().map(|(node, w)| w * height_m(node)).sum();
        let off = dot(&w, solution.height_m()) - truth;
        assert!(off * off < 9.0 * shown, "{off} against {}", shown.sqrt());
    }
}
