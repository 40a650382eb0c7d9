//! Stub autopilots that behave on the wire and in the air as PX4 v1.16 and `ArduCopter` 4.7 do
//! indoors; [`StubAutopilot`] is either of them.
//!
//! Each is a machine without I/O: messages in, one step per inertial sample, motor commands
//! and messages out. Its only source of position is the ODOMETRY that the companion sends, so a
//! bad estimate shows in flight.
//!
//! NED and FRD live here; everything outside speaks `Hall` and `Body`.
//!
//! Not imitated: EVENT and the component metadata, missions, sticks, ENU and FLU external vision,
//! and the climb of AUTO.RTL (the stub returns at its present height).

mod ardupilot;
mod commander;
mod commands;
mod controller;
mod either;
mod estimator;
mod frames;
mod guidance;
mod landing;
mod limits;
mod mixer;
mod modes;
mod outbox;
mod params;
mod reports;
mod routing;
mod setpoint;
mod status;
mod streams;
mod stub;
mod takeoff;
mod telemetry;
mod timesync;

pub use ardupilot::{ApMode, ApParams, ApType, StubArduPilot};
pub use either::{Flavour, StubAutopilot};
pub use modes::Px4Mode;
pub use params::{ParamTable, ParamValue};
pub use stub::{COMPANION_COMPONENT, Sensors, StubPx4};
