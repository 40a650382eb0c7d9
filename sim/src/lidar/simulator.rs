//! Samples of the true surface, in the order and rhythm of the sensor.

use super::LidarModel;
use crate::raycast::{self, RayHit, Surface};
use crate::world::World;
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Lidar, Transform};
use stockpilot::stats::{Noise, SeedBook};
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

/// A turning head.
#[derive(Debug, Clone)]
pub struct LidarSimulator {
    model: LidarModel,
    start: Stamp<Mono>,
    /// Samples since `start`.
    n_samples: u64,
    /// Angle of the next sample, 0.01° clockwise.
    angle_cdeg: f64,
    speed_error_ratio: f64,
    clock_at_start_ms: u64,
    range_noise: Noise,
    dropout_noise: Noise,
    speed_noise: Noise,
    dust: Noise,
    mixing: Noise,
}

impl LidarSimulator {
    /// A sensor that has been switched on before `start`, somewhere in its turn.
    #[must_use]
    pub fn new(model: LidarModel, seeds: SeedBook, start: Stamp<Mono>) -> Self {
        let mut power_up = seeds.stream("lidar.power_up");
        Self {
            model,
            start,
            n_samples: 0,
            angle_cdeg: power_up.between(0.0, CDEG_PER_TURN),
            speed_error_ratio: 0.0,
            clock_at_start_ms: power_up.bits() % CLOCK_WRAP_MS,
            range_noise: seeds.stream("lidar.range"),
            dropout_noise: seeds.stream("lidar.dropout"),
            speed_noise: seeds.stream("lidar.speed"),
            dust: seeds.stream("lidar.dust"),
            mixing: seeds.stream("lidar.mixing"),
        }
    }

    /// The sensor's numbers.
    #[must_use]
    pub fn model(&self) -> &LidarModel {
        &self.model
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
        let mut packets = Vec::new();
        while self.sample_at(SAMPLES_PER_PACKET as u64 - 1) <= until {
            packets.push(self.packet(world, &hall_from_body));
        }
        packets
    }

    /// When the sample `ahead` of the next one is measured.
    fn sample_at(&self, ahead: u64) -> Stamp<Mono> {
        let n = self.n_samples + ahead;
        let nanos = n * 1_000_000_000 / u64::from(self.model.samples_per_s);
        self.start.plus(Duration::from_nanos(nanos))
    }

    fn packet(
        &mut self,
        world: &World,
        hall_from_body: &impl Fn(Stamp<Mono>) -> Transform<Hall, Body>,
    ) -> Packet {
        const LAST: f64 = SAMPLES_PER_PACKET as f64 - 1.0;
        let speed_cdeg = self.next_speed_cdeg_per_s();
        let step_cdeg = speed_cdeg / f64::from(self.model.samples_per_s);
        // Receivers only see whole 0.01° at both ends, so the beams point exactly there.
        let start_cdeg = self.angle_cdeg.round() % CDEG_PER_TURN;
        let span_cdeg = (step_cdeg * LAST).round();
        let samples = std::array::from_fn(|i| {
            let turned = start_cdeg + span_cdeg * i as f64 / LAST;
            self.sample(world, self.sample_at(i as u64), turned % CDEG_PER_TURN, hall_from_body)
        });
        let clock_ms = self.clock_ms(samples[SAMPLES_PER_PACKET - 1].at);
        self.angle_cdeg = (self.angle_cdeg + step_cdeg * (LAST + 1.0)) % CDEG_PER_TURN;
        self.n_samples += SAMPLES_PER_PACKET as u64;
        Packet {
            samples,
            speed_dps: whole(speed_cdeg / 100.0),
            start_cdeg: whole(start_cdeg),
            end_cdeg: whole((start_cdeg + span_cdeg) % CDEG_PER_TURN),
            clock_ms,
        }
    }

    /// The speed wanders around its nominal value with a memory of about 50 packets.
    fn next_speed_cdeg_per_s(&mut self) -> f64 {
        const MEMORY: f64 = 0.98;
        let kick = (1.0 - MEMORY * MEMORY).sqrt() * self.model.speed_jitter_ratio;
        self.speed_error_ratio = MEMORY * self.speed_error_ratio + kick * self.speed_noise.normal();
        self.model.turns_per_s * CDEG_PER_TURN * (1.0 + self.speed_error_ratio)
    }

    fn clock_ms(&self, at: Stamp<Mono>) -> u16 {
        let since_start_ms = u64::try_from(at.since(self.start).as_millis()).unwrap_or(0);
        let wrapped = (self.clock_at_start_ms + since_start_ms) % CLOCK_WRAP_MS;
        u16::try_from(wrapped).unwrap_or(0)
    }

    fn sample(
        &mut self,
        world: &World,
        at: Stamp<Mono>,
        clockwise_cdeg: f64,
        hall_from_body: &impl Fn(Stamp<Mono>) -> Transform<Hall, Body>,
    ) -> Sample {
        let hall_from_lidar = hall_from_body(self.measured_at(at)) * self.model.body_from_lidar;
        let angle_rad = -clockwise_cdeg / CDEG_PER_TURN * std::f64::consts::TAU;
        let beam = |angle_rad: f64| {
            // The device counts clockwise about its z axis, the frame counter-clockwise.
            let (sin, cos) = angle_rad.sin_cos();
            let direction = hall_from_lidar.rotation * Direction::<Lidar>::new(cos, sin, 0.0);
            let reach_m = self.model.range_max_m;
            (raycast::cast(world, &hall_from_lidar.origin, &direction, reach_m), direction)
        };
        let (hit, direction) = beam(angle_rad);
        let half_rad = self.model.half_width_rad;
        let edges = (half_rad > 0.0).then(|| {
            [angle_rad - half_rad, angle_rad + half_rad]
                .map(|at_rad| beam(at_rad).0.map(|hit| hit.distance_m))
        });
        let hit = match (hit, edges) {
            (Some(hit), Some([Some(a_m), Some(b_m)])) => {
                Some(self.mixed(&hit, &direction, (a_m.min(b_m), a_m.max(b_m))))
            }
            _ => hit,
        };
        let hit = self.with_dust(hit, &direction);
        let echo = hit.and_then(|hit| self.echo(&hit, &direction));
        let (range_mm, intensity) = echo.unwrap_or((0, 0));
        Sample { at, clockwise_cdeg, range_mm, intensity }
    }

    /// The true instant of a sample with this stamp.
    fn measured_at(&self, stamp: Stamp<Mono>) -> Stamp<Mono> {
        let offset = Duration::from_secs_f64(self.model.stamp_offset_s.abs());
        if self.model.stamp_offset_s > 0.0 { stamp.minus(offset) } else { stamp.plus(offset) }
    }

    /// A range between two surfaces, if the edges of the beam's cone meet two.
    ///
    /// One smooth surface spreads the cone by 2 δ d tan ι (δ: half width, ι: angle of incidence);
    /// far more than that is an edge in depth. Where the range ends up depends on how the light is
    /// shared, which is drawn.
    fn mixed(
        &mut self,
        hit: &RayHit,
        along: &Direction<Hall>,
        (near_m, far_m): (f64, f64),
    ) -> RayHit {
        const LEAST_JUMP_M: f64 = 0.1;
        const FAR_MORE: f64 = 3.0;
        let share = self.mixing.uniform();
        let square_on = hit.normal.coords.dot(&along.coords).abs().max(0.05);
        let smooth_m = 2.0 * self.model.half_width_rad * hit.distance_m * square_on.recip();
        let jump_m = far_m - near_m;
        if jump_m < LEAST_JUMP_M.max(FAR_MORE * smooth_m) {
            return *hit;
        }
        RayHit { distance_m: near_m + share * jump_m, ..*hit }
    }

    /// The hit, or a grain of dust anywhere before it.
    fn with_dust(&mut self, hit: Option<RayHit>, along: &Direction<Hall>) -> Option<RayHit> {
        if self.model.dust_ratio <= 0.0 {
            return hit;
        }
        let (is_dust, share) = (self.dust.chance(self.model.dust_ratio), self.dust.uniform());
        if !is_dust {
            return hit;
        }
        let free_m = hit.map_or(self.model.range_max_m, |hit| hit.distance_m);
        let normal = Direction::from_coords(-along.coords);
        Some(RayHit { distance_m: share * free_m, normal, surface: Surface::Dust })
    }

    /// The reported range (mm) and intensity of a hit; `None` if the echo is lost.
    fn echo(&mut self, hit: &RayHit, direction: &Direction<Hall>) -> Option<(u16, u8)> {
        let square_on = hit.normal.coords.dot(&direction.coords).abs();
        let reach_ratio = hit.distance_m / self.model.range_max_m;
        // Draw both numbers for every beam, so that one lost echo does not shift the others.
        let noise_m = self.model.range_sigma_m * self.range_noise.normal();
        if self.dropout_noise.chance(self.dropout_ratio(reach_ratio, square_on)) {
            return None;
        }
        let range_m =
            hit.distance_m * (1.0 + self.model.range_scale) + self.model.range_bias_m + noise_m;
        let is_in_range = (self.model.range_min_m..=self.model.range_max_m).contains(&range_m);
        let strength = 230.0 * square_on.max(0.05) / (1.0 + 2.0 * reach_ratio * reach_ratio);
        let intensity = u8::try_from(whole(strength)).unwrap_or(u8::MAX);
        is_in_range.then(|| (whole(range_m * 1000.0), intensity))
    }

    /// Echoes get lost more often far away, and below 10° of grazing angle.
    fn dropout_ratio(&self, reach_ratio: f64, square_on: f64) -> f64 {
        const GRAZING: f64 = 0.17;
        let far = 0.02 * reach_ratio.powi(4);
        let grazing = 0.6 * (1.0 - square_on / GRAZING).max(0.0);
        self.model.dropout_ratio + far + grazing
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
