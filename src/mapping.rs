//! What the surface looks like, and how much lies under it.
//!
//! A beam becomes a hit point with a covariance ([`projection`]). Two maps are kept of the hits:
//!
//! - the paper's: cells of a grid ([`kalman_grid`]) with a sparse Gaussian process over them
//!   ([`sparse_gp`]), together [`grid_map`];
//! - ours, the default: a Gauss–Markov field ([`matern_field`]) on the turns of the scanner
//!   ([`footprint`], [`datum`]), whose volume carries the account of all error sources
//!   ([`budget`]), together [`field_map`].
//!
//! [`Mapper`] is the face of all this.
//!
//! Not done here: where the vehicle is (poses come in as arguments), and where to fly.

pub mod base;
pub mod bay;
pub mod belief;
pub mod budget;
pub mod change;
pub mod clip;
pub mod datum;
pub mod density;
pub mod disturbance;
pub mod field_map;
pub mod footprint;
pub mod gaps;
pub mod grid_map;
pub mod hidden_ground;
pub mod kalman_grid;
pub mod left_out;
pub mod matern_field;
pub mod matern_kernel;
pub mod merge;
pub mod polygon;
pub mod projection;
pub mod ray_ceiling;
pub mod reach;
pub mod region;
pub mod relief;
pub mod roughness;
pub mod shares;
pub mod silence;
pub mod solid;
pub mod sparse_cholesky;
pub mod sparse_gp;
pub mod statement;
pub mod surveyed_base;
pub mod triangulated_base;
pub mod unseen_patch;
pub mod volume;

mod mapper;
mod rect;
mod surface_work;

pub use grid_map::VolumeVariance;
#[cfg(test)]
pub(crate) use mapper::tests::settings_over;
pub use mapper::{KeptHit, Mapper, Method, PoseWithCov, Settings};
pub use surface_work::{KnownHeights, SolveError, SolveSurface, SolvedSurface};
