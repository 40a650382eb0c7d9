//! GUIDED: what is flown between two messages of the companion, and when none come.
//!
//! A lone position is flown to for ever. Velocity and acceleration end `GUID_TIMEOUT` after the
//! last message: a lone velocity is braked within a second, beside a position it becomes zero and
//! the position, moved on by it until then, remains.

use super::setpoint::Wish;
use crate::autopilot::estimator::Belief;
use crate::autopilot::setpoint::Target;
use nalgebra::Vector3;
use stockpilot::time::{Boot, Stamp};

/// Time in which a lone velocity is braked after its end, s.
const BRAKING_S: f64 = 1.0;
/// The climb is over this close to its height, m.
const CLIMB_DONE_M: f64 = 0.1;

/// What GUIDED does at present.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Submode {
    /// Keeps the place.
    Hold,
    /// Climbs to this z in NED.
    TakeOff(f64),
    /// Flies to a place.
    Position,
    /// Flies a place that moves.
    PositionVelocity,
    /// Flies a velocity.
    Velocity,
}

/// State of GUIDED.
#[derive(Debug, Clone)]
pub(super) struct Guided {
    submode: Submode,
    place_m: Vector3<f64>,
    velocity_mps: Vector3<f64>,
    accel_mps2: Vector3<f64>,
    yaw_rad: f64,
    yaw_rate_radps: f64,
    heard_at: Stamp<Boot>,
}

impl Guided {
    pub(super) fn new() -> Self {
        Self {
            submode: Submode::Hold,
            place_m: Vector3::zeros(),
            velocity_mps: Vector3::zeros(),
            accel_mps2: Vector3::zeros(),
            yaw_rad: 0.0,
            yaw_rate_radps: 0.0,
            heard_at: Stamp::ZERO,
        }
    }

    /// Begins, or stops, where the vehicle comes to rest.
    pub(super) fn hold(&mut self, belief: &Belief) {
        self.submode = Submode::Hold;
        self.place_m = belief.position_m + belief.velocity_mps * 0.5;
        self.velocity_mps = Vector3::zeros();
        self.accel_mps2 = Vector3::zeros();
        self.yaw_rad = belief.yaw_rad;
        self.yaw_rate_radps = 0.0;
    }

    /// Climbs over the present place to `z_m` in NED.
    pub(super) fn take_off(&mut self, belief: &Belief, z_m: f64) {
        self.hold(belief);
        self.place_m = belief.position_m;
        self.submode = Submode::TakeOff(z_m);
    }

    /// A take-off is under way.
    pub(super) fn is_taking_off(&self, belief: &Belief) -> bool {
        matches!(self.submode, Submode::TakeOff(z) if belief.position_m.z > z + CLIMB_DONE_M)
    }

    /// The companion lifts the vehicle off the ground.
    pub(super) const fn lifts(&self) -> bool {
        matches!(self.submode, Submode::TakeOff(_))
    }

    /// Takes in what the companion wishes; what cannot be flown stops the vehicle.
    pub(super) fn take(&mut self, now: Stamp<Boot>, wish: &Wish, belief: &Belief) {
        let zero = Vector3::zeros();
        match (wish.position_m, wish.velocity_mps, wish.accel_mps2) {
            (Some(place_m), Some(velocity_mps), accel) => {
                self.submode = Submode::PositionVelocity;
                self.place_m = place_m;
                self.velocity_mps = velocity_mps;
                self.accel_mps2 = accel.unwrap_or(zero);
            }
            (None, Some(velocity_mps), accel) => {
                self.submode = Submode::Velocity;
                self.velocity_mps = velocity_mps;
                self.accel_mps2 = accel.unwrap_or(zero);
            }
            (Some(place_m), None, None) => {
                self.submode = Submode::Position;
                self.place_m = place_m;
                self.velocity_mps = zero;
                self.accel_mps2 = zero;
            }
            _ => return self.hold(belief),
        }
        self.heard_at = now;
        self.yaw_rad = wish.yaw_rad.unwrap_or(self.yaw_rad);
        self.yaw_rate_radps = wish.yaw_rate_radps.unwrap_or(0.0);
    }

    /// What to fly now, `dt_s` after the last call.
    pub(super) fn target(&mut self, now: Stamp<Boot>, timeout_s: f64, dt_s: f64) -> Target {
        let age_s = now.seconds_since(self.heard_at);
        let is_fresh = age_s < timeout_s;
        match self.submode {
            Submode::Hold | Submode::Position => Target::hold(&self.place_m, self.yaw_rad),
            Submode::TakeOff(z) => {
                let goal = Vector3::new(self.place_m.x, self.place_m.y, z);
                Target::hold(&goal, self.yaw_rad)
            }
            Submode::PositionVelocity => {
                if is_fresh {
                    self.place_m += self.velocity_mps * dt_s;
                    self.velocity_mps += self.accel_mps2 * dt_s;
                } else {
                    self.velocity_mps = Vector3::zeros();
                    self.accel_mps2 = Vector3::zeros();
                    self.yaw_rate_radps = 0.0;
                }
                let mut target = Target::hold(&self.place_m, self.yaw_rad);
                target.velocity_mps = <[f64; 3]>::from(self.velocity_mps).map(Some);
                target.accel_mps2 = <[f64; 3]>::from(self.accel_mps2).map(Some);
                target.yaw_rate_radps = Some(self.yaw_rate_radps);
                target
            }
            Submode::Velocity => {
                let share = (1.0 - (age_s - timeout_s) / BRAKING_S).clamp(0.0, 1.0);
                let velocity = self.velocity_mps * share;
                Target {
                    velocity_mps: <[f64; 3]>::from(velocity).map(Some),
                    yaw_rad: Some(self.yaw_rad),
                    ..Target::default()
                }
            }
        }
    }

    /// Place, velocity and acceleration that are flown, NED.
    pub(super) const fn flown(&self) -> (&Vector3<f64>, &Vector3<f64>, &Vector3<f64>) {
        (&self.place_m, &self.velocity_mps, &self.accel_mps2)
    }
}
