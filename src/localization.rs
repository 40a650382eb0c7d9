//! Where the vehicle is, from tags in camera frames and inertial samples.
//!
//! One frame of tags becomes a pose with a covariance ([`vision_fix`]); an error-state Kalman
//! filter fuses it with the inertial samples ([`filter`]). Frames arrive late and out of order,
//! so a ring keeps the last second of states and samples and propagates again from the frame's
//! own time ([`ring`]). [`Localizer`] is the face of all this.
//!
//! Not done here: maps of the surface, decisions about the flight.

pub mod camera_model;
pub mod filter;
pub mod map_adjustment;
pub mod marker_map;
pub mod ring;
pub mod tight_update;
pub mod vision_fix;

mod frozen;
mod imu_clock;
mod linear_pose;
mod localizer;
mod place_errors;
mod planar_pose;
mod propagation;
mod start;
mod tag_health;

pub use localizer::{Health, Localizer, MANOEUVRE_MPS2, PLAUSIBLE_SPEED_MPS, Settings, Update};
pub use place_errors::PlaceErrors;
pub use start::PadPose;
