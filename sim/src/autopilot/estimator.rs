//! The autopilot's own estimator: inertial navigation held by external vision and air pressure.

mod chain;
mod ekf3;
mod inertial;
mod vision;

pub(super) use ekf3::{Ekf3, EkfNews, NavSample};
pub(super) use vision::VisionSample;

use super::params::ParamTable;
use inertial::Inertial;
use nalgebra::{UnitQuaternion, Vector3};
use std::time::Duration;
use stockpilot::time::{Boot, Stamp};
use vision::Vision;

/// Time between two looks at slow helpers (rest, fake position): 5 Hz.
const SLOW: Duration = Duration::from_millis(200);
/// Variance of the height by air pressure, m².
const PRESSURE_VAR_M2: f64 = 1.0;
/// Variance of the position that holds the tilt when nothing else does, m².
const HELD_VAR_M2: f64 = 100.0;
/// Share of a new difference between vision and air pressure that is learned per sample.
const PRESSURE_LEARNED: f64 = 0.01;
/// Variance of the heading by the compass, rad².
const COMPASS_VAR_RAD2: f64 = 0.3 * 0.3;

/// What the estimator is told with each inertial sample, FRD.
#[derive(Debug, Clone, Copy)]
pub(super) struct Inputs {
    pub(super) accel_mps2: Vector3<f64>,
    pub(super) gyro_radps: Vector3<f64>,
    pub(super) pressure_height_m: f64,
    pub(super) dt_s: f64,
    /// Heading by the compass, rad, where the autopilot uses it.
    pub(super) compass_rad: Option<f64>,
    /// Disarmed on the ground.
    pub(super) is_at_rest: bool,
}

/// The belief of the autopilot, NED and FRD.
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief {
    pub(super) attitude: UnitQuaternion<f64>,
    pub(super) rate_radps: Vector3<f64>,
    pub(super) position_m: Vector3<f64>,
    pub(super) velocity_mps: Vector3<f64>,
    pub(super) accel_mps2: Vector3<f64>,
    pub(super) yaw_rad: f64,
    pub(super) is_position_valid: bool,
}

/// Inertial navigation with its helpers.
#[derive(Debug, Clone)]
pub(super) struct Estimator {
    inertial: Option<Inertial>,
    vision: Vision,
    /// Adds to the height by air pressure to give −z.
    pressure_offset_m: Option<f64>,
    held_position_m: Vector3<f64>,
    slow_due: Stamp<Boot>,
    now: Stamp<Boot>,
}

impl Estimator {
    pub(super) fn new() -> Self {
        Self {
            inertial: None,
            vision: Vision::default(),
            pressure_offset_m: None,
            held_position_m: Vector3::zeros(),
            slow_due: Stamp::ZERO,
            now: Stamp::ZERO,
        }
    }

    /// Moves on by one inertial sample.
    pub(super) fn step(&mut self, now: Stamp<Boot>, inputs: &Inputs) {
        self.now = now;
        let accel = &inputs.accel_mps2;
        let inertial = self.inertial.get_or_insert_with(|| Inertial::levelled(accel));
        inertial.propagate(now, accel, &inputs.gyro_radps, inputs.dt_s);
        self.vision.watch(now);
        if now < self.slow_due {
            return;
        }
        self.slow_due = now.plus(SLOW);
        self.step_slow(inputs);
    }

    fn step_slow(&mut self, inputs: &Inputs) {
        let Some(inertial) = &mut self.inertial else { return };
        if inputs.is_at_rest {
            inertial.fuse_rest();
        }
        if let Some(compass_rad) = inputs.compass_rad {
            inertial.follow_compass(compass_rad, self.vision.is_yaw_aligned());
            self.vision.align_yaw();
        }
        let pressure_m = inputs.pressure_height_m;
        let height_m = -inertial.position_m.z;
        let offset = self.pressure_offset_m.get_or_insert(height_m - pressure_m);
        if self.vision.is_fusing_height() {
            *offset += (height_m - pressure_m - *offset) * PRESSURE_LEARNED;
        } else {
            inertial.fuse_down(0, height_m - (pressure_m + *offset), PRESSURE_VAR_M2);
        }
        if self.vision.is_dead_reckoning(self.now) {
            self.held_position_m = inertial.position_m;
        } else {
            for axis in 0..2 {
                let innov = self.held_position_m[axis] - inertial.position_m[axis];
                inertial.fuse_horizontal(axis, 0, innov, HELD_VAR_M2);
            }
        }
    }

    /// Takes in external vision.
    pub(super) fn on_vision(
        &mut self,
        sample: &VisionSample,
        params: &ParamTable,
        origin_altitude_m: f64,
    ) {
        if let Some(inertial) = &mut self.inertial {
            self.vision.take(self.now, sample, inertial, params, origin_altitude_m);
        }
    }

    /// What is believed now; level at the origin before the first sample.
    pub(super) fn belief(&self) -> Belief {
        belief_of(self.inertial.as_ref(), self.vision.is_position_valid(self.now))
    }

    /// Vision carries the frame `LOCAL_NED`, so a global position can follow from it.
    pub(super) const fn is_vision_north_aligned(&self) -> bool {
        self.vision.is_north_aligned()
    }

    /// `ESTIMATOR_STATUS.flags` as seen on PX4 v1.16.1: 0x1EF with vision, 0xE5 without.
    pub(super) fn status_flags(&self) -> u16 {
        if self.vision.is_position_valid(self.now) { 0x1EF } else { 0xE5 }
    }

    /// 1-σ of the horizontal and of the vertical position, m.
    pub(super) fn position_sigma_m(&self) -> (f64, f64) {
        self.inertial.as_ref().map_or((f64::INFINITY, f64::INFINITY), |nav| {
            ((nav.north.var(0) + nav.east.var(0)).sqrt(), nav.down.var(0).sqrt())
        })
    }

    /// Counts the jumps of the estimate, modulo 256.
    pub(super) const fn reset_counter(&self) -> u8 {
        self.vision.n_resets()
    }
}

/// The belief of an inertial navigation; level at the origin without one.
fn belief_of(nav: Option<&Inertial>, is_position_valid: bool) -> Belief {
    let zero = Vector3::zeros();
    Belief {
        attitude: nav.map_or_else(UnitQuaternion::identity, |n| n.attitude),
        rate_radps: nav.map_or(zero, |n| n.rate_radps),
        position_m: nav.map_or(zero, |n| n.position_m),
        velocity_mps: nav.map_or(zero, |n| n.velocity_mps),
        accel_mps2: nav.map_or(zero, |n| n.accel_mps2),
        yaw_rad: nav.map_or(0.0, Inertial::yaw_rad),
        is_position_valid,
    }
}
