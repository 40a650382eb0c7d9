//! Commands under way: repeated until answered, and given up on.

use super::dialect::WireCommand;
use super::stats::LinkStats;
use super::{AUTOPILOT_COMPONENT, SessionOutput};
use crate::messages::{CommandOutcome, VehicleCommand};
use crate::pilot::Event;
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult};
use std::time::Duration;

/// Wait for an answer before the command is repeated.
const RETRY_AFTER: Duration = Duration::from_millis(500);
/// Wait for the final answer after the autopilot said that it is at work.
const PROGRESS_WITHIN: Duration = Duration::from_secs(5);
/// Times a command is sent before it counts as unanswered.
const MAX_ATTEMPTS: u8 = 5;

/// All commands under way: at most one per MAVLink command number.
#[derive(Debug, Clone, Default)]
pub(crate) struct Commands {
    under_way: Vec<Attempt>,
}

#[derive(Debug, Clone, Copy)]
struct Attempt {
    asked: VehicleCommand,
    wire: WireCommand,
    attempts: u8,
    deadline: Stamp<Mono>,
    waits_for: Answer,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    First,
    Second,
}

impl Commands {
    /// Sends `asked`, unless it is under way already. Another command with the same MAVLink number
    /// counts as refused: its answers could not be told from the new one's.
    pub(crate) fn begin(
        &mut self,
        asked: VehicleCommand,
        wire: WireCommand,
        target_system: u8,
        now: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        if self.under_way.iter().any(|attempt| attempt.asked == asked) {
            return;
        }
        if let Some(older) = self.take(wire.command) {
            out.events.push(outcome(older.asked, false, now));
        }
        let deadline = now.plus(RETRY_AFTER);
        let attempt = Attempt { asked, wire, attempts: 1, deadline, waits_for: Answer::First };
        out.messages.push(attempt.message(target_system));
        self.under_way.push(attempt);
    }

    /// Takes in an answer to this component.
    pub(crate) fn on_answer(
        &mut self,
        command: MavCmd,
        result: MavResult,
        at: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let Some(mut attempt) = self.take(command) else { return };
        match (result, attempt.wire.second_answer_within) {
            (MavResult::MAV_RESULT_IN_PROGRESS, _) => {
                attempt.deadline = at.plus(PROGRESS_WITHIN);
                self.under_way.push(attempt);
            }
            (MavResult::MAV_RESULT_ACCEPTED, Some(span)) if attempt.waits_for == Answer::First => {
                attempt.waits_for = Answer::Second;
                attempt.deadline = at.plus(span);
                self.under_way.push(attempt);
            }
            (result, _) => {
                let is_accepted = result == MavResult::MAV_RESULT_ACCEPTED;
                out.events.push(outcome(attempt.asked, is_accepted, at));
            }
        }
    }

    /// Repeats what was not answered in time, or gives it up.
    pub(crate) fn on_time(
        &mut self,
        target_system: u8,
        now: Stamp<Mono>,
        stats: &mut LinkStats,
        out: &mut SessionOutput,
    ) {
        self.under_way.retain_mut(|attempt| {
            if now < attempt.deadline {
                return true;
            }
            if attempt.waits_for == Answer::Second {
                // No second answer: this one acknowledges once.
                out.events.push(outcome(attempt.asked, true, now));
                return false;
            }
            if attempt.attempts == MAX_ATTEMPTS {
                stats.commands_unanswered += 1;
                out.events.push(outcome(attempt.asked, false, now));
                return false;
            }
            attempt.attempts += 1;
            attempt.deadline = now.plus(RETRY_AFTER);
            stats.command_retries += 1;
            out.messages.push(attempt.message(target_system));
            true
        });
    }

    /// True while an answer is waited for.
    pub(crate) const fn are_under_way(&self) -> bool {
        !self.under_way.is_empty()
    }

    /// The autopilot is gone: nothing will be answered any more.
    pub(crate) fn abandon(&mut self, now: Stamp<Mono>, out: &mut SessionOutput) {
        let events = self.under_way.drain(..).map(|attempt| outcome(attempt.asked, false, now));
        out.events.extend(events);
    }

    /// Somebody else has the vehicle, or it is to land: only a landing is still asked for.
    pub(crate) fn withdraw(&mut self) {
        self.under_way.retain(|attempt| attempt.asked == VehicleCommand::EnterLand);
    }

    fn take(&mut self, command: MavCmd) -> Option<Attempt> {
        let index = self.under_way.iter().position(|attempt| attempt.wire.command == command)?;
        Some(self.under_way.remove(index))
    }
}

impl Attempt {
    fn message(&self, target_system: u8) -> MavMessage {
        let [param1, param2, param3, param4, param5, param6, param7] = self.wire.params;
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            command: self.wire.command,
            target_system,
            target_component: AUTOPILOT_COMPONENT,
            confirmation: self.attempts - 1,
        })
    }
}

const fn outcome(command: VehicleCommand, is_accepted: bool, at: Stamp<Mono>) -> Event {
    Event::CommandAnswered(CommandOutcome { at, command, is_accepted })
}
