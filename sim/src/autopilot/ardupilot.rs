//! The stub that behaves as `ArduCopter` 4.7 does indoors.
//!
//! [`StubArduPilot`] has the same shape as the stub of PX4: messages in, one step per inertial
//! sample, motor commands and messages out; ODOMETRY of the companion is its only source of place.
//!
//! Not imitated: missions, moving sticks, the fence, battery failsafes, and the models of radio
//! failure.

mod arming;
mod commands;
mod guided;
mod jitter;
mod modes;
mod params;
mod routing;
mod setpoint;
mod steering;
mod stub;
mod telemetry;

pub use modes::ApMode;
pub use params::{ApParams, ApType};
pub use stub::StubArduPilot;
