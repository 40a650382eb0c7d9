//! Turns packets into stamped scans.

mod frame_clock;
mod pace;

use super::{Packet, Sample};
use crate::messages::{Beam, Scan};
use crate::time::{Mono, Stamp};
use crate::units::{rad_from_deg, wrapped_rad};
use frame_clock::FrameClock;
use std::time::Duration;

/// A scan is handed on at this age even if the head has not come round.
const MAX_SCAN_AGE: Duration = Duration::from_millis(150);
/// Where the head passes its front mark, angles jitter by some degrees; only an angle that has
/// gone this far since the last turn began ends it, °.
const LEAST_TURN_DEG: f32 = 180.0;
/// A serial line sends a start bit, eight data bits and a stop bit for each byte.
const BITS_PER_BYTE: u64 = 10;

/// What an assembler met so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AssemblerStats {
    /// Beams put into scans, with or without a return.
    pub beams: u64,
    /// Places where packets are missing.
    pub gaps: u64,
    /// Samples that the sensor took but that never came, as far as its angles and its clock tell.
    pub missing_samples: u64,
    /// Times that the estimate of the sensor's clock was begun anew: after a long pause, or because
    /// arrivals had moved away from it.
    pub clock_restarts: u64,
    /// Turns of the head that were completed.
    pub turns: u64,
}

/// Puts packets together to one scan per turn of the head, and stamps every beam.
///
/// The device's clockwise angle becomes the counter-clockwise angle of `Lidar`: device 0° is x,
/// device 270° is y. A sample is measured at
///
/// ```text
/// tᵢ = t_arrival − n_bytes · 10 / baud − t_delay − (n − 1 − i) · T        (1)
/// ```
/// - `t_arrival`: when the chunk that ended the packet was read
/// - `n_bytes`: the packet's bytes and those behind it in the same chunk
/// - `t_delay`: from the last of the `n` samples until the packet leaves the sensor
/// - `T`: time between two samples
///
/// Late arrivals are bounded by the previous packet plus the measured period, so a stalled reader
/// bends no stamps; if all of half a second is late, the bound was wrong and is moved. Stamps never go
/// back.
#[derive(Debug, Clone)]
pub struct ScanAssembler {
    byte_time: Duration,
    clock: FrameClock,
    scan: Scan,
    /// Degrees that the head has gone since the turn began.
    progress_deg: f32,
    last_deg: Option<f32>,
    last_beam_at: Stamp<Mono>,
    /// Of the clocks before this one.
    restarts_before: u64,
    stats: AssemblerStats,
}

impl ScanAssembler {
    /// An assembler for packets that come over a line of `baud` bit/s; 0 for a line without bits,
    /// such as USB.
    #[must_use]
    pub fn new(baud: u32) -> Self {
        let nanos = (BITS_PER_BYTE * 1_000_000_000).checked_div(u64::from(baud));
        Self {
            byte_time: Duration::from_nanos(nanos.unwrap_or(0)),
            clock: FrameClock::new(),
            scan: Scan { start: Stamp::ZERO, beams: Vec::new() },
            progress_deg: 0.0,
            last_deg: None,
            last_beam_at: Stamp::from_nanos(i64::MIN),
            restarts_before: 0,
            stats: AssemblerStats::default(),
        }
    }

    /// Takes in a packet and hands each scan that it completes to `on_scan`.
    pub fn push(&mut self, packet: &Packet, mut on_scan: impl FnMut(Scan)) {
        if packet.samples.is_empty() {
            return;
        }
        if packet.n_lost > 0 {
            self.stats.gaps += 1;
            self.stats.missing_samples += u64::from(packet.n_lost);
            if !packet.ends_turn {
                self.bridge_gap(packet.samples[0].clockwise_deg, &mut on_scan);
            }
        }
        let n_bytes = u32::try_from(packet.n_bytes).unwrap_or(u32::MAX);
        let on_line = self.byte_time.saturating_mul(n_bytes);
        let sent_at = packet.received_at.minus(on_line.saturating_add(packet.delay));
        let last_sample_at = self.clock.last_sample_at(packet, sent_at, on_line);
        self.stats.clock_restarts = self.restarts_before + self.clock.restarts();
        let period = self.clock.sample_period();
        let mut n_later = u32::try_from(packet.samples.len()).unwrap_or(u32::MAX);
        for sample in &packet.samples {
            n_later -= 1;
            let at = last_sample_at.minus(period * n_later).max(self.last_beam_at);
            self.push_sample(*sample, at, &mut on_scan);
        }
        if packet.ends_turn {
            self.end_turn(&mut on_scan);
        }
    }

    /// Hands on the open scan if it began more than 150 ms before `now`.
    pub fn flush_if_old(&mut self, now: Stamp<Mono>, mut on_scan: impl FnMut(Scan)) {
        if now.since(self.scan.start) > MAX_SCAN_AGE {
            self.finish_scan(&mut on_scan);
        }
    }

    /// Hands on the open scan and forgets the sensor's clock, as after a reopened port.
    pub fn reset(&mut self, mut on_scan: impl FnMut(Scan)) {
        self.finish_scan(&mut on_scan);
        self.restarts_before = self.stats.clock_restarts;
        self.clock = FrameClock::new();
        self.last_deg = None;
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> AssemblerStats {
        self.stats
    }

    fn push_sample(&mut self, sample: Sample, at: Stamp<Mono>, on_scan: &mut impl FnMut(Scan)) {
        if self.has_come_round(sample.clockwise_deg) {
            self.end_turn(on_scan);
        } else if at.since(self.scan.start) > MAX_SCAN_AGE {
            self.finish_scan(on_scan);
        }
        if self.scan.beams.is_empty() {
            self.scan.start = at;
        }
        self.scan.beams.push(Beam {
            offset_ns: u32::try_from(at.nanos_since(self.scan.start)).unwrap_or(u32::MAX),
            angle_rad: lidar_angle_rad(sample.clockwise_deg),
            range_m: sample.range_m,
            intensity: sample.intensity,
        });
        self.stats.beams += 1;
        self.last_beam_at = at;
    }

    /// Over a gap the head has gone forward, however far.
    fn bridge_gap(&mut self, clockwise_deg: f32, on_scan: &mut impl FnMut(Scan)) {
        let Some(last_deg) = self.last_deg.replace(clockwise_deg) else { return };
        self.progress_deg += (clockwise_deg - last_deg).rem_euclid(360.0);
        if clockwise_deg < last_deg && self.progress_deg > LEAST_TURN_DEG {
            self.end_turn(on_scan);
        }
    }

    /// True if the head passes its front mark with the step to this angle.
    fn has_come_round(&mut self, clockwise_deg: f32) -> bool {
        let Some(last_deg) = self.last_deg.replace(clockwise_deg) else {
            // Where the first turn began is not known.
            self.progress_deg = LEAST_TURN_DEG;
            return false;
        };
        let step_deg = clockwise_deg - last_deg;
        let passes_mark = step_deg < -180.0;
        let is_back_over_mark = step_deg > 180.0;
        let forward_deg = match (passes_mark, is_back_over_mark) {
            (true, _) => step_deg + 360.0,
            (_, true) => step_deg - 360.0,
            _ => step_deg,
        };
        self.progress_deg += forward_deg;
        passes_mark && self.progress_deg > LEAST_TURN_DEG
    }

    fn end_turn(&mut self, on_scan: &mut impl FnMut(Scan)) {
        self.stats.turns += 1;
        self.progress_deg = 0.0;
        self.finish_scan(on_scan);
    }

    fn finish_scan(&mut self, on_scan: &mut impl FnMut(Scan)) {
        let n_beams = self.scan.beams.len();
        let beams = std::mem::replace(&mut self.scan.beams, Vec::with_capacity(n_beams));
        if !beams.is_empty() {
            on_scan(Scan { start: self.scan.start, beams });
        }
    }
}

/// Counter-clockwise angle in `Lidar`, rad, in (−π, π], from the clockwise angle of the device, °.
#[expect(clippy::cast_possible_truncation, reason = "single precision is what a beam holds")]
fn lidar_angle_rad(device_deg: f32) -> f32 {
    wrapped_rad(-rad_from_deg(f64::from(device_deg))) as f32
}

#[cfg(test)]
mod tests;
