//! Arming, disarming, failsafes, and what people are told of them.

use super::modes::ApMode;
use super::stub::StubArduPilot;
use crate::autopilot::landing::LandEvent;
use mavlink::dialects::ardupilotmega::MavSeverity;
use std::time::Duration;
use stockpilot::time::{Boot, Stamp};

/// "`ArduPilot` Ready" comes this long after the boot; the mode switch rules until then.
pub(super) const READY_AFTER: Duration = Duration::from_secs(6);
/// The inertial sensors disagree while they warm up.
const SENSORS_SETTLED_AFTER: Duration = Duration::from_secs(20);
/// Failing checks are told this often.
const PREARM_EVERY: Duration = Duration::from_secs(30);
/// Time from touchdown to the end of the motors, s.
const DISARM_AFTER_LANDING_S: f64 = 2.1;
/// Time from a lost position to the failsafe.
const FAILSAFE_AFTER: Duration = Duration::from_millis(950);

const CRITICAL: MavSeverity = MavSeverity::MAV_SEVERITY_CRITICAL;
const INFO: MavSeverity = MavSeverity::MAV_SEVERITY_INFO;

impl StubArduPilot {
    /// Time since the boot has passed.
    fn has_run_for(&self, span: Duration) -> bool {
        self.now.since(Stamp::ZERO) >= span
    }

    /// The autopilot has said that it is ready.
    pub(super) fn is_ready(&self) -> bool {
        self.has_run_for(READY_AFTER)
    }

    /// The checks that fail, in the firmware's words; `only_mandatory` leaves out those that a
    /// forced arming overrides.
    pub(super) fn failing_checks(&self, only_mandatory: bool) -> Vec<String> {
        if !self.is_ready() {
            return vec!["System not initialised".to_owned()];
        }
        let mut failing = Vec::new();
        if !only_mandatory {
            if !self.has_run_for(SENSORS_SETTLED_AFTER) {
                failing.push("Accels inconsistent".to_owned());
                failing.push("Gyros inconsistent".to_owned());
            }
            if self.params.is("VISO_TYPE", 1) && !self.ekf.is_odometry_healthy() {
                failing.push("VisOdom: not healthy".to_owned());
            }
            if self.origin.is_none() {
                failing.push("AHRS: waiting for home".to_owned());
            }
        }
        if self.mode.needs_position() && !self.belief.is_position_valid {
            failing.push("Need Position Estimate".to_owned());
        }
        if !self.mode.is_armable() {
            failing.push(format!("{} mode not armable", self.mode.name()));
        }
        failing
    }

    /// Arms, or tells every failing check.
    pub(super) fn arm(&mut self, is_forced: bool) -> bool {
        if self.is_armed {
            return true;
        }
        let failing = self.failing_checks(is_forced);
        for reason in &failing {
            self.outbox.text_to_all(CRITICAL, &format!("Arm: {reason}"));
        }
        if !failing.is_empty() {
            return false;
        }
        (self.is_armed, self.armed_at, self.has_flown) = (true, self.now, false);
        self.is_in_failsafe = false;
        self.home_m = self.belief.position_m;
        self.home_is_set = self.origin.is_some();
        self.outbox.text_to_all(INFO, "Arming motors");
        if self.mode == ApMode::Guided {
            self.guided.hold(&self.belief);
        }
        true
    }

    /// Disarms; refused in the air unless forced.
    pub(super) fn disarm(&mut self, is_forced: bool) -> bool {
        if self.is_armed && !self.landing.is_landed() && !is_forced {
            return false;
        }
        self.stop_motors();
        true
    }

    pub(super) fn stop_motors(&mut self) {
        if self.is_armed {
            self.is_armed = false;
            self.is_in_failsafe = false;
            self.outbox.text_to_all(INFO, "Disarming motors");
        }
    }

    /// Looks after readiness, failsafes, automatic disarming and the repeated complaints.
    pub(super) fn look_after(&mut self, land_event: Option<LandEvent>) {
        if self.is_ready() && !self.has_said_ready {
            self.has_said_ready = true;
            self.outbox.text_to_all(INFO, "ArduPilot Ready");
            // Whatever was asked before is overwritten by the mode switch.
            let switched = self.switch_mode;
            self.enter(switched);
        }
        if land_event == Some(LandEvent::TookOff) {
            self.has_flown = true;
        }
        if self.is_armed {
            self.look_for_failsafe();
            if self.landing.is_landed() {
                self.disarm_on_ground();
            }
        } else if self.has_said_ready && self.now >= self.prearm_due {
            self.prearm_due = self.now.plus(PREARM_EVERY);
            for reason in self.failing_checks(false) {
                self.outbox.text_to_all(CRITICAL, &format!("PreArm: {reason}"));
            }
        }
    }

    fn look_for_failsafe(&mut self) {
        if !self.ekf.has_lost_position() {
            self.position_lost_at = None;
            return;
        }
        let since = *self.position_lost_at.get_or_insert(self.now);
        let is_due = self.now.since(since) >= FAILSAFE_AFTER && !self.is_in_failsafe;
        if is_due && self.mode.needs_position() {
            self.is_in_failsafe = true;
            self.outbox.text_to_all(CRITICAL, "EKF variance");
            self.outbox.text_to_all(CRITICAL, "EKF Failsafe: changed to LAND Mode");
            self.enter(ApMode::Land);
        }
    }

    fn disarm_on_ground(&mut self) {
        let since = |at: Stamp<Boot>| self.now.seconds_since(at);
        let is_due = if self.has_flown {
            let is_landing = matches!(self.mode, ApMode::Land | ApMode::Rtl | ApMode::Guided);
            is_landing && since(self.landing.became_at()) >= DISARM_AFTER_LANDING_S
        } else {
            let delay_s = self.params.real("DISARM_DELAY");
            delay_s > 0.0 && since(self.armed_at) >= delay_s - 0.1
        };
        if is_due {
            self.stop_motors();
        }
    }
}
