//! The face of the localisation: samples and frames in, a pose with its covariance out.

use super::camera_model::CameraModel;
use super::filter::{Covariance, FilterState, ImuNoise, Innovation};
use super::marker_map::MarkerMap;
use super::ring::{Insertion, Ring};
use super::vision_fix::{self, NoFix};
use crate::geometry::{Body, Hall, Transform};
use crate::messages::state::{ACCEL_BIAS, GYRO_BIAS, VEL};
use crate::messages::{
    FixOutcome, FixRecord, ImuSample, NavEstimate, PoseError, TagDetections, Verdict,
};
use crate::stats::chi2_gate_99;
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, Vector3, Vector6};
use std::collections::VecDeque;
use std::time::Duration;

/// What the localisation must know before a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The cameras; [`crate::messages::CameraId`] is the index.
    pub cameras: Vec<CameraModel>,
    /// Where the tags hang.
    pub marker_map: MarkerMap,
    /// How a fix is computed.
    pub vision: vision_fix::Settings,
    /// Standard deviation of a frame's capture time on the clock of the inertial samples, s.
    pub capture_sigma_s: f64,
    /// Noise of the inertial sensors.
    pub imu_noise: ImuNoise,
    /// How far back late frames are taken in.
    pub ring_span: Duration,
    /// Without a fused fix for this long the pose counts as lost.
    pub lost_after: Duration,
    /// A pose whose largest position σ exceeds this counts as lost, m.
    pub lost_sigma_m: f64,
}

/// Whether the pose can be flown on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Health {
    /// No pose yet.
    Uninitialized,
    /// Fixes arrive and are fused.
    Good,
    /// No fix for too long, or too uncertain.
    Lost,
}

/// Filter and vision, with the last second of history.
#[derive(Debug, Clone)]
pub struct Localizer {
    settings: Settings,
    ring: Option<Ring>,
    /// Samples of the last second before the filter starts, for the biases at rest.
    rest: VecDeque<ImuSample>,
    last_imu: Option<ImuSample>,
    last_fused_at: Option<Stamp<Mono>>,
    gated: GatedStreak,
    reset_counter: u8,
    /// The newest sample when the present ring began.
    began_at: Option<Stamp<Mono>>,
}

/// Fixes in a row that the gate refused although they agree with each other.
#[derive(Debug, Clone, Copy, Default)]
struct GatedStreak {
    count: u32,
    last: Option<(Stamp<Mono>, Transform<Hall, Body>)>,
}

/// This many agreeing fixes in a row outvote the filter: half a second at 20 Hz.
const RESET_AFTER_GATED: u32 = 10;
/// Two gated fixes agree if the vehicle could have flown from one to the other, m/s.
const PLAUSIBLE_SPEED_MPS: f64 = 5.0;
const REST_SPAN: Duration = Duration::from_secs(1);
/// At rest the gyroscope wanders less than this, rad/s.
const REST_GYRO_SIGMA_RADPS: f64 = 0.02;

impl Localizer {
    /// A localizer that knows nothing yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            ring: None,
            rest: VecDeque::new(),
            last_imu: None,
            last_fused_at: None,
            gated: GatedStreak::default(),
            reset_counter: 0,
            began_at: None,
        }
    }

    /// Takes in an inertial sample.
    pub fn on_imu(&mut self, imu: ImuSample) {
        self.last_imu = Some(imu);
        if let Some(ring) = &mut self.ring {
            ring.push_imu(imu);
            return;
        }
        self.rest.push_back(imu);
        let horizon = imu.at.minus(REST_SPAN);
        while self.rest.front().is_some_and(|oldest| oldest.at < horizon) {
            self.rest.pop_front();
        }
    }

    /// Takes in the tags of a frame; the record says what became of them.
    pub fn on_tags(&mut self, frame: &TagDetections) -> FixRecord {
        let at = frame.captured_at;
        let mut record = FixRecord::of_frame(frame, chi2_gate_99(6), Verdict::NoKnownTag);
        let Some(camera) = self.settings.cameras.get(usize::from(frame.camera.0)) else {
            return record;
        };
        if self.ring.is_none() && self.gyro_bias_at_rest().is_none() {
            // Nothing can start yet, so the search for a pose would be for nothing.
            record.verdict = Verdict::NotInitialized;
            return record;
        }
        let features = vision_fix::features(&self.settings.marker_map, &frame.tags);
        record.n_tags_used = features.len() / 4;
        let state = self.ring.as_ref().and_then(|ring| ring.state_at(at));
        let prior = state.as_ref().map(|state| state.hall_from_body);
        let solved = vision_fix::solve(camera, &features, prior.as_ref(), &self.settings.vision);
        // A prior far from the truth can trap the iteration: start again from nothing.
        let solved = match (&solved, prior) {
            (Err(NoFix::BadResidual), Some(_)) => {
                vision_fix::solve(camera, &features, None, &self.settings.vision)
            }
            _ => solved,
        };
        match solved {
            Ok(mut fix) => {
                if let Some(state) = &state {
                    fix.pose_cov += self.capture_time_cov(state);
                }
                self.take_fix(at, &fix, &mut record);
                record.fix = Some(fix);
            }
            Err(NoFix::NoKnownTag) => {}
            Err(NoFix::NotObservable) => record.verdict = Verdict::NotObservable,
            Err(NoFix::BadResidual) => record.verdict = Verdict::BadResidual,
        }
        record
    }

    fn take_fix(&mut self, at: Stamp<Mono>, fix: &FixOutcome, record: &mut FixRecord) {
        let Some(ring) = &mut self.ring else {
            record.verdict = self.start(at, fix);
            return;
        };
        let pose = fix.hall_from_body;
        let insertion = ring.insert_fix(at, fix.clone());
        record.verdict = match insertion {
            Insertion::TooOld => Verdict::TooOld,
            Insertion::FromTheFuture => Verdict::FromTheFuture,
            Insertion::Placed(innovation) => {
                note(record, &innovation);
                if innovation.is_within_gate() {
                    self.last_fused_at = self.last_fused_at.max(Some(at));
                    self.gated = GatedStreak::default();
                    Verdict::Fused
                } else if self.gated.outvotes_filter(at, &pose) {
                    self.restart(at, fix)
                } else {
                    Verdict::Gated
                }
            }
        };
    }

    /// What an uncertain capture time adds to the covariance of a fix in motion, 6×6.
    ///
    /// ```text
    /// σ_t² m mᵀ,   m = (v, ω)
    /// ```
    /// The position (hall axes) moves with the velocity, the attitude (body axes) with the rate.
    fn capture_time_cov(&self, state: &FilterState) -> Matrix6<f64> {
        let (v, rate) = (state.velocity_mps, self.rate_radps(state));
        let motion = Vector6::new(v.x, v.y, v.z, rate.x, rate.y, rate.z);
        motion * motion.transpose() * self.settings.capture_sigma_s.powi(2)
    }

    /// The newest angular velocity without its bias, body axes.
    fn rate_radps(&self, state: &FilterState) -> Vector3<f64> {
        self.last_imu.map_or_else(Vector3::zeros, |imu| imu.gyro_radps - state.gyro_bias_radps)
    }

    /// Starts the filter with this fix, at rest on the pad.
    fn start(&mut self, at: Stamp<Mono>, fix: &FixOutcome) -> Verdict {
        let Some(last_imu) = self.last_imu else { return Verdict::NotInitialized };
        let Some(gyro_bias_radps) = self.gyro_bias_at_rest() else {
            return Verdict::NotInitialized;
        };
        let mut state = FilterState {
            at,
            hall_from_body: fix.hall_from_body,
            velocity_mps: Vector3::zeros(),
            gyro_bias_radps,
            accel_bias_mps2: Vector3::zeros(),
            P: Covariance::zeros(),
        };
        state.P.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.pose_cov);
        for (range, sigma) in [(VEL, 0.05), (GYRO_BIAS, 0.003), (ACCEL_BIAS, 0.15)] {
            for k in range {
                state.P[(k, k)] = f64::powi(sigma, 2);
            }
        }
        self.begin_ring(state, last_imu);
        Verdict::Initialized
    }

    /// Puts the filter onto agreeing fixes that its gate kept refusing; declares the jump.
    fn restart(&mut self, at: Stamp<Mono>, fix: &FixOutcome) -> Verdict {
        let (Some(ring), Some(last_imu)) = (&self.ring, self.last_imu) else {
            return Verdict::NotInitialized;
        };
        let mut state = ring.newest().clone();
        state.at = at;
        state.hall_from_body = fix.hall_from_body;
        // The old pose was wrong, so its correlations say nothing; the biases stay.
        state.P.fill_with_identity();
        state.P.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.pose_cov);
        for (range, sigma) in [(VEL, 0.5), (GYRO_BIAS, 0.005), (ACCEL_BIAS, 0.2)] {
            for k in range {
                state.P[(k, k)] = f64::powi(sigma, 2);
            }
        }
        self.reset_counter = self.reset_counter.wrapping_add(1);
        self.begin_ring(state, last_imu);
        Verdict::Initialized
    }

    fn begin_ring(&mut self, state: FilterState, last_imu: ImuSample) {
        let at = state.at;
        let mut ring = Ring::new(state, last_imu, self.settings.imu_noise, self.settings.ring_span);
        ring.push_imu(last_imu);
        self.ring = Some(ring);
        self.began_at = Some(last_imu.at);
        self.last_fused_at = Some(at);
        self.gated = GatedStreak::default();
        self.rest.clear();
    }

    /// The mean of the gyroscope over the last second, if the vehicle stood still.
    fn gyro_bias_at_rest(&self) -> Option<Vector3<f64>> {
        if self.rest.len() < 20 {
            return None;
        }
        #[expect(clippy::cast_precision_loss, reason = "a second holds few samples")]
        let n = self.rest.len() as f64;
        let mean = self.rest.iter().map(|imu| imu.gyro_radps).sum::<Vector3<f64>>() / n;
        let variance = self
            .rest
            .iter()
            .map(|imu| (imu.gyro_radps - mean).component_mul(&(imu.gyro_radps - mean)))
            .sum::<Vector3<f64>>()
            / n;
        (variance.max().sqrt() < REST_GYRO_SIGMA_RADPS).then_some(mean)
    }

    /// The newest belief, if there is one.
    #[must_use]
    pub fn estimate(&self) -> Option<NavEstimate> {
        let gyro_radps = self.last_imu?.gyro_radps;
        Some(self.ring.as_ref()?.newest().estimate(&gyro_radps, self.reset_counter))
    }

    /// The pose at an instant of the last second, with the covariance of its error (6×6).
    #[must_use]
    pub fn pose_at(&self, at: Stamp<Mono>) -> Option<(Transform<Hall, Body>, Matrix6<f64>)> {
        self.ring.as_ref()?.pose_at(at)
    }

    /// The error of the pose at an instant of the ring, chained to the one at `previous`: the
    /// instant of the scan before. Both hold as long as no frame captured before `at` arrives.
    #[must_use]
    pub fn pose_error_at(
        &self,
        at: Stamp<Mono>,
        previous: Option<Stamp<Mono>>,
    ) -> Option<PoseError> {
        let ring = self.ring.as_ref()?;
        let state = ring.state_at(at)?;
        // A pose from before a restart came from another filter: nothing of its error lives on.
        let from_previous = previous
            .filter(|previous| self.began_at.is_none_or(|began| *previous > began))
            .and_then(|previous| ring.error_transition(previous, at))
            .unwrap_or_else(Covariance::zeros);
        Some(PoseError {
            at,
            cov: state.P,
            from_previous,
            velocity_mps: state.velocity_mps,
            rate_radps: self.rate_radps(&state),
            tags: Vec::new(),
        })
    }

    /// The newest instant with a known pose.
    #[must_use]
    pub fn newest_at(&self) -> Option<Stamp<Mono>> {
        Some(self.ring.as_ref()?.newest().at)
    }

    /// The largest position σ of the newest belief, m.
    #[must_use]
    pub fn position_sigma_m(&self) -> Option<f64> {
        let state = self.ring.as_ref()?.newest();
        Some((0..3).map(|axis| state.P[(axis, axis)].max(0.0).sqrt()).fold(0.0, f64::max))
    }

    /// Whether the pose can be flown on.
    #[must_use]
    pub fn health(&self, now: Stamp<Mono>) -> Health {
        let (Some(sigma_m), Some(fused_at)) = (self.position_sigma_m(), self.last_fused_at) else {
            return Health::Uninitialized;
        };
        let is_fresh = now.since(fused_at) <= self.settings.lost_after;
        if is_fresh && sigma_m <= self.settings.lost_sigma_m { Health::Good } else { Health::Lost }
    }
}

fn note(record: &mut FixRecord, innovation: &Innovation) {
    record.innovation = Some(innovation.pose.into());
    record.nis = Some(innovation.nis);
    record.nis_gate = innovation.nis_gate;
}

impl GatedStreak {
    /// Counts a refused fix; true once enough of them in a row agree with each other.
    fn outvotes_filter(&mut self, at: Stamp<Mono>, pose: &Transform<Hall, Body>) -> bool {
        let agrees = self.last.is_some_and(|(last_at, last)| {
            let reach_m = 0.3 + PLAUSIBLE_SPEED_MPS * at.seconds_since(last_at).abs();
            (pose.origin - last.origin).coords.norm() < reach_m
        });
        self.count = if agrees { self.count + 1 } else { 1 };
        self.last = Some((at, *pose));
        self.count >= RESET_AFTER_GATED
    }
}
