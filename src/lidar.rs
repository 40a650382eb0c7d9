//! Serial drivers of 2D LiDAR sensors: bytes in, [`Scan`](crate::messages::Scan)s out.
//!
//! ```text
//! serial port ─ bytes ─▶ ldrobot::Parser ─ Frame ─▶ ScanAssembler ─ Scan ─▶ Event::Scanned
//! ```
//! [`ldrobot::Parser`] and [`ScanAssembler`] do no I/O and are told the time; [`Driver`] runs them
//! in a thread of its own, because serial reads block. The driver does not judge ranges: beams
//! outside the trusted range are counted by the mapping.

mod assembler;
mod driver;
pub mod ldrobot;
mod model;
mod port;
mod settings;
mod status;
mod watchdog;

pub use assembler::{AssemblerStats, ScanAssembler};
pub use driver::Driver;
pub use model::Model;
pub use port::OpenError;
pub use settings::{Settings, SettingsError};
pub use status::{LidarHealth, LidarStats, LidarStatus};
