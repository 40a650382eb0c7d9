//! The rules that end what a phase does: each looks at the facts and is true if it took over.

use super::{HoldCause, Mission, since};
use crate::messages::{FlightMode, LandedState, Severity};
use crate::mission::Phase;
use crate::mission::decision::{Effect, Inputs};
use crate::mission::guards::disagreement_text;
use crate::time::{Mono, Stamp};

impl Mission {
    /// Somebody else took the vehicle: let go at once. True if so.
    pub(super) fn yields_to_others(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
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
        // On the ground PX4 leaves a landing by itself, once it has begun it.
        let is_landing = self.phase == Phase::Land
            && vehicle.is_armed
            && (vehicle.landed != LandedState::OnGround || !self.has_begun_landing);
        if (is_flown_by_us || is_landing) && !is_ours {
            let reason = format!("mode changed to {:?}", vehicle.mode);
            self.enter(Phase::Abort, &reason, inputs.now, effects);
            return true;
        }
        false
    }

    pub(super) fn holds_without_position(
        &mut self,
        inputs: &Inputs,
        effects: &mut Vec<Effect>,
    ) -> bool {
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
    pub(super) fn lands_on_disagreement(
        &mut self,
        inputs: &Inputs,
        effects: &mut Vec<Effect>,
    ) -> bool {
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

    /// Nobody knows whether the autopilot flies by the same place. True if it lands.
    pub(super) fn lands_untold(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let is_untold =
            inputs.disagreement_m.is_none() && inputs.has_position && !inputs.is_autopilot_lost;
        self.untold_since = since(self.untold_since, is_untold, inputs.now);
        let is_lasting = |at: Stamp<Mono>| inputs.now.since(at) >= self.settings.land_after_untold;
        let is_flown = self.is_steering() && self.phase != Phase::Preflight;
        if !is_flown || !self.untold_since.is_some_and(is_lasting) {
            return false;
        }
        let text = "autopilot does not tell its position: landing".to_owned();
        effects.push(Effect::Say(Severity::Critical, text));
        self.enter(Phase::Land, "the autopilot's position is unknown", inputs.now, effects);
        true
    }

    pub(super) fn holds_too_near(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
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
    pub(super) fn holds_off_track(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let is_off = inputs.off_track_m.is_some_and(|off_m| off_m > self.settings.max_off_track_m);
        self.off_track_since = since(self.off_track_since, is_off, inputs.now);
        let is_lasting = |at: Stamp<Mono>| inputs.now.since(at) >= self.settings.off_track_for;
        if !self.off_track_since.is_some_and(is_lasting) {
            return false;
        }
        let off_m = inputs.off_track_m.unwrap_or(0.0);
        if self.lands_off_track(off_m, inputs.now, effects) {
            return true;
        }
        self.resume_to = self.phase;
        self.hold_cause = HoldCause::OffTrack;
        effects.push(Effect::Say(Severity::Warning, format!("{off_m:.1} m off its path: holding")));
        self.enter(Phase::Hold, "does not follow its trajectory", inputs.now, effects);
        true
    }

    /// In a hold: a vehicle that does not keep its place is held where it is, but not for ever. True if it
    /// lands.
    pub(super) fn lands_on_straying(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let Some(off_m) = inputs.strayed_m else { return false };
        self.recovered_since = None;
        if self.lands_off_track(off_m, inputs.now, effects) {
            return true;
        }
        let text = format!("{off_m:.1} m off its place: holding here");
        effects.push(Effect::Say(Severity::Warning, text));
        false
    }

    /// In a hold: a vehicle that stays far from where it is held, for something is near where it is, does not
    /// follow. True if it lands.
    pub(super) fn lands_far_off(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let off_m = inputs.off_track_m.unwrap_or(0.0);
        let is_off = off_m > self.settings.max_off_track_m;
        self.off_track_since = since(self.off_track_since, is_off, inputs.now);
        let patience = self.settings.land_after_intrusion;
        if self.off_track_since.is_none_or(|at| inputs.now.since(at) <= patience) {
            return false;
        }
        let text = format!("stays {off_m:.1} m off its place: landing");
        effects.push(Effect::Say(Severity::Critical, text));
        self.enter(Phase::Land, "does not follow its trajectory", inputs.now, effects);
        true
    }

    /// Counts that the vehicle did not follow. True if that was once too often.
    fn lands_off_track(&mut self, off_m: f64, now: Stamp<Mono>, effects: &mut Vec<Effect>) -> bool {
        self.n_off_track += 1;
        if self.n_off_track <= self.settings.most_off_track_holds {
            return false;
        }
        let text = format!("{off_m:.1} m off its path again: landing");
        effects.push(Effect::Say(Severity::Critical, text));
        self.enter(Phase::Land, "does not follow its trajectory", now, effects);
        true
    }

    /// In a hold, whatever it began with: where it does not get clear it lands.
    pub(super) fn lands_too_near(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let is_near = inputs.intrusion_m > 0.0;
        let began_at = match self.hold_cause {
            HoldCause::TooNear if is_near => Some(self.entered_at),
            _ => self.intruding_since,
        };
        let patience = self.settings.land_after_intrusion;
        if began_at.is_none_or(|at| inputs.now.since(at) <= patience) {
            return false;
        }
        let text = "does not get clear: landing".to_owned();
        effects.push(Effect::Say(Severity::Critical, text));
        self.enter(Phase::Land, "too near to something", inputs.now, effects);
        true
    }

    /// Charge at which the way home must begin.
    pub(super) fn return_at_ratio(&self, inputs: &Inputs) -> f64 {
        let way_home = inputs.way_home_ratio.unwrap_or(0.0);
        let needed = self.settings.land_battery_ratio + self.settings.way_home_factor * way_home;
        needed.max(self.settings.return_battery_ratio)
    }

    pub(super) fn returns_on_battery(
        &mut self,
        inputs: &Inputs,
        effects: &mut Vec<Effect>,
    ) -> bool {
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

    /// One wild word on the battery lands nobody, however long no other comes.
    pub(super) fn lands_on_battery(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) -> bool {
        let is_lasting = |first_at: Stamp<Mono>| {
            inputs.now.since(first_at) >= self.settings.battery_empty_for
                && inputs.battery_heard_at.is_none_or(|last_at| last_at > first_at)
        };
        let is_empty = self.empty_since.is_some_and(is_lasting);
        if is_empty {
            effects.push(Effect::Say(Severity::Critical, "battery empty: landing".to_owned()));
            self.enter(Phase::Land, "battery empty", inputs.now, effects);
        }
        is_empty
    }
}
