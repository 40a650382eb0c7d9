//! Drivers of 2D LiDAR sensors on serial lines: bytes in, [`Scan`](crate::messages::Scan)s out.
//!
//! ```text
//! serial port ─ bytes ─▶ Sensor ─ Packet ─▶ ScanAssembler ─ Scan ─▶ Event::Scanned
//!             ◀ requests ─┘ (Ldrobot, Rplidar, Ydlidar, Hokuyo)
//! ```
//! A [`Sensor`] speaks one maker's protocol and does no I/O: it is told bytes and the time and says
//! what to send. So does the [`ScanAssembler`]. [`Driver`] runs them in a thread of its own, because
//! serial reads block. The driver does not judge ranges: beams outside the trusted range are counted
//! by the mapping.

mod assembler;
mod detect;
mod driver;
mod head_angle;
pub mod hokuyo;
pub mod ldrobot;
mod model;
mod port;
pub mod rplidar;
mod scanner;
mod sensor;
mod settings;
mod status;
mod watchdog;
pub mod ydlidar;

pub use assembler::{AssemblerStats, ScanAssembler};
pub use detect::{Detector, Found, Probe, Stranger};
pub use driver::Driver;
pub use model::{Family, Model, Spec};
pub use port::{GOOD_LATENCY_MS, OpenError, latency_timer_ms};
pub use sensor::{Counts, Identity, Packet, Request, Sample, Sensor, Trouble};
pub use settings::{Settings, SettingsError};
pub use status::{LidarHealth, LidarStats, LidarStatus, Rates};

/// The conversation with a sensor of this model, as if its port had just been opened.
#[must_use]
pub fn sensor(model: Model) -> Box<dyn Sensor> {
    match model.family() {
        Family::Ldrobot => Box::new(ldrobot::Ldrobot::new(model)),
        Family::Rplidar => Box::new(rplidar::Rplidar::new(model)),
        Family::Ydlidar => Box::new(ydlidar::Ydlidar::new(model)),
        Family::Hokuyo => Box::new(hokuyo::Hokuyo::new(model)),
    }
}
