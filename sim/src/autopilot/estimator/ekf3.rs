//! `ArduPilot`'s EKF3 on external navigation: what it takes, what it refuses, when it gives up.
//!
//! ODOMETRY counts only in the frames `LOCAL_FRD` and `BODY_FRD`; the reader has seen to that. Its
//! covariance comes collapsed to one σ of place and one of heading. Samples closer than 20 ms are
//! left out. A changed reset counter moves the estimate to the sample.

use super::inertial::{Inertial, Past};
use super::{Belief, HELD_VAR_M2, Inputs, PRESSURE_LEARNED, PRESSURE_VAR_M2, SLOW, belief_of};
use crate::autopilot::ardupilot::ApParams;
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::time::{Boot, Stamp};
use stockpilot::units::wrapped_rad;

/// EKF3 looks at one sample in so long: a ceiling of 50 Hz.
const LEAST_INTERVAL: Duration = Duration::from_millis(20);
/// Time from the last fused place until the position counts as lost; the failsafe follows.
const LOST_AFTER: Duration = Duration::from_millis(7_000);
/// Time from the first sample until the position is used.
const USED_AFTER: Duration = Duration::from_millis(500);
/// A healthy visual odometry has spoken within so long.
const HEALTHY_WITHIN: Duration = Duration::from_millis(300);
/// Time from the last fused height until air pressure takes over.
const HEIGHT_LOST_AFTER: Duration = Duration::from_secs(5);
/// The value of `EK3_SRC1_…` that means external navigation.
const EXTERNAL: i32 = 6;

/// One ODOMETRY, checked and in NED.
#[derive(Debug, Clone, Copy)]
pub(in crate::autopilot) struct NavSample {
    /// When it was measured, by the autopilot's own correction of jitter.
    pub(in crate::autopilot) at: Stamp<Boot>,
    pub(in crate::autopilot) position_m: Vector3<f64>,
    /// 1-σ of each axis of the place, m.
    pub(in crate::autopilot) position_sigma_m: f64,
    pub(in crate::autopilot) yaw_rad: f64,
    pub(in crate::autopilot) yaw_sigma_rad: f64,
    /// Velocity in NED, where it was sent.
    pub(in crate::autopilot) velocity_mps: Option<Vector3<f64>>,
    pub(in crate::autopilot) reset_counter: u8,
}

/// What the estimator has to say to people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::autopilot) enum EkfNews {
    YawAligned,
    UsesExternalNav,
    StoppedAiding,
}

/// Inertial navigation held by external navigation and air pressure.
#[derive(Debug, Clone)]
pub(in crate::autopilot) struct Ekf3 {
    inertial: Option<Inertial>,
    now: Stamp<Boot>,
    last: Option<NavSample>,
    heard_at: Option<Stamp<Boot>>,
    aiding_since: Option<Stamp<Boot>>,
    place_fused_at: Option<Stamp<Boot>>,
    height_fused_at: Option<Stamp<Boot>>,
    is_yaw_aligned: bool,
    pressure_offset_m: Option<f64>,
    held_position_m: Vector3<f64>,
    slow_due: Stamp<Boot>,
    news: Vec<EkfNews>,
}

impl Ekf3 {
    pub(in crate::autopilot) fn new() -> Self {
        Self {
            inertial: None,
            now: Stamp::ZERO,
            last: None,
            heard_at: None,
            aiding_since: None,
            place_fused_at: None,
            height_fused_at: None,
            is_yaw_aligned: false,
            pressure_offset_m: None,
            held_position_m: Vector3::zeros(),
            slow_due: Stamp::ZERO,
            news: Vec::new(),
        }
    }

    /// Moves on by one inertial sample.
    pub(in crate::autopilot) fn step(&mut self, now: Stamp<Boot>, inputs: &Inputs) {
        self.now = now;
        let accel = &inputs.accel_mps2;
        let inertial = self.inertial.get_or_insert_with(|| Inertial::levelled(accel));
        inertial.propagate(now, accel, &inputs.gyro_radps, inputs.dt_s);
        if self.aiding_since.is_some() && !self.is_within(self.place_fused_at, 2 * LOST_AFTER) {
            self.aiding_since = None;
            self.news.push(EkfNews::StoppedAiding);
        }
        if now >= self.slow_due {
            self.slow_due = now.plus(SLOW);
            self.step_slow(inputs);
        }
    }

    fn is_within(&self, at: Option<Stamp<Boot>>, span: Duration) -> bool {
        at.is_some_and(|at| self.now.since(at) < span)
    }

    fn step_slow(&mut self, inputs: &Inputs) {
        let has_height = self.is_within(self.height_fused_at, HEIGHT_LOST_AFTER);
        let has_place = self.is_within(self.place_fused_at, LOST_AFTER);
        let Some(inertial) = &mut self.inertial else { return };
        if inputs.is_at_rest {
            inertial.fuse_rest();
        }
        if let Some(compass_rad) = inputs.compass_rad {
            inertial.follow_compass(compass_rad, self.is_yaw_aligned);
            if !self.is_yaw_aligned {
                self.is_yaw_aligned = true;
                self.news.push(EkfNews::YawAligned);
            }
        }
        let pressure_m = inputs.pressure_height_m;
        let height_m = -inertial.position_m.z;
        let offset = self.pressure_offset_m.get_or_insert(height_m - pressure_m);
        if has_height {
            *offset += (height_m - pressure_m - *offset) * PRESSURE_LEARNED;
        } else {
            inertial.fuse_down(0, height_m - (pressure_m + *offset), PRESSURE_VAR_M2);
        }
        if has_place {
            self.held_position_m = inertial.position_m;
        } else {
            for axis in 0..2 {
                let innov = self.held_position_m[axis] - inertial.position_m[axis];
                inertial.fuse_horizontal(axis, 0, innov, HELD_VAR_M2);
            }
        }
    }

    /// Takes in one sample.
    pub(in crate::autopilot) fn on_odometry(&mut self, sample: &NavSample, params: &ApParams) {
        self.heard_at = Some(self.now);
        let Some(inertial) = &mut self.inertial else { return };
        let previous = self.last;
        if previous.is_some_and(|p| sample.at < p.at.plus(LEAST_INTERVAL)) {
            return;
        }
        // A sample from before the horizon is fused as if it were of now.
        let Some(past) = inertial.past_at(sample.at).or_else(|| inertial.past_at(self.now)) else {
            return;
        };
        self.last = Some(*sample);
        let uses = |name: &str| params.is(name, EXTERNAL);
        if uses("EK3_SRC1_YAW") && !self.is_yaw_aligned {
            inertial.reset_yaw(
                wrapped_rad(sample.yaw_rad - past.yaw_rad),
                sample.yaw_sigma_rad.powi(2),
            );
            self.is_yaw_aligned = true;
            self.news.push(EkfNews::YawAligned);
        }
        if !self.is_yaw_aligned || !uses("EK3_SRC1_POSXY") {
            return;
        }
        let is_reset = previous.is_some_and(|p| p.reset_counter != sample.reset_counter);
        if self.aiding_since.is_none() {
            self.aiding_since = Some(self.now);
            self.news.push(EkfNews::UsesExternalNav);
            self.move_to(sample, &past, params);
        } else if is_reset {
            self.move_to(sample, &past, params);
        } else {
            self.fuse(sample, &past, params);
        }
    }

    fn move_to(&mut self, sample: &NavSample, past: &Past, params: &ApParams) {
        let uses_height = params.is("EK3_SRC1_POSZ", EXTERNAL);
        let uses_yaw = params.is("EK3_SRC1_YAW", EXTERNAL);
        let Some(inertial) = &mut self.inertial else { return };
        let error_m = sample.position_m - past.position_m;
        let var = sample.position_sigma_m.powi(2);
        for axis in 0..if uses_height { 3 } else { 2 } {
            inertial.reset_position(axis, error_m[axis], var);
        }
        if uses_yaw {
            let yaw_error = wrapped_rad(sample.yaw_rad - past.yaw_rad);
            inertial.reset_yaw(yaw_error, sample.yaw_sigma_rad.powi(2));
        }
        self.place_fused_at = Some(self.now);
        self.height_fused_at = Some(self.now);
    }

    fn fuse(&mut self, sample: &NavSample, past: &Past, params: &ApParams) {
        let Some(inertial) = &mut self.inertial else { return };
        let uses = |name: &str| params.is(name, EXTERNAL);
        let gate2 = (params.real("EK3_POS_I_GATE") * 1e-2).powi(2);
        let var = sample.position_sigma_m.powi(2);
        let error_m = sample.position_m - past.position_m;
        let bound =
            gate2 * (inertial.north.innovation_var(0, var) + inertial.east.innovation_var(0, var));
        if error_m.xy().norm_squared() <= bound {
            for axis in 0..2 {
                inertial.fuse_horizontal(axis, 0, error_m[axis], var);
            }
            self.place_fused_at = Some(self.now);
        }
        let height_bound = gate2 * inertial.down.innovation_var(0, var);
        if uses("EK3_SRC1_POSZ") && error_m.z.powi(2) <= height_bound {
            inertial.fuse_down(0, error_m.z, var);
            self.height_fused_at = Some(self.now);
        }
        if let Some(velocity_mps) = sample.velocity_mps {
            let innov = velocity_mps - past.velocity_mps;
            let var = params.real("VISO_VEL_M_NSE").powi(2);
            if uses("EK3_SRC1_VELXY") {
                inertial.fuse_horizontal(0, 1, innov.x, var);
                inertial.fuse_horizontal(1, 1, innov.y, var);
            }
            if uses("EK3_SRC1_VELZ") {
                inertial.fuse_down(1, innov.z, var);
            }
        }
        if uses("EK3_SRC1_YAW") {
            let yaw_error = wrapped_rad(sample.yaw_rad - past.yaw_rad);
            inertial.fuse_yaw(0, yaw_error.clamp(-0.2, 0.2), sample.yaw_sigma_rad.powi(2));
        }
        if !self.is_within(self.place_fused_at, LOST_AFTER) {
            self.move_to(sample, past, params);
        }
    }

    /// What is believed now; level at the origin before the first sample.
    pub(in crate::autopilot) fn belief(&self) -> Belief {
        belief_of(self.inertial.as_ref(), self.is_position_valid())
    }

    /// The position may be flown on.
    pub(in crate::autopilot) fn is_position_valid(&self) -> bool {
        self.is_within(self.place_fused_at, LOST_AFTER)
            && self.aiding_since.is_some_and(|since| self.now.since(since) >= USED_AFTER)
    }

    /// The place was fused once and is lost.
    pub(in crate::autopilot) fn has_lost_position(&self) -> bool {
        self.place_fused_at.is_some() && !self.is_within(self.place_fused_at, LOST_AFTER)
    }

    /// Visual odometry has spoken lately.
    pub(in crate::autopilot) fn is_odometry_healthy(&self) -> bool {
        self.is_within(self.heard_at, HEALTHY_WITHIN)
    }

    /// `EKF_STATUS_REPORT.flags`: 831 when good; constant position mode otherwise.
    pub(in crate::autopilot) fn status_flags(&self) -> u16 {
        if self.is_position_valid() { 0x33F } else { 0xA7 }
    }

    /// What has changed since the last call.
    pub(in crate::autopilot) fn take_news(&mut self) -> Vec<EkfNews> {
        std::mem::take(&mut self.news)
    }
}
