//! Gates, consistency measures and seeded noise.

mod chi2;
mod noise;

pub use chi2::{CHI2_99, chi2_gate_99};
pub use noise::{Noise, SeedBook};
