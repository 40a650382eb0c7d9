//! Where each mode wants to go.

use super::estimator::Belief;
use super::modes::Px4Mode;
use super::params::ParamTable;
use super::setpoint::Target;
use nalgebra::Vector3;

/// Distance from home at which the return turns into a landing, m.
const HOME_REACHED_M: f64 = 0.3;
/// Speed of the return, m/s.
const RETURN_MPS: f64 = 1.5;

/// The place that the present mode holds on to.
#[derive(Debug, Clone)]
pub(super) struct Guidance {
    mode: Option<Px4Mode>,
    place_m: Vector3<f64>,
    yaw_rad: f64,
    home_m: Vector3<f64>,
    is_climb_done: bool,
    /// A person holds the sticks, centred.
    has_pilot: bool,
}

impl Guidance {
    pub(super) fn new() -> Self {
        Self {
            mode: None,
            place_m: Vector3::zeros(),
            yaw_rad: 0.0,
            home_m: Vector3::zeros(),
            is_climb_done: false,
            has_pilot: false,
        }
    }

    /// From now on a person holds the sticks, centred.
    pub(super) const fn give_to_pilot(&mut self) {
        self.has_pilot = true;
    }

    /// Remembers where the vehicle was armed.
    pub(super) fn set_home(&mut self, belief: &Belief) {
        self.home_m = belief.position_m;
    }

    /// Home in NED, m.
    pub(super) const fn home_m(&self) -> &Vector3<f64> {
        &self.home_m
    }

    /// AUTO.TAKEOFF has reached its altitude.
    pub(super) fn is_climb_done(&self) -> bool {
        self.mode == Some(Px4Mode::TakeOff) && self.is_climb_done
    }

    /// The target of `mode`; `offboard` is the companion's.
    pub(super) fn target(
        &mut self,
        mode: Px4Mode,
        belief: &Belief,
        offboard: &Target,
        params: &ParamTable,
    ) -> Target {
        if self.mode != Some(mode) {
            self.mode = Some(mode);
            // Where a gentle braking ends.
            self.place_m = belief.position_m + belief.velocity_mps * 0.5;
            self.yaw_rad = belief.yaw_rad;
            self.is_climb_done = false;
        }
        let land_mps = params.real("MPC_LAND_SPEED");
        if mode != Px4Mode::Offboard && !belief.is_position_valid {
            return Target::sink(None, self.yaw_rad, land_mps);
        }
        match mode {
            Px4Mode::Offboard => *offboard,
            Px4Mode::Land => Target::sink(Some(&self.place_m), self.yaw_rad, land_mps),
            Px4Mode::Position if self.has_pilot => Target::hold(&self.place_m, self.yaw_rad),
            Px4Mode::Altitude | Px4Mode::Stabilized | Px4Mode::Manual | Px4Mode::Acro
                if self.has_pilot =>
            {
                Target::sink(None, self.yaw_rad, 0.0)
            }
            // Without sticks PX4 cannot run these and sinks blindly.
            Px4Mode::Manual
            | Px4Mode::Altitude
            | Px4Mode::Position
            | Px4Mode::Acro
            | Px4Mode::Stabilized
            | Px4Mode::Termination => Target::sink(None, self.yaw_rad, land_mps),
            Px4Mode::TakeOff => self.climb(belief, params),
            Px4Mode::Return => self.way_home(belief, land_mps),
            Px4Mode::Loiter | Px4Mode::Mission => Target::hold(&self.place_m, self.yaw_rad),
        }
    }

    fn climb(&mut self, belief: &Belief, params: &ParamTable) -> Target {
        let goal_z = self.home_m.z - params.real("MIS_TAKEOFF_ALT");
        let left_m = belief.position_m.z - goal_z;
        self.is_climb_done |= left_m < 0.2;
        let speed = left_m.clamp(0.0, params.real("MPC_TKO_SPEED"));
        let mut target = Target::hold(&self.place_m, self.yaw_rad);
        target.position_m[2] = self.is_climb_done.then_some(goal_z);
        target.velocity_mps[2] = (!self.is_climb_done).then_some(-speed);
        target
    }

    fn way_home(&self, belief: &Belief, land_mps: f64) -> Target {
        let way = (self.home_m - belief.position_m).xy();
        if way.norm() < HOME_REACHED_M {
            return Target::sink(Some(&self.home_m), self.yaw_rad, land_mps);
        }
        let velocity = way.normalize() * RETURN_MPS.min(way.norm());
        Target {
            position_m: [None, None, Some(self.place_m.z)],
            velocity_mps: [Some(velocity.x), Some(velocity.y), None],
            yaw_rad: Some(self.yaw_rad),
            ..Target::default()
        }
    }
}
