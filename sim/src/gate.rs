//! One MAVLink link of the simulator to the outside: datagrams or TCP, signed or not.
//!
//! Frames are found, checked and signed by the `mavlink` crate alone. Nothing of the service's own
//! link is used here, so that the two judge each other.

use anyhow::{Context as _, anyhow, ensure};
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{
    AsyncMavlinkReader, MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, Message,
    MessageData as _, SigningConfig, SigningData, calculate_crc,
};
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;
use stockpilot::service::clock::Clock;
use tokio::io::AsyncWriteExt as _;
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Messages that wait in each direction.
const CAPACITY: usize = 4096;
const LARGEST_DATAGRAM: usize = 65_536;
/// Pause before a server is called again.
const CALL_AGAIN_AFTER: Duration = Duration::from_secs(1);
/// MAVLink 2 says by this bit that a frame is signed.
const IS_SIGNED: u8 = 1;
/// `SETUP_SIGNING` carries a key; no autopilot takes it here and none passes it on.
const SETUP_SIGNING: u32 = 256;

/// Where a link of the simulator ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GateAddress {
    /// Waits for datagrams and answers the first who sends some.
    UdpIn(String),
    /// Sends datagrams to this address first.
    UdpOut(String),
    /// Waits for TCP connections, one at a time.
    TcpIn(String),
    /// Connects to a TCP server, again and again.
    TcpOut(String),
}

impl FromStr for GateAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("`{text}` is none of udpin:, udpout:, tcpin:, tcpout: with HOST:PORT");
        let (kind, place) = text.split_once(':').ok_or_else(wrong)?;
        if place.rsplit_once(':').is_none_or(|(_, port)| port.parse::<u16>().is_err()) {
            return Err(wrong());
        }
        match kind {
            "udpin" => Ok(Self::UdpIn(place.to_owned())),
            "udpout" => Ok(Self::UdpOut(place.to_owned())),
            "tcpin" => Ok(Self::TcpIn(place.to_owned())),
            "tcpout" => Ok(Self::TcpOut(place.to_owned())),
            _ => Err(wrong()),
        }
    }
}

/// Signs and checks with the `mavlink` crate's own code.
pub(crate) fn signing_key(path: &Path, link: u8) -> anyhow::Result<Arc<SigningData>> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read the key {}", path.display()))?;
    let digits = text.trim().as_bytes();
    ensure!(digits.len() == 64 && digits.is_ascii(), "a key has 64 hexadecimal digits");
    let mut key = [0; 32];
    for (byte, pair) in key.iter_mut().zip(digits.chunks(2)) {
        *byte = u8::from_str_radix(std::str::from_utf8(pair)?, 16)
            .map_err(|_| anyhow!("a key has 64 hexadecimal digits"))?;
    }
    Ok(Arc::new(SigningData::from_config(SigningConfig::new(key, link, true, false))))
}

/// A message with its sender.
pub(crate) type Parcel = (MavHeader, MavMessage);

/// An open link.
pub(crate) struct Gate {
    pub(crate) incoming: mpsc::Receiver<Parcel>,
    outgoing: mpsc::Sender<Parcel>,
    local: Option<SocketAddr>,
}

impl fmt::Debug for Gate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gate").field("local", &self.local).finish_non_exhaustive()
    }
}

impl Gate {
    /// Opens `address` until `stop` is cancelled. With `signing` what leaves is signed, and what
    /// comes in unsigned, wrongly signed or twice is dropped.
    pub(crate) async fn open(
        address: &GateAddress,
        signing: Option<Arc<SigningData>>,
        stop: CancellationToken,
    ) -> io::Result<Self> {
        let (incoming_tx, incoming) = mpsc::channel(CAPACITY);
        let (outgoing, outgoing_rx) = mpsc::channel(CAPACITY);
        let ends = Ends { incoming: incoming_tx, outgoing: outgoing_rx, signing };
        let local = match address {
            GateAddress::UdpIn(bind) => {
                let socket = UdpSocket::bind(bind).await?;
                let local = socket.local_addr()?;
                tokio::spawn(stop.run_until_cancelled_owned(datagrams(socket, None, ends)));
                Some(local)
            }
            GateAddress::UdpOut(peer) => {
                let socket = UdpSocket::bind("0.0.0.0:0").await?;
                let unknown = || io::Error::new(io::ErrorKind::NotFound, "the peer is not known");
                let peer = tokio::net::lookup_host(peer).await?.next().ok_or_else(unknown)?;
                let local = socket.local_addr()?;
                tokio::spawn(stop.run_until_cancelled_owned(datagrams(socket, Some(peer), ends)));
                Some(local)
            }
            GateAddress::TcpIn(bind) => {
                let listener = TcpListener::bind(bind).await?;
                let local = listener.local_addr()?;
                tokio::spawn(stop.run_until_cancelled_owned(serve(listener, ends)));
                Some(local)
            }
            GateAddress::TcpOut(host) => {
                tokio::spawn(stop.run_until_cancelled_owned(call(host.clone(), ends)));
                None
            }
        };
        Ok(Self { incoming, outgoing, local })
    }

    /// Hands over a message; what does not fit is lost, as on a wire.
    pub(crate) fn send(&self, parcel: Parcel) {
        if self.outgoing.try_send(parcel).is_err() {
            tracing::debug!("a message found no place");
        }
    }

    /// The own address, where somebody may speak to it.
    pub(crate) const fn local(&self) -> Option<SocketAddr> {
        self.local
    }
}

/// The task's side of the channels.
struct Ends {
    incoming: mpsc::Sender<Parcel>,
    outgoing: mpsc::Receiver<Parcel>,
    signing: Option<Arc<SigningData>>,
}

impl Ends {
    fn frame(&self, (header, message): &Parcel) -> Vec<u8> {
        let mut raw = MAVLinkV2MessageRaw::new();
        if let Some(signing) = &self.signing {
            raw.serialize_message_for_signing(*header, message);
            signing.sign_message(&mut raw);
        } else {
            raw.serialize_message(*header, message);
        }
        raw.raw_bytes().to_vec()
    }

    /// Hands on a frame; gives the answer that a command of an unknown number gets.
    fn take_in(&self, raw: &MAVLinkMessageRaw) -> Option<Vec<u8>> {
        if raw.message_id() == SETUP_SIGNING || !self.is_trusted(raw) {
            return None;
        }
        let Ok(message) = MavMessage::parse(raw.version(), raw.message_id(), raw.payload()) else {
            return self.signing.is_none().then(|| unsupported(raw)).flatten();
        };
        let header = MavHeader {
            system_id: raw.system_id(),
            component_id: raw.component_id(),
            sequence: raw.sequence(),
        };
        if self.incoming.try_send((header, message)).is_err() {
            tracing::debug!("a message that came in found no place");
        }
        None
    }

    fn is_trusted(&self, raw: &MAVLinkMessageRaw) -> bool {
        match (&self.signing, raw) {
            (None, _) => true,
            (Some(signing), MAVLinkMessageRaw::V2(raw)) => {
                raw.incompatibility_flags() & IS_SIGNED != 0 && signing.verify_signature(raw)
            }
            (Some(_), MAVLinkMessageRaw::V1(_)) => false,
        }
    }
}

/// As PX4, locks onto the first peer: whoever comes later is not heard.
async fn datagrams(socket: UdpSocket, mut peer: Option<SocketAddr>, mut ends: Ends) {
    let mut buffer = vec![0; LARGEST_DATAGRAM];
    loop {
        tokio::select! {
            parcel = ends.outgoing.recv() => {
                let Some(parcel) = parcel else { return };
                if let Some(peer) = peer {
                    let frame = ends.frame(&parcel);
                    if let Err(error) = socket.send_to(&frame, peer).await {
                        tracing::debug!(%error, "a datagram was not sent");
                    }
                }
            }
            Ok((length, from)) = socket.recv_from(&mut buffer) => {
                if *peer.get_or_insert(from) == from {
                    let mut reader = MavlinkReader::new(&buffer[..length]);
                    while let Ok(raw) = reader.read_any_raw_message::<MavMessage>() {
                        if let Some(answer) = ends.take_in(&raw)
                            && let Err(error) = socket.send_to(&answer, from).await
                        {
                            tracing::debug!(%error, "an answer was not sent");
                        }
                    }
                }
            }
        }
    }
}

async fn serve(listener: TcpListener, mut ends: Ends) {
    loop {
        tokio::select! {
            Ok((stream, from)) = listener.accept() => {
                tracing::info!(%from, "a client");
                if let Err(error) = talk(stream, &mut ends).await {
                    tracing::info!(%from, %error, "the client has gone");
                }
            }
            // Nobody listens: gone.
            parcel = ends.outgoing.recv() => if parcel.is_none() { return },
        }
    }
}

async fn call(host: String, mut ends: Ends) {
    let clock = Clock::real();
    loop {
        match TcpStream::connect(&host).await {
            Ok(stream) => {
                if let Err(error) = talk(stream, &mut ends).await {
                    tracing::info!(%host, %error, "the server has gone");
                }
            }
            Err(error) => tracing::debug!(%host, %error, "nobody is there yet"),
        }
        if ends.incoming.is_closed() {
            return;
        }
        clock.sleep_until(clock.now().plus(CALL_AGAIN_AFTER)).await;
    }
}

async fn talk(stream: TcpStream, ends: &mut Ends) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let (reader, mut writer) = stream.into_split();
    let mut reader = AsyncMavlinkReader::new(reader);
    loop {
        tokio::select! {
            raw = reader.read_any_raw_message::<MavMessage>() => match raw {
                Ok(raw) => {
                    if let Some(answer) = ends.take_in(&raw) {
                        writer.write_all(&answer).await?;
                    }
                }
                Err(mavlink::error::MessageReadError::Io(error)) => return Err(error),
                Err(_) => {}
            },
            parcel = ends.outgoing.recv() => {
                let Some(parcel) = parcel else { return Ok(()) };
                let frame = ends.frame(&parcel);
                writer.write_all(&frame).await?;
            }
        }
    }
}

/// `COMMAND_INT` and `COMMAND_LONG`: the command's number and its target stand at the same place.
const COMMANDS: [u32; 2] = [75, 76];
const COMMAND_AT: usize = 28;
/// Where the payload of a MAVLink 2 frame begins.
const PAYLOAD_AT: usize = 10;

/// The answer to a command whose number the `mavlink` crate does not know, if it is for the autopilot:
/// unsupported, as the real ones say.
fn unsupported(raw: &MAVLinkMessageRaw) -> Option<Vec<u8>> {
    let payload = raw.payload();
    let is_command = COMMANDS.contains(&raw.message_id());
    let number = payload.get(COMMAND_AT..COMMAND_AT + 2).filter(|_| is_command)?;
    let target = [0, 1].map(|k| payload.get(COMMAND_AT + 2 + k).copied().unwrap_or(0));
    if target[0] > 1 || target[1] > 1 {
        return None;
    }
    let answer = m::COMMAND_ACK_DATA {
        result: m::MavResult::MAV_RESULT_UNSUPPORTED,
        target_system: u8::try_from(raw.system_id()).unwrap_or(0),
        target_component: raw.component_id(),
        ..m::COMMAND_ACK_DATA::DEFAULT
    };
    let header = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
    let mut frame = MAVLinkV2MessageRaw::new();
    frame.serialize_message(header, &MavMessage::COMMAND_ACK(answer));
    let mut bytes = frame.raw_bytes().to_vec();
    bytes.get_mut(PAYLOAD_AT..PAYLOAD_AT + 2)?.copy_from_slice(number);
    let end = bytes.len().checked_sub(2)?;
    let checksum = calculate_crc(bytes.get(1..end)?, m::COMMAND_ACK_DATA::EXTRA_CRC);
    bytes.get_mut(end..)?.copy_from_slice(&checksum.to_le_bytes());
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_of_unknown_numbers_are_answered() {
        let command = m::COMMAND_LONG_DATA {
            target_system: 1,
            target_component: 1,
            ..m::COMMAND_LONG_DATA::DEFAULT
        };
        let mut frame = MAVLinkV2MessageRaw::new();
        let from = MavHeader { system_id: 255, component_id: 190, sequence: 3 };
        frame.serialize_message(from, &MavMessage::COMMAND_LONG(command));
        let mut bytes = frame.raw_bytes().to_vec();
        // 31999 is nobody's command.
        bytes[PAYLOAD_AT + COMMAND_AT..][..2].copy_from_slice(&31_999_u16.to_le_bytes());
        let end = bytes.len() - 2;
        let checksum = calculate_crc(&bytes[1..end], m::COMMAND_LONG_DATA::EXTRA_CRC);
        bytes[end..].copy_from_slice(&checksum.to_le_bytes());
        let mut reader = MavlinkReader::new(bytes.as_slice());
        let raw = reader.read_any_raw_message::<MavMessage>().unwrap();
        assert!(MavMessage::parse(raw.version(), raw.message_id(), raw.payload()).is_err());
        let answer = unsupported(&raw).expect("an answer");
        let mut reader = MavlinkReader::new(answer.as_slice());
        let raw = reader.read_any_raw_message::<MavMessage>().expect("a right checksum");
        assert_eq!((raw.message_id(), raw.system_id(), raw.component_id()), (77, 1, 1));
        assert_eq!(raw.payload()[..3], [0xff, 0x7c, 3], "31999, unsupported");
        assert_eq!(raw.payload()[8..10], [255, 190], "to who asked");
    }
}
