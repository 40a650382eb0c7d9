//! Turns frames into stamped scans.

mod frame_clock;
mod gap;

use super::Model;
use super::ldrobot::{FRAME_BYTES, FRAME_SAMPLES, Frame};
use crate::messages::{Beam, Scan};
use crate::time::{Mono, Stamp};
use crate::units::{rad_from_deg, wrapped_rad};
use frame_clock::FrameClock;
use gap::frames_between;
use std::time::Duration;

/// A scan is handed on at this age even if the head has not come round.
const MAX_SCAN_AGE: Duration = Duration::from_millis(150);
/// A step back of the angle by more than this is a new turn, not jitter of the encoder, °.
const WRAP_STEP_DEG: f64 = 5.0;
/// A serial line sends a start bit, eight data bits and a stop bit for each byte.
const BITS_PER_BYTE: u64 = 10;

/// What an assembler met so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AssemblerStats {
    /// Beams put into scans, with or without a return.
    pub beams: u64,
    /// Places where frames are missing.
    pub gaps: u64,
    /// Samples that the sensor took but that never came, as far as angle and device time tell.
    pub missing_samples: u64,
    /// Times that the estimate of the sensor's clock was begun anew after a long pause.
    pub clock_restarts: u64,
}

/// Puts frames together to one scan per turn of the head, and stamps every beam.
///
/// The device's clockwise angle becomes the counter-clockwise angle of `Lidar`: device 0° is x,
/// device 270° is y. A sample is measured at
///
/// ```text
/// tᵢ = t_arrival − n_bytes · 10 / baud − (11 − i) · T        (1)
/// ```
/// - `t_arrival`: when the chunk that ended the frame was read
/// - `n_bytes`: the frame's 47 bytes and those behind it in the same chunk
/// - `T`: time between two samples
///
/// The frame is taken to leave the sensor right after its last sample. Late arrivals are bounded by
/// the previous frame plus the nominal period, so a stalled reader bends no stamps. Stamps never
/// go back.
#[derive(Debug, Clone)]
pub struct ScanAssembler {
    model: Model,
    byte_time: Duration,
    clock: FrameClock,
    previous: Option<Frame>,
    scan: Scan,
    last_angle_deg: f64,
    last_beam_at: Stamp<Mono>,
    stats: AssemblerStats,
}

impl ScanAssembler {
    /// An assembler for frames of `model` that come over a line of `baud` bit/s.
    #[must_use]
    pub fn new(model: Model, baud: u32) -> Self {
        Self {
            model,
            byte_time: Duration::from_nanos(BITS_PER_BYTE * 1_000_000_000 / u64::from(baud.max(1))),
            clock: FrameClock::new(model.sample_period()),
            previous: None,
            scan: Scan { start: Stamp::ZERO, beams: Vec::new() },
            last_angle_deg: 0.0,
            last_beam_at: Stamp::from_nanos(i64::MIN),
            stats: AssemblerStats::default(),
        }
    }

    /// Takes in a frame that ended `n_bytes_after` bytes before the end of a chunk read at
    /// `received_at`, and hands each scan that it completes to `on_scan`.
    pub fn push(
        &mut self,
        frame: &Frame,
        received_at: Stamp<Mono>,
        n_bytes_after: usize,
        mut on_scan: impl FnMut(Scan),
    ) {
        let n_frames = self.note_gap(frame);
        let n_bytes = u32::try_from(FRAME_BYTES + n_bytes_after).unwrap_or(u32::MAX);
        let sent_at = received_at.minus(self.byte_time * n_bytes);
        let last_sample_at = self.clock.last_sample_at(frame, sent_at, n_frames);
        self.stats.clock_restarts = self.clock.restarts();
        for sample_idx in 0..FRAME_SAMPLES {
            self.push_sample(frame, sample_idx, last_sample_at, &mut on_scan);
        }
        self.previous = Some(*frame);
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
        self.previous = None;
        self.clock = FrameClock::new(self.model.sample_period());
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> AssemblerStats {
        self.stats
    }

    /// Frames from the previous one to this one; 1 if none is missing.
    fn note_gap(&mut self, frame: &Frame) -> u32 {
        let n_frames =
            self.previous.map_or(1, |previous| frames_between(&previous, frame, self.model));
        if n_frames > 1 {
            self.stats.gaps += 1;
            self.stats.missing_samples += u64::from(n_frames - 1) * FRAME_SAMPLES as u64;
        }
        n_frames
    }

    fn push_sample(
        &mut self,
        frame: &Frame,
        sample_idx: usize,
        last_sample_at: Stamp<Mono>,
        on_scan: &mut impl FnMut(Scan),
    ) {
        let n_later = u32::try_from(FRAME_SAMPLES - 1 - sample_idx).unwrap_or(0);
        let at = last_sample_at.minus(self.clock.sample_period() * n_later).max(self.last_beam_at);
        let angle_deg = frame.angle_deg(sample_idx);
        let is_new_turn = angle_deg < self.last_angle_deg - WRAP_STEP_DEG;
        if is_new_turn || at.since(self.scan.start) > MAX_SCAN_AGE {
            self.finish_scan(on_scan);
        }
        if self.scan.beams.is_empty() {
            self.scan.start = at;
        }
        let sample = frame.samples[sample_idx];
        self.scan.beams.push(Beam {
            offset_ns: u32::try_from(at.nanos_since(self.scan.start)).unwrap_or(u32::MAX),
            angle_rad: lidar_angle_rad(angle_deg),
            range_m: f32::from(sample.range_mm) / 1000.0,
            intensity: sample.intensity,
        });
        self.stats.beams += 1;
        self.last_angle_deg = angle_deg;
        self.last_beam_at = at;
    }

    fn finish_scan(&mut self, on_scan: &mut impl FnMut(Scan)) {
        let beams = std::mem::take(&mut self.scan.beams);
        if !beams.is_empty() {
            on_scan(Scan { start: self.scan.start, beams });
        }
    }
}

/// Counter-clockwise angle in `Lidar`, rad, in (−π, π], from the clockwise angle of the device, °.
#[expect(clippy::cast_possible_truncation, reason = "single precision is what a beam holds")]
fn lidar_angle_rad(device_deg: f64) -> f32 {
    wrapped_rad(-rad_from_deg(device_deg)) as f32
}

#[cfg(test)]
mod tests;
