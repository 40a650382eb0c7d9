//! The person at the ground station: says start, and listens. Or a real ground station on a socket.

use crate::autopilot::{COMPANION_COMPONENT, StubAutopilot};
use anyhow::Context as _;
use mavlink::dialects::ardupilotmega::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavState,
    MavType, NAMED_VALUE_FLOAT_DATA,
};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;
use stockpilot::time::{Mono, Stamp};

/// A ground station on the autopilot's other link.
#[derive(Debug, Clone, Default)]
pub struct Operator {
    next_heartbeat: Stamp<Mono>,
    next_start: Stamp<Mono>,
    is_start_acknowledged: bool,
    wishes: Vec<(MavCmd, f32)>,
    /// The ground station is switched off: it neither speaks nor hears.
    pub is_silent: bool,
    /// Lines of text, in the order they came; long ones joined from their pieces.
    pub texts: Vec<String>,
    /// The id of the newest line, by which its further pieces are known; 0 without any.
    text_id: u16,
    /// The last value of VOLUME, m³, as a ground station shows it.
    pub volume_m3: Option<f32>,
    station: Option<Station>,
}

/// A program of others that hears everything and says when to start.
#[derive(Debug, Clone)]
struct Station {
    socket: Arc<UdpSocket>,
    peer: Option<SocketAddr>,
}

/// The vehicle is left alone for its sensors to settle before the start.
const START_AFTER: Duration = Duration::from_secs(4);
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
const START_RETRY: Duration = Duration::from_secs(3);
/// The system id of PX4 out of the box.
const AUTOPILOT_SYSTEM: u8 = 1;
/// The id ground stations use.
const GROUND_STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };

impl Operator {
    /// Leaves the talking to a ground station that speaks to this address (`HOST:PORT`, port 0 for a
    /// free one), and gives the address that was taken.
    ///
    /// # Errors
    /// If the address cannot be had.
    pub fn at_station(address: &str) -> anyhow::Result<(Self, SocketAddr)> {
        let open = || {
            let socket = UdpSocket::bind(address)?;
            socket.set_nonblocking(true)?;
            Ok::<_, std::io::Error>((socket.local_addr()?, socket))
        };
        let (local, socket) =
            open().with_context(|| format!("no socket for the ground station at {address}"))?;
        let station = Some(Station { socket: Arc::new(socket), peer: None });
        Ok((Self { station, ..Self::default() }, local))
    }

    /// Hears everything and starts nothing: somebody else does.
    #[must_use]
    pub fn looking_on() -> Self {
        Self { is_start_acknowledged: true, ..Self::default() }
    }

    /// Sends one of the user commands with the next step; nobody looks after it.
    pub fn ask(&mut self, command: MavCmd) {
        self.wishes.push((command, 0.0));
    }

    /// Asks for another flight of the same survey, into its gaps.
    pub fn ask_for_gaps(&mut self) {
        self.wishes.push((MavCmd::MAV_CMD_USER_1, 1.0));
    }

    /// What a ground station says now, `now` after the flight began: its heartbeat, and what the
    /// person wishes.
    pub fn speak(&mut self, now: Stamp<Mono>) -> Vec<(MavHeader, MavMessage)> {
        let mut said = Vec::new();
        if now >= self.next_heartbeat {
            self.next_heartbeat = now.plus(HEARTBEAT_EVERY);
            said.push(heartbeat());
        }
        let is_due = now >= self.next_start.max(Stamp::ZERO.plus(START_AFTER));
        if is_due && !self.is_start_acknowledged {
            self.next_start = now.plus(START_RETRY);
            said.push(user_command((MavCmd::MAV_CMD_USER_1, 0.0)));
        }
        said.extend(self.wishes.drain(..).map(user_command));
        said.into_iter().map(|message| (GROUND_STATION, message)).collect()
    }

    /// Speaks and listens once per step of the simulation.
    pub fn step(&mut self, now: Stamp<Mono>, autopilot: &mut StubAutopilot) {
        let heard = autopilot.to_ground_station();
        if self.is_silent {
            return;
        }
        for (header, message) in heard {
            self.hear(header, &message);
            if let Some(station) = &self.station {
                station.show(header, &message);
            }
        }
        if let Some(station) = &mut self.station {
            station.pass_on(now, autopilot);
            return;
        }
        for (header, message) in self.speak(now) {
            autopilot.forward(now, header, &message);
        }
    }

    /// Listens to one message.
    pub fn hear(&mut self, header: MavHeader, message: &MavMessage) {
        match message {
            // An autopilot that does not know its companion yet answers in its place.
            MavMessage::COMMAND_ACK(ack)
                if ack.command == MavCmd::MAV_CMD_USER_1
                    && header.component_id == COMPANION_COMPONENT =>
            {
                self.is_start_acknowledged = true;
            }
            MavMessage::STATUSTEXT(text) if header.component_id == COMPANION_COMPONENT => {
                let piece = text.text.to_str().unwrap_or("?");
                let is_further = text.id != 0 && text.chunk_seq > 0 && text.id == self.text_id;
                match self.texts.last_mut().filter(|_| is_further) {
                    Some(line) => line.push_str(piece),
                    None => self.texts.push(piece.to_owned()),
                }
                self.text_id = text.id;
            }
            MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA { name, value, .. })
                if name.to_str() == Ok("VOLUME") =>
            {
                self.volume_m3 = Some(*value);
            }
            _ => {}
        }
    }
}

impl Station {
    /// A datagram that is lost is lost, as on a radio.
    fn show(&self, header: MavHeader, message: &MavMessage) {
        let Some(peer) = self.peer else { return };
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message(header, message);
        if let Err(error) = self.socket.send_to(frame.raw_bytes(), peer) {
            tracing::debug!(%error, "the ground station missed a message");
        }
    }

    fn pass_on(&mut self, now: Stamp<Mono>, autopilot: &mut StubAutopilot) {
        let mut buffer = [0; 2_048];
        while let Ok((length, from)) = self.socket.recv_from(&mut buffer) {
            self.peer = Some(from);
            let mut reader = MavlinkReader::new(&buffer[..length]);
            while let Ok((header, message)) = reader.read_any_message::<MavMessage>() {
                autopilot.forward(now, header, &message);
            }
        }
    }
}

fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

fn user_command((command, param1): (MavCmd, f32)) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: AUTOPILOT_SYSTEM,
        target_component: COMPANION_COMPONENT,
        command,
        param1,
        ..COMMAND_LONG_DATA::DEFAULT
    })
}
