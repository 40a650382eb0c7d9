//! The transition machine.

mod phases;
mod rules;

use super::Phase;
use super::decision::{Effect, Inputs};
use super::guards::{PreflightCheck, Settings, preflight_checks};
use crate::messages::{FlightMode, LandedState, OperatorVerb, TakeOff, VehicleCommand};
use crate::time::{Mono, Stamp};

/// Why a hold began, and so what may end it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HoldCause {
    Operator,
    FixLost,
    LidarLost,
    TooNear,
    OffTrack,
}

/// The state of the mission.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "independent marks of one flight")]
pub struct Mission {
    settings: Settings,
    phase: Phase,
    entered_at: Stamp<Mono>,
    last_command: Option<(VehicleCommand, Stamp<Mono>)>,
    hold_cause: HoldCause,
    resume_to: Phase,
    /// Since when what the hold waits for is back.
    recovered_since: Option<Stamp<Mono>>,
    /// Since when the position is gone.
    lost_since: Option<Stamp<Mono>>,
    /// Since when the way home is flown without being there.
    stuck_since: Option<Stamp<Mono>>,
    /// Since when the autopilot believes to be elsewhere, or turned.
    disagrees_since: Option<Stamp<Mono>>,
    /// Since when the autopilot's place cannot be compared.
    untold_since: Option<Stamp<Mono>>,
    /// Since when the vehicle is not where its trajectory has it.
    off_track_since: Option<Stamp<Mono>>,
    /// Holds of this flight because of that.
    n_off_track: u32,
    /// When the battery was heard of for the first of all words in a row that say that it is empty.
    empty_since: Option<Stamp<Mono>>,
    /// Since when the vehicle is nearer to something than it may be.
    intruding_since: Option<Stamp<Mono>>,
    /// When a start was called off after the companion had asked to arm.
    called_off_at: Option<Stamp<Mono>>,
    /// The autopilot has begun to land.
    has_begun_landing: bool,
    /// In this preflight the autopilot has followed the companion.
    was_companion: bool,
    /// In this preflight the companion has asked to arm.
    has_asked_to_arm: bool,
    is_complete: bool,
    /// This flight goes on with the survey of the last one, into its gaps.
    is_into_gaps: bool,
    /// How this vehicle comes off the ground.
    takes_off: TakeOff,
    /// Setpoints may be sent: from the first on, or once a command has lifted the vehicle.
    is_lifted: bool,
}

impl Mission {
    /// A mission on the ground.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            phase: Phase::Idle,
            entered_at: Stamp::ZERO,
            last_command: None,
            hold_cause: HoldCause::Operator,
            resume_to: Phase::Survey,
            recovered_since: None,
            lost_since: None,
            stuck_since: None,
            disagrees_since: None,
            untold_since: None,
            off_track_since: None,
            n_off_track: 0,
            empty_since: None,
            intruding_since: None,
            called_off_at: None,
            has_begun_landing: false,
            was_companion: false,
            has_asked_to_arm: false,
            is_complete: false,
            is_into_gaps: false,
            takes_off: TakeOff::BySetpoints,
            is_lifted: false,
        }
    }

    /// Where the flight stands.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// True if the present flight, or the last one, goes on with the survey before it.
    #[must_use]
    pub const fn is_into_gaps(&self) -> bool {
        self.is_into_gaps
    }

    /// True while setpoints are to be sent.
    ///
    /// Where a command lifts the vehicle there are none before it flies: on the ground they would
    /// call the take-off off.
    #[must_use]
    pub fn is_steering(&self) -> bool {
        let is_on_ground = match self.phase {
            Phase::Preflight => true,
            Phase::TakeOff => !self.is_lifted,
            _ => false,
        };
        self.phase.is_steering() && !(self.takes_off == TakeOff::ByCommand && is_on_ground)
    }

    /// Takes a person's wish; true if it is done, under way, or was so already.
    pub fn on_operator(
        &mut self,
        verb: OperatorVerb,
        inputs: &Inputs,
        effects: &mut Vec<Effect>,
    ) -> bool {
        use Phase::{Abort, Hold, Idle, Land, Preflight, Return, Survey};
        let wanted = match (verb, self.phase) {
            (OperatorVerb::Start, Idle) => Preflight,
            (OperatorVerb::FlyGaps, Idle) if inputs.has_gaps => Preflight,
            (OperatorVerb::Start | OperatorVerb::FlyGaps, Preflight | Phase::TakeOff | Survey) => {
                // The other kind of flight is under way: that is not what was asked for.
                return self.is_into_gaps == (verb == OperatorVerb::FlyGaps);
            }
            // There is nothing to hold yet where a command lifts the vehicle.
            (OperatorVerb::Hold | OperatorVerb::Return, Phase::TakeOff) if !self.is_steering() => {
                Land
            }
            (OperatorVerb::Hold, Phase::TakeOff | Survey | Return) => {
                self.resume_to = self.phase;
                Hold
            }
            (OperatorVerb::Hold, Hold) => {
                // The person's wish outlives the fault that began the hold.
                self.hold_cause = HoldCause::Operator;
                return true;
            }
            (OperatorVerb::Resume, Hold) if inputs.has_position => self.resume_to,
            (OperatorVerb::Hold | OperatorVerb::Return | OperatorVerb::Land, Preflight) => Idle,
            (OperatorVerb::Return, Phase::TakeOff | Survey | Hold) if inputs.has_position => Return,
            (OperatorVerb::Resume, Survey)
            | (OperatorVerb::Return, Return | Land)
            | (OperatorVerb::Land, Land) => return true,
            (OperatorVerb::Land, Phase::TakeOff | Survey | Return | Hold) => Land,
            // The companion came back to a vehicle that still waits for it in the air.
            (OperatorVerb::Land, Idle) if is_left_flying(inputs) => Land,
            (_, Idle | Preflight | Phase::TakeOff | Survey | Return | Land | Hold | Abort) => {
                return false;
            }
        };
        if wanted == Hold {
            self.hold_cause = HoldCause::Operator;
        }
        if wanted == Preflight {
            self.is_into_gaps = verb == OperatorVerb::FlyGaps;
        }
        let is_called_off = self.phase == Preflight && wanted == Idle;
        self.enter(wanted, "operator", inputs.now, effects);
        if is_called_off {
            self.stop_what_may_start(inputs, effects);
        }
        true
    }

    /// What is gone through before the motors turn, as it stands.
    #[must_use]
    pub fn preflight_checks(&self, inputs: &Inputs) -> Vec<PreflightCheck> {
        preflight_checks(inputs, &self.settings)
    }

    /// Charge at which the vehicle turns home by itself, 0 to 1.
    #[must_use]
    pub fn turns_home_at_ratio(&self, inputs: &Inputs) -> f64 {
        self.return_at_ratio(inputs)
    }

    /// Looks at the facts and goes on if they ask for it.
    pub fn step(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        self.lost_since = since(self.lost_since, !inputs.has_position, inputs.now);
        if let Some(vehicle) = inputs.vehicle {
            self.takes_off = vehicle.takes_off;
            self.has_begun_landing |= self.phase == Phase::Land && vehicle.mode == FlightMode::Land;
        }
        let is_empty =
            inputs.battery_ratio.is_some_and(|ratio| ratio < self.settings.land_battery_ratio);
        let heard_at = inputs.battery_heard_at.unwrap_or(inputs.now);
        self.empty_since = since(self.empty_since, is_empty, heard_at);
        let is_intruding = inputs.intrusion_m > self.settings.max_intrusion_m;
        self.intruding_since = since(self.intruding_since, is_intruding, inputs.now);
        if self.yields_to_others(inputs, effects) {
            return;
        }
        if self.lands_on_disagreement(inputs, effects) || self.lands_untold(inputs, effects) {
            return;
        }
        match self.phase {
            Phase::Idle => self.step_idle(inputs, effects),
            Phase::Preflight => self.step_preflight(inputs, effects),
            Phase::TakeOff => self.step_take_off(inputs, effects),
            Phase::Survey => self.step_survey(inputs, effects),
            Phase::Return => self.step_return(inputs, effects),
            Phase::Hold => self.step_hold(inputs, effects),
            Phase::Land => self.step_land(inputs, effects),
            Phase::Abort => self.step_abort(inputs, effects),
        }
    }

    /// Asks, and asks again at the configured pace as long as this is called.
    fn ask(&mut self, command: VehicleCommand, now: Stamp<Mono>, effects: &mut Vec<Effect>) {
        let is_due = self.last_command.is_none_or(|(last, at)| {
            last != command || now.since(at) >= self.settings.command_retry
        });
        if is_due {
            self.last_command = Some((command, now));
            effects.push(Effect::Command(command));
        }
    }

    fn enter(&mut self, to: Phase, reason: &str, now: Stamp<Mono>, effects: &mut Vec<Effect>) {
        let from = self.phase;
        self.phase = to;
        self.entered_at = now;
        self.last_command = None;
        self.recovered_since = None;
        self.stuck_since = None;
        self.off_track_since = None;
        self.has_begun_landing = false;
        if from == Phase::Preflight && to == Phase::Idle && self.has_asked_to_arm {
            self.called_off_at = Some(now);
        }
        if to == Phase::Preflight {
            self.n_off_track = 0;
            self.is_complete = false;
            self.was_companion = false;
            self.is_lifted = false;
            self.has_asked_to_arm = false;
        }
        effects.push(Effect::Enter { from, to, reason: reason.to_owned() });
        if to == Phase::Land {
            self.ask(VehicleCommand::EnterLand, now, effects);
        }
    }
}

/// Since when something holds, if it does.
fn since(before: Option<Stamp<Mono>>, holds: bool, now: Stamp<Mono>) -> Option<Stamp<Mono>> {
    if holds { before.or(Some(now)) } else { None }
}

/// Armed in the air, in the companion's mode.
fn is_left_flying(inputs: &Inputs) -> bool {
    inputs.vehicle.is_some_and(|vehicle| {
        vehicle.is_armed
            && vehicle.mode == FlightMode::Companion
            && vehicle.landed != LandedState::OnGround
    })
}

#[cfg(test)]
mod tests;
