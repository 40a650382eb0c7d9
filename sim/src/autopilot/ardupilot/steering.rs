//! Where each mode wants to go.

use super::modes::ApMode;
use super::stub::StubArduPilot;
use crate::autopilot::limits::{Lift, Limits};
use crate::autopilot::setpoint::Target;
use crate::vehicle::MotorCommands;

/// Distance from home at which the return turns into a landing, m.
const HOME_REACHED_M: f64 = 0.3;
/// Speed of the return, m/s.
const RETURN_MPS: f64 = 1.5;

impl StubArduPilot {
    /// Enters a mode, whatever the checks say.
    pub(super) fn enter(&mut self, mode: ApMode) {
        if self.mode != mode {
            self.mode = mode;
            self.heartbeat_is_due = true;
        }
        self.place_m = self.belief.position_m + self.belief.velocity_mps * 0.5;
        self.yaw_rad = self.belief.yaw_rad;
        if mode == ApMode::Guided {
            self.guided.hold(&self.belief);
        }
    }

    pub(super) fn control(&mut self, dt_s: f64) -> MotorCommands {
        let target = self.target(dt_s);
        // On the ground only a take-off lifts; anything else leaves it standing with idle rotors.
        let wants_up =
            !self.landing.is_landed() || (self.mode == ApMode::Guided && self.guided.lifts());
        let lift = Lift::ardupilot(&self.params);
        let is_landed = self.landing.is_landed();
        self.takeoff.step(self.now, &lift, self.is_armed, wants_up, is_landed);
        match self.takeoff.climb_limit_mps(self.now, &lift) {
            Some(climb_limit_mps) if wants_up || !is_landed => {
                let limits = Limits::ardupilot(&self.params);
                self.controller.step(&self.belief, &target, &limits, climb_limit_mps, dt_s)
            }
            _ => {
                let idle = self.controller.idle(&self.belief);
                if self.is_armed { idle } else { [0.0; 4] }
            }
        }
    }

    fn target(&mut self, dt_s: f64) -> Target {
        let land_mps = self.params.real("LAND_SPEED") * 1e-2;
        if !self.belief.is_position_valid && self.mode.needs_position() {
            return Target::sink(None, self.yaw_rad, 0.0);
        }
        match self.mode {
            ApMode::Guided => self.guided.target(self.now, self.params.real("GUID_TIMEOUT"), dt_s),
            ApMode::Stabilize | ApMode::AltHold => Target::sink(None, self.yaw_rad, 0.0),
            ApMode::Auto | ApMode::Loiter | ApMode::Brake => {
                Target::hold(&self.place_m, self.yaw_rad)
            }
            ApMode::Land => {
                let place = self.belief.is_position_valid.then_some(&self.place_m);
                Target::sink(place, self.yaw_rad, land_mps)
            }
            ApMode::Rtl => self.way_home(land_mps),
        }
    }

    /// Climbs to `RTL_ALT` first, then flies home level, then lands.
    fn way_home(&self, land_mps: f64) -> Target {
        let way = (self.home_m - self.belief.position_m).xy();
        if way.norm() < HOME_REACHED_M {
            return Target::sink(Some(&self.home_m), self.yaw_rad, land_mps);
        }
        let return_z = self.home_m.z - self.params.real("RTL_ALT") * 1e-2;
        let z = return_z.min(self.place_m.z);
        if self.belief.position_m.z > z + 0.3 {
            let mut climb = Target::hold(&self.place_m, self.yaw_rad);
            climb.position_m[2] = Some(z);
            return climb;
        }
        let velocity = way.normalize() * RETURN_MPS.min(way.norm());
        Target {
            position_m: [None, None, Some(z)],
            velocity_mps: [Some(velocity.x), Some(velocity.y), None],
            yaw_rad: Some(self.yaw_rad),
            ..Target::default()
        }
    }
}
