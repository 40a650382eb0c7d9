//! The link between companion and autopilot, in a tester's hands.

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::time::{Mono, Stamp};

/// A transmitter holds this much; what comes on top is lost, bytes.
const TRANSMITTER_BYTES: f64 = 1_024.0;

/// A message with its sender.
pub(super) type Addressed = (MavHeader, MavMessage);

/// The direction of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// From the autopilot.
    ToCompanion,
    /// From the companion.
    ToAutopilot,
}

/// What becomes of one message: none, itself, or others.
pub(super) type Tamper = Box<dyn FnMut(Way, Stamp<Mono>, Addressed) -> Vec<Addressed> + Send>;

/// Delays, cuts, changes and adds messages; without a fault it passes everything on at once.
#[derive(Default)]
pub struct LinkLayer {
    /// Nothing passes, either way; what is under way is lost.
    pub is_cut: bool,
    /// From the autopilot's sending to the companion's hearing.
    pub delay_to_companion: Duration,
    /// From the companion's sending to the autopilot's hearing.
    pub delay_to_autopilot: Duration,
    /// What the line carries in each direction, bytes/s; as much as there is if `None`.
    pub bytes_per_s: Option<f64>,
    /// When the line is free again: to the companion, to the autopilot.
    free_at: [Stamp<Mono>; 2],
    tamper: Option<Tamper>,
    to_companion: VecDeque<(Stamp<Mono>, Addressed)>,
    to_autopilot: VecDeque<(Stamp<Mono>, Addressed)>,
    /// Answers to the companion that the layer itself gives.
    injected: Vec<Addressed>,
}

impl std::fmt::Debug for LinkLayer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LinkLayer").field("is_cut", &self.is_cut).finish_non_exhaustive()
    }
}

impl LinkLayer {
    /// From now on `tamper` decides what becomes of each message.
    pub(super) fn tamper_with(
        &mut self,
        tamper: impl FnMut(Way, Stamp<Mono>, Addressed) -> Vec<Addressed> + Send + 'static,
    ) {
        self.tamper = Some(Box::new(tamper));
    }

    /// Everything works again.
    pub fn mend(&mut self) {
        self.is_cut = false;
        self.delay_to_companion = Duration::ZERO;
        self.delay_to_autopilot = Duration::ZERO;
        self.bytes_per_s = None;
        self.tamper = None;
    }

    /// Lets the companion hear a message as if it had come over the link.
    pub fn inject(&mut self, header: MavHeader, message: MavMessage) {
        self.injected.push((header, message));
    }

    /// Takes in what was sent and gives out what arrives now.
    pub(crate) fn pass(
        &mut self,
        way: Way,
        now: Stamp<Mono>,
        sent: Vec<Addressed>,
    ) -> Vec<Addressed> {
        let delay = match way {
            Way::ToCompanion => self.delay_to_companion,
            Way::ToAutopilot => self.delay_to_autopilot,
        };
        let mut sent = sent;
        if way == Way::ToCompanion {
            sent.append(&mut self.injected);
        }
        if let Some(tamper) = &mut self.tamper {
            sent = sent.into_iter().flat_map(|one| tamper(way, now, one)).collect();
        }
        let queue = match way {
            Way::ToCompanion => &mut self.to_companion,
            Way::ToAutopilot => &mut self.to_autopilot,
        };
        if self.is_cut {
            queue.clear();
            return Vec::new();
        }
        let free_at = &mut self.free_at[usize::from(way == Way::ToAutopilot)];
        for one in sent {
            let Some(left_at) = transmitted(&one, now, self.bytes_per_s, free_at) else { continue };
            queue.push_back((left_at.plus(delay), one));
        }
        let n_due = queue.iter().take_while(|(due, _)| *due <= now).count();
        queue.drain(..n_due).map(|(_, one)| one).collect()
    }
}

/// When the last byte of a message has left; `None` if it finds no room.
fn transmitted(
    (header, message): &Addressed,
    now: Stamp<Mono>,
    bytes_per_s: Option<f64>,
    free_at: &mut Stamp<Mono>,
) -> Option<Stamp<Mono>> {
    let Some(bytes_per_s) = bytes_per_s else { return Some(now) };
    if free_at.since(now).as_secs_f64() * bytes_per_s > TRANSMITTER_BYTES {
        return None;
    }
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(*header, message);
    let takes = Duration::from_secs_f64(raw.raw_bytes().len() as f64 / bytes_per_s);
    *free_at = now.max(*free_at).plus(takes);
    Some(*free_at)
}
