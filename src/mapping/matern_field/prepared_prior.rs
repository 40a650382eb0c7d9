//! What follows from lattice and prior alone, computed once and shared by the solves that have both.

use super::lattice::Lattice;
use super::multigrid::{self, Frame};
use super::prior::{Operator, Prior};
use super::solution::Level;
use super::stencil::Stencil;
use std::sync::{Arc, OnceLock};

/// A prior on a lattice.
#[derive(Debug)]
pub(super) struct PreparedPrior {
    pub(super) prior: Prior,
    pub(super) operator: Operator,
    /// Q0.
    pub(super) q: Stencil,
    pub(super) level: Option<Level>,
    /// The prior's part of the grids; the exact solver has none.
    frames: OnceLock<Vec<Arc<Frame>>>,
}

impl PreparedPrior {
    pub(super) fn new(lattice: &Lattice, prior: &Prior) -> Self {
        let operator = Operator::new(lattice, prior);
        let level = (prior.mean_sigma_m > 0.0).then(|| Level::new(lattice, &operator, prior));
        let q = operator.stencil(lattice);
        Self { prior: *prior, operator, q, level, frames: OnceLock::new() }
    }

    pub(super) fn frames(&self, lattice: &Lattice) -> &[Arc<Frame>] {
        self.frames.get_or_init(|| multigrid::frames(lattice, &self.operator))
    }
}
