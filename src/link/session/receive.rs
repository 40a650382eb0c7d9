//! Messages from the autopilot and from people.

use super::act::operator_ack;
use super::{Autopilot, Session, SessionOutput};
use crate::link::dialect::{Dialect, Px4};
use crate::link::{AUTOPILOT_COMPONENT, OWN_COMPONENT, inbound};
use crate::messages::{
    LandedState, OperatorAnswer, OperatorCommand, OperatorRequest, VehicleState,
};
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavResult,
};
use mavlink::{MavHeader, Message as _};

/// True for the heartbeat of an autopilot that is spoken here.
pub(crate) fn is_known_autopilot(header: &MavHeader, data: &HEARTBEAT_DATA) -> bool {
    header.component_id == AUTOPILOT_COMPONENT && data.autopilot == Px4::AUTOPILOT
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
        match u8::try_from(header.system_id) {
            Ok(system) => self.dispatch(system, header.component_id, message, arrived, out),
            Err(_) => self.stats.foreign_messages += 1,
        }
        self.count_sent(sent_before, out);
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
                self.asked((system, component), target, data.command, arrived, out);
            }
            MavMessage::COMMAND_INT(data) => {
                let target = (data.target_system, data.target_component);
                self.asked((system, component), target, data.command, arrived, out);
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
            MavMessage::HIGHRES_IMU(data) => self.imu(data, arrived, out),
            MavMessage::TIMESYNC(data) => self.timesync_in(data, arrived, out),
            MavMessage::LOCAL_POSITION_NED(data) => self.position(data, arrived, out),
            MavMessage::ATTITUDE_QUATERNION(data) => self.attitude(data, arrived),
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
        let is_known = component == AUTOPILOT_COMPONENT && data.autopilot == Px4::AUTOPILOT;
        match &mut self.autopilot {
            None if is_known && system != 0 => {
                let state = vehicle_state(data, LandedState::Unknown, arrived);
                self.autopilot = Some(Autopilot::new(system, state));
            }
            Some(autopilot) if is_known && autopilot.system == system => {
                autopilot.state = vehicle_state(data, autopilot.state.landed, arrived);
                autopilot.heard_at = arrived;
                autopilot.is_lost = false;
            }
            _ if data.autopilot == MavAutopilot::MAV_AUTOPILOT_INVALID => {
                self.stats.foreign_messages += 1;
                return;
            }
            _ => {
                self.stats.refused_autopilots += 1;
                return;
            }
        }
        self.stats.messages_in += 1;
        out.events.extend(self.autopilot.as_ref().map(|a| Event::Vehicle(a.state)));
    }

    /// The landed state is told at each change; the heartbeat repeats it.
    fn landed(&mut self, landed: LandedState, arrived: Stamp<Mono>, out: &mut SessionOutput) {
        let Some(autopilot) = &mut self.autopilot else { return };
        if autopilot.state.landed != landed {
            autopilot.state.landed = landed;
            autopilot.state.at = arrived;
            out.events.push(Event::Vehicle(autopilot.state));
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
        command: MavCmd,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let own = self.autopilot_system().map(|system| (system, OWN_COMPONENT));
        if own != Some(target) || own == Some(from) {
            self.stats.foreign_messages += 1;
            return;
        }
        let (system, component) = from;
        if let Some(verb) = inbound::operator_verb(command) {
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

fn vehicle_state(data: &HEARTBEAT_DATA, landed: LandedState, at: Stamp<Mono>) -> VehicleState {
    VehicleState {
        at,
        is_armed: data.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
        mode: Px4::flight_mode(data),
        landed,
        in_failsafe: Px4::is_in_failsafe(data),
    }
}
