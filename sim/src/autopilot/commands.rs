//! `COMMAND_LONG`, `COMMAND_INT` and `SET_MODE` with the answers of PX4 v1.16.1.

use super::frames::whole;
use super::modes::{ModeRequest, Px4Mode};
use super::outbox::Link;
use super::streams::id;
use super::stub::StubPx4;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult,
    MavSeverity,
};

/// Component id of ground stations; only they hear why a mode is not available.
const GROUND_COMPONENT: u8 = 190;
/// param2 of `MAV_CMD_COMPONENT_ARM_DISARM` that disarms in the air.
const FORCE: f32 = 21196.0;

/// A command, whichever message carried it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Command {
    command: MavCmd,
    params: [f32; 2],
    param3: f32,
    from: MavHeader,
    link: Link,
}

impl Command {
    pub(super) const fn long(from: MavHeader, link: Link, data: &COMMAND_LONG_DATA) -> Self {
        let params = [data.param1, data.param2];
        Self { command: data.command, params, param3: data.param3, from, link }
    }

    pub(super) const fn int(from: MavHeader, link: Link, data: &COMMAND_INT_DATA) -> Self {
        let params = [data.param1, data.param2];
        Self { command: data.command, params, param3: data.param3, from, link }
    }

    /// `SET_MODE`, which PX4 treats as `MAV_CMD_DO_SET_MODE`.
    pub(super) fn set_mode(from: MavHeader, link: Link, custom_mode: u32) -> Self {
        let [_, _, main, sub] = custom_mode.to_le_bytes();
        Self {
            command: MavCmd::MAV_CMD_DO_SET_MODE,
            params: [1.0, f32::from(main)],
            param3: f32::from(sub),
            from,
            link,
        }
    }
}

impl StubPx4 {
    /// Does what a command asks and acknowledges it.
    pub(super) fn on_command(&mut self, command: &Command) {
        let [param1, param2] = command.params;
        let result = match command.command {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.arm_or_disarm(param1, param2),
            MavCmd::MAV_CMD_DO_SET_MODE => {
                // The link answers first, then the commander.
                self.acknowledge(command, MavResult::MAV_RESULT_ACCEPTED);
                self.set_mode(command)
            }
            MavCmd::MAV_CMD_NAV_TAKEOFF => self.switch(command, Px4Mode::TakeOff),
            MavCmd::MAV_CMD_NAV_LAND => self.switch(command, Px4Mode::Land),
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => self.switch(command, Px4Mode::Return),
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => self.set_interval(command),
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.request_message(command),
            MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN => self.reboot_on_request(command),
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        };
        self.acknowledge(command, result);
    }

    fn acknowledge(&mut self, command: &Command, result: MavResult) {
        let ack = COMMAND_ACK_DATA {
            command: command.command,
            result,
            target_system: u8::try_from(command.from.system_id).unwrap_or(0),
            target_component: command.from.component_id,
            ..COMMAND_ACK_DATA::DEFAULT
        };
        self.outbox.send(command.link, MavMessage::COMMAND_ACK(ack));
    }

    fn arm_or_disarm(&mut self, param1: f32, param2: f32) -> MavResult {
        let facts = self.facts();
        let is_done = if param1 > 0.5 {
            let was_armed = self.commander.is_armed();
            let is_armed = self.commander.arm(self.now, &facts, &mut self.outbox);
            if is_armed && !was_armed {
                self.guidance.set_home(&self.belief);
            }
            is_armed
        } else {
            let is_forced = (param2 - FORCE).abs() < 0.5;
            self.commander.disarm(&facts, is_forced, &mut self.outbox)
        };
        accepted_or(is_done, MavResult::MAV_RESULT_TEMPORARILY_REJECTED)
    }

    fn set_mode(&mut self, command: &Command) -> MavResult {
        let byte = |value: f32| u8::try_from(whole(f64::from(value))).unwrap_or(u8::MAX);
        match Px4Mode::requested(byte(command.params[1]), byte(command.param3)) {
            ModeRequest::Known(mode) => self.switch(command, mode),
            ModeRequest::UnknownAuto => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            ModeRequest::UnknownMain => MavResult::MAV_RESULT_ACCEPTED,
        }
    }

    fn switch(&mut self, command: &Command, mode: Px4Mode) -> MavResult {
        let facts = self.facts();
        let is_done = self.commander.request(mode, &facts);
        if !is_done && command.from.component_id == GROUND_COMPONENT {
            let text = format!("Switching to {} is currently not available", mode.name());
            self.outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, &text);
        }
        // Landing and returning are taken in any case; failsafes find what is possible.
        let is_escape = command.command != MavCmd::MAV_CMD_DO_SET_MODE
            && matches!(mode, Px4Mode::Land | Px4Mode::Return);
        if !is_done && is_escape {
            self.commander.force_land();
        }
        accepted_or(is_done || is_escape, MavResult::MAV_RESULT_TEMPORARILY_REJECTED)
    }

    fn set_interval(&mut self, command: &Command) -> MavResult {
        let [message_id, interval_us] = command.params.map(|value| whole(f64::from(value)));
        // The rate of its heartbeat is nobody's to choose.
        let is_known = u32::try_from(message_id).is_ok_and(|message_id| {
            message_id != id::HEARTBEAT
                && self.streams_mut(command.link).set_interval(message_id, interval_us)
        });
        accepted_or(is_known, MavResult::MAV_RESULT_FAILED)
    }

    fn request_message(&mut self, command: &Command) -> MavResult {
        let message_id = u32::try_from(whole(f64::from(command.params[0]))).ok();
        // These belong to a handshake and are not sent on request.
        let wanted = message_id.filter(|wanted| *wanted != id::TIMESYNC);
        let message = wanted.and_then(|wanted| self.message(wanted));
        let is_known = message.is_some();
        if let Some(message) = message {
            self.outbox.send(command.link, message);
        }
        accepted_or(is_known, MavResult::MAV_RESULT_DENIED)
    }

    fn reboot_on_request(&mut self, command: &Command) -> MavResult {
        if self.commander.is_armed() {
            return MavResult::MAV_RESULT_DENIED;
        }
        self.wants_reboot = (command.params[0] - 1.0).abs() < 0.5;
        MavResult::MAV_RESULT_ACCEPTED
    }
}

const fn accepted_or(is_done: bool, otherwise: MavResult) -> MavResult {
    if is_done { MavResult::MAV_RESULT_ACCEPTED } else { otherwise }
}
