//! The link between companion and autopilot, in a tester's hands.

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::link::outbox::{Outbox, Outgoing, Pace};
use stockpilot::time::{Mono, Stamp};

/// The autopilot's transmitter holds this much; what comes on top is lost, bytes.
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
    slow_line: Option<SlowLine>,
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

    /// From now on the line carries no more than this in each direction, bytes/s.
    pub fn slow_down(&mut self, bytes_per_s: f64) {
        self.slow_line = Some(SlowLine {
            outbox: Outbox::default(),
            to_autopilot: Pace::new(bytes_per_s),
            to_companion: Some(Pace::new(bytes_per_s)),
            most_waiting: Duration::from_secs_f64(TRANSMITTER_BYTES / bytes_per_s),
        });
    }

    /// The same only for what goes to the autopilot.
    pub fn slow_down_to_autopilot(&mut self, bytes_per_s: f64) {
        self.slow_down(bytes_per_s);
        if let Some(line) = &mut self.slow_line {
            line.to_companion = None;
        }
    }

    /// Everything works again.
    pub fn mend(&mut self) {
        self.is_cut = false;
        self.delay_to_companion = Duration::ZERO;
        self.delay_to_autopilot = Duration::ZERO;
        self.slow_line = None;
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
        let left = match (&mut self.slow_line, way) {
            (None, _) => sent.into_iter().map(|one| (now, one)).collect(),
            (Some(line), Way::ToCompanion) => line.autopilot_sends(now, sent),
            (Some(line), Way::ToAutopilot) => line.companion_sends(now, sent),
        };
        queue.extend(left.into_iter().map(|(left_at, one)| (left_at.plus(delay), one)));
        let n_due = queue.iter().take_while(|(due, _)| *due <= now).count();
        queue.drain(..n_due).map(|(_, one)| one).collect()
    }
}

/// A line that carries less than is asked of it.
struct SlowLine {
    /// The companion's transport.
    outbox: Outbox,
    to_autopilot: Pace,
    to_companion: Option<Pace>,
    /// What the autopilot's transmitter holds.
    most_waiting: Duration,
}

impl SlowLine {
    /// In order; what finds no room is lost. With each message the instant at which it has left.
    fn autopilot_sends(
        &mut self,
        now: Stamp<Mono>,
        sent: Vec<Addressed>,
    ) -> Vec<(Stamp<Mono>, Addressed)> {
        let Some(pace) = &mut self.to_companion else {
            return sent.into_iter().map(|one| (now, one)).collect();
        };
        let mut left = Vec::new();
        for one in sent {
            if pace.free_at().since(now) <= self.most_waiting {
                left.push((pace.hand_over(now, frame_bytes(&one)), one));
            }
        }
        left
    }

    /// As the service's transport does it: the most urgent and newest first.
    fn companion_sends(
        &mut self,
        now: Stamp<Mono>,
        sent: Vec<Addressed>,
    ) -> Vec<(Stamp<Mono>, Addressed)> {
        for (header, message) in sent {
            self.outbox.put(Outgoing { header, message });
        }
        let mut left = Vec::new();
        while self.to_autopilot.open_from() <= now
            && let Some(Outgoing { header, message }) = self.outbox.take()
        {
            let one = (header, message);
            left.push((self.to_autopilot.hand_over(now, frame_bytes(&one)), one));
        }
        left
    }
}

fn frame_bytes((header, message): &Addressed) -> usize {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(*header, message);
    raw.raw_bytes().len()
}
