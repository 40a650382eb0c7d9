//! `COMMAND_LONG`, `COMMAND_INT` and `SET_MODE` with the answers of `ArduCopter` 4.7.

use super::modes::ApMode;
use super::stub::StubArduPilot;
use crate::autopilot::frames::whole;
use crate::autopilot::outbox::Link;
use crate::autopilot::streams::id;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult,
    MavSeverity,
};

/// param2 of `MAV_CMD_COMPONENT_ARM_DISARM` that forces.
const FORCE: f32 = 21196.0;
/// Streams are served at 0.8 of the main loop's rate at most: shortest interval at 400 Hz, µs.
const SHORTEST_INTERVAL_US: i64 = 3_125;

/// A command, whichever message carried it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Command {
    command: MavCmd,
    params: [f32; 2],
    height_m: f32,
    from: MavHeader,
    link: Link,
}

impl Command {
    pub(super) const fn long(from: MavHeader, link: Link, data: &COMMAND_LONG_DATA) -> Self {
        let params = [data.param1, data.param2];
        Self { command: data.command, params, height_m: data.param7, from, link }
    }

    pub(super) const fn int(from: MavHeader, link: Link, data: &COMMAND_INT_DATA) -> Self {
        let params = [data.param1, data.param2];
        Self { command: data.command, params, height_m: data.z, from, link }
    }
}

impl StubArduPilot {
    /// Does what a command asks and acknowledges it once.
    pub(super) fn on_command(&mut self, command: &Command) {
        let [param1, param2] = command.params;
        let result = match command.command {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => {
                let is_forced = (param2 - FORCE).abs() < 0.5;
                let is_done =
                    if param1 > 0.5 { self.arm(is_forced) } else { self.disarm(is_forced) };
                accepted_or_failed(is_done)
            }
            MavCmd::MAV_CMD_DO_SET_MODE => {
                let number = u32::try_from(whole(f64::from(param2))).unwrap_or(u32::MAX);
                accepted_or_failed(self.switch_to_number(number))
            }
            MavCmd::MAV_CMD_NAV_TAKEOFF => accepted_or_failed(self.take_off(command.height_m)),
            MavCmd::MAV_CMD_NAV_LAND => accepted_or_failed(self.switch(ApMode::Land)),
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => accepted_or_failed(self.switch(ApMode::Rtl)),
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => self.set_interval(command),
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.request_message(command),
            MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN => {
                self.wants_reboot = !self.is_armed && (param1 - 1.0).abs() < 0.5;
                accepted_or_failed(!self.is_armed)
            }
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        };
        let ack = COMMAND_ACK_DATA {
            command: command.command,
            result,
            target_system: u8::try_from(command.from.system_id).unwrap_or(0),
            target_component: command.from.component_id,
            ..COMMAND_ACK_DATA::DEFAULT
        };
        self.outbox.send(command.link, MavMessage::COMMAND_ACK(ack));
    }

    /// Enters the mode with this number; false with a text if there is none or it may not run.
    pub(super) fn switch_to_number(&mut self, number: u32) -> bool {
        let Some(mode) = ApMode::numbered(number) else {
            let text = format!("No such mode {number}");
            self.outbox.text_to_all(MavSeverity::MAV_SEVERITY_WARNING, &text);
            return false;
        };
        self.switch(mode)
    }

    fn switch(&mut self, mode: ApMode) -> bool {
        if self.is_armed && mode.needs_position() && !self.belief.is_position_valid {
            let text = format!("Mode change to {} failed: requires position", mode.name());
            self.outbox.text_to_all(MavSeverity::MAV_SEVERITY_WARNING, &text);
            return false;
        }
        if mode != ApMode::Land {
            self.is_in_failsafe = false;
        }
        self.enter(mode);
        true
    }

    /// Only in GUIDED, armed and on the ground; the height is above home.
    fn take_off(&mut self, height_m: f32) -> bool {
        let may = self.mode == ApMode::Guided && self.is_armed && self.landing.is_landed();
        if may && height_m.is_finite() && height_m > 0.0 {
            let z_m = self.home_m.z - f64::from(height_m);
            let belief = self.belief;
            self.guided.take_off(&belief, z_m);
        }
        may
    }

    fn set_interval(&mut self, command: &Command) -> MavResult {
        let [message_id, interval_us] = command.params.map(|value| whole(f64::from(value)));
        let streams = match command.link {
            Link::Companion => &mut self.companion_streams,
            Link::Ground => &mut self.ground_streams,
        };
        let is_too_fast = (1..SHORTEST_INTERVAL_US).contains(&interval_us);
        let is_known = !is_too_fast
            && u32::try_from(message_id).is_ok_and(|id| streams.set_interval(id, interval_us));
        if is_known {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        let text = if is_too_fast {
            format!("Interval {interval_us} too short")
        } else {
            format!("No ap_message for mavlink id ({message_id})")
        };
        self.outbox.text_to_all(MavSeverity::MAV_SEVERITY_INFO, &text);
        MavResult::MAV_RESULT_DENIED
    }

    /// Says yes to every message that it knows, even if there is nothing to send.
    fn request_message(&mut self, command: &Command) -> MavResult {
        let message_id = u32::try_from(whole(f64::from(command.params[0]))).unwrap_or(u32::MAX);
        let is_known = message_id != id::TIMESYNC && super::telemetry::is_known(message_id);
        if let Some(message) = self.message(message_id).filter(|_| is_known) {
            self.outbox.send(command.link, message);
        }
        accepted_or_failed(is_known)
    }
}

const fn accepted_or_failed(is_done: bool) -> MavResult {
    if is_done { MavResult::MAV_RESULT_ACCEPTED } else { MavResult::MAV_RESULT_FAILED }
}
