//! An autopilot on the other end of a link, for tools.

use super::comparison::{Comparison, compare, compare_demand};
use super::exchange::{Exchange, Outcome};
use super::file::ParamFile;
use super::value::{Encoding, Kind, Value};
use crate::link::transport::{Outgoing, Timer, Transport};
use crate::link::{AUTOPILOT_COMPONENT, Address, Guard, OWN_COMPONENT};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType,
};
use std::time::Duration;
use tokio_util::sync::{CancellationToken, DropGuard};

/// An autopilot speaks once a second.
const HEARD_WITHIN: Duration = Duration::from_secs(10);
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
const POLL_EVERY: Duration = Duration::from_millis(20);
/// The system id that is used before the autopilot has told its own.
const FIRST_GUESS_SYSTEM: u8 = 1;

/// Why nothing came of it.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The link cannot be opened.
    #[error("cannot open {address}: {source}")]
    Link {
        /// Which.
        address: Address,
        /// Why.
        source: std::io::Error,
    },
    /// Nobody speaks.
    #[error("no autopilot was heard on {0} within 10 s")]
    Silent(Address),
    /// The motors may turn.
    #[error("the autopilot is armed: parameters are written on the ground only")]
    Armed,
    /// It speaks, but tells no parameter.
    #[error("the autopilot answers none of {n_asked} parameters")]
    Mute {
        /// How many it was asked for.
        n_asked: usize,
    },
    /// The link's task has ended.
    #[error("the link has ended")]
    Ended,
}

/// An autopilot that was heard.
#[derive(Debug)]
pub struct LiveAutopilot<T> {
    transport: Transport,
    timer: T,
    system: u8,
    encoding: Encoding,
    is_armed: bool,
    _stop: DropGuard,
}

impl<T: Timer> LiveAutopilot<T> {
    /// Opens `address` and waits for the heartbeat of an autopilot.
    ///
    /// # Errors
    /// A link that cannot be opened, or ten seconds without a heartbeat.
    pub async fn find(address: &Address, guard: Guard, timer: T) -> Result<Self, LiveError> {
        let stop = CancellationToken::new();
        let transport = Transport::start_guarded(address, guard, timer.clone(), stop.clone()).await;
        let transport =
            transport.map_err(|source| LiveError::Link { address: address.clone(), source })?;
        let mut found = Self {
            transport,
            timer,
            system: FIRST_GUESS_SYSTEM,
            encoding: Encoding::Bytewise,
            is_armed: false,
            _stop: stop.drop_guard(),
        };
        let deadline = found.timer.now().plus(HEARD_WITHIN);
        loop {
            if address.speaks_first() {
                found.send(heartbeat());
            }
            let wait = found.timer.now().plus(HEARTBEAT_EVERY);
            if found.hears_autopilot(wait).await? {
                return Ok(found);
            }
            if found.timer.now() > deadline {
                return Err(LiveError::Silent(address.clone()));
            }
        }
    }

    /// The kind of autopilot, by how it encodes parameters.
    #[must_use]
    pub const fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Its system id.
    #[must_use]
    pub const fn system(&self) -> u8 {
        self.system
    }

    /// What the autopilot has under these names.
    ///
    /// # Errors
    /// [`LiveError::Ended`].
    pub async fn read(&mut self, names: &[String]) -> Result<Vec<Outcome>, LiveError> {
        self.work_off(Exchange::read(self.system, self.encoding, names)).await
    }

    /// Every line and demand of a file beside what the autopilot has.
    ///
    /// # Errors
    /// [`LiveError::Ended`], and [`LiveError::Mute`] if it answers not a single one.
    pub async fn compare(&mut self, file: &ParamFile) -> Result<Vec<Comparison>, LiveError> {
        let names: Vec<String> = file.lines.iter().map(|line| line.name.clone()).collect();
        let outcomes = self.read(&names).await?;
        if outcomes.iter().all(|outcome| outcome.found.is_none()) {
            return Err(LiveError::Mute { n_asked: names.len() });
        }
        let pairs = std::iter::zip(&file.lines, outcomes);
        let mut comparisons: Vec<_> =
            pairs.map(|(line, outcome)| compare(line, outcome.found)).collect();
        for demand in &file.demands {
            let outcomes = self.read(&demand.names).await?;
            let found: Vec<_> = outcomes.iter().map(|outcome| outcome.found).collect();
            comparisons.push(compare_demand(demand, &found));
        }
        Ok(comparisons)
    }

    /// Writes values of the autopilot's own types, and says what it has afterwards.
    ///
    /// # Errors
    /// [`LiveError::Armed`] in flight, [`LiveError::Ended`].
    pub async fn write(
        &mut self,
        values: Vec<(String, Kind, Value)>,
    ) -> Result<Vec<Outcome>, LiveError> {
        if self.is_armed {
            return Err(LiveError::Armed);
        }
        self.work_off(Exchange::write(self.system, self.encoding, values)).await
    }

    async fn work_off(&mut self, mut exchange: Exchange) -> Result<Vec<Outcome>, LiveError> {
        let mut heartbeat_due = self.timer.now();
        let mut messages = Vec::new();
        while !exchange.is_done() {
            let now = self.timer.now();
            if now >= heartbeat_due {
                heartbeat_due = now.plus(HEARTBEAT_EVERY);
                messages.push(heartbeat());
            }
            exchange.on_time(now, &mut messages);
            for message in messages.drain(..) {
                self.send(message);
            }
            let timer = self.timer.clone();
            tokio::select! {
                received = self.transport.received.recv() => {
                    let received = received.ok_or(LiveError::Ended)?;
                    if let MavMessage::PARAM_VALUE(data) = &received.message
                        && self.is_mine(&received.header)
                    {
                        exchange.on_value(data);
                    }
                }
                () = timer.sleep_until(now.plus(POLL_EVERY)) => {}
            }
        }
        Ok(exchange.outcomes())
    }

    /// True once a heartbeat of an autopilot has come; false if none came until `deadline`.
    async fn hears_autopilot(
        &mut self,
        deadline: crate::time::Stamp<crate::time::Mono>,
    ) -> Result<bool, LiveError> {
        let timer = self.timer.clone();
        loop {
            let received = tokio::select! {
                received = self.transport.received.recv() => received.ok_or(LiveError::Ended)?,
                () = timer.sleep_until(deadline) => return Ok(false),
            };
            let MavMessage::HEARTBEAT(data) = &received.message else { continue };
            let Ok(system) = u8::try_from(received.header.system_id) else { continue };
            let encoding = match data.autopilot {
                MavAutopilot::MAV_AUTOPILOT_PX4 => Encoding::Bytewise,
                MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Encoding::CCast,
                _ => continue,
            };
            if received.header.component_id == AUTOPILOT_COMPONENT {
                self.system = system;
                self.encoding = encoding;
                self.is_armed = data.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                return Ok(true);
            }
        }
    }

    fn is_mine(&self, header: &MavHeader) -> bool {
        header.system_id == u32::from(self.system) && header.component_id == AUTOPILOT_COMPONENT
    }

    fn send(&self, message: MavMessage) {
        let header = MavHeader {
            system_id: u32::from(self.system),
            component_id: OWN_COMPONENT,
            sequence: 0,
        };
        // What finds no place is asked for again.
        let _sent = self.transport.outgoing.send(Outgoing { header, message });
    }
}

fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_STANDBY,
        mavlink_version: 3,
    })
}
