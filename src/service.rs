//! service
pub mod clock;
