//! The sensors' conversation, which is a monologue, and its packets.

use super::gap::{elapsed_s, frames_between};
use super::{FRAME_BYTES, FRAME_SAMPLES, Frame, Parser};
use crate::lidar::{Counts, Identity, Model, Packet, Request, Sample, Sensor};
use crate::time::{Mono, Stamp};

#[expect(clippy::cast_possible_truncation, reason = "there are twelve")]
const SAMPLES_IN_FRAME: u32 = FRAME_SAMPLES as u32;

/// An LDROBOT sensor: it talks as soon as it has power and listens to nothing.
#[derive(Debug, Clone)]
pub struct Ldrobot {
    model: Model,
    parser: Parser,
    previous: Option<Frame>,
    packet: Packet,
    identity: Identity,
    has_frame: bool,
}

impl Ldrobot {
    /// A sensor of this model. Its bytes do not tell which it is.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let name = model.full_name().to_owned();
        Self {
            model,
            parser: Parser::new(),
            previous: None,
            packet: Packet::default(),
            identity: Identity { model: Some(model), name, ..Identity::default() },
            has_frame: false,
        }
    }
}

impl Sensor for Ldrobot {
    fn restart(&mut self, _now: Stamp<Mono>) {
        self.parser.reset();
        self.previous = None;
        self.has_frame = false;
    }

    fn poll(&mut self, _now: Stamp<Mono>) -> Option<Request> {
        None
    }

    fn feed(&mut self, bytes: &[u8], now: Stamp<Mono>, on_packet: &mut dyn FnMut(&Packet)) {
        let Self { model, parser, previous, packet, has_frame, .. } = self;
        parser.feed(bytes, |frame, n_bytes_after| {
            packet.begin(now, FRAME_BYTES + n_bytes_after, model.sample_period());
            fill(packet, &frame);
            if let Some(previous) = previous {
                packet.n_lost = (frames_between(previous, &frame, *model) - 1) * SAMPLES_IN_FRAME;
                packet.device_elapsed_s = Some(elapsed_s(previous, &frame));
            }
            *previous = Some(frame);
            *has_frame = true;
            on_packet(packet);
        });
    }

    fn counts(&self) -> Counts {
        let stats = self.parser.stats();
        Counts {
            bytes: stats.bytes,
            frames: stats.frames,
            checksum_errors: stats.crc_errors + stats.implausible,
            skipped_bytes: stats.skipped_bytes,
            restarts: 0,
        }
    }

    fn identity(&self) -> Option<&Identity> {
        self.has_frame.then_some(&self.identity)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "single precision is what a sample holds")]
fn fill(packet: &mut Packet, frame: &Frame) {
    let samples = frame.samples.iter().enumerate().map(|(sample_idx, sample)| Sample {
        clockwise_deg: frame.angle_deg(sample_idx) as f32,
        range_m: f32::from(sample.range_mm) / 1000.0,
        intensity: sample.intensity,
    });
    packet.samples.extend(samples);
}
