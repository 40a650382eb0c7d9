//! The brain's actions as messages.

use super::{Autopilot, Session, SessionOutput};
use crate::link::{PAGE, inbound, outbound};
use crate::messages::{CommandOutcome, NavEstimate, OperatorAnswer, VehicleCommand};
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
            // The page asks by another way.
            Action::Answer(answer) if answer.to == PAGE => {}
            // Nobody is there to read it, and the own system id is not known yet.
            _ if self.autopilot.is_none() => {}
            Action::Steer(setpoint) => {
                let system = self.autopilot_system().unwrap_or(0);
                self.push(outbound::setpoint(setpoint, system), out);
            }
            Action::PublishOdometry(estimate) => {
                self.telemetry.fixed(outbound::quality(estimate), now);
                self.push_odometry(estimate, out);
            }
            Action::PublishSight(estimate) => self.push_odometry(estimate, out),
            Action::ReportVolume(report) => self.telemetry.report(report, now, &mut out.messages),
            Action::VolumesAccounted(accounts) => self.telemetry.note(accounts),
            Action::Say(line) => {
                self.telemetry.say(line.severity, &line.text, &mut out.messages);
            }
            Action::Answer(answer) => {
                let is_accepted = self.operators.answer(answer, now);
                out.messages.push(operator_ack(&OperatorAnswer { is_accepted, ..*answer }));
            }
            // What is still unanswered must not be repeated over the pilot's head.
            Action::PhaseChanged(PhaseChange { to: Phase::Abort | Phase::Idle, .. }) => {
                self.commands.abandon(now, out);
            }
            Action::PhaseChanged(PhaseChange { to: Phase::Land, .. }) => self.commands.withdraw(),
            Action::Start { .. }
            | Action::PhaseChanged(_)
            | Action::FixTreated(_)
            | Action::SurfaceSolved(_)
            | Action::PlanChosen(_)
            | Action::Ended(_) => {}
        }
        self.count_sent(sent_before, out);
    }

    /// The service ends: no start is taken any more.
    pub const fn refuse_starts(&mut self) {
        self.operators.refuse_starts();
    }

    /// True while a command to the autopilot is under way.
    #[must_use]
    pub const fn awaits_answers(&self) -> bool {
        self.commands.are_under_way()
    }

    /// What to answer the own page for what the mission says; see `OperatorDesk::answer`.
    pub fn own_answer(&mut self, answer: &OperatorAnswer, now: Stamp<Mono>) -> bool {
        self.operators.answer(answer, now)
    }

    fn push_odometry(&mut self, estimate: &NavEstimate, out: &mut SessionOutput) {
        let dialect = self.autopilot.as_ref().map(|autopilot| autopilot.dialect);
        self.push(dialect.and_then(|d| outbound::odometry(estimate, d)), out);
    }

    fn push(&mut self, message: Option<MavMessage>, out: &mut SessionOutput) {
        match message {
            Some(message) => out.messages.push(message),
            None => self.stats.outbound_refused += 1,
        }
    }

    /// Without an autopilot, or one that knows it, a command is refused at once.
    fn command(&mut self, command: VehicleCommand, now: Stamp<Mono>, out: &mut SessionOutput) {
        let known = match &self.autopilot {
            Some(Autopilot { system, dialect, is_lost: false, .. }) => {
                dialect.wire_command(command).map(|wire| (*system, wire))
            }
            _ => None,
        };
        let Some((system, wire)) = known else {
            let refusal = CommandOutcome { at: now, command, is_accepted: false };
            out.events.push(Event::CommandAnswered(refusal));
            return;
        };
        self.commands.begin(command, wire, system, now, out);
    }
}

pub(super) fn operator_ack(answer: &OperatorAnswer) -> MavMessage {
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
