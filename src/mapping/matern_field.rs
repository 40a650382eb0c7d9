//! The surface as a Matérn field whose precision is sparse, and what beams say about it.
//!
//! A [`Lattice`] of nodes covers the map's grid; a [`Prior`] says how smooth and how high the surface
//! is expected to be; every beam adds a [`Row`] to the [`Information`]; [`solve`] gives the
//! [`Solution`]: heights, the adjoint of a volume (with its variance), variances, draws.
//!
//! Not done here: from beam to height and variance (`projection`), error sources that beams share
//! (the budget, which needs [`Solution::adjoint`]), bays and volumes.
//!

#![doc = include_str!("matern_field/derivation.md")]

mod estimate;
mod functional;
mod information;
mod iterative;
mod lattice;
mod multigrid;
mod prepared_prior;
mod prior;
mod solution;
mod stencil;

#[cfg(test)]
mod tests;

pub use estimate::{Datum, PriorEstimate, estimate_prior};
pub use functional::{Functional, FunctionalVar};
pub use information::Information;
pub use lattice::{Lattice, Row};
pub use prior::Prior;
pub use solution::{Adjoint, Solution};

use super::sparse_cholesky::CholeskyError;
use std::sync::Arc;

/// The field cannot be solved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldError {
    /// The prior has a number that is not finite or not positive.
    #[error("no field has this prior: {prior:?}")]
    Prior {
        /// What was asked for.
        prior: Prior,
    },
    /// Values for another lattice.
    #[error("{got} values for a lattice of {expected} nodes")]
    Size {
        /// Values given.
        got: usize,
        /// Nodes.
        expected: usize,
    },
    /// The level has no prior, and there are no data.
    #[error("nothing is known of the surface's level: it has no prior and no data")]
    NoLevel,
    /// The iterative solver stopped too early.
    #[error("residual ratio still {residual_ratio:e} after {n_steps} steps")]
    NotConverged {
        /// Steps taken.
        n_steps: usize,
        /// Residual against the right-hand side.
        residual_ratio: f64,
    },
    /// An iterative solution was asked for what needs a factor.
    #[error("an iterative solution has no factor")]
    NoFactor,
    /// The factorisation failed.
    #[error(transparent)]
    Cholesky(#[from] CholeskyError),
}

/// How the linear system is solved.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Solver {
    /// Whatever is fastest for the size and the coverage.
    #[default]
    Automatic,
    /// Sparse Cholesky factor: exact, and the only one that gives draws.
    Direct,
    /// Conjugate gradients, preconditioned by multigrid: time and memory in proportion to the
    /// nodes, whatever the coverage.
    Iterative {
        /// Stops when the residual is this small against the right-hand side, both in the norm of
        /// the preconditioner.
        residual_ratio: f64,
    },
}

impl Solver {
    /// Iterative, good enough for an update in flight: with what `functional` corrects, the volume is off
    /// by less than a thousandth of its σ; σ by less than a ten-thousandth of itself.
    pub const LIVE: Self = Self::Iterative { residual_ratio: 1e-4 };

    /// Up to here the factor is made in less than a tenth of a second, and gives draws and exact
    /// variances for little more.
    pub(in crate::mapping) const MOST_NODES_DIRECT: usize = 20_000;

    fn choose(self, lattice: &Lattice) -> Self {
        match self {
            Self::Automatic if lattice.n_nodes() > Self::MOST_NODES_DIRECT => {
                Self::Iterative { residual_ratio: 1e-6 }
            }
            Self::Automatic => Self::Direct,
            chosen => chosen,
        }
    }
}

/// Solves for the surface. A pure function of its arguments: the same give the same bits.
///
/// `warm_start` is the height at the nodes of an earlier solution; only the iterative solver
/// looks at it.
///
/// # Errors
/// [`FieldError`].
pub fn solve(
    lattice: &Arc<Lattice>,
    prior: &Prior,
    information: &Information,
    solver: Solver,
    warm_start: Option<&[f64]>,
) -> Result<Solution, FieldError> {
    Solution::new(lattice, prior, information, solver, warm_start)
}
