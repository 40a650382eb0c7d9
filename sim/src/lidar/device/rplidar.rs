//! Slamtec RPLIDAR: requests, scan modes, and the six formats of samples.

mod catalogue;
mod formats;
#[cfg(test)]
mod oracle;
mod scan;

use super::{Device, Frame, Mishap};
use crate::lidar::head::Head;
use crate::lidar::{LidarModel, Scene};
use catalogue::{Catalogue, Motor};
use scan::Scan;
use std::time::Duration;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

pub use formats::Format;

/// An answer leaves this long after its request.
const THINKING: Duration = Duration::from_millis(1);
/// From a reset to its banner, as measured on an A1.
const REBOOT: Duration = Duration::from_millis(671);
/// Samples leave once the head has this share of its speed.
const SCAN_FROM_SHARE: f64 = 0.9;
/// Error number while the head does not turn. The maker does not publish his.
const MOTOR_ERROR: u16 = 0x0001;
const INTERNAL_ERROR: u16 = 0x0042;

/// The firmware.
#[derive(Debug)]
pub(super) struct Rplidar {
    catalogue: Catalogue,
    head: Head,
    inbox: Vec<u8>,
    answers: Vec<Frame>,
    scan: Option<Scan>,
    wanted: Option<usize>,
    reboots_until: Option<Stamp<Mono>>,
    error: u16,
    angle_deg: f64,
}

impl Rplidar {
    pub(super) fn new(model: &LidarModel, model_byte: u8, seeds: SeedBook) -> Self {
        let catalogue = Catalogue::of(model_byte);
        let mut head = Head::at_rest(model.turns_per_s, model.speed_jitter_ratio, seeds);
        // An A1 turns whenever DTR lets it, and a pseudo-terminal has no DTR.
        head.drive(catalogue.motor == Motor::Dtr, Stamp::ZERO);
        Self {
            catalogue,
            head,
            inbox: Vec::new(),
            answers: Vec::new(),
            scan: None,
            wanted: None,
            reboots_until: None,
            error: 0,
            angle_deg: seeds.stream("lidar.power_up").between(0.0, 360.0),
        }
    }

    /// Acts on one whole request.
    fn act(&mut self, command: u8, payload: &[u8], now: Stamp<Mono>) {
        // Any request ends a scan.
        (self.scan, self.wanted) = (None, None);
        let at = now.plus(THINKING);
        let mut answer = |kind: u8, payload: &[u8]| {
            self.answers.push(Frame::answer(single(kind, payload), at));
        };
        match (command, payload) {
            (0x25, _) if self.catalogue.motor == Motor::Internal => self.head.drive(false, now),
            (0x40, _) => {
                self.reboots_until = Some(now.plus(REBOOT));
                self.error = 0;
            }
            (0x50, _) => answer(0x04, &self.catalogue.info()),
            (0x52, _) => {
                let status = if self.error == 0 { 0 } else { 2 };
                let [low, high] = self.error.to_le_bytes();
                answer(0x06, &[status, low, high]);
            }
            (0x59, _) => answer(0x15, &self.catalogue.sample_rates()),
            (0x84, [i0, i1, i2, i3, rest @ ..]) => {
                let item = u32::from_le_bytes([*i0, *i1, *i2, *i3]);
                let mode = rest.first_chunk::<2>().map(|b| usize::from(u16::from_le_bytes(*b)));
                if let Some(value) = self.catalogue.conf(item, mode) {
                    answer(0x20, &[item.to_le_bytes().to_vec(), value].concat());
                }
            }
            (0xFF, _) if self.catalogue.motor == Motor::Pwm => answer(0xFF, &[1, 0, 0, 0]),
            (0x20 | 0x21, _) => self.begin(0, now),
            (0x82, [mode, ..]) => self.begin(usize::from(*mode), now),
            (0xF0, [low, high]) if self.catalogue.motor == Motor::Pwm => {
                self.head.drive(u16::from_le_bytes([*low, *high]) > 0, now);
            }
            (0xA8, [low, high]) if self.catalogue.motor == Motor::Speed => {
                self.head.drive(u16::from_le_bytes([*low, *high]) > 0, now);
            }
            _ => {}
        }
    }

    fn begin(&mut self, mode: usize, now: Stamp<Mono>) {
        let Some(known) = self.catalogue.modes.get(mode) else { return };
        if self.error != 0 {
            return;
        }
        let (length, kind) = (known.format.bytes(), known.format.kind());
        let mut bytes = vec![0xA5, 0x5A];
        bytes.extend((length | 1 << 30).to_le_bytes());
        bytes.push(kind);
        self.answers.push(Frame::answer(bytes, now.plus(THINKING)));
        self.wanted = Some(mode);
        if self.catalogue.motor == Motor::Internal {
            self.head.drive(true, now);
        }
    }

    /// Takes whole requests out of the inbox; those with a wrong checksum are ignored in silence.
    fn take_requests(&mut self, now: Stamp<Mono>) {
        while let Some(start) = self.inbox.iter().position(|byte| *byte == 0xA5) {
            self.inbox.drain(..start);
            let Some(command) = self.inbox.get(1).copied() else { return };
            if command & 0x80 == 0 {
                self.inbox.drain(..2);
                self.act(command, &[], now);
                continue;
            }
            let Some(length) = self.inbox.get(2).map(|byte| usize::from(*byte)) else { return };
            if self.inbox.len() < length + 4 {
                return;
            }
            let request: Vec<u8> = self.inbox.drain(..length + 4).collect();
            let (sum, guarded) = (request[length + 3], &request[..length + 3]);
            if guarded.iter().fold(0, |xor, byte| xor ^ byte) == sum {
                self.act(command, &guarded[3..], now);
            }
        }
        self.inbox.clear();
    }
}

impl Device for Rplidar {
    fn hear(&mut self, bytes: &[u8], now: Stamp<Mono>) {
        if self.reboots_until.is_none() {
            self.inbox.extend_from_slice(bytes);
            self.take_requests(now);
        }
    }

    fn advance(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene, out: &mut Vec<Frame>) {
        if let Some(at) = self.reboots_until.filter(|at| *at <= until) {
            self.reboots_until = None;
            out.push(Frame::answer(self.catalogue.banner(), at));
        }
        out.append(&mut self.answers);
        if self.head.is_held() {
            // The firmware notices, stops its laser and reports it.
            self.scan = None;
            self.error = MOTOR_ERROR;
        }
        if let Some(mode) = self.wanted
            && self.head.share(until) >= SCAN_FROM_SHARE
        {
            self.wanted = None;
            let mode = &self.catalogue.modes[mode];
            self.scan = Some(Scan::new(mode.format, mode.period_us, self.angle_deg, until));
        }
        if let Some(scan) = &mut self.scan {
            scan.advance(until, &mut self.head, scene, out);
        }
    }

    fn suffer(&mut self, mishap: Mishap, now: Stamp<Mono>) {
        match mishap {
            Mishap::HeadHeld(is_held) => self.head.hold(is_held, now),
            Mishap::InternalError => {
                self.error = INTERNAL_ERROR;
                (self.scan, self.wanted) = (None, None);
            }
        }
    }
}

/// A single reply: descriptor and payload.
fn single(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xA5, 0x5A];
    bytes.extend(u32::try_from(payload.len()).unwrap_or(0).to_le_bytes());
    bytes.push(kind);
    bytes.extend_from_slice(payload);
    bytes
}
