//! Stands between the autopilot and the service, passes every byte on, and reads the truth.
//!
//! Frames are passed as they are, signed or not. The truth is asked for as a companion's second
//! component; on a signed link that is refused, and the truth must come by another one.

use super::source::Listener;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavAutopilot, MavCmd, MavMessage};
use mavlink::{
    AsyncMavlinkReader, MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, Message,
    MessageData as _,
};
use std::io;
use std::net::SocketAddr;
use std::time::Duration;
use stockpilot::link::Address;
use stockpilot::service::clock::Clock;
use stockpilot::time::{Mono, Stamp};
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpStream, UdpSocket};
use tokio_serial::SerialPortBuilderExt as _;

/// The truth is asked for this often, µs.
const TRUTH_INTERVAL_US: f32 = 20_000.0;
/// It is asked for again when it has stayed away for so long.
const ASK_EVERY: Duration = Duration::from_secs(1);
/// `MAV_COMP_ID_ONBOARD_COMPUTER2`: the service is the first.
const COMPONENT: u8 = 192;
/// The autopilot's own component.
const AUTOPILOT: u8 = 1;
const LARGEST_DATAGRAM: usize = 65_536;

/// The side of the autopilot, opened.
#[derive(Debug)]
pub(super) enum Far {
    Datagrams { socket: UdpSocket, peer: Option<SocketAddr> },
    Stream(Address),
}

impl Far {
    pub(super) async fn open(address: &Address) -> io::Result<Self> {
        let Address::Udp { bind, peer } = address else { return Ok(Self::Stream(address.clone())) };
        let socket = UdpSocket::bind(bind).await?;
        let peer = match peer {
            Some(peer) => tokio::net::lookup_host(peer).await?.next(),
            None => None,
        };
        Ok(Self::Datagrams { socket, peer })
    }

    /// The own address for datagrams.
    pub(super) fn local(&self) -> Option<SocketAddr> {
        match self {
            Self::Datagrams { socket, .. } => socket.local_addr().ok(),
            Self::Stream(_) => None,
        }
    }
}

/// Passes on between the autopilot and the service's own address, for ever.
pub(super) async fn run(far: Far, service: SocketAddr, listener: Listener) -> io::Result<()> {
    let near = UdpSocket::bind("127.0.0.1:0").await?;
    near.connect(service).await?;
    let clock = Clock::real();
    let mut asker = Asker::new(listener, clock.now());
    match far {
        Far::Datagrams { socket, peer } => datagrams(&socket, peer, &near, &mut asker).await,
        Far::Stream(address) => loop {
            let result = match &address {
                Address::Serial { path, baud } => {
                    match tokio_serial::new(path, *baud).open_native_async() {
                        Ok(port) => stream(port, &near, &mut asker).await,
                        Err(error) => Err(error.into()),
                    }
                }
                Address::Tcp { host } => match TcpStream::connect(host).await {
                    Ok(tcp) => stream(tcp, &near, &mut asker).await,
                    Err(error) => Err(error),
                },
                Address::Udp { .. } => return Ok(()),
            };
            if let Err(error) = result {
                tracing::debug!(%address, %error, "the autopilot's stream is broken");
            }
            clock.sleep_until(clock.now().plus(ASK_EVERY)).await;
        },
    }
}

async fn datagrams(
    far: &UdpSocket,
    mut peer: Option<SocketAddr>,
    near: &UdpSocket,
    asker: &mut Asker,
) -> io::Result<()> {
    let (mut from_far, mut from_near) = (vec![0; LARGEST_DATAGRAM], vec![0; LARGEST_DATAGRAM]);
    loop {
        tokio::select! {
            Ok((length, from)) = far.recv_from(&mut from_far) => {
                if *peer.get_or_insert(from) == from {
                    let datagram = &from_far[..length];
                    pass(near.send(datagram).await);
                    let mut reader = MavlinkReader::new(datagram);
                    while let Ok(raw) = reader.read_any_raw_message::<MavMessage>() {
                        if let Some(question) = asker.read(&raw) {
                            pass(far.send_to(&question, from).await);
                        }
                    }
                }
            }
            Ok(length) = near.recv(&mut from_near) => {
                if let Some(peer) = peer {
                    pass(far.send_to(&from_near[..length], peer).await);
                }
            }
        }
    }
}

/// Until the stream breaks.
async fn stream(
    far: impl AsyncRead + AsyncWrite + Unpin,
    near: &UdpSocket,
    asker: &mut Asker,
) -> io::Result<()> {
    let (reader, mut writer) = tokio::io::split(far);
    let mut reader = AsyncMavlinkReader::new(reader);
    let mut from_near = vec![0; LARGEST_DATAGRAM];
    loop {
        tokio::select! {
            raw = reader.read_any_raw_message::<MavMessage>() => match raw {
                Ok(raw) => {
                    pass(near.send(bytes_of(&raw)).await);
                    if let Some(question) = asker.read(&raw) {
                        writer.write_all(&question).await?;
                    }
                }
                Err(mavlink::error::MessageReadError::Io(error)) => return Err(error),
                Err(_) => {}
            },
            Ok(length) = near.recv(&mut from_near) => {
                writer.write_all(&from_near[..length]).await?;
            }
        }
    }
}

/// A datagram that is not sent is lost, as on a wire.
fn pass(sent: io::Result<usize>) {
    if let Err(error) = sent {
        tracing::debug!(%error, "a datagram was not passed on");
    }
}

fn bytes_of(raw: &MAVLinkMessageRaw) -> &[u8] {
    match raw {
        MAVLinkMessageRaw::V1(raw) => raw.raw_bytes(),
        MAVLinkMessageRaw::V2(raw) => raw.raw_bytes(),
    }
}

/// Reads the truth and asks for it while it stays away.
#[derive(Debug)]
struct Asker {
    listener: Listener,
    clock: Clock,
    /// When the truth came or was asked for last.
    content_at: Stamp<Mono>,
    n_asked: u8,
}

impl Asker {
    fn new(listener: Listener, now: Stamp<Mono>) -> Self {
        Self { listener, clock: Clock::real(), content_at: now, n_asked: 0 }
    }

    /// Looks at a frame of the autopilot; gives a frame with a question, if one is due.
    fn read(&mut self, raw: &MAVLinkMessageRaw) -> Option<Vec<u8>> {
        let is_of_interest = matches!(
            raw.message_id(),
            m::HEARTBEAT_DATA::ID | m::SIM_STATE_DATA::ID | m::HIL_STATE_QUATERNION_DATA::ID
        );
        let message = is_of_interest
            .then(|| MavMessage::parse(raw.version(), raw.message_id(), raw.payload()).ok())??;
        let now = self.clock.now();
        if self.listener.hear(&message) {
            self.content_at = now;
            return None;
        }
        let MavMessage::HEARTBEAT(heartbeat) = message else { return None };
        let is_due = raw.component_id() == AUTOPILOT && now.since(self.content_at) >= ASK_EVERY;
        let wanted = match heartbeat.autopilot {
            MavAutopilot::MAV_AUTOPILOT_PX4 => m::HIL_STATE_QUATERNION_DATA::ID,
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => m::SIM_STATE_DATA::ID,
            _ => return None,
        };
        is_due.then(|| {
            self.content_at = now;
            self.n_asked = self.n_asked.wrapping_add(1);
            question(raw.system_id(), wanted, self.n_asked)
        })
    }
}

#[expect(clippy::cast_precision_loss, reason = "message ids are exact in single precision")]
fn question(system: u32, message_id: u32, sequence: u8) -> Vec<u8> {
    let header = MavHeader { system_id: system, component_id: COMPONENT, sequence };
    let command = m::COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        param1: message_id as f32,
        param2: TRUTH_INTERVAL_US,
        target_system: u8::try_from(system).unwrap_or(0),
        target_component: AUTOPILOT,
        ..m::COMMAND_LONG_DATA::DEFAULT
    };
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, &MavMessage::COMMAND_LONG(command));
    raw.raw_bytes().to_vec()
}
