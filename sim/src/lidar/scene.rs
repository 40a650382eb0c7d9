//! What a sensor sees: the true hall through its optics, or an empty room.

use super::LidarModel;
use super::fading::{DarkPatches, Fading, chance_of_echo};
use crate::raycast::{self, RayHit, Surface};
use crate::world::World;
use nalgebra::Vector3;
use std::fmt;
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Lidar, Transform};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

/// A return as the sensor measures it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Echo {
    /// Distance with its errors, m.
    pub range_m: f64,
    /// Strength of the return.
    pub intensity: u8,
}

/// Whatever is around a sensor. Angles are clockwise from the front mark, °.
pub trait Scene {
    /// The distance to the first surface, without noise; `None` beyond the sensor's reach.
    fn distance_m(&mut self, at: Stamp<Mono>, clockwise_deg: f64) -> Option<f64>;

    /// What the sensor measures there; `None` if nothing comes back.
    fn echo(&mut self, at: Stamp<Mono>, clockwise_deg: f64) -> Option<Echo>;
}

/// The sensor's optics with everything that is drawn for it.
#[derive(Debug, Clone)]
pub struct Optics {
    model: LidarModel,
    range_noise: Noise,
    angle_noise: Noise,
    dropout_noise: Noise,
    dark_patches: DarkPatches,
    dust: Noise,
    mixing: Noise,
}

/// The true hall, seen from a moving vehicle.
pub struct HallView<'a, P> {
    optics: &'a mut Optics,
    world: &'a World,
    hall_from_body: P,
}

impl<P> fmt::Debug for HallView<'_, P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HallView").field("world", &self.world.name).finish_non_exhaustive()
    }
}

impl Optics {
    /// The optics of a model.
    #[must_use]
    pub fn new(model: LidarModel, seeds: SeedBook) -> Self {
        Self {
            model,
            range_noise: seeds.stream("lidar.range"),
            angle_noise: seeds.stream("lidar.angle"),
            dropout_noise: seeds.stream("lidar.dropout"),
            dark_patches: DarkPatches::drawn(seeds),
            dust: seeds.stream("lidar.dust"),
            mixing: seeds.stream("lidar.mixing"),
        }
    }

    /// The sensor's numbers.
    #[must_use]
    pub const fn model(&self) -> &LidarModel {
        &self.model
    }

    /// The hall through these optics; `hall_from_body` gives the true pose at any instant.
    pub fn view<'a, P: Fn(Stamp<Mono>) -> Transform<Hall, Body>>(
        &'a mut self,
        world: &'a World,
        hall_from_body: P,
    ) -> HallView<'a, P> {
        HallView { optics: self, world, hall_from_body }
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

    /// The measured echo of a hit at this distance and squareness, from a surface of this
    /// reflectivity; `None` if it is lost.
    pub(super) fn echo(
        &mut self,
        distance_m: f64,
        square_on: f64,
        reflectivity: f64,
    ) -> Option<Echo> {
        let reach_ratio = distance_m / self.model.range_max_m;
        // Draw both numbers for every beam, so that one lost echo does not shift the others.
        let noise_m = self.model.range_sigma_m * self.range_noise.normal();
        if self.dropout_noise.chance(self.dropout_ratio(reach_ratio, square_on, reflectivity)) {
            return None;
        }
        let range_m =
            distance_m * (1.0 + self.model.range_scale) + self.model.range_bias_m + noise_m;
        let is_in_range = (self.model.range_min_m..=self.model.range_max_m).contains(&range_m);
        let strength =
            230.0 * reflectivity * square_on.max(0.05) / (1.0 + 2.0 * reach_ratio * reach_ratio);
        let intensity = strength_of(strength);
        is_in_range.then_some(Echo { range_m, intensity })
    }

    /// What a surface sends back at a place in the hall, 1 for white.
    fn reflectivity(&self, surface: Surface, place_m: &Vector3<f64>) -> f64 {
        let is_patchy = self.model.fading == Fading::DarkPatches && surface == Surface::Material;
        if is_patchy { self.dark_patches.reflectivity(place_m.x, place_m.y) } else { 1.0 }
    }

    /// Echoes get lost more often far away, and below 10° of grazing angle; where they fade, long
    /// before that.
    fn dropout_ratio(&self, reach_ratio: f64, square_on: f64, reflectivity: f64) -> f64 {
        const GRAZING: f64 = 0.17;
        if self.model.fading != Fading::None {
            let chance = chance_of_echo(reach_ratio, square_on, reflectivity);
            return 1.0 - (1.0 - self.model.dropout_ratio) * chance;
        }
        let far = 0.02 * reach_ratio.powi(4);
        let grazing = 0.6 * (1.0 - square_on / GRAZING).max(0.0);
        self.model.dropout_ratio + far + grazing
    }
}

impl<P: Fn(Stamp<Mono>) -> Transform<Hall, Body>> HallView<'_, P> {
    /// Casts a beam at this counter-clockwise angle.
    fn cast(
        &self,
        hall_from_lidar: &Transform<Hall, Lidar>,
        angle_rad: f64,
    ) -> (Option<RayHit>, Direction<Hall>) {
        let (sin, cos) = angle_rad.sin_cos();
        let direction = hall_from_lidar.rotation * Direction::<Lidar>::new(cos, sin, 0.0);
        let reach_m = self.optics.model.range_max_m;
        (raycast::cast(self.world, &hall_from_lidar.origin, &direction, reach_m), direction)
    }

    fn hall_from_lidar(&self, at: Stamp<Mono>) -> Transform<Hall, Lidar> {
        (self.hall_from_body)(self.optics.measured_at(at)) * self.optics.model.body_from_lidar
    }
}

impl<P: Fn(Stamp<Mono>) -> Transform<Hall, Body>> Scene for HallView<'_, P> {
    fn distance_m(&mut self, at: Stamp<Mono>, clockwise_deg: f64) -> Option<f64> {
        let (hit, _) = self.cast(&self.hall_from_lidar(at), counter_clockwise_rad(clockwise_deg));
        hit.map(|hit| hit.distance_m)
    }

    fn echo(&mut self, at: Stamp<Mono>, clockwise_deg: f64) -> Option<Echo> {
        let hall_from_lidar = self.hall_from_lidar(at);
        // Drawn for every beam, so that a lost echo does not shift the others.
        let jitter_rad = self.optics.model.angle_sigma_rad * self.optics.angle_noise.normal();
        let angle_rad = counter_clockwise_rad(clockwise_deg) + jitter_rad;
        let (hit, direction) = self.cast(&hall_from_lidar, angle_rad);
        let half_rad = self.optics.model.half_width_rad;
        let edges = (half_rad > 0.0).then(|| {
            [angle_rad - half_rad, angle_rad + half_rad]
                .map(|at_rad| self.cast(&hall_from_lidar, at_rad).0.map(|hit| hit.distance_m))
        });
        let hit = match (hit, edges) {
            (Some(hit), Some([Some(a_m), Some(b_m)])) => {
                Some(self.optics.mixed(&hit, &direction, (a_m.min(b_m), a_m.max(b_m))))
            }
            _ => hit,
        };
        let hit = self.optics.with_dust(hit, &direction)?;
        let square_on = hit.normal.coords.dot(&direction.coords).abs();
        let place_m = hall_from_lidar.origin.coords + hit.distance_m * direction.coords;
        let reflectivity = self.optics.reflectivity(hit.surface, &place_m);
        self.optics.echo(hit.distance_m, square_on, reflectivity)
    }
}

/// The device counts clockwise about its z axis, the frame counter-clockwise.
fn counter_clockwise_rad(clockwise_deg: f64) -> f64 {
    -clockwise_deg / 360.0 * std::f64::consts::TAU
}

/// The nearest whole strength.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a float-to-integer cast saturates, as the sensor does"
)]
fn strength_of(strength: f64) -> u8 {
    strength.round() as u8
}

/// A rectangular room around a sensor at rest, for emulators without a hall.
#[derive(Debug, Clone)]
pub struct Room {
    optics: Optics,
    half_length_m: f64,
    half_width_m: f64,
    parts: Vec<Part>,
}

/// A part of the vehicle that the sensor sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// From this direction, clockwise, in [0, 360), °.
    pub from_deg: f64,
    /// To this one, °; smaller if the part lies about 0.
    pub to_deg: f64,
    /// How far it is, m.
    pub distance_m: f64,
}

impl Part {
    fn holds(&self, clockwise_deg: f64) -> bool {
        let (from, to) = (self.from_deg, self.to_deg);
        let is_after = clockwise_deg >= from;
        if from <= to { is_after && clockwise_deg < to } else { is_after || clockwise_deg < to }
    }
}

impl Room {
    /// 6 m along the front mark, 4 m across, the sensor in the middle.
    #[must_use]
    pub const fn new(optics: Optics) -> Self {
        Self { optics, half_length_m: 3.0, half_width_m: 2.0, parts: Vec::new() }
    }

    /// The walls ahead and behind at this distance.
    #[must_use]
    pub fn with_half_length_m(mut self, half_length_m: f64) -> Self {
        self.half_length_m = half_length_m;
        self
    }

    /// Parts of the vehicle before the walls.
    #[must_use]
    pub fn with_parts(mut self, parts: Vec<Part>) -> Self {
        self.parts = parts;
        self
    }

    /// Distance to what is nearest, and how squarely the beam meets it.
    fn nearest(&self, clockwise_deg: f64) -> (f64, f64) {
        let turned_deg = clockwise_deg.rem_euclid(360.0);
        let part = self.parts.iter().find(|part| part.holds(turned_deg));
        part.map_or_else(|| self.wall(clockwise_deg), |part| (part.distance_m, 1.0))
    }

    /// Distance to the wall, and how squarely the beam meets it.
    #[must_use]
    pub fn wall(&self, clockwise_deg: f64) -> (f64, f64) {
        let (sin, cos) = clockwise_deg.to_radians().sin_cos();
        let (ahead_m, aside_m) = (self.half_length_m / cos.abs(), self.half_width_m / sin.abs());
        if ahead_m < aside_m { (ahead_m, cos.abs()) } else { (aside_m, sin.abs()) }
    }
}

impl Scene for Room {
    fn distance_m(&mut self, _at: Stamp<Mono>, clockwise_deg: f64) -> Option<f64> {
        Some(self.nearest(clockwise_deg).0)
    }

    fn echo(&mut self, _at: Stamp<Mono>, clockwise_deg: f64) -> Option<Echo> {
        let (distance_m, square_on) = self.nearest(clockwise_deg);
        self.optics.echo(distance_m, square_on, 1.0)
    }
}
