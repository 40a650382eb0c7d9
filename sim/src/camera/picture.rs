//! A camera that hands over pictures instead of markers.

use super::CameraModel;
use super::renderer::{N_INSTANTS, Renderer};
use crate::world::World;
use std::io::Write;
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Transform};
use stockpilot::messages::CameraId;
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

/// How a sensor takes pictures. Brightness is a share of full scale at `gain` 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureModel {
    /// Blur of lens and focus beside the pixel's own square, Gaussian, px.
    pub blur_sigma_px: f64,
    /// How long the shutter is open.
    pub exposure: Duration,
    /// Brightness of paper.
    pub white: f32,
    /// Brightness of print.
    pub black: f32,
    /// Brightness of walls and everything else.
    pub wall: f32,
    /// Exposure and amplification together; above 1 paper is burnt out sooner.
    pub gain: f32,
    /// How much darker the farthest corner is.
    pub vignetting: f32,
    /// Noise without light, of 255.
    pub read_noise: f32,
    /// Variance of the noise for each unit of brightness, of 255.
    pub shot_noise: f32,
    /// From the middle of the exposure to the last byte at the computer.
    pub transfer: Duration,
}

impl PictureModel {
    /// An ordinary machine-vision camera in a lit hall, exposed for 3 ms.
    #[must_use]
    pub const fn usual() -> Self {
        Self {
            blur_sigma_px: 0.6,
            exposure: Duration::from_millis(3),
            white: 0.75,
            black: 0.06,
            wall: 0.42,
            gain: 1.0,
            vignetting: 0.35,
            read_noise: 2.0,
            shot_noise: 0.04,
            transfer: Duration::from_millis(15),
        }
    }
}

/// A picture that has reached the computer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// The middle of the exposure.
    pub captured_at: Stamp<Mono>,
    /// Which camera.
    pub camera: CameraId,
    /// Width, px.
    pub width_px: u32,
    /// Height, px.
    pub height_px: u32,
    /// Brightness by rows.
    pub pixels: Vec<u8>,
}

impl Picture {
    /// Writes it as binary PGM with its stamp in a comment.
    ///
    /// # Errors
    /// What the sink says.
    pub fn write_pgm(&self, sink: &mut impl Write) -> std::io::Result<()> {
        write!(sink, "P5\n# captured_at_ns {}\n", self.captured_at.nanos())?;
        write!(sink, "{} {}\n255\n", self.width_px, self.height_px)?;
        sink.write_all(&self.pixels)
    }
}

/// A camera that takes pictures at a steady rate.
#[derive(Debug, Clone)]
pub struct PictureCamera {
    model: CameraModel,
    pictures: PictureModel,
    renderer: Renderer,
    noise: Noise,
    next_capture: Stamp<Mono>,
}

impl PictureCamera {
    /// A camera whose first picture is exposed at `start`.
    #[must_use]
    pub fn new(
        model: CameraModel,
        pictures: PictureModel,
        seeds: SeedBook,
        start: Stamp<Mono>,
    ) -> Self {
        let noise = seeds.stream(&format!("camera{}.picture", model.id.0));
        let renderer = Renderer::new(&model, pictures, noise.clone());
        Self { model, pictures, renderer, noise, next_capture: start }
    }

    /// The pictures that reach the computer at `until` or before; `hall_from_body` gives the true
    /// pose at any instant of the last tenth of a second.
    pub fn advance(
        &mut self,
        world: &World,
        until: Stamp<Mono>,
        hall_from_body: impl Fn(Stamp<Mono>) -> Transform<Hall, Body>,
    ) -> Vec<Picture> {
        let period = Duration::from_secs_f64(1.0 / self.model.detector.frames_per_s);
        let mut pictures = Vec::new();
        while self.next_capture.plus(self.pictures.transfer) <= until {
            pictures.push(self.picture(world, self.next_capture, &hall_from_body));
            self.next_capture = self.next_capture.plus(period);
        }
        pictures
    }

    /// The picture whose exposure has its middle at this instant.
    pub fn picture(
        &mut self,
        world: &World,
        captured_at: Stamp<Mono>,
        hall_from_body: impl Fn(Stamp<Mono>) -> Transform<Hall, Body>,
    ) -> Picture {
        let opened_at = captured_at.minus(self.pictures.exposure / 2);
        let poses = std::array::from_fn(|k| {
            let part = (k as f64 + 0.5) / N_INSTANTS as f64;
            hall_from_body(opened_at.plus(self.pictures.exposure.mul_f64(part)))
                * self.model.body_from_camera
        });
        Picture {
            captured_at,
            camera: self.model.id,
            width_px: self.model.lens.width_px,
            height_px: self.model.lens.height_px,
            pixels: self.renderer.render(world, &poses, &mut self.noise),
        }
    }
}
