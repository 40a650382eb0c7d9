//! The face of the localisation: samples and frames in, a pose with its covariance out.

mod frames;
mod gated_streak;

use super::camera_model::CameraModel;
use super::filter::{Covariance, FilterState, ImuNoise};
use super::frozen::FrozenWatch;
use super::imu_clock::{ImuClock, Tick};
use super::marker_map::MarkerMap;
use super::place_errors::PlaceErrors;
use super::ring::{Insertion, Ring};
use super::start::{PadPose, RestWindow, aligned};
use super::tag_health::{TagHealth, TagName};
use super::vision_fix;
use crate::geometry::{Body, Hall, Transform};
use crate::messages::state::{ATT, POS, VEL};
use crate::messages::{
    FixRecord, FixSource, ImuSample, NavEstimate, PoseError, Severity, StatusText, TagSensitivity,
    Verdict,
};
use crate::stats::chi2_gate_99;
use crate::time::{Mono, Stamp};
use gated_streak::GatedStreak;
pub use gated_streak::{MANOEUVRE_MPS2, PLAUSIBLE_SPEED_MPS};
use nalgebra::Matrix6;
use std::sync::Arc;
use std::time::Duration;

/// How a frame meets the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Update {
    /// As one pose with its covariance, as in the paper.
    Loose,
    /// Corner by corner; a pose stands in where the corners and the state do not agree.
    #[default]
    Tight,
}

/// What the localisation must know before a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The cameras; [`crate::messages::CameraId`] is the index.
    pub cameras: Vec<CameraModel>,
    /// Where the tags hang.
    pub marker_map: MarkerMap,
    /// How a fix is computed.
    pub vision: vision_fix::Settings,
    /// How a frame meets the filter.
    pub update: Update,
    /// Standard deviation of a frame's capture time on the clock of the inertial samples, s.
    pub capture_sigma_s: f64,
    /// Noise of the inertial sensors.
    pub imu_noise: ImuNoise,
    /// Where the vehicle stands before a flight, if somebody declares it.
    pub pad: Option<PadPose>,
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
    /// Roll, pitch and the gyroscope's bias are known from standing on the ground; position and
    /// yaw are not.
    Aligned,
    /// Fixes arrive and are fused, or the vehicle stands on its declared pad.
    Good,
    /// No fix for too long, or too uncertain.
    Lost,
}

/// Filter and vision, with the last second of history.
#[derive(Debug, Clone)]
pub struct Localizer {
    settings: Settings,
    cameras: Vec<Arc<CameraModel>>,
    ring: Option<Ring>,
    placement: Placement,
    is_on_ground: bool,
    /// Samples of the last second.
    rest: RestWindow,
    imu_clock: ImuClock,
    last_imu: Option<ImuSample>,
    last_fused_at: Option<Stamp<Mono>>,
    /// When tags and filter agreed for the last time, whatever happened since.
    last_agreed_at: Option<Stamp<Mono>>,
    /// Poses after this were found to be wrong; nobody asked yet.
    doubtful_since: Option<Stamp<Mono>>,
    gated: GatedStreak,
    reset_counter: u8,
    /// The newest sample when the present ring began.
    began_at: Option<Stamp<Mono>>,
    standstill: Standstill,
    tag_health: TagHealth,
    frozen: Vec<FrozenWatch>,
    /// Camera and tags of the latest fused frame.
    last_fused_tags: Option<(usize, Vec<TagName>)>,
    notices: Vec<StatusText>,
    records: Vec<FixRecord>,
}

/// Where position and yaw come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Placement {
    /// They are not known.
    Unknown,
    /// From the declared pad; no tag was fused yet.
    Pad,
    /// From tags.
    Tags,
    /// The time jumped: the next fix must place the vehicle anew.
    Stale,
}

/// The attempts to fuse a standstill since the last record of them.
#[derive(Debug, Clone, Default)]
struct Standstill {
    last_at: Option<Stamp<Mono>>,
    record: Option<FixRecord>,
}

/// A vehicle on the ground is asked this often whether it stands.
const STANDSTILL_EVERY: Duration = Duration::from_millis(100);
/// So many attempts share a record.
const STANDSTILLS_PER_RECORD: usize = 10;
/// What the vehicle may do in a gap that is too long to bridge: σ of force, m/s², and turn, rad/s.
const GAP_ACCEL_MPS2: f64 = 3.0;
const GAP_RATE_RADPS: f64 = 1.0;
/// After a longer gap nothing more is forgotten, s.
const MAX_FORGOTTEN_S: f64 = 10.0;

impl Localizer {
    /// A localizer that knows nothing yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            cameras: settings.cameras.iter().cloned().map(Arc::new).collect(),
            frozen: vec![FrozenWatch::default(); settings.cameras.len()],
            settings,
            ring: None,
            placement: Placement::Unknown,
            is_on_ground: false,
            rest: RestWindow::default(),
            imu_clock: ImuClock::default(),
            last_imu: None,
            last_fused_at: None,
            last_agreed_at: None,
            doubtful_since: None,
            gated: GatedStreak::default(),
            reset_counter: 0,
            began_at: None,
            standstill: Standstill::default(),
            tag_health: TagHealth::default(),
            last_fused_tags: None,
            notices: Vec::new(),
            records: Vec::new(),
        }
    }

    /// Says whether the vehicle is certain to be on the ground: only then a vehicle that looks as
    /// if it stood still is believed to.
    pub const fn set_on_ground(&mut self, is_on_ground: bool) {
        self.is_on_ground = is_on_ground;
    }

    /// What people should know, since the last call.
    pub fn take_notices(&mut self) -> Vec<StatusText> {
        std::mem::take(&mut self.notices)
    }

    /// If the filter was found to be wrong since the last call: when it was right for the last time.
    /// What was seen from its poses after that is in doubt.
    pub const fn take_doubt(&mut self) -> Option<Stamp<Mono>> {
        self.doubtful_since.take()
    }

    /// Records of attempts to fuse something else than a frame, since the last call.
    pub fn take_records(&mut self) -> Vec<FixRecord> {
        std::mem::take(&mut self.records)
    }

    /// Takes in an inertial sample. One whose stamp jumps is refused; a clock that stays away is
    /// believed, and costs the position.
    pub fn on_imu(&mut self, imu: ImuSample) {
        match self.imu_clock.judge(imu.at) {
            Tick::Refused => return,
            Tick::Next => {}
            Tick::Jumped(by_s) => self.on_jump(&imu, by_s),
        }
        self.last_imu = Some(imu);
        self.rest.push(imu);
        if let Some(ring) = &mut self.ring {
            ring.push_imu(imu);
        }
        let is_due = |last: Stamp<Mono>| imu.at.since(last) >= STANDSTILL_EVERY || last > imu.at;
        if self.is_on_ground && self.standstill.last_at.is_none_or(is_due) {
            self.standstill.last_at = Some(imu.at);
            self.stand(imu.at);
        }
    }

    /// Samples are missing for too long, or their clock was set: keeps what outlives that.
    fn on_jump(&mut self, imu: &ImuSample, by_s: f64) {
        self.notices.push(StatusText {
            severity: Severity::Warning,
            text: format!("the inertial samples jumped by {by_s:.2} s"),
        });
        self.rest.clear();
        let Some(ring) = &self.ring else { return };
        let gap_s = by_s.abs().min(MAX_FORGOTTEN_S);
        let mut state = ring.newest().clone();
        let velocity_sigma_mps = GAP_ACCEL_MPS2 * gap_s;
        // The vehicle may have gone on as it flew, or have stopped at once.
        let position_sigma_m = 0.5 * velocity_sigma_mps * gap_s + state.velocity_mps.norm() * gap_s;
        let grown =
            [(POS, position_sigma_m), (ATT, GAP_RATE_RADPS * gap_s), (VEL, velocity_sigma_mps)];
        for (range, sigma) in grown {
            for k in range {
                state.P[(k, k)] += f64::powi(sigma, 2);
            }
        }
        state.at = imu.at;
        self.begin_ring(state, *imu);
        if self.placement != Placement::Unknown {
            self.placement = Placement::Stale;
        }
        self.last_fused_at = None;
    }

    /// Asks whether the vehicle stands, and says so to the filter: aligns one that knows nothing.
    fn stand(&mut self, at: Stamp<Mono>) {
        let Some(rest) = self.rest.standstill() else { return };
        let Some(ring) = &mut self.ring else {
            let Some(last_imu) = self.last_imu else { return };
            let pad = self.settings.pad;
            self.begin_ring(aligned(at, &rest, pad.as_ref()), last_imu);
            self.placement = pad.map_or(Placement::Unknown, |_| Placement::Pad);
            self.last_fused_at = pad.map(|_| at);
            return;
        };
        let Insertion::Placed(innovation) = ring.insert_standstill(at, rest.gyro_radps) else {
            return;
        };
        let is_fused = innovation.is_within_gate();
        // On its declared pad the vehicle knows where it is without a tag.
        if is_fused && self.placement == Placement::Pad {
            self.last_fused_at = self.last_fused_at.max(Some(at));
            self.last_agreed_at = self.last_agreed_at.max(Some(at));
        }
        let record = self.standstill.record.get_or_insert_with(|| standstill_record(at));
        record.at = at;
        record.n_points += 1;
        record.n_points_used += usize::from(is_fused);
        frames::note(record, &innovation);
        record.verdict = if is_fused { Verdict::Fused } else { Verdict::Gated };
        if record.n_points >= STANDSTILLS_PER_RECORD {
            self.records.extend(self.standstill.record.take());
        }
    }

    fn begin_ring(&mut self, mut state: FilterState, last_imu: ImuSample) {
        let at = state.at;
        let place_sigma_m = self.settings.marker_map.place_sigma_m();
        state.places = state.places.or_else(|| PlaceErrors::new(place_sigma_m));
        let mut ring = Ring::new(state, last_imu, self.settings.imu_noise, self.settings.ring_span);
        self.rest.after(at).for_each(|imu| ring.push_imu(*imu));
        ring.push_imu(last_imu);
        self.ring = Some(ring);
        self.began_at = Some(last_imu.at);
        self.gated = GatedStreak::default();
    }

    /// The newest belief, if the position is known.
    #[must_use]
    pub fn estimate(&self) -> Option<NavEstimate> {
        self.alignment().filter(|_| self.placement != Placement::Unknown)
    }

    /// The newest belief, even if only roll, pitch and biases mean anything ([`Health::Aligned`]):
    /// position and yaw then have a σ as large as any hall.
    #[must_use]
    pub fn alignment(&self) -> Option<NavEstimate> {
        let gyro_radps = self.last_imu?.gyro_radps;
        Some(self.ring.as_ref()?.newest().estimate(&gyro_radps, self.reset_counter))
    }

    fn placed_ring(&self) -> Option<&Ring> {
        self.ring.as_ref().filter(|_| self.placement != Placement::Unknown)
    }

    /// The pose at an instant of the last second, with the covariance of its error (6×6).
    #[must_use]
    pub fn pose_at(&self, at: Stamp<Mono>) -> Option<(Transform<Hall, Body>, Matrix6<f64>)> {
        self.placed_ring()?.pose_at(at)
    }

    /// The error of the pose at an instant of the ring, chained to the one at `previous`: the
    /// instant of the scan before; misplaced tags stand apart from its covariance. Both hold as long as no frame captured before `at` arrives.
    #[must_use]
    pub fn pose_error_at(
        &self,
        at: Stamp<Mono>,
        previous: Option<Stamp<Mono>>,
    ) -> Option<PoseError> {
        let ring = self.placed_ring()?;
        let (state, rate_radps) = ring.motion_at(at)?;
        // A pose from before a restart came from another filter: nothing of its error lives on.
        let from_previous = previous
            .filter(|previous| self.began_at.is_none_or(|began| *previous > began))
            .and_then(|previous| ring.error_transition(previous, at))
            .unwrap_or_else(Covariance::zeros);
        let tags = state.places.as_ref().map_or_else(
            || self.tag_sensitivities(&state.hall_from_body),
            |places| places.sensitivities(),
        );
        Some(PoseError {
            at,
            cov: state.P,
            from_previous,
            velocity_mps: state.velocity_mps,
            rate_radps,
            tags: tags.iter().map(TagSensitivity::to_single).collect(),
        })
    }

    /// For a map that counts as exact: what errors in the places of the tags of the latest fused
    /// frame would do to a fix from this pose.
    fn tag_sensitivities(&self, hall_from_body: &Transform<Hall, Body>) -> Vec<TagSensitivity> {
        let Some((camera_idx, tags)) = &self.last_fused_tags else { return Vec::new() };
        let Some(camera) = self.cameras.get(*camera_idx) else { return Vec::new() };
        vision_fix::tag_sensitivity(camera, &self.settings.marker_map, tags, hall_from_body)
    }

    /// False while inertial samples have yet to say how the vehicle came to be where a frame of this
    /// instant sees it.
    #[must_use]
    pub fn can_take(&self, captured_at: Stamp<Mono>) -> bool {
        self.ring.as_ref().is_none_or(|ring| captured_at <= ring.covered_until())
    }

    /// The newest instant with a known pose.
    #[must_use]
    pub fn newest_at(&self) -> Option<Stamp<Mono>> {
        Some(self.placed_ring()?.newest().at)
    }

    /// The newest pose, if it is known.
    #[must_use]
    pub fn pose(&self) -> Option<Transform<Hall, Body>> {
        Some(self.placed_ring()?.newest().hall_from_body)
    }

    /// The stamp of the newest inertial sample.
    #[must_use]
    pub fn last_sample_at(&self) -> Option<Stamp<Mono>> {
        self.last_imu.map(|imu| imu.at)
    }

    /// True if the pose can be flown on and no part of the belief is NaN or infinite.
    #[must_use]
    pub fn is_trusted(&self, now: Stamp<Mono>) -> bool {
        self.health(now) == Health::Good
            && self.placed_ring().is_some_and(|ring| ring.newest().is_finite())
    }

    /// The largest position σ of the newest belief, m.
    #[must_use]
    pub fn position_sigma_m(&self) -> Option<f64> {
        let cov = self.placed_ring()?.newest().pose_cov();
        // What is not a number is not known at all; `max` would pass it over.
        let sigma_m = |var_m2: f64| {
            if var_m2.is_finite() { var_m2.max(0.0).sqrt() } else { f64::INFINITY }
        };
        Some((0..3).map(|axis| sigma_m(cov[(axis, axis)])).fold(0.0, f64::max))
    }

    /// Whether the pose can be flown on.
    #[must_use]
    pub fn health(&self, now: Stamp<Mono>) -> Health {
        let Some(sigma_m) = self.position_sigma_m() else {
            return if self.ring.is_some() { Health::Aligned } else { Health::Uninitialized };
        };
        let is_fresh =
            self.last_fused_at.is_some_and(|at| now.since(at) <= self.settings.lost_after);
        if is_fresh && sigma_m <= self.settings.lost_sigma_m { Health::Good } else { Health::Lost }
    }
}

fn standstill_record(at: Stamp<Mono>) -> FixRecord {
    FixRecord {
        at,
        age_s: 0.0,
        source: FixSource::Standstill,
        n_tags: 0,
        n_tags_used: 0,
        n_points: 0,
        n_points_used: 0,
        fix: None,
        innovation: None,
        innovation_cov: None,
        nis: None,
        nis_gate: chi2_gate_99(6),
        verdict: Verdict::Gated,
    }
}
