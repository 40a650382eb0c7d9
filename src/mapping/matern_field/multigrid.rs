//! A preconditioner whose cost and quality do not depend on the size: multigrid on two unknowns.
//!
//! Where nothing was seen, Q is the fourth-order operator s K K, on which plain multigrid and
//! incomplete factors grow slow. With a second unknown y = √s K x it becomes two of second order,
//!
//! ```text
//! ⎡  W    √s K ⎤ ⎡x⎤   ⎡r⎤
//! ⎣ √s K   −I  ⎦ ⎣y⎦ = ⎣0⎦         whose x is (W + s K K)⁻¹ r,
//! ```
//! and a Gauss–Seidel sweep that solves for x and y of a node together smooths them as well as it
//! smooths Poisson's equation. Coarse grids are Galerkin's, with bilinear transfer; sweeps run
//! forwards before and backwards after the coarse grid, so the preconditioner is symmetric.
//!
//! Source: [Trottenberg, Oosterlee, Schüller 2001], section 8.3 (systems; biharmonic as a system).

mod coarsening;
mod grid;

use super::information::Information;
use super::lattice::Lattice;
use super::prior::Operator;
pub(super) use grid::Frame;
use grid::{Grid, Pair};
use std::sync::Arc;

/// Entries towards the node itself, E, NW, N, NE.
pub(super) type Ahead = [f64; 5];

/// The grids, finest first.
#[derive(Debug)]
pub(super) struct Multigrid {
    grids: Vec<Grid>,
}

/// Unknowns and right-hand sides of all grids.
#[derive(Debug)]
pub(super) struct Work {
    unknown: Vec<Vec<Pair>>,
    rhs: Vec<Vec<Pair>>,
}

/// Sweeps on the coarsest grid, which has five rows or columns at most.
const N_COARSEST_SWEEPS: usize = 8;

/// The frames of all grids, finest first.
pub(super) fn frames(lattice: &Lattice, operator: &Operator) -> Vec<Arc<Frame>> {
    let mut frames = vec![Arc::new(Frame::finest(lattice, operator))];
    while let Some(last) = frames.last()
        && last.n_cols.min(last.n_rows) > 5
    {
        let coarse = Arc::new(last.coarsened());
        frames.push(coarse);
    }
    frames
}

impl Multigrid {
    pub(super) fn new(frames: &[Arc<Frame>], information: &Information) -> Self {
        let mut grids: Vec<Grid> = Vec::with_capacity(frames.len());
        for frame in frames {
            let next = match grids.last() {
                None => Grid::finest(frame, information),
                Some(last) => last.coarsened(frame),
            };
            grids.push(next);
        }
        Self { grids }
    }

    pub(super) fn work(&self) -> Work {
        let zeros = || self.grids.iter().map(|grid| grid.frame.zeros()).collect();
        Work { unknown: zeros(), rhs: zeros() }
    }

    /// z ≈ Q⁻¹ r by one cycle from zero.
    pub(super) fn apply(&self, work: &mut Work, r: &[f64], z: &mut [f64]) {
        let Some(finest) = self.grids.first() else { return };
        for (row, of_row) in r.chunks_exact(finest.frame.n_cols).enumerate() {
            let pairs = &mut work.rhs[0][finest.frame.at(0, row)..];
            pairs.iter_mut().zip(of_row).for_each(|(pair, r)| pair[0] = *r);
        }
        for (grid, pair) in self.grids.windows(2).enumerate() {
            let (fine, coarse) = (&pair[0], &pair[1]);
            fine.sweep_from_zero(&mut work.unknown[grid], &work.rhs[grid]);
            fine.restrict_residual(&work.unknown[grid], coarse, &mut work.rhs[grid + 1]);
        }
        if let Some(coarsest) = self.grids.last() {
            let last = self.grids.len() - 1;
            let (unknown, rhs) = (&mut work.unknown[last], &work.rhs[last]);
            unknown.fill([0.0; 2]);
            for _ in 0..N_COARSEST_SWEEPS {
                coarsest.sweep_forwards(unknown, rhs);
                coarsest.sweep_backwards(unknown, rhs);
            }
        }
        for (grid, pair) in self.grids.windows(2).enumerate().rev() {
            let (fine, coarse) = (&pair[0], &pair[1]);
            let (upper, lower) = work.unknown.split_at_mut(grid + 1);
            fine.add_correction(&mut upper[grid], coarse, &lower[0]);
            fine.sweep_backwards(&mut upper[grid], &work.rhs[grid]);
        }
        for (row, of_row) in z.chunks_exact_mut(finest.frame.n_cols).enumerate() {
            let pairs = &work.unknown[0][finest.frame.at(0, row)..];
            pairs.iter().zip(of_row).for_each(|(pair, z)| *z = pair[0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::matern_field::Prior;
    use crate::messages::GridGeometry;

    #[test]
    fn all_grids_together_hold_little_more_than_the_finest() {
        let prior = Prior { range_m: 4.0, sigma_m: 1.0, mean_m: 0.0, mean_sigma_m: 1.0 };
        for n in [50, 100, 200, 400] {
            let grid =
                GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: n, n_rows: n };
            let lattice = Lattice::covering(&grid, prior.padding_m(), |_, _| false);
            let frames = frames(&lattice, &Operator::new(&lattice, &prior));
            let n_held: usize = frames.iter().map(|frame| frame.k.len()).sum();
            // A quarter of a quarter and so on: 4/3, and the rings, of which the smallest grids have most.
            let edge = f64::from(u32::try_from(lattice.size().0).expect("small"));
            let bound = 4.0 / 3.0 * edge * edge + 16.0 * edge + 40.0 * frames.len() as f64;
            assert!((n_held as f64) < bound, "{n}²: {n_held} against {bound}");
        }
    }
}
