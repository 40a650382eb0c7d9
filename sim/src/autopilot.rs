//! A stub autopilot that behaves on the wire and in the air as PX4 v1.16 does indoors.
//!
//! [`StubPx4`] is a machine without I/O: messages in, one step per inertial sample, motor commands
//! and messages out. Its only source of position is the ODOMETRY that the companion sends, so a
//! bad estimate shows in flight.
//!
//! NED and FRD live here; everything outside speaks `Hall` and `Body`.
//!
//! Not imitated: EVENT and the component metadata, missions, sticks, ENU and FLU external vision,
//! and the climb of AUTO.RTL (the stub returns at its present height).

mod commander;
mod commands;
mod controller;
mod estimator;
mod frames;
mod guidance;
mod landing;
mod mixer;
mod modes;
mod outbox;
mod params;
mod routing;
mod setpoint;
mod streams;
mod stub;
mod takeoff;
mod telemetry;
mod timesync;

pub use modes::Px4Mode;
pub use params::{ParamTable, ParamValue};
pub use stub::{COMPANION_COMPONENT, Sensors, StubPx4};
