//! The brain and its link's session, fed with frames and events; what leaves must be numbers.

use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavlinkReader, Message as _};
use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::link::{Address, Guard, Session, SessionOutput, Settings, wire};
use stockpilot::pilot::{Action, Event, Pilot};
use stockpilot::time::{Mono, Stamp};

/// The autopilot booted this long before the companion's zero.
const BOOT_LEAD: Duration = Duration::from_secs(30);
/// Longer than any frame: refutes a false beginning at the end of the input.
const PADDING: [u8; 300] = [0; 300];

/// Everything between the transport and the world, without either.
pub(crate) struct WireScene {
    pub(crate) pilot: Pilot,
    session: Session,
    guard: Guard,
    out: SessionOutput,
    events: VecDeque<Event>,
    actions: Vec<Action>,
    pub(crate) now: Stamp<Mono>,
    /// What has left, by its name.
    pub(crate) sent: std::collections::BTreeMap<&'static str, u32>,
    /// Numbers that were refused on their way out.
    pub(crate) n_refused: u64,
}

impl WireScene {
    pub(crate) fn new(settings: stockpilot::pilot::Settings) -> Self {
        let address: Address = "udpin:127.0.0.1:0".parse().expect("an address");
        let mut scene = Self {
            pilot: Pilot::new(settings),
            session: Session::new(Settings::new(address)),
            guard: Guard::unsigned(),
            out: SessionOutput::default(),
            events: VecDeque::new(),
            actions: Vec::new(),
            now: Stamp::from_nanos(1_000_000_000),
            sent: std::collections::BTreeMap::new(),
            n_refused: 0,
        };
        scene.hear(&frame((1, 1), 0, &[0, 0, 4, 3, 2, 12, 0x1d, 3, 3]));
        scene
    }

    /// The same scene once more, with a guard that has seen nothing: a brain is quicker copied than
    /// made.
    #[allow(dead_code, reason = "for the fuzz targets")]
    pub(crate) fn fork(&self) -> Self {
        Self {
            pilot: self.pilot.clone(),
            session: self.session.clone(),
            guard: Guard::unsigned(),
            out: self.out.clone(),
            events: self.events.clone(),
            actions: self.actions.clone(),
            now: self.now,
            sent: self.sent.clone(),
            n_refused: self.n_refused,
        }
    }

    /// Takes in bytes as the transports do.
    pub(crate) fn hear(&mut self, bytes: &[u8]) {
        use std::io::Read as _;
        let padded = bytes.chain(PADDING.as_slice());
        let mut reader = MavlinkReader::with_capacity(PADDING.len(), padded);
        while let Ok(raw) = reader.read_any_raw_message::<MavMessage>() {
            if !self.guard.admits(&raw, self.now) {
                continue;
            }
            if let Ok((header, message)) = wire::decode(&raw) {
                self.session.on_message(&header, &message, self.now, &mut self.out);
                self.take_output();
            }
        }
    }

    /// Tells the brain something, and does what it wants; jobs come back as actions.
    pub(crate) fn tell(&mut self, event: Event) -> Vec<Action> {
        self.events.push_back(event);
        self.work_off()
    }

    /// Sends what an action means.
    pub(crate) fn act(&mut self, action: &Action) {
        self.session.on_action(action, self.now, &mut self.out);
        self.take_output();
    }

    /// Moves the clock on and ticks; gives what the brain wanted.
    pub(crate) fn tick(&mut self, by: Duration) -> Vec<Action> {
        self.now = self.now.plus(by);
        self.session.on_time(self.now, &mut self.out);
        self.take_output();
        self.tell(Event::Ticked(self.now))
    }

    fn work_off(&mut self) -> Vec<Action> {
        let mut all = Vec::new();
        while let Some(event) = self.events.pop_front() {
            let mut actions = std::mem::take(&mut self.actions);
            self.pilot.step(event, &mut actions);
            for action in actions.drain(..) {
                self.session.on_action(&action, self.now, &mut self.out);
                self.take_output();
                all.push(action);
            }
            self.actions = actions;
        }
        all
    }

    /// Checks what leaves; answers TIMESYNC as an autopilot would.
    fn take_output(&mut self) {
        let messages = std::mem::take(&mut self.out.messages);
        for message in &messages {
            assert!(is_finite(message), "{message:?}");
            *self.sent.entry(message.message_name()).or_default() += 1;
        }
        self.events.extend(self.out.events.drain(..));
        self.n_refused = self.session.stats().outbound_refused;
        for message in messages {
            if let MavMessage::TIMESYNC(m::TIMESYNC_DATA { tc1: 0, ts1, .. }) = message {
                let boot_ns = self.now.plus(BOOT_LEAD).nanos();
                let payload = [boot_ns.to_le_bytes(), ts1.to_le_bytes()].concat();
                self.hear(&frame((1, 1), 111, &payload));
            }
        }
    }
}

/// True unless a number in it is NaN or infinite, wherever it stands.
pub(crate) fn is_finite(message: &MavMessage) -> bool {
    !format!("{message:?}")
        .split(|c: char| !c.is_alphanumeric())
        .any(|word| matches!(word, "NaN" | "inf"))
}

/// A MAVLink 2 frame with a right checksum around any payload.
pub(crate) fn frame(from: (u8, u8), id: u32, payload: &[u8]) -> Vec<u8> {
    let payload = &payload[..payload.len().min(255)];
    let used = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
    let [id0, id1, id2, _] = id.to_le_bytes();
    let length = u8::try_from(used).expect("at most 255");
    let mut bytes = vec![0xfd, length, 0, 0, 0, from.0, from.1, id0, id1, id2];
    bytes.extend_from_slice(payload.get(..used).unwrap_or(&[0]));
    let crc = mavlink::calculate_crc(&bytes[1..], MavMessage::extra_crc(id));
    bytes.extend_from_slice(&crc.to_le_bytes());
    bytes
}
