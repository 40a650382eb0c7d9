//! Emulated sensors: what their firmware hears and says.
//!
//! ```text
//! host bytes ─▶ Device::hear        Scene ─▶ Device::advance ─ Frame ─▶ Uart ─▶ PtyLine ─▶ host
//! ```
//! Nothing here comes from the service's drivers: numbers are packed by code of their own.

mod hokuyo;
mod ldrobot;
mod rplidar;
#[cfg(test)]
mod vectors;
mod ydlidar;

use super::{LidarModel, Scene};
use std::fmt;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

pub use rplidar::Format;

/// Bytes that leave the sensor together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// The bytes.
    pub bytes: Vec<u8>,
    /// Samples in it; 0 for an answer.
    pub n_samples: u64,
    /// When the sensor has them ready.
    pub ready_at: Stamp<Mono>,
}

impl Frame {
    fn answer(bytes: Vec<u8>, ready_at: Stamp<Mono>) -> Self {
        Self { bytes, n_samples: 0, ready_at }
    }
}

/// What can be done to a sensor on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mishap {
    /// Its head is held, or let go.
    HeadHeld(bool),
    /// It reports an error until it is reset.
    InternalError,
}

/// A sensor's firmware.
pub trait Device: fmt::Debug + Send {
    /// Bytes from the host that have arrived by `now`.
    fn hear(&mut self, bytes: &[u8], now: Stamp<Mono>);

    /// Goes on to `until`; what it says is added to `out` in order.
    fn advance(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene, out: &mut Vec<Frame>);

    /// Something happens to it.
    fn suffer(&mut self, mishap: Mishap, now: Stamp<Mono>);
}

/// Which firmware a model runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Firmware {
    /// LDROBOT.
    Ldrobot,
    /// Slamtec, by the model byte.
    Rplidar(u8),
    /// YDLIDAR, by the model byte; 0 for one that only talks.
    Ydlidar(u8),
    /// Hokuyo, by the number of its steps.
    Hokuyo(u32),
}

/// A sensor that gets its power at `now`; `is_running` if it has had it for long.
#[must_use]
pub fn device(
    model: &LidarModel,
    seeds: SeedBook,
    now: Stamp<Mono>,
    is_running: bool,
) -> Box<dyn Device> {
    match model.firmware {
        Firmware::Ldrobot => Box::new(ldrobot::Ldrobot::new(model, seeds, now, is_running)),
        Firmware::Rplidar(byte) => Box::new(rplidar::Rplidar::new(model, byte, seeds)),
        Firmware::Ydlidar(byte) => {
            Box::new(ydlidar::Ydlidar::new(model, byte, seeds, now, is_running))
        }
        Firmware::Hokuyo(steps) => Box::new(hokuyo::Hokuyo::new(model, steps, seeds, now)),
    }
}

/// When sample number `n` after `start` is measured at this rate.
fn sample_at(start: Stamp<Mono>, n: u64, samples_per_s: f64) -> Stamp<Mono> {
    start.plus(std::time::Duration::from_secs_f64(n as f64 / samples_per_s))
}

/// The nearest whole number in the range of the target; floats saturate.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a float-to-integer cast saturates, as the sensor does"
)]
fn whole(value: f64) -> u32 {
    value.round() as u32
}
