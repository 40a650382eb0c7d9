//! The person at the simulator's ground station link.

use crate::gate::{Gate, GateAddress};
use crate::operator::Operator;
use mavlink::SigningData;
use std::net::SocketAddr;
use std::sync::Arc;
use stockpilot::time::{Mono, Stamp};
use tokio_util::sync::CancellationToken;

/// A ground station on a link of the autopilot's own, which routes to and from the service; or none,
/// where the user has one.
#[derive(Debug)]
pub(super) struct Ground {
    operator: Operator,
    gate: Option<Gate>,
}

impl Ground {
    pub(super) async fn open(
        address: Option<&GateAddress>,
        signing: Option<Arc<SigningData>>,
        stop: CancellationToken,
    ) -> std::io::Result<Self> {
        let gate = match address {
            Some(address) => Some(Gate::open(address, signing, stop).await?),
            None => None,
        };
        Ok(Self { operator: Operator::default(), gate })
    }

    pub(super) fn local(&self) -> Option<SocketAddr> {
        self.gate.as_ref()?.local()
    }

    /// Speaks and listens, `now` after the flight began.
    pub(super) fn step(&mut self, now: Stamp<Mono>) {
        let Some(gate) = &mut self.gate else { return };
        while let Ok((header, message)) = gate.incoming.try_recv() {
            self.operator.hear(header, &message);
        }
        for parcel in self.operator.speak(now) {
            gate.send(parcel);
        }
    }

    /// What the service has said to the people.
    pub(super) fn texts(&self) -> &[String] {
        &self.operator.texts
    }
}
