//! What every sensor's protocol gives and takes: the one face of all drivers.

use super::Model;
use crate::time::{Mono, Stamp};
use std::fmt;
use std::time::Duration;

/// One range as the sensor sent it, in its own axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Direction, clockwise from the front mark seen from above, °, in [0, 360).
    pub clockwise_deg: f32,
    /// Distance, m; 0 where nothing came back.
    pub range_m: f32,
    /// Strength of the return in the sensor's own scale; 0 if it tells none.
    pub intensity: u8,
}

/// Samples that left the sensor together, in the order of measurement.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Packet {
    /// The samples.
    pub samples: Vec<Sample>,
    /// When the chunk was read that ended the packet.
    pub received_at: Stamp<Mono>,
    /// Bytes of the packet, and of what followed it in the same chunk.
    pub n_bytes: usize,
    /// From the last sample until the packet begins to leave the sensor.
    pub delay: Duration,
    /// Time between two samples, as the sensor states it.
    pub sample_period: Duration,
    /// Samples lost between the packet before and this one.
    pub n_lost: u32,
    /// Sample times between the packet before and this one in which the sensor does not measure.
    pub n_idle: u32,
    /// Time from the end of the packet before by the sensor's own clock, s.
    pub device_elapsed_s: Option<f64>,
    /// The head's turn ends with this packet.
    pub ends_turn: bool,
}

impl Packet {
    /// Empties the packet for a new one.
    pub(super) fn begin(&mut self, received_at: Stamp<Mono>, n_bytes: usize, period: Duration) {
        let mut samples = std::mem::take(&mut self.samples);
        samples.clear();
        *self = Self { samples, received_at, n_bytes, sample_period: period, ..Self::default() };
    }
}

/// What the driver is to do on the line for the sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// Send these bytes.
    Send(Vec<u8>),
    /// Set the modem line DTR, which switches some motors. A line without modem lines ignores it.
    SetDtr(bool),
}

/// What a protocol met so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Bytes fed.
    pub bytes: u64,
    /// Frames delivered.
    pub frames: u64,
    /// Frames refused for their checksum or for impossible numbers.
    pub checksum_errors: u64,
    /// Bytes that belong to no delivered frame.
    pub skipped_bytes: u64,
    /// Times that the conversation with the sensor was begun anew.
    pub restarts: u64,
}

/// Who the sensor says it is.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Identity {
    /// What it is, as far as it tells or its bytes show.
    pub model: Option<Model>,
    /// The maker's name for it.
    pub name: String,
    /// Firmware version.
    pub firmware: Option<String>,
    /// Serial number.
    pub serial: Option<String>,
    /// Scan mode in use.
    pub mode: Option<String>,
    /// Time between two samples in that mode, where the sensor tells it.
    pub sample_period: Option<Duration>,
}

impl Identity {
    /// `SLAMTEC RPLIDAR A1, firmware 1.29, serial 0A1B`
    #[must_use]
    pub fn said(&self) -> String {
        let model = self.model.map_or("a LiDAR without a name", Model::full_name);
        let name = if self.name.is_empty() { model } else { &self.name };
        let more = [("firmware", &self.firmware), ("serial", &self.serial)];
        more.into_iter().fold(name.to_owned(), |said, (what, value)| match value {
            Some(value) => format!("{said}, {what} {value}"),
            None => said,
        })
    }
}

/// What the sensor itself complains of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Trouble {
    /// What is wrong and how to mend it.
    pub text: String,
}

/// A protocol of a 2D LiDAR without input and output: it is told bytes and the time.
///
/// The driver calls [`restart`](Self::restart) when the port is open, then again and again
/// [`poll`](Self::poll) for what to send and [`feed`](Self::feed) for what came. Whatever comes on
/// the line, none of them panics, and the conversation finds its way back by itself.
pub trait Sensor: fmt::Debug + Send {
    /// The port was opened at `now`: everything begins anew, but for the counts.
    fn restart(&mut self, now: Stamp<Mono>);

    /// What is to be done on the line now; called until it is `None`.
    fn poll(&mut self, now: Stamp<Mono>) -> Option<Request>;

    /// Takes in a chunk read at `now` and hands on each packet that it completes.
    fn feed(&mut self, bytes: &[u8], now: Stamp<Mono>, on_packet: &mut dyn FnMut(&Packet));

    /// What leaves the sensor quiet before the port is closed.
    fn farewell(&self) -> Vec<Request> {
        Vec::new()
    }

    /// Counts so far.
    fn counts(&self) -> Counts;

    /// Who it is, once that is known.
    fn identity(&self) -> Option<&Identity>;

    /// What it complains of now.
    fn trouble(&self) -> Option<&Trouble> {
        None
    }
}
