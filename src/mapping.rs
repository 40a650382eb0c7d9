//! What the surface looks like, and how much lies under it.
//!
//! A beam becomes a hit point with a covariance ([`projection`]); hits update the cells of a grid
//! ([`kalman_grid`]); a sparse Gaussian process over the cells gives the surface and the volume
//! ([`sparse_gp`], [`volume`]). [`Mapper`] is the face of all this.
//!
//! Not done here: where the vehicle is (poses come in as arguments), and where to fly.

pub mod base;
pub mod bay;
pub mod change;
pub mod clip;
pub mod density;
pub mod kalman_grid;
pub mod matern_kernel;
pub mod polygon;
pub mod projection;
pub mod region;
pub mod sparse_cholesky;
pub mod sparse_gp;
pub mod statement;
pub mod surveyed_base;
pub mod triangulated_base;
pub mod volume;

mod mapper;
mod rect;

pub use mapper::{Mapper, PoseWithCov, Settings, SolveSurface, SolvedSurface, VolumeVariance};
