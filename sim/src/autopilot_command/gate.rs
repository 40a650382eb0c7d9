//! One link of the stub to the outside: datagrams or a TCP server, signed or not.
//!
//! Frames are found, checked and signed by the `mavlink` crate alone. Nothing of the service's own
//! link is used here, so that the two judge each other.

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{
    AsyncMavlinkReader, MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, Message,
    SigningData,
};
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::str::FromStr;
use std::sync::Arc;
use tokio::io::AsyncWriteExt as _;
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Messages that wait in each direction.
const CAPACITY: usize = 4096;
const LARGEST_DATAGRAM: usize = 65_536;
/// MAVLink 2 says by this bit that a frame is signed.
const IS_SIGNED: u8 = 1;
/// `SETUP_SIGNING` carries a key; no autopilot takes it here and none passes it on.
const SETUP_SIGNING: u32 = 256;

/// Where a link of the stub ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GateAddress {
    /// Waits for datagrams and answers the first who sends some.
    UdpIn(String),
    /// Sends datagrams to this address first.
    UdpOut(String),
    /// Waits for TCP connections, one at a time.
    TcpIn(String),
}

impl FromStr for GateAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is none of udpin:, udpout:, tcpin: with HOST:PORT");
        let (kind, place) = text.split_once(':').ok_or_else(wrong)?;
        if place.rsplit_once(':').is_none_or(|(_, port)| port.parse::<u16>().is_err()) {
            return Err(wrong());
        }
        match kind {
            "udpin" => Ok(Self::UdpIn(place.to_owned())),
            "udpout" => Ok(Self::UdpOut(place.to_owned())),
            "tcpin" => Ok(Self::TcpIn(place.to_owned())),
            _ => Err(wrong()),
        }
    }
}

/// A message with its sender.
pub(super) type Parcel = (MavHeader, MavMessage);

/// An open link.
pub(super) struct Gate {
    pub(super) incoming: mpsc::Receiver<Parcel>,
    outgoing: mpsc::Sender<Parcel>,
    local: SocketAddr,
}

impl fmt::Debug for Gate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gate").field("local", &self.local).finish_non_exhaustive()
    }
}

impl Gate {
    /// Opens `address` until `stop` is cancelled. With `signing` what leaves is signed, and what
    /// comes in unsigned, wrongly signed or twice is dropped.
    pub(super) async fn open(
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
                local
            }
            GateAddress::UdpOut(peer) => {
                let socket = UdpSocket::bind("0.0.0.0:0").await?;
                let unknown = || io::Error::new(io::ErrorKind::NotFound, "the peer is not known");
                let peer = tokio::net::lookup_host(peer).await?.next().ok_or_else(unknown)?;
                let local = socket.local_addr()?;
                tokio::spawn(stop.run_until_cancelled_owned(datagrams(socket, Some(peer), ends)));
                local
            }
            GateAddress::TcpIn(bind) => {
                let listener = TcpListener::bind(bind).await?;
                let local = listener.local_addr()?;
                tokio::spawn(stop.run_until_cancelled_owned(serve(listener, ends)));
                local
            }
        };
        Ok(Self { incoming, outgoing, local })
    }

    /// Hands over a message; what does not fit is lost, as on a wire.
    pub(super) fn send(&self, parcel: Parcel) {
        if self.outgoing.try_send(parcel).is_err() {
            tracing::debug!("a message of the stub found no place");
        }
    }

    /// The own address.
    pub(super) const fn local(&self) -> SocketAddr {
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

    fn take_in(&self, raw: &MAVLinkMessageRaw) {
        if raw.message_id() == SETUP_SIGNING || !self.is_trusted(raw) {
            return;
        }
        let Ok(message) = MavMessage::parse(raw.version(), raw.message_id(), raw.payload()) else {
            return;
        };
        let header = MavHeader {
            system_id: raw.system_id(),
            component_id: raw.component_id(),
            sequence: raw.sequence(),
        };
        if self.incoming.try_send((header, message)).is_err() {
            tracing::debug!("a message for the stub found no place");
        }
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
                        tracing::debug!(%error, "a datagram of the stub was not sent");
                    }
                }
            }
            Ok((length, from)) = socket.recv_from(&mut buffer) => {
                if *peer.get_or_insert(from) == from {
                    let mut reader = MavlinkReader::new(&buffer[..length]);
                    while let Ok(raw) = reader.read_any_raw_message::<MavMessage>() {
                        ends.take_in(&raw);
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
                tracing::info!(%from, "a client of the stub");
                if let Err(error) = talk(stream, &mut ends).await {
                    tracing::info!(%from, %error, "the client has gone");
                }
            }
            // Nobody listens: gone.
            parcel = ends.outgoing.recv() => if parcel.is_none() { return },
        }
    }
}

async fn talk(stream: TcpStream, ends: &mut Ends) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let (reader, mut writer) = stream.into_split();
    let mut reader = AsyncMavlinkReader::new(reader);
    loop {
        tokio::select! {
            raw = reader.read_any_raw_message::<MavMessage>() => match raw {
                Ok(raw) => ends.take_in(&raw),
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
