//! Surfaces and point clouds as files that other programs read.

mod digest;

pub use digest::{sha256_of_bytes, sha256_of_file};
