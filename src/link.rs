//! Talks MAVLink with the autopilot and the ground station.
//!
//! [`Session`] is the protocol without any I/O: decoded messages and the brain's actions go in,
//! events and messages come out, and it is told the time. [`transport`] moves the bytes.
//!
//! This is the only place that knows MAVLink's axes. Hall and Body are turned to NED and FRD here:
//!
//! ```text
//! local NED = ( x, −y, −z) of Hall        FRD = ( x, −y, −z) of Body
//! ```
//!
//! What is true of one family of autopilots only (mode numbers, which frames an ODOMETRY may
//! carry, how a mode change is acknowledged) stands in `dialect`: PX4 and `ArduPilot` are spoken,
//! and the first heartbeat decides which.
//!
//! One message's way: a transport finds a frame, [`wire::decode`] makes a message of it,
//! [`Session::on_message`] checks the sender and every number, and the brain sees an
//! [`Event`](crate::pilot::Event) in SI units, Body or Hall axes and stamps of `Mono`.
//!
//! [`Guard`] stands between transport and session: signatures, floods, addresses.
//!
//! Not here: forwarding between links, and a second autopilot. A system id
//! above 255 is not spoken.

mod autopilot_clock;
mod budget;
mod command;
mod dialect;
mod frames;
mod inbound;
mod operator;
mod outbound;
pub mod outbox;
pub mod params;
mod security;
mod session;
mod settings;
pub mod signing;
mod stats;
mod streams;
mod telemetry;
mod text;
pub mod transport;
pub mod wire;

pub use budget::LinkBudget;
pub use security::{Guard, GuardStats, Network, NetworkError, SecuritySettings};
pub use session::{Session, SessionOutput};
pub use settings::{Address, AddressError, Settings};
pub use stats::LinkStats;

use crate::messages::OperatorRequest;

/// MAVLink component id of this service (`MAV_COMP_ID_ONBOARD_COMPUTER`).
pub const OWN_COMPONENT: u8 = 191;

/// Who asks by the own page: nobody on the wire has system 0.
pub const PAGE: OperatorRequest = OperatorRequest { system: 0, component: OWN_COMPONENT };

/// MAVLink component id of an autopilot (`MAV_COMP_ID_AUTOPILOT1`).
pub const AUTOPILOT_COMPONENT: u8 = 1;
