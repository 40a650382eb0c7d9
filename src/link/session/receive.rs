//! Messages from the autopilot and from people.

use super::act::operator_ack;
use super::{Autopilot, MODE_NEWS_EVERY, RIVAL_REMEMBERED_FOR, Session, SessionOutput};
use crate::link::dialect::Dialect;
use crate::link::{AUTOPILOT_COMPONENT, OWN_COMPONENT, PAGE, inbound};
use crate::messages::{
    FlightMode, LandedState, OperatorAnswer, OperatorCommand, OperatorRequest, OperatorVerb,
    Severity,
};
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, GPS_GLOBAL_ORIGIN_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage,
    MavResult,
};
use mavlink::{MavHeader, Message as _, MessageData as _};
use std::time::Duration;

/// Frames that overtake one another on the way are not further apart.
const MOST_REORDERED: u8 = 16;
/// So many far jumps back of the numbering …
const JUMPS_OF_TWO: u8 = 4;
/// … within this time come from two autopilots with the same number; a restart makes one.
const JUMPS_WITHIN: Duration = Duration::from_secs(2);

/// True for the heartbeat of an autopilot that is spoken here.
pub(crate) fn is_known_autopilot(header: &MavHeader, data: &HEARTBEAT_DATA) -> bool {
    header.component_id == AUTOPILOT_COMPONENT && Dialect::of(data).is_some()
}

impl Session {
    /// Takes in one message that arrived from the wire and appends what follows from it to `out`.
    pub fn on_message(
        &mut self,
        header: &MavHeader,
        message: &MavMessage,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let sent_before = out.messages.len();
        self.count_missed(header, arrived);
        match u8::try_from(header.system_id) {
            Ok(system) => self.dispatch(system, header.component_id, message, arrived, out),
            Err(_) => self.stats.foreign_messages += 1,
        }
        self.count_sent(sent_before, out);
    }

    /// Frames of the autopilot that its numbering skips were lost on the way; a numbering that jumps
    /// back and forth is that of two autopilots.
    fn count_missed(&mut self, header: &MavHeader, arrived: Stamp<Mono>) {
        let Some(autopilot) = &mut self.autopilot else { return };
        let is_autopilot = header.system_id == u32::from(autopilot.system)
            && header.component_id == AUTOPILOT_COMPONENT;
        if !is_autopilot {
            return;
        }
        if let Some(expected) = autopilot.next_sequence {
            let skipped = header.sequence.wrapping_sub(expected);
            // A late or repeated frame would look like almost a whole round.
            if skipped < 128 {
                self.stats.messages_missed += u64::from(skipped);
            } else if skipped < u8::MAX - MOST_REORDERED {
                autopilot.jumps_back(arrived);
            }
        }
        autopilot.next_sequence = Some(header.sequence.wrapping_add(1));
    }

    fn dispatch(
        &mut self,
        system: u8,
        component: u8,
        message: &MavMessage,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        match message {
            MavMessage::HEARTBEAT(data) => self.heartbeat_in(system, component, data, arrived, out),
            MavMessage::COMMAND_LONG(data) => {
                let target = (data.target_system, data.target_component);
                let asked = (data.command, data.param1);
                self.asked((system, component), target, asked, arrived, out);
            }
            MavMessage::COMMAND_INT(data) => {
                let target = (data.target_system, data.target_component);
                let asked = (data.command, data.param1);
                self.asked((system, component), target, asked, arrived, out);
            }
            MavMessage::PARAM_REQUEST_LIST(_)
            | MavMessage::PARAM_REQUEST_READ(_)
            | MavMessage::PARAM_SET(_) => {
                let own = self.autopilot_system().map(|system| (system, OWN_COMPONENT));
                let is_mine =
                    own.is_some_and(|own| self.params.on_message(message, own, &mut out.messages));
                self.stats.foreign_messages += u64::from(!is_mine);
            }
            _ if component == AUTOPILOT_COMPONENT && Some(system) == self.autopilot_system() => {
                self.stats.messages_in += 1;
                self.streams.on_arrival(message.message_id());
                self.autopilot_says(message, arrived, out);
            }
            _ => self.stats.foreign_messages += 1,
        }
    }

    fn autopilot_says(
        &mut self,
        message: &MavMessage,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        match message {
            MavMessage::HIGHRES_IMU(data) => {
                self.imu(data.time_usec, inbound::inertial(data), arrived, out);
            }
            MavMessage::RAW_IMU(data) if self.streams.wants_raw_imu() => {
                self.imu(data.time_usec, Some(inbound::raw_inertial(data)), arrived, out);
            }
            MavMessage::GPS_GLOBAL_ORIGIN(data) => self.origin(data, out),
            MavMessage::TIMESYNC(data) => self.timesync_in(data, arrived, out),
            MavMessage::LOCAL_POSITION_NED(data) => self.position(data, arrived, out),
            MavMessage::ATTITUDE_QUATERNION(data) => self.attitude(data, arrived),
            MavMessage::CURRENT_MODE(data) => self.current_mode(data.custom_mode, arrived, out),
            MavMessage::EXTENDED_SYS_STATE(data) => {
                self.landed(inbound::landed_state(data.landed_state), arrived, out);
            }
            MavMessage::BATTERY_STATUS(data) if data.id == 0 => {
                let sample = inbound::battery_status(data, arrived);
                if let Some(autopilot) = &mut self.autopilot {
                    autopilot.has_battery_status |= sample.is_some();
                }
                self.battery(sample, out);
            }
            MavMessage::SYS_STATUS(data)
                if self.autopilot.as_ref().is_some_and(|a| !a.has_battery_status) =>
            {
                self.battery(inbound::sys_status_battery(data, arrived), out);
            }
            MavMessage::COMMAND_ACK(data) => self.command_ack(data, arrived, out),
            _ => {}
        }
    }

    /// Latches the first autopilot of a known family, follows its heartbeat, refuses any other.
    fn heartbeat_in(
        &mut self,
        system: u8,
        component: u8,
        data: &HEARTBEAT_DATA,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let family = Dialect::of(data).filter(|_| component == AUTOPILOT_COMPONENT && system != 0);
        match (&mut self.autopilot, family) {
            (None, Some(dialect)) => {
                let state = dialect.vehicle_state(data, LandedState::Unknown, arrived);
                self.autopilot = Some(Autopilot::new(system, dialect, state));
                self.streams.speak(dialect);
            }
            (Some(autopilot), Some(dialect))
                if autopilot.system == system && autopilot.dialect == dialect =>
            {
                let mode_before = autopilot.state.mode;
                autopilot.follow(data, arrived);
                if is_left(mode_before, autopilot.state.mode) {
                    self.commands.withdraw();
                }
            }
            _ if data.autopilot == MavAutopilot::MAV_AUTOPILOT_INVALID => {
                self.stats.foreign_messages += 1;
                return;
            }
            (known, family) => {
                self.stats.refused_autopilots += 1;
                if let (Some(autopilot), Some(_)) = (known, family) {
                    autopilot.rival_heard_at = Some(arrived);
                }
                return;
            }
        }
        self.stats.messages_in += 1;
        self.streams.on_arrival(HEARTBEAT_DATA::ID);
        out.events.extend(self.autopilot.as_ref().map(|a| Event::Vehicle(a.state)));
    }

    /// The mode between two heartbeats; a change is told at once. Whichever of the two came last
    /// counts: both are filled when they leave.
    fn current_mode(&mut self, custom_mode: u32, arrived: Stamp<Mono>, out: &mut SessionOutput) {
        let Some(autopilot) = &mut self.autopilot else { return };
        let mode = autopilot.dialect.mode_numbered(custom_mode);
        if is_left(autopilot.state.mode, mode) {
            self.commands.withdraw();
        }
        let is_prompt = autopilot.tells_mode_at_once(arrived);
        autopilot.mode_heard_at = Some(arrived);
        let state = &mut autopilot.state;
        // Whether a silent autopilot is back is for its heartbeat to say; that somebody else has the
        // vehicle cannot wait for that.
        let is_told = !autopilot.is_lost || mode != FlightMode::Companion;
        if is_told && (state.mode, state.is_mode_prompt) != (mode, is_prompt) {
            (state.mode, state.is_mode_prompt, state.at) = (mode, is_prompt, arrived);
            out.events.push(Event::Vehicle(*state));
            out.events.extend(autopilot.is_lost.then_some(Event::AutopilotLost(arrived)));
        }
    }

    /// Somebody has set an origin: put it level where its altitude is a danger, and say so.
    fn origin(&mut self, data: &GPS_GLOBAL_ORIGIN_DATA, out: &mut SessionOutput) {
        let Some(autopilot) = &mut self.autopilot else { return };
        let (dialect, system) = (autopilot.dialect, autopilot.system);
        if let Some(message) = autopilot.origin.on_heard(data, dialect, system) {
            self.stats.origins_levelled += 1;
            out.messages.push(message);
            let altitude_m = f64::from(data.altitude) * 1e-3;
            let text = format!("map origin at {altitude_m:.0} m is dangerous indoors: set to 0 m");
            self.telemetry.say(Severity::Warning, &text, &mut out.messages);
        }
    }

    /// The landed state is told at each change; the heartbeat repeats it.
    fn landed(&mut self, landed: LandedState, arrived: Stamp<Mono>, out: &mut SessionOutput) {
        let Some(autopilot) = &mut self.autopilot else { return };
        if autopilot.state.landed != landed {
            autopilot.state.landed = landed;
            autopilot.state.at = arrived;
            if !autopilot.is_lost {
                out.events.push(Event::Vehicle(autopilot.state));
            }
        }
    }

    /// An answer counts if it is meant for this component; old firmware leaves the target at 0.
    fn command_ack(
        &mut self,
        data: &COMMAND_ACK_DATA,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let own_system = self.autopilot_system().unwrap_or(0);
        let is_mine = (data.target_system == 0 || data.target_system == own_system)
            && (data.target_component == 0 || data.target_component == OWN_COMPONENT);
        if is_mine {
            self.commands.on_answer(data.command, data.result, arrived, out);
        }
    }

    /// A command from anyone; only those to this very component are looked at.
    fn asked(
        &mut self,
        from: (u8, u8),
        target: (u8, u8),
        (command, param1): (MavCmd, f32),
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let own = self.autopilot_system().map(|system| (system, OWN_COMPONENT));
        // System 0 is nobody on the wire: it means everybody, and here the own page.
        if own != Some(target) || own == Some(from) || from.0 == PAGE.system {
            self.stats.foreign_messages += 1;
            return;
        }
        let (system, component) = from;
        if let Some(verb) = inbound::operator_verb(command, param1) {
            self.stats.operator_commands += 1;
            let from = OperatorRequest { system, component };
            if !self.operators.passes(verb, from, arrived) {
                let refusal = OperatorAnswer { verb, to: from, is_accepted: false };
                out.messages.push(operator_ack(&refusal));
                return;
            }
            out.events.push(Event::Operator(OperatorCommand { at: arrived, verb, from }));
        } else {
            self.stats.unsupported_commands += 1;
            out.messages.push(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command,
                result: MavResult::MAV_RESULT_UNSUPPORTED,
                target_system: system,
                target_component: component,
                ..Default::default()
            }));
        }
    }
}

impl Session {
    /// Takes in a wish from the own page; `None` for a start that was called off meanwhile.
    ///
    /// The answer is the brain's [`crate::pilot::Action::Answer`] to [`PAGE`], as
    /// [`Self::own_answer`] gives it.
    pub fn on_own_wish(&mut self, verb: OperatorVerb, arrived: Stamp<Mono>) -> Option<Event> {
        self.stats.operator_commands += 1;
        let passes = self.operators.passes(verb, PAGE, arrived);
        passes.then_some(Event::Operator(OperatorCommand { at: arrived, verb, from: PAGE }))
    }
}

/// True if the companion steers no more.
fn is_left(before: FlightMode, after: FlightMode) -> bool {
    before == FlightMode::Companion && after != FlightMode::Companion
}

impl Autopilot {
    /// The numbering of its frames has jumped far back.
    fn jumps_back(&mut self, arrived: Stamp<Mono>) {
        match &mut self.jumps {
            Some((first_at, n_jumps)) if arrived.since(*first_at) < JUMPS_WITHIN => {
                *n_jumps = n_jumps.saturating_add(1);
                if *n_jumps >= JUMPS_OF_TWO {
                    self.rival_heard_at = Some(arrived);
                }
            }
            jumps => *jumps = Some((arrived, 1)),
        }
    }

    fn tells_mode_at_once(&self, now: Stamp<Mono>) -> bool {
        self.dialect.heartbeat_tells_mode()
            || self.mode_heard_at.is_some_and(|at| now.since(at) < MODE_NEWS_EVERY)
    }

    /// Takes in the next heartbeat.
    fn follow(&mut self, data: &HEARTBEAT_DATA, arrived: Stamp<Mono>) {
        self.state = self.dialect.vehicle_state(data, self.state.landed, arrived);
        self.state.is_mode_prompt = self.tells_mode_at_once(arrived);
        self.state.is_contested =
            self.rival_heard_at.is_some_and(|at| arrived.since(at) < RIVAL_REMEMBERED_FOR);
        self.heard_at = arrived;
        self.is_lost = false;
    }
}
