//! Frames at a steady rate, handed over late and imperfect.

use super::{CameraModel, SeenTag};
use crate::world::World;
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Transform};
use stockpilot::messages::{TagDetection, TagDetections};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

/// A camera with its detector, at work.
///
/// Latencies are drawn for each frame, so a frame may overtake an older one.
#[derive(Debug, Clone)]
pub struct CameraSimulator {
    model: CameraModel,
    next_capture: Stamp<Mono>,
    under_way: Vec<TagDetections>,
    pixel_noise: Noise,
    latency_noise: Noise,
    missed_fault: Noise,
    outlier_fault: Noise,
}

impl CameraSimulator {
    /// A camera whose first frame is exposed at `start`.
    #[must_use]
    pub fn new(model: CameraModel, seeds: SeedBook, start: Stamp<Mono>) -> Self {
        let stream = |purpose: &str| seeds.stream(&format!("camera{}.{purpose}", model.id.0));
        Self {
            next_capture: start,
            under_way: Vec::new(),
            pixel_noise: stream("pixels"),
            latency_noise: stream("latency"),
            missed_fault: stream("fault.missed"),
            outlier_fault: stream("fault.outlier"),
            model,
        }
    }

    /// The camera's numbers.
    #[must_use]
    pub fn model(&self) -> &CameraModel {
        &self.model
    }

    /// All frames that arrive at `until` or before, in the order of arrival.
    ///
    /// `hall_from_body` gives the true pose at any instant since the last call. A frame without
    /// markers arrives too, empty.
    pub fn advance(
        &mut self,
        world: &World,
        until: Stamp<Mono>,
        hall_from_body: impl Fn(Stamp<Mono>) -> Transform<Hall, Body>,
    ) -> Vec<TagDetections> {
        let period = Duration::from_secs_f64(1.0 / self.model.detector.frames_per_s);
        while self.next_capture <= until {
            let frame = self.frame(world, &hall_from_body(self.next_capture));
            self.under_way.push(frame);
            self.next_capture = self.next_capture.plus(period);
        }
        let is_there = |frame: &mut TagDetections| frame.received_at <= until;
        let mut arrived: Vec<TagDetections> = self.under_way.extract_if(.., is_there).collect();
        arrived.sort_by_key(|frame| frame.received_at);
        arrived
    }

    /// The frame that is exposed now.
    fn frame(&mut self, world: &World, hall_from_body: &Transform<Hall, Body>) -> TagDetections {
        let (shortest, longest) = self.model.detector.latency;
        let spread = longest.saturating_sub(shortest);
        let latency = shortest + spread.mul_f64(self.latency_noise.uniform());
        let view = self.model.view(world, hall_from_body);
        TagDetections {
            captured_at: self.next_capture,
            received_at: self.next_capture.plus(latency),
            camera: self.model.id,
            tags: view.iter().filter_map(|seen| self.detection(seen)).collect(),
            points: Vec::new(),
        }
    }

    /// What the detector makes of one marker; `None` if it misses it.
    fn detection(&mut self, seen: &SeenTag<'_>) -> Option<TagDetection> {
        let detector = &self.model.detector;
        let mut corners_px = seen.corners_px;
        for coordinate in corners_px.iter_mut().flatten() {
            *coordinate += detector.pixel_sigma_px * self.pixel_noise.normal();
        }
        if self.outlier_fault.chance(detector.outlier_ratio) {
            displace_one(&mut corners_px, &mut self.outlier_fault);
        }
        let is_missed = self.missed_fault.chance(detector.missed_ratio);
        let decision_margin = (30.0 + seen.edge_px).min(100.0) + self.pixel_noise.normal();
        let (id, family) = (seen.tag.id, seen.tag.family);
        (!is_missed).then_some(TagDetection { id, family, corners_px, decision_margin })
    }
}

/// Moves one corner by 8 to 60 px.
fn displace_one(corners_px: &mut [[f64; 2]; 4], noise: &mut Noise) {
    let (sin, cos) = noise.between(0.0, std::f64::consts::TAU).sin_cos();
    let by_px = noise.between(8.0, 60.0);
    let victim = usize::from(noise.bits().to_le_bytes()[0] % 4);
    corners_px[victim][0] += by_px * cos;
    corners_px[victim][1] += by_px * sin;
}
