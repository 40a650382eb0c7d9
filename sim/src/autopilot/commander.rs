//! Arming, modes and failsafes.

use super::landing::LandEvent;
use super::modes::Px4Mode;
use super::outbox::Outbox;
use super::params::ParamTable;
use mavlink::dialects::ardupilotmega::{MavModeFlag, MavSeverity, MavState};
use stockpilot::time::{Boot, Stamp};

/// What the commander judges by.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_excessive_bools, reason = "independent health checks, named one by one")]
pub(super) struct Facts {
    pub(super) is_position_valid: bool,
    pub(super) is_global_valid: bool,
    /// A usable setpoint arrived less than `COM_OF_LOSS_T` ago.
    pub(super) has_setpoints: bool,
    pub(super) is_landed: bool,
    pub(super) land_changed_at: Stamp<Boot>,
}

impl Facts {
    /// A mode's own checks pass.
    pub(super) const fn allow(&self, mode: Px4Mode) -> bool {
        let has_local = self.is_position_valid || !mode.needs_local_position();
        let has_global = self.is_global_valid || !mode.needs_global_position();
        let has_setpoints = self.has_setpoints || !matches!(mode, Px4Mode::Offboard);
        has_local && has_global && has_setpoints
    }
}

/// State of the commander.
#[derive(Debug, Clone)]
pub(super) struct Commander {
    is_armed: bool,
    armed_at: Stamp<Boot>,
    has_flown: bool,
    intended: Px4Mode,
    before_landing: Px4Mode,
    failsafe: Option<Px4Mode>,
}

impl Commander {
    pub(super) const fn new() -> Self {
        Self {
            is_armed: false,
            armed_at: Stamp::ZERO,
            has_flown: false,
            intended: Px4Mode::Loiter,
            before_landing: Px4Mode::Loiter,
            failsafe: None,
        }
    }

    pub(super) const fn is_armed(&self) -> bool {
        self.is_armed
    }

    pub(super) const fn is_in_failsafe(&self) -> bool {
        self.failsafe.is_some()
    }

    /// The mode that flies.
    pub(super) fn active(&self) -> Px4Mode {
        self.failsafe.unwrap_or(self.intended)
    }

    /// The mode that was asked for; a failsafe may fly another.
    pub(super) const fn intended(&self) -> Px4Mode {
        self.intended
    }

    /// Changes the intended mode; refused while armed if the mode's checks fail.
    pub(super) fn request(&mut self, mode: Px4Mode, facts: &Facts) -> bool {
        if self.is_armed && !facts.allow(mode) {
            return false;
        }
        if mode != Px4Mode::Land && self.intended != mode {
            self.before_landing = mode;
        }
        self.intended = mode;
        self.failsafe = None;
        true
    }

    /// Lands with whatever position there is.
    pub(super) const fn force_land(&mut self) {
        self.intended = Px4Mode::Land;
    }

    /// Arms, or says why not.
    pub(super) fn arm(&mut self, now: Stamp<Boot>, facts: &Facts, outbox: &mut Outbox) -> bool {
        if self.is_armed {
            return true;
        }
        if !facts.allow(self.intended) {
            let text = "Arming denied: Resolve system health failures first";
            outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, text);
            return false;
        }
        (self.is_armed, self.armed_at, self.has_flown) = (true, now, false);
        outbox.text(MavSeverity::MAV_SEVERITY_INFO, "Armed by external command");
        true
    }

    /// Disarms on request; refused in the air unless forced.
    pub(super) fn disarm(&mut self, facts: &Facts, is_forced: bool, outbox: &mut Outbox) -> bool {
        if self.is_armed && !facts.is_landed && !is_forced {
            let text = "Disarming denied: not landed";
            outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, text);
            return false;
        }
        if self.is_armed {
            self.stop();
            outbox.text(MavSeverity::MAV_SEVERITY_INFO, "Disarmed by external command");
        }
        true
    }

    /// Stops the motors whatever happens.
    pub(super) fn stop(&mut self) {
        self.is_armed = false;
        self.failsafe = None;
        if self.intended == Px4Mode::Land {
            self.intended = self.before_landing;
        }
    }

    /// Looks after failsafes and automatic disarming.
    pub(super) fn step(
        &mut self,
        now: Stamp<Boot>,
        facts: &Facts,
        params: &ParamTable,
        land_event: Option<LandEvent>,
        outbox: &mut Outbox,
    ) {
        match land_event {
            Some(LandEvent::TookOff) => {
                self.has_flown = true;
                outbox.text(MavSeverity::MAV_SEVERITY_INFO, "Takeoff detected");
            }
            Some(LandEvent::Landed) => {
                outbox.text(MavSeverity::MAV_SEVERITY_INFO, "Landing detected");
            }
            None => {}
        }
        if !self.is_armed {
            return;
        }
        self.look_for_failsafe(facts, params, outbox);
        if facts.is_landed {
            self.disarm_on_ground(now, facts, params, outbox);
        }
    }

    /// The intended mode comes back by itself when its checks pass again.
    fn look_for_failsafe(&mut self, facts: &Facts, params: &ParamTable, outbox: &mut Outbox) {
        let fallback = if facts.allow(self.intended) {
            None
        } else if !facts.is_position_valid {
            Some(Px4Mode::Land)
        } else {
            Some(setpoint_loss_mode(facts, params))
        };
        if fallback.is_some() && self.failsafe.is_none() {
            outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, "Failsafe activated");
            if fallback == Some(Px4Mode::Position) {
                // There are no sticks.
                let text = "Matching flight task was not able to run";
                outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, text);
            }
        }
        self.failsafe = fallback;
    }

    fn disarm_on_ground(
        &mut self,
        now: Stamp<Boot>,
        facts: &Facts,
        params: &ParamTable,
        outbox: &mut Outbox,
    ) {
        let after_landing_s = params.real("COM_DISARM_LAND");
        let before_flight_s = params.real("COM_DISARM_PRFLT");
        let text = if self.has_flown {
            let is_due = now.seconds_since(facts.land_changed_at) >= after_landing_s;
            (after_landing_s > 0.0 && is_due).then_some("Disarmed by landing")
        } else {
            let is_due = now.seconds_since(self.armed_at) >= before_flight_s;
            (before_flight_s > 0.0 && is_due).then_some("Disarmed by auto preflight disarming")
        };
        if let Some(text) = text {
            self.stop();
            outbox.text(MavSeverity::MAV_SEVERITY_INFO, text);
        }
    }

    /// `base_mode` of HEARTBEAT.
    pub(super) fn base_mode(&self, facts: &Facts) -> MavModeFlag {
        let mode = self.active();
        let bits = if mode.is_auto() {
            0x1d
        } else if mode == Px4Mode::Offboard {
            if facts.has_setpoints { 0x11 } else { 0x01 }
        } else {
            0x51
        };
        MavModeFlag::from_bits_retain(bits | if self.is_armed { 0x80 } else { 0 })
    }

    /// `system_status` of HEARTBEAT.
    pub(super) fn system_status(&self, facts: &Facts) -> MavState {
        match (self.is_armed, self.failsafe) {
            (true, Some(_)) => MavState::MAV_STATE_CRITICAL,
            (true, None) => MavState::MAV_STATE_ACTIVE,
            (false, _) if facts.allow(self.intended) => MavState::MAV_STATE_STANDBY,
            (false, _) => MavState::MAV_STATE_UNINIT,
        }
    }
}

/// `COM_OBL_RC_ACT`: what to do when the setpoints stay away.
fn setpoint_loss_mode(facts: &Facts, params: &ParamTable) -> Px4Mode {
    let wanted = match params.int("COM_OBL_RC_ACT") {
        0 => Px4Mode::Position,
        1 => Px4Mode::Altitude,
        2 => Px4Mode::Stabilized,
        3 => Px4Mode::Return,
        5 => Px4Mode::Loiter,
        6 => Px4Mode::Termination,
        _ => Px4Mode::Land,
    };
    if facts.allow(wanted) { wanted } else { Px4Mode::Land }
}
