//! The brain's actions as messages.

use super::{Autopilot, Session, SessionOutput};
use crate::link::dialect::{Dialect as _, Px4};
use crate::link::{inbound, outbound};
use crate::messages::{CommandOutcome, OperatorAnswer, VehicleCommand};
use crate::mission::Phase;
use crate::pilot::{Action, Event, PhaseChange};
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavMessage, MavResult};

impl Session {
    /// Appends what `action` means on the wire to `out`; actions that do not concern the link
    /// change nothing.
    pub fn on_action(&mut self, action: &Action, now: Stamp<Mono>, out: &mut SessionOutput) {
        let sent_before = out.messages.len();
        match action {
            Action::Command(command) => self.command(*command, now, out),
            // Nobody is there to read it, and the own system id is not known yet.
            _ if self.autopilot.is_none() => {}
            Action::Steer(setpoint) => {
                let system = self.autopilot_system().unwrap_or(0);
                self.push(outbound::setpoint(setpoint, system), out);
            }
            Action::PublishOdometry(estimate) => self.push(outbound::odometry(estimate), out),
            Action::ReportVolume(report) => self.telemetry.report(report, now, &mut out.messages),
            Action::VolumesAccounted(accounts) => self.telemetry.note(accounts),
            Action::Say(line) => {
                self.telemetry.say(line.severity, &line.text, &mut out.messages);
            }
            Action::Answer(answer) => out.messages.push(operator_ack(answer)),
            // What is still unanswered must not be repeated over the pilot's head.
            Action::PhaseChanged(PhaseChange { to: Phase::Abort | Phase::Idle, .. }) => {
                self.commands.abandon(now, out);
            }
            Action::Start { .. }
            | Action::PhaseChanged(_)
            | Action::FixTreated(_)
            | Action::SurfaceSolved(_)
            | Action::PlanChosen(_)
            | Action::Ended(_) => {}
        }
        self.count_sent(sent_before, out);
    }

    fn push(&mut self, message: Option<MavMessage>, out: &mut SessionOutput) {
        match message {
            Some(message) => out.messages.push(message),
            None => self.stats.outbound_refused += 1,
        }
    }

    /// Without an autopilot a command is refused at once.
    fn command(&mut self, command: VehicleCommand, now: Stamp<Mono>, out: &mut SessionOutput) {
        let Some(Autopilot { system, is_lost: false, .. }) = self.autopilot else {
            let refusal = CommandOutcome { at: now, command, is_accepted: false };
            out.events.push(Event::CommandAnswered(refusal));
            return;
        };
        self.commands.begin(command, Px4::wire_command(command), system, now, out);
    }
}

fn operator_ack(answer: &OperatorAnswer) -> MavMessage {
    let result = if answer.is_accepted {
        MavResult::MAV_RESULT_ACCEPTED
    } else {
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED
    };
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command: inbound::operator_command(answer.verb),
        result,
        target_system: answer.to.system,
        target_component: answer.to.component,
        ..Default::default()
    })
}
