//! Worlds, vehicle, sensors and autopilot that fly stockpilot without hardware.
//!
//! The truth in here shares units, stamps, frames and message types with the service, and no
//! equation with anything it judges.

pub mod autopilot;
pub mod vehicle;
