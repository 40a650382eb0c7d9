//! What is done in each phase while nothing forbids it.

use super::{HoldCause, Mission};
use crate::messages::{
    FlightMode, LandedState, Severity, TAKE_OFF_HEIGHT_M, TakeOff, VehicleCommand,
};
use crate::mission::Phase;
use crate::mission::decision::{Effect, Inputs};
use crate::mission::guards::{preflight_faults, preflight_line};
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// A commanded take-off counts as done from this share of its height on.
const LIFTED_RATIO: f64 = 0.7;

/// Motors that were asked to start may do so for so long after the start was called off.
const MAY_ARM_YET_FOR: Duration = Duration::from_secs(10);

impl Mission {
    /// Motors that start although the start was called off stop again.
    pub(super) fn step_idle(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        if inputs.vehicle.is_some_and(|vehicle| vehicle.is_armed) {
            self.stop_what_may_start(inputs, effects);
        }
    }

    /// After a start that was called off the autopilot may arm yet, for it was asked to.
    pub(super) fn stop_what_may_start(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        let is_ours_on_ground = inputs.vehicle.is_some_and(|vehicle| {
            vehicle.mode == FlightMode::Companion && vehicle.landed == LandedState::OnGround
        });
        if self.may_arm_yet(inputs.now) && is_ours_on_ground {
            self.ask(VehicleCommand::Disarm, inputs.now, effects);
        }
    }

    /// Motors may start yet, for the autopilot was asked to start them before the start was called off.
    #[must_use]
    pub fn may_arm_yet(&self, now: Stamp<Mono>) -> bool {
        self.called_off_at.is_some_and(|at| now.since(at) < MAY_ARM_YET_FOR)
    }

    pub(super) fn step_preflight(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        let waited = inputs.now.since(self.entered_at);
        let is_companion = inputs.vehicle.is_some_and(|v| v.mode == FlightMode::Companion);
        let is_armed = inputs.vehicle.is_some_and(|v| v.is_armed);
        if is_armed && !self.has_asked_to_arm {
            self.stop_what_may_start(inputs, effects);
        }
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
            self.stop_what_may_start(inputs, effects);
            return;
        }
        if !faults.is_empty() || waited < self.settings.stream_before_mode {
            return;
        }
        if is_companion && !self.has_asked_to_arm {
            effects.push(Effect::Say(Severity::Info, preflight_line(inputs)));
        }
        if is_companion {
            self.has_asked_to_arm = true;
            self.called_off_at = None;
        }
        let command =
            if is_companion { VehicleCommand::Arm } else { VehicleCommand::EnterCompanionMode };
        self.ask(command, inputs.now, effects);
    }

    pub(super) fn step_take_off(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
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

    pub(super) fn step_survey(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
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

    pub(super) fn step_return(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
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

    pub(super) fn step_hold(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        let waited = inputs.now.since(self.entered_at);
        if self.lands_on_battery(inputs, effects) || self.lands_on_straying(inputs, effects) {
            return;
        }
        if !inputs.has_position {
            self.recovered_since = None;
            self.off_track_since = None;
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
        if self.lands_too_near(inputs, effects) {
            return;
        }
        // Somebody may stand on the way home: a hold asked for on it is kept.
        let is_kept = self.hold_cause == HoldCause::Operator && self.resume_to == Phase::Return;
        if !is_kept && self.returns_on_battery(inputs, effects) {
            return;
        }
        if self.lands_far_off(inputs, effects) {
            return;
        }
        let is_recovered = match self.hold_cause {
            HoldCause::Operator => false,
            HoldCause::FixLost => true,
            HoldCause::LidarLost => inputs.has_lidar,
            HoldCause::TooNear => inputs.intrusion_m <= 0.0,
            HoldCause::OffTrack => {
                inputs.off_track_m.is_some_and(|off_m| off_m <= self.settings.max_off_track_m)
            }
        };
        if is_recovered {
            let since = *self.recovered_since.get_or_insert(inputs.now);
            if inputs.now.since(since) >= self.settings.recovered_after {
                self.enter(self.resume_to, "recovered", inputs.now, effects);
            }
        } else {
            self.recovered_since = None;
            let is_lidar_gone = self.hold_cause == HoldCause::LidarLost;
            if is_lidar_gone && waited > self.settings.return_after_lidar_lost {
                self.enter(Phase::Return, "LiDAR does not come back", inputs.now, effects);
            }
        }
    }

    pub(super) fn step_land(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        let Some(vehicle) = inputs.vehicle else { return };
        if !vehicle.is_armed {
            self.enter(Phase::Idle, "landed", inputs.now, effects);
            effects.push(Effect::Ended { is_complete: self.is_complete });
        } else if vehicle.mode == FlightMode::Companion {
            self.ask(VehicleCommand::EnterLand, inputs.now, effects);
        }
    }

    pub(super) fn step_abort(&mut self, inputs: &Inputs, effects: &mut Vec<Effect>) {
        if inputs.vehicle.is_some_and(|vehicle| !vehicle.is_armed) {
            self.enter(Phase::Idle, "disarmed", inputs.now, effects);
            effects.push(Effect::Ended { is_complete: false });
        }
    }
}
