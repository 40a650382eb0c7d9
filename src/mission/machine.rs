//! The transition machine.

use super::Phase;
use super::guards::{
    PreflightCheck, Settings, disagreement_text, preflight_checks, preflight_faults, preflight_line,
};
use crate::messages::{
    FlightMode, LandedState, OperatorVerb, Severity, StorageState, TAKE_OFF_HEIGHT_M, TakeOff,
    VehicleCommand, VehicleState,
};
use crate::time::{Mono, Stamp};

/// Everything a decision rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of one instant")]
pub struct Inputs {
    /// The instant of the decision.
    pub now: Stamp<Mono>,
    /// The autopilot's last word on mode and arming.
    pub vehicle: Option<VehicleState>,
    /// The autopilot has been silent for too long.
    pub is_autopilot_lost: bool,
    /// The own pose can be flown on.
    pub has_position: bool,
    /// The autopilot's samples come late, and so does every ODOMETRY that it gets: it soon flies by
    /// dead reckoning.
    pub is_late: bool,
    /// Beams arrive.
    pub has_lidar: bool,
    /// State of charge, 0 to 1.
    pub battery_ratio: Option<f64>,
    /// There is somewhere to fly.
    pub has_plan: bool,
    /// No waypoint is left.
    pub is_plan_done: bool,
    /// Every waypoint that was wished for is flown.
    pub is_plan_complete: bool,
    /// The last flight has left gaps in its map that can be flown to.
    pub has_gaps: bool,
    /// Heading of the body against that of the survey, rad; `None` without a pose.
    pub heading_error_rad: Option<f64>,
    /// Largest 1-σ of the own position, m.
    pub position_sigma_m: Option<f64>,
    /// Distance between where the autopilot and where the companion believes to be, m; `None`
    /// while one of them does not know.
    pub disagreement_m: Option<f64>,
    /// The autopilot's heading minus the own one, rad; `None` while one of them does not know.
    pub heading_disagreement_rad: Option<f64>,
    /// By how much the vehicle is nearer to walls, ceiling, obstacles, fence or material than its
    /// trajectory, beyond what is demanded there, m; 0 while it is not.
    pub intrusion_m: f64,
    /// How far the vehicle is from where its trajectory has it now, m; 0 while either is unknown.
    pub off_track_m: f64,
    /// Charge that the way home and the landing there will take, 0 to 1; `None` while unknown.
    pub way_home_ratio: Option<f64>,
    /// Height of the body over where the flight began, m; `None` without a pose.
    pub height_over_home_m: Option<f64>,
    /// The present trajectory has come to its end, wherever the vehicle is.
    pub is_trajectory_over: bool,
    /// The end of the present trajectory is reached.
    pub is_at_target: bool,
    /// The disk with the log; `None` where nobody looks at it.
    pub storage: Option<StorageState>,
}

/// What a decision leads to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Effect {
    /// Ask something of the autopilot.
    Command(VehicleCommand),
    /// The phase changed.
    Enter {
        /// Before.
        from: Phase,
        /// After.
        to: Phase,
        /// Why, for a person.
        reason: String,
    },
    /// The take-off by command is done: steer from where the vehicle is.
    Lifted,
    /// Tell the people.
    Say(Severity, String),
    /// The vehicle is on the ground and disarmed after a flight.
    Ended {
        /// The survey ran to its end.
        is_complete: bool,
    },
}

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
    /// Since when the vehicle is not where its trajectory has it.
    off_track_since: Option<Stamp<Mono>>,
    /// Holds of this flight because of that.
    n_off_track: u32,
    /// Since when every word on the battery says that it is empty.
    empty_since: Option<Stamp<Mono>>,
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

/// A commanded take-off counts as done from this share of its height on.
const LIFTED_RATIO: f64 = 0.7;

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
            off_track_since: None,
            n_off_track: 0,
            empty_since: None,
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
        let may_arm_yet = self.phase == Preflight && self.has_asked_to_arm;
        self.enter(wanted, "operator", inputs.now, effects);
        if may_arm_yet {
            // Nothing is in the air: motors that start after all are to stop at once.
            effects.push(Effect::Command(VehicleCommand::Disarm));
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
        self.empty_since = since(self.empty_since, is_empty, inputs.now);
        if self.yields_to_others(inputs, effects) {
            return;
        }
        if self.lands_on_disagreement(inputs, effects) {
            return;
        }
        match self.phase {
            Phase::Idle => {}
            Phase::Preflight => self.step_preflight(inputs, effects),
            Phase::TakeOff => self.step_take_off(inputs, effects),
            Phase::Survey => self.step_survey(inputs, effects),
            Phase::Return => self.step_return(inputs, effects),
            Phase::Hold => self.step_hold(inputs, effects),
            Phase::Land => self.step_land(inputs, effects),
            Phase::Abort => self.step_abort(inputs, effects),
        }
    }

    /// Somebody else took the vehicle: let go at once. True if so.
    fn yields_to_others(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let Some(vehicle) = inputs.vehicle else { return false };
        let is_flown_by_us =
            matches!(self.phase, Phase::TakeOff | Phase::Survey | Phase::Return | Phase::Hold);
        if is_flown_by_us && !vehicle.is_armed {
            self.enter(Phase::Abort, "disarmed by somebody else", inputs.now, effects);
            return true;
        }
        let is_ours = match (vehicle.mode, self.phase) {
            // Whoever takes a vehicle out of a landing that has begun wants it elsewhere.
            (FlightMode::Companion, Phase::Land) => !self.has_begun_landing,
            (FlightMode::Land, Phase::Land) | (FlightMode::Companion, _) => true,
            _ => false,
        };
        // On the ground PX4 leaves its landing by itself.
        let is_landing = self.phase == Phase::Land
            && vehicle.is_armed
            && vehicle.landed != LandedState::OnGround;
        if (is_flown_by_us || is_landing) && !is_ours {
            let reason = format!("mode changed to {:?}", vehicle.mode);
            self.enter(Phase::Abort, &reason, inputs.now, effects);
            return true;
        }
        false
    }

    fn step_preflight(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        let waited = inputs.now.since(self.entered_at);
        let is_companion = inputs.vehicle.is_some_and(|v| v.mode == FlightMode::Companion);
        let is_armed = inputs.vehicle.is_some_and(|v| v.is_armed);
        if self.was_companion && !is_companion {
            // Somebody has turned the mode switch: the start is theirs to repeat.
            effects
                .push(Effect::Say(Severity::Warning, "start called off: mode changed".to_owned()));
            self.enter(Phase::Idle, "mode changed by somebody else", inputs.now, effects);
            return;
        }
        self.was_companion |= is_companion;
        if is_armed && is_companion && self.has_asked_to_arm {
            self.enter(Phase::TakeOff, "armed", inputs.now, effects);
            return;
        }
        let faults = preflight_faults(inputs, &self.settings);
        if waited > self.settings.preflight_timeout {
            let reason = match faults.as_slice() {
                [] => "the autopilot refuses to arm".to_owned(),
                faults => faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
            };
            effects.push(Effect::Say(Severity::Error, format!("no take-off: {reason}")));
            self.enter(Phase::Idle, &reason, inputs.now, effects);
            return;
        }
        if !faults.is_empty() || waited < self.settings.stream_before_mode {
            return;
        }
        if is_companion && !self.has_asked_to_arm {
            effects.push(Effect::Say(Severity::Info, preflight_line(inputs)));
        }
        self.has_asked_to_arm |= is_companion;
        let command =
            if is_companion { VehicleCommand::Arm } else { VehicleCommand::EnterCompanionMode };
        self.ask(command, inputs.now, effects);
    }

    fn step_take_off(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        if !self.is_lifted && !self.lifts(inputs, effects) {
            return;
        }
        if self.holds_without_position(inputs, effects) || self.lands_on_battery(inputs, effects) {
            return;
        }
        if inputs.is_at_target {
            self.enter(Phase::Survey, "at height", inputs.now, effects);
        } else if inputs.now.since(self.entered_at) > self.settings.take_off_timeout {
            effects.push(Effect::Say(Severity::Error, "take-off takes too long".to_owned()));
            self.enter(Phase::Land, "take-off timed out", inputs.now, effects);
        }
    }

    /// Asks for the take-off until the vehicle is up; true once it is.
    fn lifts(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        if self.takes_off == TakeOff::BySetpoints {
            self.is_lifted = true;
            return true;
        }
        if !inputs.has_position {
            effects.push(Effect::Say(Severity::Error, "markers lost: no take-off".to_owned()));
            self.enter(Phase::Land, "position lost", inputs.now, effects);
            return false;
        }
        let landed = inputs.vehicle.map_or(LandedState::Unknown, |vehicle| vehicle.landed);
        let is_flying = matches!(landed, LandedState::InAir | LandedState::TakingOff);
        let is_high =
            inputs.height_over_home_m.is_some_and(|h| h >= LIFTED_RATIO * TAKE_OFF_HEIGHT_M);
        if is_flying && is_high {
            self.is_lifted = true;
            effects.push(Effect::Lifted);
        } else if inputs.now.since(self.entered_at) > self.settings.take_off_timeout {
            effects.push(Effect::Say(Severity::Error, "take-off takes too long".to_owned()));
            self.enter(Phase::Land, "take-off timed out", inputs.now, effects);
        } else if landed == LandedState::OnGround {
            self.ask(VehicleCommand::TakeOff, inputs.now, effects);
        }
        self.is_lifted
    }

    fn step_survey(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        if self.holds_without_position(inputs, effects)
            || self.lands_on_battery(inputs, effects)
            || self.holds_too_near(inputs, effects)
            || self.holds_off_track(inputs, effects)
            || self.returns_on_battery(inputs, effects)
        {
            return;
        }
        if !inputs.has_lidar {
            self.resume_to = Phase::Survey;
            self.hold_cause = HoldCause::LidarLost;
            effects.push(Effect::Say(Severity::Warning, "LiDAR silent: holding".to_owned()));
            self.enter(Phase::Hold, "LiDAR lost", inputs.now, effects);
        } else if inputs.is_plan_done {
            self.is_complete = inputs.is_plan_complete;
            self.enter(Phase::Return, "survey done", inputs.now, effects);
        }
    }

    fn step_return(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        if self.holds_without_position(inputs, effects)
            || self.lands_on_battery(inputs, effects)
            || self.holds_too_near(inputs, effects)
            || self.holds_off_track(inputs, effects)
        {
            return;
        }
        if inputs.is_at_target {
            self.enter(Phase::Land, "over the pad", inputs.now, effects);
        } else if inputs.is_trajectory_over {
            let since = *self.stuck_since.get_or_insert(inputs.now);
            if inputs.now.since(since) > self.settings.land_beside_pad_after {
                let text = "cannot reach the pad: landing here".to_owned();
                effects.push(Effect::Say(Severity::Warning, text));
                self.enter(Phase::Land, "does not come over the pad", inputs.now, effects);
            }
        }
    }

    fn step_hold(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        let waited = inputs.now.since(self.entered_at);
        if self.lands_on_battery(inputs, effects) {
            return;
        }
        if !inputs.has_position {
            self.recovered_since = None;
            let patience = if inputs.is_late {
                self.settings.land_after_late
            } else {
                self.settings.land_after_fix_lost
            };
            let is_gone = |since| inputs.now.since(since) > patience;
            if self.lost_since.is_some_and(is_gone) {
                effects.push(Effect::Say(Severity::Critical, "position lost: landing".to_owned()));
                self.enter(Phase::Land, "position lost", inputs.now, effects);
            }
            return;
        }
        // Somebody may stand on the way home: a hold asked for on it is kept.
        let is_kept = self.hold_cause == HoldCause::Operator && self.resume_to == Phase::Return;
        if !is_kept && self.returns_on_battery(inputs, effects) {
            return;
        }
        let is_recovered = match self.hold_cause {
            HoldCause::Operator => false,
            HoldCause::FixLost => true,
            HoldCause::LidarLost => inputs.has_lidar,
            HoldCause::TooNear => inputs.intrusion_m <= 0.0,
            HoldCause::OffTrack => inputs.off_track_m <= self.settings.max_off_track_m,
        };
        if is_recovered {
            let since = *self.recovered_since.get_or_insert(inputs.now);
            if inputs.now.since(since) >= self.settings.recovered_after {
                self.enter(self.resume_to, "recovered", inputs.now, effects);
            }
        } else {
            self.recovered_since = None;
            if self.hold_cause == HoldCause::TooNear && waited > self.settings.land_after_intrusion
            {
                let text = "does not get clear: landing".to_owned();
                effects.push(Effect::Say(Severity::Critical, text));
                self.enter(Phase::Land, "too near to something", inputs.now, effects);
                return;
            }
            let is_lidar_gone = self.hold_cause == HoldCause::LidarLost;
            if is_lidar_gone && waited > self.settings.return_after_lidar_lost {
                self.enter(Phase::Return, "LiDAR does not come back", inputs.now, effects);
            }
        }
    }

    fn step_land(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        let Some(vehicle) = inputs.vehicle else { return };
        if !vehicle.is_armed {
            self.enter(Phase::Idle, "landed", inputs.now, effects);
            effects.push(Effect::Ended { is_complete: self.is_complete });
        } else if vehicle.mode == FlightMode::Companion {
            self.ask(VehicleCommand::EnterLand, inputs.now, effects);
        }
    }

    fn step_abort(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        if inputs.vehicle.is_some_and(|vehicle| !vehicle.is_armed) {
            self.enter(Phase::Idle, "disarmed", inputs.now, effects);
            effects.push(Effect::Ended { is_complete: false });
        }
    }

    fn holds_without_position(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        if inputs.has_position {
            return false;
        }
        self.resume_to = self.phase;
        self.hold_cause = HoldCause::FixLost;
        effects.push(Effect::Say(Severity::Warning, "markers lost: holding".to_owned()));
        self.enter(Phase::Hold, "position lost", inputs.now, effects);
        true
    }

    /// The autopilot flies by a place or a heading of its own: what it is asked for leads elsewhere,
    /// so it is asked for no more than a landing. True if so.
    fn lands_on_disagreement(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let text = disagreement_text(inputs, &self.settings);
        let Some(text) = text.filter(|_| inputs.has_position) else {
            self.disagrees_since = None;
            return false;
        };
        let since = *self.disagrees_since.get_or_insert(inputs.now);
        let is_flown = self.is_steering() && self.phase != Phase::Preflight;
        if !is_flown || inputs.now.since(since) < self.settings.disagrees_for {
            return false;
        }
        effects.push(Effect::Say(Severity::Critical, text));
        self.enter(Phase::Land, "the autopilot believes to be elsewhere", inputs.now, effects);
        true
    }

    fn holds_too_near(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        if inputs.intrusion_m <= self.settings.max_intrusion_m {
            return false;
        }
        self.resume_to = self.phase;
        self.hold_cause = HoldCause::TooNear;
        let text = format!("{:.2} m too near to something: holding", inputs.intrusion_m);
        effects.push(Effect::Say(Severity::Warning, text));
        self.enter(Phase::Hold, "too near to something", inputs.now, effects);
        true
    }

    /// The vehicle does not follow: it is blown away, or hears nothing. What it would be told next leads
    /// it in a straight line to where it is not, so its trajectory begins anew where it is. True if so.
    fn holds_off_track(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let is_off = inputs.off_track_m > self.settings.max_off_track_m;
        self.off_track_since = since(self.off_track_since, is_off, inputs.now);
        let is_lasting = |at: Stamp<Mono>| inputs.now.since(at) >= self.settings.off_track_for;
        if !self.off_track_since.is_some_and(is_lasting) {
            return false;
        }
        self.n_off_track += 1;
        let off_m = inputs.off_track_m;
        if self.n_off_track > self.settings.most_off_track_holds {
            let text = format!("{off_m:.1} m off its path again: landing");
            effects.push(Effect::Say(Severity::Critical, text));
            self.enter(Phase::Land, "does not follow its trajectory", inputs.now, effects);
            return true;
        }
        self.resume_to = self.phase;
        self.hold_cause = HoldCause::OffTrack;
        effects.push(Effect::Say(Severity::Warning, format!("{off_m:.1} m off its path: holding")));
        self.enter(Phase::Hold, "does not follow its trajectory", inputs.now, effects);
        true
    }

    /// Charge at which the way home must begin.
    fn return_at_ratio(&self, inputs: &Inputs) -> f64 {
        let way_home = inputs.way_home_ratio.unwrap_or(0.0);
        let needed = self.settings.land_battery_ratio + self.settings.way_home_factor * way_home;
        needed.max(self.settings.return_battery_ratio)
    }

    fn returns_on_battery(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let reason = match inputs.battery_ratio {
            None => "battery unknown",
            Some(ratio) if ratio < self.settings.return_battery_ratio => "battery low",
            Some(ratio) if ratio < self.return_at_ratio(inputs) => {
                "battery just reaches for the way home"
            }
            Some(_) => return false,
        };
        effects.push(Effect::Say(Severity::Warning, format!("{reason}: returning")));
        self.enter(Phase::Return, reason, inputs.now, effects);
        true
    }

    /// One wild word on the battery lands nobody.
    fn lands_on_battery(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let is_lasting = |at: Stamp<Mono>| inputs.now.since(at) >= self.settings.battery_empty_for;
        let is_empty = self.empty_since.is_some_and(is_lasting);
        if is_empty {
            effects.push(Effect::Say(Severity::Critical, "battery empty: landing".to_owned()));
            self.enter(Phase::Land, "battery empty", inputs.now, effects);
        }
        is_empty
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
