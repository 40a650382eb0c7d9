//! Packets joined to turns of the head.

use super::{Packet, Sample};
use stockpilot::messages::{Beam, Scan};

/// Collects samples until the head passes its front mark.
#[derive(Debug, Clone, Default)]
pub struct TurnAssembler {
    turn: Vec<Sample>,
}

impl TurnAssembler {
    /// Adds a packet; gives the turn that it completes, if it does.
    ///
    /// The first turn after switching on is the rest of one.
    pub fn push(&mut self, packet: &Packet) -> Option<Scan> {
        let mut finished = None;
        for sample in &packet.samples {
            let last = self.turn.last();
            if last.is_some_and(|last| sample.clockwise_cdeg < last.clockwise_cdeg) {
                finished = scan(&self.turn);
                self.turn.clear();
            }
            self.turn.push(*sample);
        }
        finished
    }
}

/// The samples as a scan in the axes of `Lidar`.
fn scan(samples: &[Sample]) -> Option<Scan> {
    let start = samples.first()?.at;
    let beam = |sample: &Sample| Beam {
        offset_ns: u32::try_from(sample.at.since(start).as_nanos()).unwrap_or(u32::MAX),
        angle_rad: counter_clockwise_rad(sample.clockwise_cdeg),
        range_m: f32::from(sample.range_mm) / 1000.0,
        intensity: sample.intensity,
    };
    Some(Scan { start, beams: samples.iter().map(beam).collect() })
}

/// The angle about +z of `Lidar` inside (−π, π], rad.
#[expect(clippy::cast_possible_truncation, reason = "single precision is the message's own")]
fn counter_clockwise_rad(clockwise_cdeg: f64) -> f32 {
    stockpilot::units::wrapped_rad(-(clockwise_cdeg / 100.0).to_radians()) as f32
}
