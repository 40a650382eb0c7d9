//! The prior's numbers from the data, by marginal likelihood.
//!
//! ```text
//! −2 ln p(z) = Σ ln R + Σ (z − mean)²/R − bᵀ Q_h⁻¹ b + ln det Q − ln det Q0 + ln(s σ_β²) + const
//! ```
//! with R = `R_white` + nugget² and Q, Q0, s, b of the module page. Both determinants come with the
//! factors; Q0's from K, det Q0 = sⁿ det² K with s the operator's scale.

use super::FieldError;
use super::information::Information;
use super::lattice::{EAST, Lattice, NORTH, Row};
use super::prior::{Operator, Prior};
use super::{Solver, solve};
use crate::mapping::sparse_cholesky::{Analysis, CholeskyError};
use std::sync::Arc;

/// A single height for the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Datum {
    /// Where it was measured.
    pub row: Row,
    /// Height over the hall floor, m.
    pub height_m: f64,
    /// Variance of its own independent error, without roughness, m².
    pub white_var_m2: f64,
}

/// What the data say about the prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PriorEstimate {
    /// Practical range ρ, m.
    pub range_m: f64,
    /// Standard deviation of the surface around its level, m.
    pub sigma_m: f64,
    /// Standard deviation of the roughness below the size of a cell, m.
    pub nugget_m: f64,
    /// ln p(z) there, up to a constant.
    pub log_likelihood: f64,
}

/// Most evaluations of the likelihood.
const N_EVALUATIONS: usize = 60;
/// The search ends when the corners' −2 ln p differ by less than this; a parameter off by its own
/// standard error changes it by 1.
const ENOUGH: f64 = 0.02;

/// Estimates ρ, σ and the nugget by marginal likelihood, starting from `prior` and `nugget_m`.
///
/// The lattice must be as fine as the map that will use the numbers: what a coarser one cannot
/// follow counts as nugget. A part of the map, or some thousand hits of it, is enough, because the
/// time goes with the nodes: two sparse factors an evaluation, 60 evaluations at most. ρ stays
/// between two cells and the lattice's extent, σ between 1 mm and 100 m, the nugget between
/// 0.1 mm and 10 m.
///
/// Source: Nelder and Mead 1965 for the search, over the logarithms.
///
/// # Errors
/// A prior that is none; factors that do not fit into memory.
pub fn estimate_prior(
    lattice: &Arc<Lattice>,
    data: &[Datum],
    prior: &Prior,
    nugget_m: f64,
) -> Result<PriorEstimate, FieldError> {
    prior.check()?;
    let likelihood = Likelihood::new(lattice, data, prior)?;
    let start = [prior.range_m.ln(), prior.sigma_m.ln(), nugget_m.max(1e-4).ln()];
    let (best, value) = minimise(|p| likelihood.minus_two_log(p), start)?;
    let [range_m, sigma_m, nugget_m] = likelihood.bounded(best);
    Ok(PriorEstimate { range_m, sigma_m, nugget_m, log_likelihood: -0.5 * value })
}

struct Likelihood<'a> {
    lattice: &'a Arc<Lattice>,
    data: &'a [Datum],
    prior: &'a Prior,
    /// Pattern of K.
    analysis: Arc<Analysis>,
}

impl<'a> Likelihood<'a> {
    fn new(
        lattice: &'a Arc<Lattice>,
        data: &'a [Datum],
        prior: &'a Prior,
    ) -> Result<Self, FieldError> {
        let too_large = || CholeskyError::TooLarge { size: lattice.n_nodes() };
        let (mut starts, mut rows) = (vec![0], Vec::new());
        let n_cols = lattice.size().0;
        for (node, links) in lattice.links().iter().enumerate() {
            let ahead = [(0, true), (1, links & EAST != 0), (n_cols, links & NORTH != 0)];
            for (offset, _) in ahead.into_iter().filter(|(_, is_there)| *is_there) {
                rows.push(u32::try_from(node + offset).map_err(|_| too_large())?);
            }
            starts.push(u32::try_from(rows.len()).map_err(|_| too_large())?);
        }
        let analysis = Arc::new(Analysis::new(lattice.n_nodes(), &starts, &rows)?);
        Ok(Self { lattice, data, prior, analysis })
    }

    /// Range, σ and nugget, m, within their bounds.
    #[expect(clippy::cast_precision_loss, reason = "node counts stay far below 2^53")]
    fn bounded(&self, [range, sigma, nugget]: [f64; 3]) -> [f64; 3] {
        let (n_cols, n_rows) = self.lattice.size();
        let spacing_m = self.lattice.spacing_m();
        let extent_m = spacing_m * n_cols.max(n_rows) as f64;
        [
            range.exp().clamp(2.0 * spacing_m, extent_m.max(2.0 * spacing_m)),
            sigma.exp().clamp(1e-3, 100.0),
            nugget.exp().clamp(1e-4, 10.0),
        ]
    }

    fn minus_two_log(&self, parameters: [f64; 3]) -> Result<f64, FieldError> {
        let [range_m, sigma_m, nugget_m] = self.bounded(parameters);
        let prior = Prior { range_m, sigma_m, ..*self.prior };
        let mut information = Information::new(self.lattice);
        let mut of_data = 0.0;
        for Datum { row, height_m, white_var_m2 } in self.data {
            let var_m2 = white_var_m2 + nugget_m * nugget_m;
            if information.add(row, *height_m, 1.0 / var_m2) {
                of_data += var_m2.ln() + (height_m - prior.mean_m).powi(2) / var_m2;
            }
        }
        let solution = solve(self.lattice, &prior, &information, Solver::Direct, None)?;
        let explained: f64 =
            std::iter::zip(information.innovations(prior.mean_m), solution.height_m())
                .map(|(b, h)| b * (h - prior.mean_m))
                .sum();
        let posterior = solution.log_det().ok_or(FieldError::NoFactor)?;
        Ok(of_data - explained + posterior - self.prior_log_det(&prior)?)
    }

    /// ln det Q0.
    #[expect(clippy::cast_precision_loss, reason = "node counts stay far below 2^53")]
    fn prior_log_det(&self, prior: &Prior) -> Result<f64, FieldError> {
        let operator = Operator::new(self.lattice, prior);
        let mut lower = Vec::with_capacity(3 * self.lattice.n_nodes());
        for (links, diagonal) in self.lattice.links().iter().zip(&operator.diagonal) {
            lower.push(*diagonal);
            lower.extend([EAST, NORTH].iter().filter(|way| links & **way != 0).map(|_| -1.0));
        }
        let k = self.analysis.factorize(&lower)?.log_det();
        Ok(self.lattice.n_nodes() as f64 * operator.scale.ln() + 2.0 * k)
    }
}

/// −2 ln p(z) for numbers inside of the bounds; for tests.
#[cfg(test)]
pub(super) fn minus_two_log_likelihood(
    lattice: &Arc<Lattice>,
    data: &[Datum],
    prior: &Prior,
    nugget_m: f64,
) -> Result<f64, FieldError> {
    let parameters = [prior.range_m, prior.sigma_m, nugget_m].map(f64::ln);
    Likelihood::new(lattice, data, prior)?.minus_two_log(parameters)
}

type Point = [f64; 3];

/// The simplex search of Nelder and Mead; steps of a factor 1.6 at first.
fn minimise(
    f: impl Fn(Point) -> Result<f64, FieldError>,
    start: Point,
) -> Result<(Point, f64), FieldError> {
    let mut corners = vec![(start, f(start)?)];
    for axis in 0..3 {
        let mut corner = start;
        corner[axis] += 0.47;
        corners.push((corner, f(corner)?));
    }
    let mut n_evaluations = 4;
    while n_evaluations < N_EVALUATIONS {
        corners.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (best, second_worst, worst) = (corners[0].1, corners[2].1, corners[3]);
        if worst.1 - best < ENOUGH {
            break;
        }
        let centre: Point =
            std::array::from_fn(|axis| corners[..3].iter().map(|c| c.0[axis]).sum::<f64>() / 3.0);
        let along = |t: f64| -> Point {
            std::array::from_fn(|axis| centre[axis] + t * (worst.0[axis] - centre[axis]))
        };
        let mut try_at = |t: f64| -> Result<(Point, f64), FieldError> {
            n_evaluations += 1;
            Ok((along(t), f(along(t))?))
        };
        let reflected = try_at(-1.0)?;
        corners[3] = if reflected.1 < best {
            let expanded = try_at(-2.0)?;
            if expanded.1 < reflected.1 { expanded } else { reflected }
        } else if reflected.1 < second_worst {
            reflected
        } else {
            let contracted = try_at(if reflected.1 < worst.1 { -0.5 } else { 0.5 })?;
            if contracted.1 < worst.1.min(reflected.1) {
                contracted
            } else {
                let best = corners[0].0;
                for corner in &mut corners[1..] {
                    corner.0 = std::array::from_fn(|axis| 0.5 * (best[axis] + corner.0[axis]));
                    corner.1 = f(corner.0)?;
                }
                n_evaluations += 3;
                continue;
            }
        };
    }
    corners.sort_by(|a, b| a.1.total_cmp(&b.1));
    Ok(corners[0])
}
