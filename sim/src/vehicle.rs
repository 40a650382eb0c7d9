//! The quadrotor as it really moves: rigid body, rotors, battery, wind and inertial sensors.
//!
//! Truth lives in `Hall` (z up) and `Body` (forward-left-up). One call of [`Vehicle::step`] moves
//! everything by [`STEP`]; every fifth call an inertial sample is ready. Equal seeds and equal
//! commands give equal bits.
//!
//! Not modelled: blade flapping, ground effect, and the loss of thrust of an empty battery.

mod battery;
mod collision;
mod history;
mod imu;
mod quadrotor;
mod rigid_body;
mod rotors;
mod wind;

pub use battery::{Battery, BatterySettings};
pub use collision::{Collision, Surroundings};
pub use imu::{ImuSettings, InertialSensor};
pub use quadrotor::{STEP, Vehicle, VehicleSettings};
pub use rigid_body::{MotionState, RigidBodySettings};
pub use rotors::{MotorCommands, RotorSettings, Rotors};
pub use wind::{Wind, WindSettings};
