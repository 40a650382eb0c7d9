//! A sensor and its driver on a line without a kernel, in a room of 6 m × 4 m.

use std::time::Duration;
use stockpilot::lidar::{Model, Request, ScanAssembler, Sensor, sensor};
use stockpilot::messages::Scan;
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::lidar::{Device, LidarModel, Optics, Room, device};

pub(crate) const STEP: Duration = Duration::from_millis(2);

/// A model without noise and without lost returns.
pub(crate) fn exact(model: Model) -> LidarModel {
    LidarModel {
        range_sigma_m: 0.0,
        angle_sigma_rad: 0.0,
        dropout_ratio: 0.0,
        ..LidarModel::of(model)
    }
}

pub(crate) fn room(model: &LidarModel) -> Room {
    Room::new(Optics::new(model.clone(), SeedBook::new(1)))
}

/// What the line does to the bytes on their way to the driver.
pub(crate) trait Line {
    fn carry(&mut self, bytes: Vec<u8>) -> Vec<u8>;
}

/// Carries everything.
pub(crate) struct Clean;

impl Line for Clean {
    fn carry(&mut self, bytes: Vec<u8>) -> Vec<u8> {
        bytes
    }
}

/// Flips one bit of this share of the bytes, and halves this share of the frames.
pub(crate) struct Noisy {
    pub(crate) noise: Noise,
    pub(crate) byte_ratio: f64,
    pub(crate) half_ratio: f64,
}

impl Noisy {
    pub(crate) fn new(byte_ratio: f64, half_ratio: f64) -> Self {
        Self { noise: SeedBook::new(7).stream("line"), byte_ratio, half_ratio }
    }
}

impl Line for Noisy {
    fn carry(&mut self, mut bytes: Vec<u8>) -> Vec<u8> {
        for byte in &mut bytes {
            if self.noise.chance(self.byte_ratio) {
                *byte ^= 1 << (self.noise.bits() % 8);
            }
        }
        if self.noise.chance(self.half_ratio) {
            bytes.truncate(bytes.len() / 2);
        }
        bytes
    }
}

/// A sensor that has just got its power, its driver, and the room.
pub(crate) struct Bench {
    pub(crate) device: Box<dyn Device>,
    pub(crate) sensor: Box<dyn Sensor>,
    pub(crate) assembler: ScanAssembler,
    pub(crate) room: Room,
    pub(crate) now: Stamp<Mono>,
    pub(crate) scans: Vec<Scan>,
}

impl Bench {
    pub(crate) fn new(model: Model) -> Self {
        let exact = exact(model);
        let now = Stamp::ZERO.plus(Duration::from_secs(100));
        let mut sensor = sensor(model);
        sensor.restart(now);
        Self {
            device: device(&exact, SeedBook::new(3), now, false),
            sensor,
            assembler: ScanAssembler::new(0),
            room: room(&exact),
            now,
            scans: Vec::new(),
        }
    }

    /// Goes on for a while; bytes take no time on this line.
    pub(crate) fn run(&mut self, seconds: f64, line: &mut dyn Line) {
        let end = self.now.plus(Duration::from_secs_f64(seconds));
        while self.now < end {
            self.now = self.now.plus(STEP);
            while let Some(request) = self.sensor.poll(self.now) {
                if let Request::Send(bytes) = request {
                    self.device.hear(&bytes, self.now);
                }
            }
            let mut frames = Vec::new();
            self.device.advance(self.now, &mut self.room, &mut frames);
            let Self { sensor, assembler, scans, now, .. } = self;
            for frame in frames {
                let bytes = line.carry(frame.bytes);
                sensor.feed(&bytes, *now, &mut |packet| {
                    assembler.push(packet, |scan| scans.push(scan));
                });
            }
        }
    }

    /// Distances from the walls of all beams with a return, mm: `(how many, median, 99 %, largest)`.
    pub(crate) fn errors_mm(&self) -> (usize, f64, f64, f64) {
        let beams = self.scans.iter().flat_map(|scan| &scan.beams);
        let mut errors: Vec<f64> = beams
            .filter(|beam| beam.range_m > 0.0)
            .map(|beam| {
                let clockwise_deg = -f64::from(beam.angle_rad).to_degrees();
                let (wall_m, _) = self.room.wall(clockwise_deg);
                (f64::from(beam.range_m) - wall_m).abs() * 1000.0
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        let at = |percent: usize| errors[(errors.len() - 1) * percent / 100];
        (errors.len(), at(50), at(99), at(100))
    }
}
