//! The variance of one weighted sum of heights, again and again for other data.
//!
//! ```text
//! q = Q⁻¹ w,   var = wᵀ q,   Q = Q0 + Σ a aᵀ/R
//! ```
//! Prior, pattern of the factor and weights stay; only the information changes. Whoever compares many
//! sets of data (planned flights) pays for one numeric factor and one pass over it each.

use super::FieldError;
use super::information::Information;
use super::iterative::dot;
use super::lattice::Lattice;
use super::prior::{Operator, Prior};
use super::solution::Level;
use super::stencil::Stencil;
use crate::mapping::sparse_cholesky::Analysis;
use std::sync::Arc;

/// Σ w h on a lattice under a prior.
#[derive(Debug)]
pub struct Functional {
    lattice: Arc<Lattice>,
    analysis: Arc<Analysis>,
    prior: Stencil,
    level: Option<Level>,
    w: Vec<f64>,
}

/// What is left of the uncertainty of the sum.
#[derive(Debug, Clone, PartialEq)]
pub struct FunctionalVar {
    /// q = Σ* w, the covariance of the heights with the sum.
    pub q: Vec<f64>,
    /// wᵀ q, data taken as independent.
    pub var: f64,
}

impl Functional {
    /// Sets up the sum with these weights of the nodes.
    ///
    /// # Errors
    /// A prior that is none, weights of another size, a factor that does not fit into memory.
    pub fn new(lattice: &Arc<Lattice>, prior: &Prior, w: Vec<f64>) -> Result<Self, FieldError> {
        prior.check()?;
        if w.len() != lattice.n_nodes() {
            return Err(FieldError::Size { got: w.len(), expected: lattice.n_nodes() });
        }
        let operator = Operator::new(lattice, prior);
        let level = (prior.mean_sigma_m > 0.0).then(|| Level::new(lattice, &operator, prior));
        Ok(Self {
            analysis: lattice.analysis()?,
            prior: operator.stencil(lattice),
            level,
            w,
            lattice: Arc::clone(lattice),
        })
    }

    /// The nodes.
    #[must_use]
    pub const fn lattice(&self) -> &Arc<Lattice> {
        &self.lattice
    }

    /// The weights.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.w
    }

    /// The variance of the sum given these data.
    ///
    /// # Errors
    /// Data of another lattice; a factor that fails; neither prior nor data of the level.
    pub fn given(&self, information: &Information) -> Result<FunctionalVar, FieldError> {
        if information.n_nodes() != self.w.len() {
            return Err(FieldError::Size { got: information.n_nodes(), expected: self.w.len() });
        }
        let mut q = self.prior.clone();
        information.add_to(&mut q);
        let factor = self.analysis.factorize(&q.lower_values())?;
        let y = match &self.level {
            None => factor.solve(&self.w),
            Some(level) => {
                let (mut y, response) = level.response_and(&factor, &self.w)?;
                let amount = dot(&response.v, &self.w) / response.s;
                y.iter_mut().zip(&response.v).for_each(|(y, v)| *y += amount * v);
                y
            }
        };
        Ok(FunctionalVar { var: dot(&self.w, &y), q: y })
    }
}
