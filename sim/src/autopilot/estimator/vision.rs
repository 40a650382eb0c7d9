//! External vision: when it is fused, gated, reset and given up.
//!
//! In `LOCAL_NED` the place counts only once the heading is aligned, by vision itself or by a compass:
//! without either, nothing is fused and nobody is told.
//! Fusion starts with two successive samples less than [`MAX_INTERVAL`] apart and ends
//! [`STOP_AFTER`] after the last one. A changed reset counter moves the estimate to the sample.
//! Outliers are gated; when nothing passes for [`RESET_AFTER`], the estimate moves to the sample,
//! five times at most.

use super::inertial::Inertial;
use crate::autopilot::params::ParamTable;
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::time::{Boot, Stamp};
use stockpilot::units::wrapped_rad;

const MAX_INTERVAL: Duration = Duration::from_millis(200);
const STOP_AFTER: Duration = Duration::from_millis(400);
const RESET_AFTER: Duration = Duration::from_secs(1);
/// Time from the start of fusion until the position counts as valid.
const VALID_AFTER: Duration = Duration::from_millis(500);
/// Time from the last fusion until the position counts as lost.
const LOST_AFTER: Duration = Duration::from_millis(4700);
const MAX_TIMEOUT_RESETS: u8 = 5;

const BIT_HORIZONTAL: i32 = 1;
const BIT_VERTICAL: i32 = 2;
const BIT_VELOCITY: i32 = 4;
const BIT_YAW: i32 = 8;

/// One ODOMETRY, checked and in NED.
#[derive(Debug, Clone, Copy)]
pub(in crate::autopilot) struct VisionSample {
    pub(in crate::autopilot) at: Stamp<Boot>,
    pub(in crate::autopilot) position_m: Vector3<f64>,
    pub(in crate::autopilot) position_var_m2: Vector3<f64>,
    pub(in crate::autopilot) yaw_rad: f64,
    pub(in crate::autopilot) yaw_var_rad2: f64,
    /// Velocity in NED and its variance, where it was sent.
    pub(in crate::autopilot) velocity: Option<(Vector3<f64>, Vector3<f64>)>,
    pub(in crate::autopilot) reset_counter: u8,
    pub(in crate::autopilot) quality: i8,
    pub(in crate::autopilot) is_north_aligned: bool,
}

/// State of the fusion.
#[derive(Debug, Clone, Default)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of the fusion")]
pub(super) struct Vision {
    last: Option<VisionSample>,
    heard_at: Option<Stamp<Boot>>,
    fusing_since: Option<Stamp<Boot>>,
    fuses_height: bool,
    horizontal_fused_at: Option<Stamp<Boot>>,
    height_fused_at: Option<Stamp<Boot>>,
    was_valid: bool,
    is_yaw_aligned: bool,
    has_stopped: bool,
    n_timeout_resets: u8,
    n_resets: u8,
}

impl Vision {
    /// Ends the fusion when samples stay away.
    pub(super) fn watch(&mut self, now: Stamp<Boot>) {
        let is_silent = self.heard_at.is_none_or(|at| now.since(at) > STOP_AFTER);
        if self.fusing_since.is_some() && is_silent {
            self.fusing_since = None;
            self.fuses_height = false;
            self.has_stopped = true;
        }
        self.was_valid = self.is_position_valid(now);
    }

    pub(super) fn is_position_valid(&self, now: Stamp<Boot>) -> bool {
        let is_recent = self.horizontal_fused_at.is_some_and(|at| now.since(at) < LOST_AFTER);
        let is_settled = self.fusing_since.is_some_and(|since| now.since(since) >= VALID_AFTER);
        is_recent && (self.was_valid || is_settled)
    }

    /// The position still follows from vision of the last five seconds.
    pub(super) fn is_dead_reckoning(&self, now: Stamp<Boot>) -> bool {
        self.horizontal_fused_at.is_some_and(|at| now.since(at) < Duration::from_secs(5))
    }

    pub(super) const fn is_fusing_height(&self) -> bool {
        self.fuses_height
    }

    pub(super) const fn is_north_aligned(&self) -> bool {
        matches!(&self.last, Some(sample) if sample.is_north_aligned)
    }

    pub(super) const fn is_yaw_aligned(&self) -> bool {
        self.is_yaw_aligned
    }

    /// Another source has aligned the heading.
    pub(super) const fn align_yaw(&mut self) {
        self.is_yaw_aligned = true;
    }

    pub(super) const fn n_resets(&self) -> u8 {
        self.n_resets
    }

    /// Takes in one sample.
    pub(super) fn take(
        &mut self,
        now: Stamp<Boot>,
        sample: &VisionSample,
        inertial: &mut Inertial,
        params: &ParamTable,
        origin_altitude_m: f64,
    ) {
        let delay = Duration::from_secs_f64(params.real("EKF2_EV_DELAY").max(0.0) * 1e-3);
        let sample = VisionSample { at: sample.at.minus(delay), ..*sample };
        let previous = self.last;
        if previous.is_some_and(|p| sample.at <= p.at)
            || i32::from(sample.quality) < params.int("EKF2_EV_QMIN")
        {
            return;
        }
        let Some(past) = inertial.past_at(sample.at) else { return };
        self.last = Some(sample);
        self.heard_at = Some(now);
        let error_m = sample.position_m - past.position_m;
        let yaw_error_rad = wrapped_rad(sample.yaw_rad - past.yaw_rad);
        let fusion = Fusion { now, sample, error_m, yaw_error_rad, params };
        if self.fusing_since.is_none() {
            let is_dense = previous.is_some_and(|p| sample.at.since(p.at) < MAX_INTERVAL);
            let has_heading = self.is_yaw_aligned || fusion.uses(BIT_YAW);
            let is_placeable = has_heading || !sample.is_north_aligned;
            if is_dense && is_placeable && fusion.uses(BIT_HORIZONTAL | BIT_VERTICAL) {
                self.start(&fusion, inertial, origin_altitude_m);
            }
        } else if previous.is_some_and(|p| p.reset_counter != sample.reset_counter) {
            self.move_to(&fusion, inertial);
            fusion.reset_yaw(inertial);
        } else {
            self.fuse(&fusion, inertial, past.velocity_mps);
        }
    }

    fn start(&mut self, fusion: &Fusion<'_>, inertial: &mut Inertial, origin_altitude_m: f64) {
        self.fusing_since = Some(fusion.now);
        self.fuses_height = fusion.uses(BIT_VERTICAL);
        self.move_to(fusion, inertial);
        // PX4 v1.16.1 resets the height to the absolute altitude here and forgets the origin's.
        if self.has_stopped && self.fuses_height && fusion.params.int("EKF2_HGT_REF") == 3 {
            inertial.reset_position(2, origin_altitude_m, fusion.position_var(2));
        }
        if !self.is_yaw_aligned && fusion.uses(BIT_YAW) {
            fusion.reset_yaw(inertial);
            self.is_yaw_aligned = true;
        }
    }

    /// Moves the position to the sample.
    fn move_to(&mut self, fusion: &Fusion<'_>, inertial: &mut Inertial) {
        for axis in (0..3).filter(|axis| fusion.uses(position_bit(*axis))) {
            inertial.reset_position(axis, fusion.error_m[axis], fusion.position_var(axis));
        }
        self.horizontal_fused_at = Some(fusion.now);
        self.height_fused_at = Some(fusion.now);
        self.n_resets = self.n_resets.wrapping_add(1);
    }

    fn fuse(&mut self, fusion: &Fusion<'_>, inertial: &mut Inertial, past_mps: Vector3<f64>) {
        if fusion.uses(BIT_HORIZONTAL) && fusion.passes_horizontal(inertial) {
            for axis in 0..2 {
                let var = fusion.position_var(axis);
                inertial.fuse_horizontal(axis, 0, fusion.error_m[axis], var);
            }
            self.horizontal_fused_at = Some(fusion.now);
        }
        if fusion.uses(BIT_VERTICAL) && fusion.passes_height(inertial) {
            inertial.fuse_down(0, fusion.error_m.z, fusion.position_var(2));
            self.height_fused_at = Some(fusion.now);
        }
        fusion.fuse_velocity(inertial, past_mps);
        fusion.fuse_yaw(inertial);
        self.reset_on_timeout(fusion, inertial);
    }

    fn reset_on_timeout(&mut self, fusion: &Fusion<'_>, inertial: &mut Inertial) {
        let is_failing = |at| fusion.now.since(at) > RESET_AFTER;
        let horizontal = self.horizontal_fused_at.is_some_and(is_failing);
        if (horizontal || self.height_fused_at.is_some_and(is_failing))
            && self.n_timeout_resets < MAX_TIMEOUT_RESETS
        {
            self.n_timeout_resets += 1;
            self.move_to(fusion, inertial);
        }
    }
}

const fn position_bit(axis: usize) -> i32 {
    if axis < 2 { BIT_HORIZONTAL } else { BIT_VERTICAL }
}

/// One sample against the state at its time.
struct Fusion<'params> {
    now: Stamp<Boot>,
    sample: VisionSample,
    error_m: Vector3<f64>,
    yaw_error_rad: f64,
    params: &'params ParamTable,
}

impl Fusion<'_> {
    fn uses(&self, bits: i32) -> bool {
        self.params.int("EKF2_EV_CTRL") & bits != 0
    }

    /// The parameter is a lower bound of the message's σ, or the σ itself.
    fn var(&self, name: &str, message_var: f64) -> f64 {
        let floor = self.params.real(name).powi(2);
        let from_message = self.params.int("EKF2_EV_NOISE_MD") == 0 && message_var.is_finite();
        if from_message { message_var.max(floor) } else { floor }
    }

    fn position_var(&self, axis: usize) -> f64 {
        self.var("EKF2_EVP_NOISE", self.sample.position_var_m2[axis])
    }

    fn passes_horizontal(&self, inertial: &Inertial) -> bool {
        let gate2 = self.params.real("EKF2_EVP_GATE").powi(2);
        let north_var = inertial.north.innovation_var(0, self.position_var(0));
        let east_var = inertial.east.innovation_var(0, self.position_var(1));
        self.error_m.x.powi(2) <= gate2 * north_var && self.error_m.y.powi(2) <= gate2 * east_var
    }

    fn passes_height(&self, inertial: &Inertial) -> bool {
        let gate2 = self.params.real("EKF2_EVP_GATE").powi(2);
        self.error_m.z.powi(2) <= gate2 * inertial.down.innovation_var(0, self.position_var(2))
    }

    fn fuse_velocity(&self, inertial: &mut Inertial, past_mps: Vector3<f64>) {
        let Some((velocity_mps, var)) = self.sample.velocity else { return };
        if !self.uses(BIT_VELOCITY) {
            return;
        }
        let innov = velocity_mps - past_mps;
        let gate2 = self.params.real("EKF2_EVV_GATE").powi(2);
        let var = var.map(|v| self.var("EKF2_EVV_NOISE", v));
        for axis in 0..2 {
            let chain = if axis == 0 { &inertial.north } else { &inertial.east };
            if innov[axis].powi(2) <= gate2 * chain.innovation_var(1, var[axis]) {
                inertial.fuse_horizontal(axis, 1, innov[axis], var[axis]);
            }
        }
        if innov.z.powi(2) <= gate2 * inertial.down.innovation_var(1, var.z) {
            inertial.fuse_down(1, innov.z, var.z);
        }
    }

    fn yaw_var(&self) -> f64 {
        self.var("EKF2_EVA_NOISE", self.sample.yaw_var_rad2)
    }

    /// PX4 limits a large heading innovation instead of refusing it for ever.
    fn fuse_yaw(&self, inertial: &mut Inertial) {
        if self.uses(BIT_YAW) {
            let bound = 3.0 * inertial.yaw.innovation_var(0, self.yaw_var()).sqrt();
            inertial.fuse_yaw(0, self.yaw_error_rad.clamp(-bound, bound), self.yaw_var());
        }
    }

    fn reset_yaw(&self, inertial: &mut Inertial) {
        if self.uses(BIT_YAW) {
            inertial.reset_yaw(self.yaw_error_rad, self.yaw_var());
        }
    }
}
