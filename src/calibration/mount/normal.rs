//! Normal equations by spans of time, their solution, and how far it scatters.

use nalgebra::{DMatrix, DVector};

/// Spans of time of a flight, one left out at a time.
const N_BLOCKS: usize = 20;

/// Σ w a aᵀ and Σ w a z of some data.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    h: DMatrix<f64>,
    g: DVector<f64>,
}

impl Normal {
    fn new(n: usize) -> Self {
        Self { h: DMatrix::zeros(n, n), g: DVector::zeros(n) }
    }

    pub(super) fn add(&mut self, row: &DVector<f64>, target: f64, weight: f64) {
        self.h.ger(weight, row, row, 1.0);
        self.g.axpy(weight * target, row, 1.0);
    }

    fn join(&mut self, other: &Self) {
        self.h += &other.h;
        self.g += &other.g;
    }

    /// The equations of the first `n_free` unknowns, the others held at `x`.
    fn held(&self, x: &DVector<f64>, n_free: usize) -> Self {
        let n_held = x.len() - n_free;
        let known = self.h.view((0, n_free), (n_free, n_held)) * x.rows(n_free, n_held);
        Self {
            h: self.h.view((0, 0), (n_free, n_free)).into_owned(),
            g: self.g.rows(0, n_free) - known,
        }
    }

    /// x and the inverse of H with a prior about zero.
    fn solve(&self, prior_sigma: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut h = self.h.clone();
        for (k, sigma) in prior_sigma.iter().enumerate() {
            h[(k, k)] += sigma.max(1e-9).powi(-2);
        }
        let factor = h.cholesky()?;
        Some((factor.solve(&self.g), factor.inverse()))
    }
}

/// The data of a flight in spans of time.
#[derive(Debug, Clone)]
pub(super) struct Blocks {
    n_turns: usize,
    blocks: Vec<Normal>,
}

impl Blocks {
    pub(super) fn new(n: usize, n_turns: usize) -> Self {
        Self { n_turns, blocks: vec![Normal::new(n); N_BLOCKS] }
    }

    pub(super) fn of_turn(&mut self, turn_idx: usize) -> &mut Normal {
        let block = turn_idx * N_BLOCKS / self.n_turns.max(1);
        &mut self.blocks[block.min(N_BLOCKS - 1)]
    }

    fn sum(&self, is_in: impl Fn(usize) -> bool) -> Normal {
        let mut sum = Normal::new(self.blocks[0].g.len());
        let chosen = self.blocks.iter().enumerate().filter(|(block, _)| is_in(*block));
        chosen.for_each(|(_, block)| sum.join(block));
        sum
    }

    pub(super) fn solve(&self, prior_sigma: &[f64]) -> Option<DVector<f64>> {
        Some(self.sum(|_| true).solve(prior_sigma)?.0)
    }

    /// The standard deviation of each unknown: by the normal equations, or by leaving out one span after
    /// the other, whichever is larger.
    pub(super) fn sigma(&self, prior_sigma: &[f64], x: &DVector<f64>) -> Option<Vec<f64>> {
        let (_, cov) = self.sum(|_| true).solve(prior_sigma)?;
        let scatter = self.scatter_var(prior_sigma, x)?;
        Some((0..x.len()).map(|k| cov[(k, k)].max(scatter[k]).sqrt()).collect())
    }

    /// Delete-a-group jackknife: (B − 1)/B Σ (x₍ᵦ₎ − x)².
    #[expect(clippy::cast_precision_loss, reason = "twenty blocks")]
    fn scatter_var(&self, prior_sigma: &[f64], x: &DVector<f64>) -> Option<DVector<f64>> {
        let mut var = DVector::zeros(x.len());
        for left_out in 0..N_BLOCKS {
            let (without, _) = self.sum(|block| block != left_out).solve(prior_sigma)?;
            var += (without - x).map(|d| d * d);
        }
        Some(var * ((N_BLOCKS - 1) as f64 / N_BLOCKS as f64))
    }

    /// First half minus second half of the first `n_free` unknowns, over the standard deviation of that
    /// difference: twice the scatter of the whole. The others last for the whole flight and are held at
    /// `x`, for they are the same in both halves.
    pub(super) fn halves_z(
        &self,
        prior_sigma: &[f64],
        x: &DVector<f64>,
        n_free: usize,
    ) -> Option<Vec<f64>> {
        let held = Self {
            n_turns: self.n_turns,
            blocks: self.blocks.iter().map(|block| block.held(x, n_free)).collect(),
        };
        let prior_sigma = &prior_sigma[..n_free];
        let whole = held.solve(prior_sigma)?;
        let (first, cov_a) = held.sum(|block| block < N_BLOCKS / 2).solve(prior_sigma)?;
        let (second, cov_b) = held.sum(|block| block >= N_BLOCKS / 2).solve(prior_sigma)?;
        let scatter = held.scatter_var(prior_sigma, &whole)?;
        let z = |k: usize| {
            let var = (4.0 * scatter[k]).max(cov_a[(k, k)] + cov_b[(k, k)]);
            (first[k] - second[k]) / var.sqrt().max(1e-12)
        };
        Some((0..n_free).map(z).collect())
    }
}
