//! Samples of the true surface, in the order and rhythm of the sensor.

use super::head::Head;
use super::{LidarModel, Optics, Scene};
use crate::world::World;
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Transform};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// Samples in one packet of the LDROBOT protocol.
pub const SAMPLES_PER_PACKET: usize = 12;
/// The sensor counts its angles in 0.01°.
const CDEG_PER_TURN: f64 = 36_000.0;
/// Its clock starts again at this many milliseconds.
const CLOCK_WRAP_MS: u64 = 30_000;

/// One range as the sensor reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When it was measured, by the stamps that reach the receiver: the true instant if the
    /// model's stamps are not off.
    pub at: Stamp<Mono>,
    /// Clockwise from the front mark, seen from above the sensor, 0.01°, below 36 000.
    ///
    /// This is the angle that a receiver interpolates from the packet's first and last angle.
    pub clockwise_cdeg: f64,
    /// Distance, mm; 0 without a return.
    pub range_mm: u16,
    /// Strength of the return.
    pub intensity: u8,
}

/// Twelve samples that leave the sensor together.
#[derive(Debug, Clone, PartialEq)]
pub struct Packet {
    /// The samples, in the order of measurement.
    pub samples: [Sample; SAMPLES_PER_PACKET],
    /// Speed of the head, °/s.
    pub speed_dps: u16,
    /// Angle of the first sample, 0.01°.
    pub start_cdeg: u16,
    /// Angle of the last sample, 0.01°.
    pub end_cdeg: u16,
    /// The sensor's own clock at the last sample, ms, 0 to 29 999.
    pub clock_ms: u16,
}

/// Twelve samples after twelve samples, while the head turns.
#[derive(Debug, Clone)]
pub(super) struct Rhythm {
    samples_per_s: u32,
    start: Stamp<Mono>,
    /// Samples since `start`.
    n_samples: u64,
    /// Angle of the next sample, 0.01° clockwise.
    angle_cdeg: f64,
    clock_at_start_ms: u64,
    pub(super) head: Head,
}

impl Rhythm {
    /// A sensor somewhere in its turn, whose head has been turning for long.
    pub(super) fn new(model: &LidarModel, seeds: SeedBook, start: Stamp<Mono>) -> Self {
        let mut power_up = seeds.stream("lidar.power_up");
        Self {
            samples_per_s: model.samples_per_s,
            start,
            n_samples: 0,
            angle_cdeg: power_up.between(0.0, CDEG_PER_TURN),
            clock_at_start_ms: power_up.bits() % CLOCK_WRAP_MS,
            head: Head::turning(model.turns_per_s, model.speed_jitter_ratio, seeds),
        }
    }

    /// The next packet, if its last sample is measured at `until` or before.
    pub(super) fn next(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene) -> Option<Packet> {
        const LAST: f64 = SAMPLES_PER_PACKET as f64 - 1.0;
        if self.sample_at(SAMPLES_PER_PACKET as u64 - 1) > until {
            return None;
        }
        let speed_cdeg = 100.0 * self.head.next_speed_dps(self.sample_at(0));
        let step_cdeg = speed_cdeg / f64::from(self.samples_per_s);
        // Receivers only see whole 0.01° at both ends, so the beams point exactly there.
        let start_cdeg = self.angle_cdeg.round() % CDEG_PER_TURN;
        let span_cdeg = (step_cdeg * LAST).round();
        let samples = std::array::from_fn(|i| {
            let turned = start_cdeg + span_cdeg * i as f64 / LAST;
            sample(scene, self.sample_at(i as u64), turned % CDEG_PER_TURN)
        });
        let clock_ms = self.clock_ms(samples[SAMPLES_PER_PACKET - 1].at);
        self.angle_cdeg = (self.angle_cdeg + step_cdeg * (LAST + 1.0)) % CDEG_PER_TURN;
        self.n_samples += SAMPLES_PER_PACKET as u64;
        Some(Packet {
            samples,
            speed_dps: whole(speed_cdeg / 100.0),
            start_cdeg: whole(start_cdeg),
            end_cdeg: whole((start_cdeg + span_cdeg) % CDEG_PER_TURN),
            clock_ms,
        })
    }

    /// When the sample `ahead` of the next one is measured.
    fn sample_at(&self, ahead: u64) -> Stamp<Mono> {
        let n = self.n_samples + ahead;
        let nanos = n * 1_000_000_000 / u64::from(self.samples_per_s);
        self.start.plus(Duration::from_nanos(nanos))
    }

    fn clock_ms(&self, at: Stamp<Mono>) -> u16 {
        let since_start_ms = u64::try_from(at.since(self.start).as_millis()).unwrap_or(0);
        let wrapped = (self.clock_at_start_ms + since_start_ms) % CLOCK_WRAP_MS;
        u16::try_from(wrapped).unwrap_or(0)
    }
}

fn sample(scene: &mut dyn Scene, at: Stamp<Mono>, clockwise_cdeg: f64) -> Sample {
    let echo = scene.echo(at, clockwise_cdeg / 100.0);
    let (range_mm, intensity) =
        echo.map_or((0, 0), |echo| (whole(echo.range_m * 1000.0), echo.intensity));
    Sample { at, clockwise_cdeg, range_mm, intensity }
}

/// A turning head in the true hall, for campaigns.
#[derive(Debug, Clone)]
pub struct LidarSimulator {
    rhythm: Rhythm,
    optics: Optics,
}

impl LidarSimulator {
    /// A sensor that has been switched on before `start`, somewhere in its turn.
    #[must_use]
    pub fn new(model: LidarModel, seeds: SeedBook, start: Stamp<Mono>) -> Self {
        Self { rhythm: Rhythm::new(&model, seeds, start), optics: Optics::new(model, seeds) }
    }

    /// The sensor's numbers.
    #[must_use]
    pub const fn model(&self) -> &LidarModel {
        self.optics.model()
    }

    /// Its optics alone, for an emulated sensor.
    #[must_use]
    pub fn into_optics(self) -> Optics {
        self.optics
    }

    /// All packets whose last sample is measured at `until` or before.
    ///
    /// `hall_from_body` gives the true pose at any instant since the last call.
    pub fn advance(
        &mut self,
        world: &World,
        until: Stamp<Mono>,
        hall_from_body: impl Fn(Stamp<Mono>) -> Transform<Hall, Body>,
    ) -> Vec<Packet> {
        let mut view = self.optics.view(world, hall_from_body);
        std::iter::from_fn(|| self.rhythm.next(until, &mut view)).collect()
    }
}

/// The nearest whole number that the protocol's fields hold.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a float-to-integer cast saturates, as the sensor does"
)]
fn whole(value: f64) -> u16 {
    value.round() as u16
}
