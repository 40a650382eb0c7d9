//! Worlds, vehicle, sensors and autopilot that fly stockpilot on a laptop.
//!
//! The truth is made with ranks 0 to 2 of `stockpilot` only: nothing in [`world`], [`raycast`],
//! [`vehicle`], [`autopilot`], [`lidar`], [`camera`], [`rig`] and [`judge`] shares an equation
//! with what it judges. [`campaign`] feeds the brain directly, [`fly`] flies the real service, and
//! [`sitl`] flies it on an autopilot's own simulator.

pub mod autopilot;
pub mod autopilot_command;
pub mod calibration;
pub mod camera;
pub mod camera_faults;
pub mod campaign;
pub mod carry;
pub mod comparison;
pub mod consistency;
pub mod faults;
pub mod fly;
mod gate;
pub mod hall;
pub mod hazards;
pub mod judge;
pub mod lidar;
mod lidar_catalogue;
pub mod lidar_command;
pub mod lidar_faults;
pub mod load;
pub mod machine;
pub mod operator;
pub mod outside;
pub mod paper;
pub mod parallel;
mod picture_line;
pub mod raycast;
pub mod report;
pub mod rig;
pub mod scenario;
pub mod sitl;
pub mod survey;
mod temporary_log;
pub mod vehicle;
pub mod world;
