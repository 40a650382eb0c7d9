//! Where the truth comes from.

use super::truth::{Truth, truth_of};
use crate::gate::{Gate, GateAddress};
use std::net::SocketAddr;
use std::str::FromStr;
use stockpilot::service::clock::Clock;
use stockpilot::time::{Mono, Stamp};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Truths that wait for the emulators: far more than come in one of their steps.
const CAPACITY: usize = 256;

/// Where the simulator tells the truth.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TruthAddress {
    /// On the service's own link, asked for there.
    Link,
    /// On another link.
    At(GateAddress),
}

impl FromStr for TruthAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "link" {
            return Ok(Self::Link);
        }
        text.parse().map(Self::At).map_err(|error| format!("neither `link`, and {error}"))
    }
}

/// A truth and when it arrived.
pub(super) type Arrived = (Stamp<Mono>, Truth);

/// Stamps truths as they arrive.
#[derive(Debug, Clone)]
pub(super) struct Listener {
    clock: Clock,
    truths: mpsc::Sender<Arrived>,
}

impl Listener {
    pub(super) fn new(clock: Clock) -> (Self, mpsc::Receiver<Arrived>) {
        let (truths, receiver) = mpsc::channel(CAPACITY);
        (Self { clock, truths }, receiver)
    }

    /// Takes a message; true if it was a truth.
    pub(super) fn hear(&self, message: &mavlink::dialects::ardupilotmega::MavMessage) -> bool {
        match truth_of(message) {
            Some(Ok(truth)) => {
                if self.truths.try_send((self.clock.now(), truth)).is_err() {
                    tracing::debug!("a truth found no place");
                }
                true
            }
            Some(Err(error)) => {
                tracing::warn!(%error, "a truth cannot be used");
                false
            }
            None => false,
        }
    }
}

/// Listens on a link of its own; gives its address.
pub(super) async fn listen(
    address: &GateAddress,
    listener: Listener,
    stop: CancellationToken,
) -> std::io::Result<Option<SocketAddr>> {
    let gate = Gate::open(address, None, stop.clone()).await?;
    let local = gate.local();
    tokio::spawn(stop.run_until_cancelled_owned(async move {
        // The whole of it: the link ends when its other half is dropped.
        let mut gate = gate;
        while let Some((_, message)) = gate.incoming.recv().await {
            listener.hear(&message);
        }
    }));
    Ok(local)
}
