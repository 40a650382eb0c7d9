//! YDLIDAR: `A5 xx` commands and `AA 55` packets.

#[cfg(test)]
mod oracle;

use super::{Device, Frame, Mishap, sample_at, whole};
use crate::lidar::head::Head;
use crate::lidar::{LidarModel, Scene};
use std::time::Duration;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

const THINKING: Duration = Duration::from_millis(1);
/// Packets leave once the head has this share of its speed.
const SCAN_FROM_SHARE: f64 = 0.5;
/// Samples of a usual packet.
const PACKET_SAMPLES: u32 = 40;
/// Error number while the head does not turn.
const MOTOR_ERROR: u16 = 0x0001;
/// Model byte of the T-mini Pro, whose samples carry an intensity.
const TMINI_PRO: u8 = 150;
/// First model byte of the TG series.
const TG15: u8 = 100;

/// How distances are told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// ¼ mm, beside the head's angle.
    Triangle,
    /// mm.
    TimeOfFlight,
    /// Intensity, then ¼ mm in whole mm above two flag bits.
    WithIntensity,
}

/// The firmware.
#[derive(Debug)]
pub(super) struct Ydlidar {
    model: u8,
    kind: Kind,
    samples_per_s: f64,
    head: Head,
    half_byte: Option<u8>,
    answers: Vec<Frame>,
    wants_scan: bool,
    /// The first sample of the running scan.
    scan_start: Option<Stamp<Mono>>,
    n_samples: u64,
    angle_deg: f64,
    begins_turn: bool,
    error: u16,
}

impl Ydlidar {
    pub(super) fn new(
        model: &LidarModel,
        model_byte: u8,
        seeds: SeedBook,
        now: Stamp<Mono>,
        is_running: bool,
    ) -> Self {
        let kind = match model_byte {
            TMINI_PRO => Kind::WithIntensity,
            TG15.. => Kind::TimeOfFlight,
            _ => Kind::Triangle,
        };
        let only_talks = model_byte == 0;
        let (turns_per_s, jitter) = (model.turns_per_s, model.speed_jitter_ratio);
        let mut head = if only_talks && is_running {
            Head::turning(turns_per_s, jitter, seeds)
        } else {
            Head::at_rest(turns_per_s, jitter, seeds)
        };
        head.drive(only_talks, now);
        Self {
            model: model_byte,
            kind,
            samples_per_s: f64::from(model.samples_per_s),
            head,
            half_byte: None,
            answers: Vec::new(),
            wants_scan: only_talks,
            scan_start: None,
            n_samples: 0,
            angle_deg: seeds.stream("lidar.power_up").between(0.0, 360.0),
            begins_turn: false,
            error: 0,
        }
    }

    fn act(&mut self, command: u8, now: Stamp<Mono>) {
        let mut answer = |kind: u8, payload: &[u8]| {
            let mut bytes = vec![0xA5, 0x5A];
            bytes.extend(u32::try_from(payload.len()).unwrap_or(0).to_le_bytes());
            bytes.push(kind);
            bytes.extend_from_slice(payload);
            self.answers.push(Frame::answer(bytes, now.plus(THINKING)));
        };
        match command {
            0x60 | 0x61 if self.error == 0 => {
                let descriptor = vec![0xA5, 0x5A, 0x05, 0x00, 0x00, 0x40, 0x81];
                self.answers.push(Frame::answer(descriptor, now.plus(THINKING)));
                self.wants_scan = true;
                self.head.drive(true, now);
            }
            0x00 | 0x65 => {
                (self.wants_scan, self.scan_start) = (false, None);
                self.head.drive(false, now);
            }
            0x90 => {
                let mut info = [0; 20];
                // Model, firmware 1.9, hardware 2, serial 2017…
                info[..4].copy_from_slice(&[self.model, 9, 1, 2]);
                info[4..8].copy_from_slice(&[2, 0, 1, 7]);
                answer(0x04, &info);
            }
            0x91 | 0x92 => {
                let [low, high] = self.error.to_le_bytes();
                answer(0x06, &[u8::from(self.error != 0) * 2, low, high]);
            }
            // The highest rate of the TG series, and 9,000/s of a G4.
            0xD1 => answer(0x04, &[if self.model >= TG15 { 3 } else { 2 }]),
            _ => {}
        }
    }

    /// One packet, if it is complete by `until`.
    fn packet(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene) -> Option<Frame> {
        let start = self.scan_start?;
        let step_deg = self.head.share(until) * self.nominal_step_deg();
        let left_in_turn = ((360.0 - self.angle_deg) / step_deg.max(1e-6)).ceil();
        let n = if self.begins_turn { 1 } else { whole(left_in_turn).clamp(1, PACKET_SAMPLES) };
        let ready_at = sample_at(start, self.n_samples + u64::from(n) - 1, self.samples_per_s);
        if ready_at > until {
            return None;
        }
        let step_deg = self.head.next_speed_dps(ready_at) / self.samples_per_s;
        let first_q6 = whole(self.angle_deg * 64.0);
        let last_q6 = whole((self.angle_deg + step_deg * f64::from(n - 1)) * 64.0);
        let span_q6 = f64::from(last_q6 - first_q6);
        let mut samples = Vec::new();
        for k in 0..n {
            let at = sample_at(start, self.n_samples + u64::from(k), self.samples_per_s);
            let share = f64::from(k) / f64::from(n.max(2) - 1);
            let head_deg = (f64::from(first_q6) + span_q6 * share) / 64.0;
            samples.push(self.shoot(at, head_deg, scene));
        }
        let bytes = self.pack(first_q6, last_q6, &samples);
        self.n_samples += u64::from(n);
        let end_deg = self.angle_deg + step_deg * f64::from(n);
        self.begins_turn = end_deg >= 360.0;
        self.angle_deg = end_deg % 360.0;
        Some(Frame { bytes, n_samples: u64::from(n), ready_at })
    }

    fn nominal_step_deg(&self) -> f64 {
        // The X2 to G4 turn about seven to eleven times a second.
        10.0 * 360.0 / self.samples_per_s
    }

    /// Strength and distance of a sample, mm, measured where the receiver will think it was.
    fn shoot(&self, at: Stamp<Mono>, head_deg: f64, scene: &mut dyn Scene) -> (u8, f64) {
        let beam_deg = |mm: f64| (head_deg + self.beside_deg(mm)).rem_euclid(360.0);
        let mut angle_deg = beam_deg(2000.0);
        if self.kind == Kind::Triangle {
            for _ in 0..2 {
                let mm = scene.distance_m(at, angle_deg).map_or(0.0, |m| 1000.0 * m);
                angle_deg = beam_deg(mm);
            }
        }
        scene.echo(at, angle_deg).map_or((0, 0.0), |echo| (echo.intensity, 1000.0 * echo.range_m))
    }

    /// The beam's angle beside the head's in a triangulating sensor, °: its lens stands 21.8 mm off
    /// the axis and meets the front direction 155.3 mm ahead.
    fn beside_deg(&self, mm: f64) -> f64 {
        if self.kind != Kind::Triangle || mm <= 0.0 {
            return 0.0;
        }
        (21.8 / mm - 21.8 / 155.3).atan().to_degrees()
    }

    fn pack(&self, first_q6: u32, last_q6: u32, samples: &[(u8, f64)]) -> Vec<u8> {
        let angle = |q6: u32| u16::try_from((q6 % 23_040) << 1 | 1).unwrap_or(1);
        let (first, last) = (angle(first_q6), angle(last_q6));
        let n = u8::try_from(samples.len()).unwrap_or(u8::MAX);
        // The X4 tells no rate; the others 10.0 Hz, the TG series 3 Hz less than it turns.
        let rate = if self.model >= TG15 { 70_u8 } else { 0 };
        let flags = rate << 1 | u8::from(self.begins_turn);
        let mut sum = 0x55AA ^ first ^ last ^ u16::from_le_bytes([flags, n]);
        let mut body = Vec::new();
        for (intensity, mm) in samples {
            let told = match self.kind {
                Kind::Triangle => whole(mm * 4.0),
                Kind::TimeOfFlight => whole(*mm),
                Kind::WithIntensity => whole(*mm) * 4,
            };
            let told = u16::try_from(told).unwrap_or(0);
            sum ^= told;
            if self.kind == Kind::WithIntensity {
                sum ^= u16::from(*intensity);
                body.push(*intensity);
            }
            body.extend(told.to_le_bytes());
        }
        let mut bytes = vec![0xAA, 0x55, flags, n];
        for word in [first, last, sum] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend(body);
        bytes
    }
}

impl Device for Ydlidar {
    fn hear(&mut self, bytes: &[u8], now: Stamp<Mono>) {
        if self.model == 0 {
            return;
        }
        for byte in bytes {
            match (self.half_byte.take(), *byte) {
                (Some(_), command) => self.act(command, now),
                (None, 0xA5) => self.half_byte = Some(0xA5),
                (None, _) => {}
            }
        }
    }

    fn advance(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene, out: &mut Vec<Frame>) {
        out.append(&mut self.answers);
        if self.head.is_held() {
            (self.error, self.scan_start) = (MOTOR_ERROR, None);
            return;
        }
        self.error = 0;
        if self.wants_scan && self.scan_start.is_none() && self.head.share(until) >= SCAN_FROM_SHARE
        {
            (self.scan_start, self.n_samples) = (Some(until), 0);
        }
        while let Some(frame) = self.packet(until, scene) {
            out.push(frame);
        }
    }

    fn suffer(&mut self, mishap: Mishap, now: Stamp<Mono>) {
        match mishap {
            Mishap::HeadHeld(is_held) => self.head.hold(is_held, now),
            Mishap::InternalError => self.error = MOTOR_ERROR,
        }
    }
}
