//! From armed on the ground to flight: rotors spool up, then the climb is let go slowly.

use super::limits::Lift;
use stockpilot::time::{Boot, Stamp};
use stockpilot::units::GRAVITY_MPS2;

/// Gain of the vertical velocity loop, 1/s; with it the ramp starts at zero thrust.
const VELOCITY_P_PER_S: f64 = 4.0;

/// Where the take-off stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TakeOff {
    /// Rotors stand still.
    Disarmed,
    /// Rotors come up to idle.
    SpoolUp(Stamp<Boot>),
    /// Waits for a setpoint above the ground.
    Ready,
    /// The bound of the climb rises.
    Ramp(Stamp<Boot>),
    /// Flies.
    Flight,
}

impl TakeOff {
    /// Moves on.
    pub(super) fn step(
        &mut self,
        now: Stamp<Boot>,
        lift: &Lift,
        is_armed: bool,
        wants_up: bool,
        is_landed: bool,
    ) {
        *self = match *self {
            _ if !is_armed => Self::Disarmed,
            Self::Disarmed => Self::SpoolUp(now),
            Self::SpoolUp(since) if now.seconds_since(since) >= lift.spool_up_s => Self::Ready,
            Self::Ready if wants_up => Self::Ramp(now),
            Self::Ramp(since) if now.seconds_since(since) >= lift.ramp_s => Self::Flight,
            Self::Ramp(_) if !wants_up && is_landed => Self::Ready,
            Self::Flight if is_landed => Self::Ready,
            other => other,
        };
    }

    /// Bound of the climb, m/s; `None` while the rotors shall idle or stand.
    ///
    /// The ramp starts at the velocity that asks for no thrust at all, −g/P.
    pub(super) fn climb_limit_mps(&self, now: Stamp<Boot>, lift: &Lift) -> Option<f64> {
        match *self {
            Self::Disarmed | Self::SpoolUp(_) | Self::Ready => None,
            Self::Flight => Some(f64::INFINITY),
            Self::Ramp(since) => {
                let share = (now.seconds_since(since) / lift.ramp_s).clamp(0.0, 1.0);
                let start = -GRAVITY_MPS2 / VELOCITY_P_PER_S;
                Some(start + (lift.climb_mps - start) * share)
            }
        }
    }
}
