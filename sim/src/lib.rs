//! Worlds, vehicle, sensors and autopilot that fly stockpilot on a laptop.
//!
//! The truth here is made with ranks 0 to 2 of `stockpilot` only: nothing in [`world`],
//! [`raycast`], [`vehicle`], [`autopilot`], `lidar` and `camera` shares an equation with what it
//! judges.

pub mod autopilot;
pub mod raycast;
pub mod vehicle;
pub mod world;
