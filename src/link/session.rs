//! The protocol without I/O: who is who, what is asked, what is answered.

mod act;
mod origin;
mod receive;
mod samples;

pub(crate) use receive::is_known_autopilot;

use super::autopilot_clock::AutopilotClock;
use super::command::Commands;
use super::dialect::Dialect;
use super::operator::OperatorDesk;
use super::params::ParamServer;
use super::streams::Streams;
use super::telemetry::Telemetry;
use super::{LinkStats, OWN_COMPONENT, Settings};
use crate::geometry::{Body, Hall, Rotation};
use crate::messages::{Severity, VehicleState};
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType, TIMESYNC_DATA,
};
use nalgebra::Vector3;
use origin::Origin;
use std::time::Duration;

const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
const TIMESYNC_EVERY: Duration = Duration::from_millis(100);
const AUTOPILOT_SILENT_FOR: Duration = Duration::from_secs(3);
/// A second autopilot counts as gone after so long without a heartbeat.
const RIVAL_REMEMBERED_FOR: Duration = Duration::from_secs(10);
/// Words on the mode that follow each other faster come as changes do; PX4's default is one in two
/// seconds, and what is asked for brings two in one.
const MODE_NEWS_EVERY: Duration = Duration::from_millis(1_200);
/// The default system id of both families, used only where this side has to speak before it has heard.
const FIRST_GUESS_SYSTEM: u8 = 1;

/// What one call produced, in order.
#[derive(Debug, Clone, Default)]
pub struct SessionOutput {
    /// For the brain.
    pub events: Vec<Event>,
    /// To be sent under [`Session::header`].
    pub messages: Vec<MavMessage>,
}

impl SessionOutput {
    /// Empties both lists and keeps their memory.
    pub fn clear(&mut self) {
        self.events.clear();
        self.messages.clear();
    }
}

/// One autopilot, the people behind it, and this service's place among them.
///
/// The first heartbeat of component 1 that shows a known family fixes that family and the system
/// id: it is the autopilot's and, with component 191, also the own one. Nothing is sent unless [`Session::on_time`] or
/// [`Session::on_action`] is called, so the heartbeat stops when the caller stops.
#[derive(Debug, Clone)]
pub struct Session {
    settings: Settings,
    autopilot: Option<Autopilot>,
    clock: AutopilotClock,
    commands: Commands,
    streams: Streams,
    telemetry: Telemetry,
    operators: OperatorDesk,
    params: ParamServer,
    heartbeat_sent_at: Option<Stamp<Mono>>,
    timesync_sent_at: Option<Stamp<Mono>>,
    stats: LinkStats,
}

/// What is known of the autopilot.
#[derive(Debug, Clone)]
struct Autopilot {
    system: u8,
    dialect: Dialect,
    origin: Origin,
    /// When another autopilot was last heard.
    rival_heard_at: Option<Stamp<Mono>>,
    /// The sequence number that its next frame should have.
    next_sequence: Option<u8>,
    /// When its numbering first jumped far back of late, and how often since.
    jumps: Option<(Stamp<Mono>, u8)>,
    heard_at: Stamp<Mono>,
    is_lost: bool,
    state: VehicleState,
    attitude: Option<HeardAttitude>,
    last_imu_at: Option<Stamp<Mono>>,
    has_battery_status: bool,
    /// When `CURRENT_MODE` last came.
    mode_heard_at: Option<Stamp<Mono>>,
}

/// The autopilot's attitude at an instant, and how it turns.
#[derive(Debug, Clone, Copy)]
struct HeardAttitude {
    at: Stamp<Mono>,
    rotation: Rotation<Hall, Body>,
    /// In Body axes.
    rate_radps: Vector3<f64>,
}

impl Session {
    /// A session that has heard nothing yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            streams: Streams::new(&settings),
            params: ParamServer::new(&settings.published),
            settings,
            autopilot: None,
            clock: AutopilotClock::default(),
            commands: Commands::default(),
            telemetry: Telemetry::default(),
            operators: OperatorDesk::default(),
            heartbeat_sent_at: None,
            timesync_sent_at: None,
            stats: LinkStats::default(),
        }
    }

    /// What every message is sent under; the transport numbers them.
    #[must_use]
    pub fn header(&self) -> MavHeader {
        let system = self.autopilot_system().unwrap_or(FIRST_GUESS_SYSTEM);
        MavHeader { system_id: u32::from(system), component_id: OWN_COMPONENT, sequence: 0 }
    }

    /// The autopilot's system id, once it has been heard.
    #[must_use]
    pub fn autopilot_system(&self) -> Option<u8> {
        self.autopilot.as_ref().map(|autopilot| autopilot.system)
    }

    /// True once the autopilot's clock can be read; until then its samples are dropped.
    #[must_use]
    pub fn is_clock_known(&self) -> bool {
        self.clock.mono_from_boot(Stamp::ZERO).is_some()
    }

    /// The counters.
    #[must_use]
    pub const fn stats(&self) -> LinkStats {
        self.stats
    }

    /// Does what is due at `now`; to be called at every tick of the brain.
    pub fn on_time(&mut self, now: Stamp<Mono>, out: &mut SessionOutput) {
        let sent_before = out.messages.len();
        self.watch_autopilot(now, out);
        if self.autopilot.is_some() || self.settings.address.speaks_first() {
            self.heartbeat(now, out);
        }
        if let Some(Autopilot { system, dialect, is_lost: false, origin, .. }) = &mut self.autopilot
        {
            let (system, dialect) = (*system, *dialect);
            origin.on_time(dialect, system, now, &mut out.messages);
            self.timesync(system, now, out);
            let thin_before = self.stats.thin_imu_windows;
            self.streams.on_time(system, dialect, now, &mut self.stats, &mut out.messages);
            if thin_before == 0 && self.stats.thin_imu_windows > 0 {
                self.telemetry.say(
                    Severity::Warning,
                    dialect.thin_line_advice(),
                    &mut out.messages,
                );
            }
            self.commands.on_time(system, now, &mut self.stats, out);
            self.params.on_time(&mut out.messages);
            self.telemetry.on_time(now, &mut out.messages);
        }
        self.count_sent(sent_before, out);
    }

    fn count_sent(&mut self, sent_before: usize, out: &SessionOutput) {
        let sent = u64::try_from(out.messages.len() - sent_before).unwrap_or(u64::MAX);
        self.stats.messages_out = self.stats.messages_out.saturating_add(sent);
    }

    /// Says once that the autopilot has fallen silent.
    fn watch_autopilot(&mut self, now: Stamp<Mono>, out: &mut SessionOutput) {
        let Some(autopilot) = &mut self.autopilot else { return };
        if !autopilot.is_lost && now.since(autopilot.heard_at) > AUTOPILOT_SILENT_FOR {
            autopilot.is_lost = true;
            self.stats.autopilot_losses += 1;
            self.streams.forget();
            self.commands.abandon(now, out);
            out.events.push(Event::AutopilotLost(now));
        }
    }

    fn heartbeat(&mut self, now: Stamp<Mono>, out: &mut SessionOutput) {
        if is_due(&mut self.heartbeat_sent_at, HEARTBEAT_EVERY, now) {
            out.messages.push(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                custom_mode: 0,
                mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                base_mode: MavModeFlag::empty(),
                system_status: MavState::MAV_STATE_ACTIVE,
                mavlink_version: 3,
            }));
        }
    }

    fn timesync(&mut self, system: u8, now: Stamp<Mono>, out: &mut SessionOutput) {
        if is_due(&mut self.timesync_sent_at, TIMESYNC_EVERY, now) {
            self.clock.on_request(now);
            out.messages.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: 0,
                ts1: now.nanos(),
                target_system: system,
                target_component: super::AUTOPILOT_COMPONENT,
            }));
        }
    }
}

impl Autopilot {
    const fn new(system: u8, dialect: Dialect, state: VehicleState) -> Self {
        Self {
            system,
            dialect,
            origin: Origin::new(),
            rival_heard_at: None,
            next_sequence: None,
            jumps: None,
            heard_at: state.at,
            is_lost: false,
            state,
            attitude: None,
            last_imu_at: None,
            has_battery_status: false,
            mode_heard_at: None,
        }
    }
}

/// True, and remembered, if `every` has passed since the last time.
///
/// The next turn is counted from the last one's due time, so that 60 Hz ticks keep 10 Hz exactly;
/// after a pause it starts anew.
fn is_due(last: &mut Option<Stamp<Mono>>, every: Duration, now: Stamp<Mono>) -> bool {
    match *last {
        Some(at) if now.since(at) < every => false,
        Some(at) if now.since(at) < 2 * every => {
            *last = Some(at.plus(every));
            true
        }
        _ => {
            *last = Some(now);
            true
        }
    }
}

#[cfg(test)]
mod tests;
