//! LDROBOT sensors: they talk as soon as they have power and listen to nothing.

#[cfg(test)]
mod oracle;

use super::{Device, Frame, Mishap};
use crate::lidar::head::Head;
use crate::lidar::simulator::Rhythm;
use crate::lidar::{LidarModel, SAMPLES_PER_PACKET, Scene, encode};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// A talking head.
#[derive(Debug)]
pub(super) struct Ldrobot {
    rhythm: Rhythm,
}

impl Ldrobot {
    pub(super) fn new(
        model: &LidarModel,
        seeds: SeedBook,
        now: Stamp<Mono>,
        is_running: bool,
    ) -> Self {
        let mut rhythm = Rhythm::new(model, seeds, now);
        if !is_running {
            rhythm.head = Head::at_rest(model.turns_per_s, model.speed_jitter_ratio, seeds);
            rhythm.head.drive(true, now);
        }
        Self { rhythm }
    }
}

impl Device for Ldrobot {
    fn hear(&mut self, _bytes: &[u8], _now: Stamp<Mono>) {}

    fn advance(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene, out: &mut Vec<Frame>) {
        while let Some(packet) = self.rhythm.next(until, scene) {
            let ready_at = packet.samples[SAMPLES_PER_PACKET - 1].at;
            let bytes = encode(&packet).to_vec();
            out.push(Frame { bytes, n_samples: SAMPLES_PER_PACKET as u64, ready_at });
        }
    }

    fn suffer(&mut self, mishap: Mishap, now: Stamp<Mono>) {
        if let Mishap::HeadHeld(is_held) = mishap {
            self.rhythm.head.hold(is_held, now);
        }
    }
}
