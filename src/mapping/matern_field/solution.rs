//! The posterior: heights, adjoints, variances, draws.

use super::information::Information;
use super::iterative::{Stop, conjugate_gradients, dot};
use super::lattice::Lattice;
use super::multigrid::Multigrid;
use super::prepared_prior::PreparedPrior;
use super::prior::{Operator, Prior};
use super::stencil::Stencil;
use super::{FieldError, Solver};
use crate::mapping::sparse_cholesky::Factor;
use crate::stats::Noise;
use std::sync::Arc;

/// The field given the data.
#[derive(Debug)]
pub struct Solution {
    lattice: Arc<Lattice>,
    prior: Prior,
    system: System,
    height_m: Vec<f64>,
    /// What the solve left of the right-hand side, 1/m.
    residual: Vec<f64>,
    n_steps: usize,
}

/// The answer to "how does Σ w h react to the data, and how uncertain is it".
#[derive(Debug, Clone, PartialEq)]
pub struct Adjoint {
    /// q = Σ* w, the covariance of the heights times w. A datum with row a, value z and variance R moves Σ w h
    /// by aᵀq/R for each metre that z moves.
    pub q: Vec<f64>,
    /// The prior's share of the variance: `qₓᵀ Q0 qₓ + q_β²/σ_β²`.
    pub prior_var: f64,
    /// The whole variance wᵀ q, data taken as independent.
    pub var: f64,
    /// Steps that its solve took; 1 for the direct solver.
    pub n_steps: usize,
}

/// `Q_h h = b`, where `Q_h` is the precision of the whole height.
#[derive(Debug)]
struct System {
    prior: Arc<PreparedPrior>,
    q: Stencil,
    method: Method,
}

/// The unknown level β, integrated out: `Q_h = Q − c g gᵀ`.
#[derive(Debug)]
pub(super) struct Level {
    /// g = Q0 1.
    g: Vec<f64>,
    /// `c = 1/(1/σ_β² + 1ᵀg)`.
    c: f64,
    /// `1/σ_β²`, 1/m².
    prior_info: f64,
}

/// How much looser an adjoint may be solved than the heights: the variance of its volume is off by the
/// square of what is left, and the volume by its product with the heights' own.
const ADJOINT_LOOSER: f64 = 30.0;

#[derive(Debug)]
enum Method {
    /// Q⁻¹ by its factor; `Q_h⁻¹ = Q⁻¹ + v vᵀ/s`.
    Direct {
        factor: Factor,
        level: Option<LevelResponse>,
    },
    Iterative {
        multigrid: Multigrid,
        stop: Stop,
    },
}

/// v = Q⁻¹ g, `s = 1/σ_β² + gᵀ(1 − v)`.
#[derive(Debug)]
pub(super) struct LevelResponse {
    pub(super) v: Vec<f64>,
    pub(super) s: f64,
}

impl System {
    fn new(
        lattice: &Lattice,
        prior: &Prior,
        information: &Information,
        solver: Solver,
    ) -> Result<Self, FieldError> {
        let prior = lattice.prepared(prior);
        let mut q = prior.q.clone();
        information.add_to(&mut q);
        let method = match solver.choose(lattice) {
            Solver::Iterative { residual_ratio } => Method::Iterative {
                multigrid: Multigrid::new(prior.frames(lattice), information),
                stop: Stop { residual_ratio, n_steps: 500 },
            },
            Solver::Direct | Solver::Automatic => {
                let factor = lattice.analysis()?.factorize(&q.lower_values())?;
                let level = prior.level.as_ref();
                let level = level.map(|level| level.response(&factor)).transpose()?;
                Method::Direct { factor, level }
            }
        };
        Ok(Self { prior, q, method })
    }

    /// `y = Q_h x`.
    fn apply(&self, x: &[f64], y: &mut [f64]) {
        self.q.apply(x, y);
        if let Some(Level { g, c, .. }) = &self.prior.level {
            let amount = c * dot(g, x);
            y.iter_mut().zip(g).for_each(|(y, g)| *y -= amount * g);
        }
    }

    /// `Q_h⁻¹ b`, and how many steps it took; an iterative solve may stop at `looser` times its residual.
    fn solve(
        &self,
        b: &[f64],
        start: Option<&[f64]>,
        looser: f64,
    ) -> Result<(Vec<f64>, usize), FieldError> {
        match &self.method {
            Method::Direct { factor, level } => {
                let mut x = factor.solve(b);
                if let Some(LevelResponse { v, s }) = level {
                    let amount = dot(v, b) / s;
                    x.iter_mut().zip(v).for_each(|(x, v)| *x += amount * v);
                }
                Ok((x, 1))
            }
            Method::Iterative { multigrid, stop } => {
                let start = start.map_or_else(|| vec![0.0; b.len()], <[f64]>::to_vec);
                let mut work = multigrid.work();
                let precondition = |r: &[f64], z: &mut [f64]| multigrid.apply(&mut work, r, z);
                let apply = |x: &[f64], y: &mut [f64]| self.apply(x, y);
                let stop = Stop { residual_ratio: looser * stop.residual_ratio, ..*stop };
                let done = conjugate_gradients(apply, precondition, b, start, stop)?;
                Ok((done.x, done.n_steps))
            }
        }
    }
}

impl Level {
    pub(super) fn new(lattice: &Lattice, operator: &Operator, prior: &Prior) -> Self {
        let g = operator.apply(lattice, &vec![1.0; lattice.n_nodes()]);
        let prior_info = prior.mean_sigma_m.powi(-2);
        let c = 1.0 / (prior_info + g.iter().sum::<f64>());
        Self { g, c, prior_info }
    }

    pub(super) fn response(&self, factor: &Factor) -> Result<LevelResponse, FieldError> {
        self.response_of(factor.solve(&self.g))
    }

    /// Q⁻¹ w for a known level, and the level's response, by one pass over the factor.
    pub(super) fn response_and(
        &self,
        factor: &Factor,
        w: &[f64],
    ) -> Result<(Vec<f64>, LevelResponse), FieldError> {
        let [y, v] = factor.solve_each([w, &self.g]);
        Ok((y, self.response_of(v)?))
    }

    fn response_of(&self, v: Vec<f64>) -> Result<LevelResponse, FieldError> {
        let seen: f64 = self.g.iter().zip(&v).map(|(g, v)| g * (1.0 - v)).sum();
        let s = self.prior_info + seen;
        // Without a prior and without data the level is not determined; what is left is rounding.
        let scale = 1.0 / self.c - self.prior_info;
        if s > 1e-9 * scale { Ok(LevelResponse { v, s }) } else { Err(FieldError::NoLevel) }
    }
}

impl Solution {
    pub(super) fn new(
        lattice: &Arc<Lattice>,
        prior: &Prior,
        information: &Information,
        solver: Solver,
        warm_start: Option<&[f64]>,
    ) -> Result<Self, FieldError> {
        prior.check()?;
        let expected = lattice.n_nodes();
        for got in [Some(information.n_nodes()), warm_start.map(<[f64]>::len)] {
            if let Some(got) = got.filter(|got| *got != expected) {
                return Err(FieldError::Size { got, expected });
            }
        }
        let system = System::new(lattice, prior, information, solver)?;
        let b = information.innovations(prior.mean_m);
        let start = warm_start.map(|start| start.iter().map(|h| h - prior.mean_m).collect());
        let start: Option<Vec<f64>> = start;
        let (x, n_steps) = system.solve(&b, start.as_deref(), 1.0)?;
        let mut residual = vec![0.0; expected];
        system.apply(&x, &mut residual);
        residual.iter_mut().zip(&b).for_each(|(r, b)| *r = b - *r);
        let height_m = x.iter().map(|x| prior.mean_m + x).collect();
        Ok(Self {
            lattice: Arc::clone(lattice),
            prior: *prior,
            system,
            height_m,
            residual,
            n_steps,
        })
    }

    /// Expected height over the hall floor at every node, m.
    #[must_use]
    pub fn height_m(&self) -> &[f64] {
        &self.height_m
    }

    /// The nodes.
    #[must_use]
    pub const fn lattice(&self) -> &Arc<Lattice> {
        &self.lattice
    }

    /// The prior.
    #[must_use]
    pub const fn prior(&self) -> &Prior {
        &self.prior
    }

    /// Steps that the solve of the heights took; 1 for the direct solver.
    #[must_use]
    pub const fn n_steps(&self) -> usize {
        self.n_steps
    }

    /// The adjoint of Σ w h. `warm_start` is the `q` of an earlier one with the same w.
    ///
    /// # Errors
    /// Weights of another size; [`FieldError::NotConverged`].
    pub fn adjoint(&self, w: &[f64], warm_start: Option<&[f64]>) -> Result<Adjoint, FieldError> {
        let expected = self.lattice.n_nodes();
        for got in [Some(w.len()), warm_start.map(<[f64]>::len)].into_iter().flatten() {
            if got != expected {
                return Err(FieldError::Size { got, expected });
            }
        }
        let (q, n_steps) = self.system.solve(w, warm_start, ADJOINT_LOOSER)?;
        let (q_field, of_level) = self.parts(&q);
        let prior_var = self.system.prior.operator.energy(&self.lattice, &q_field) + of_level;
        Ok(Adjoint { prior_var, var: dot(w, &q), q, n_steps })
    }

    /// The part of [`Adjoint::prior_var`] that the bends of the field at these nodes have.
    #[must_use]
    pub fn prior_var_at(&self, adjoint: &Adjoint, counts: &[bool]) -> f64 {
        let (q_field, _) = self.parts(&adjoint.q);
        let operator = &self.system.prior.operator;
        let bends = operator.half(&self.lattice, &q_field);
        let counted = std::iter::zip(bends, counts).filter(|(_, counts)| **counts);
        operator.scale * counted.map(|(bend, _)| bend * bend).sum::<f64>()
    }

    /// The field's part qₓ of an adjoint, and what its level adds to the prior's share.
    fn parts(&self, q: &[f64]) -> (Vec<f64>, f64) {
        match &self.system.prior.level {
            None => (q.to_vec(), 0.0),
            Some(Level { g, c, prior_info }) => {
                let q_level = c * dot(g, q);
                (q.iter().map(|q| q - q_level).collect(), q_level * q_level * prior_info)
            }
        }
    }

    /// Σ w h, corrected for what the iterative solve left: wᵀh + qᵀ(b − Q h). Its error is of
    /// second order in those of h and q.
    #[must_use]
    pub fn functional(&self, w: &[f64], adjoint: &Adjoint) -> f64 {
        dot(w, &self.height_m) + dot(&adjoint.q, &self.residual)
    }

    /// A draw of the surface given the data, m; None for an iterative solution, which has no
    /// factor. From a solution without data it is a draw of the prior.
    #[must_use]
    pub fn sample_m(&self, noise: &mut Noise) -> Option<Vec<f64>> {
        let Method::Direct { factor, level } = &self.system.method else { return None };
        let white: Vec<f64> = (0..self.height_m.len()).map(|_| noise.normal()).collect();
        let mut draw = factor.colour(&white);
        if let Some(LevelResponse { v, s }) = level {
            let amount = noise.normal() / s.sqrt();
            draw.iter_mut().zip(v).for_each(|(x, v)| *x += amount * v);
        }
        draw.iter_mut().zip(&self.height_m).for_each(|(x, mean_m)| *x += mean_m);
        Some(draw)
    }

    /// Variance of the height at every node, m²: the diagonal of Σ*, exact. An iterative solution
    /// has to find its factor first.
    ///
    /// # Errors
    /// The factor that it needs does not fit into memory.
    pub fn marginal_var_m2(&self) -> Result<Vec<f64>, FieldError> {
        if let Method::Direct { factor, level } = &self.system.method {
            return Ok(diagonal_of_inverse(factor, level.as_ref()));
        }
        let system = &self.system;
        let factor = self.lattice.analysis()?.factorize(&system.q.lower_values())?;
        let level = system.prior.level.as_ref().map(|level| level.response(&factor)).transpose()?;
        Ok(diagonal_of_inverse(&factor, level.as_ref()))
    }

    /// ln det Q of the joint precision of field and level, over the level's own prior precision:
    /// ln det Q + `ln(s σ_β²)`. None for an iterative solution.
    pub(super) fn log_det(&self) -> Option<f64> {
        let Method::Direct { factor, level } = &self.system.method else { return None };
        // A level without a prior adds a constant only.
        let own = level.as_ref().map_or(0.0, |LevelResponse { s, .. }| {
            let var_m2 = self.prior.mean_sigma_m.powi(2);
            if var_m2.is_finite() { (s * var_m2).ln() } else { s.ln() }
        });
        Some(factor.log_det() + own)
    }
}

/// The diagonal of Q⁻¹ + v vᵀ/s.
fn diagonal_of_inverse(factor: &Factor, level: Option<&LevelResponse>) -> Vec<f64> {
    let mut var_m2 = factor.inverse_diagonal();
    if let Some(LevelResponse { v, s }) = level {
        var_m2.iter_mut().zip(v).for_each(|(var, v)| *var += v * v / s);
    }
    var_m2
}
