//! Worlds, vehicle and sensors that fly stockpilot on a laptop.
//!
//! Everything here is the *truth* that the service is judged against, so nothing here borrows the
//! service's estimators, parsers or projections: from `stockpilot` only frames, stamps, seeded
//! noise and plain messages are used.

pub mod camera;
pub mod lidar;
pub mod raycast;
pub mod world;
