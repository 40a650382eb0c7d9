//! From the tags of a frame to an update of the filter.

use super::super::camera_model::CameraModel;
use super::super::filter::{Covariance, FilterState, Innovation};
use super::super::frozen::Picture;
use super::super::ring::{FrameInsertion, FramePlaced, Insertion};
use super::super::start::{AT_REST, IN_FLIGHT, Rest, agrees_with_gravity, set_sigma};
use super::super::tag_health::TagPoints;
use super::super::tight_update::{Frame, Sighting, Viewpoint};
use super::super::vision_fix::{self, NoFix};
use super::{Localizer, Placement, Update};
use crate::geometry::{Body, Hall, Transform};
use crate::messages::{
    FixOutcome, FixRecord, FixSource, Severity, StatusText, TagDetection, TagDetections, Verdict,
};
use crate::stats::chi2_gate_99;
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, Vector2, Vector3};
use std::sync::Arc;

/// Fixes in a row that the gate refused although they agree with each other.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GatedStreak {
    count: u32,
    last: Option<(Stamp<Mono>, Transform<Hall, Body>)>,
}

/// This many agreeing fixes in a row outvote the filter: half a second at 20 Hz.
const RESET_AFTER_GATED: u32 = 10;
/// Two gated fixes agree if the vehicle could have flown from one to the other, m/s.
const PLAUSIBLE_SPEED_MPS: f64 = 5.0;
/// In flight one tag alone, which may have been moved, outvotes nobody.
const MIN_TAGS_TO_RELOCATE: usize = 2;

/// The mapped tags of a frame.
struct Seen {
    /// Those that are trusted, for the vision fix.
    tags: Vec<TagDetection>,
    /// The points of all of them.
    frame: Frame,
    points: Vec<TagPoints>,
}

impl Localizer {
    /// Takes in the tags of a frame; the record says what became of them.
    pub fn on_tags(&mut self, frame: &TagDetections) -> FixRecord {
        let mut record = FixRecord::of_frame(frame, chi2_gate_99(6), Verdict::NoKnownTag);
        let camera_idx = usize::from(frame.camera.0);
        let Some(camera) = self.cameras.get(camera_idx).cloned() else { return record };
        if self.ring.is_none() && self.rest.gyro_rest().is_none() {
            // Nothing can start yet, so the search for a pose would be for nothing.
            record.verdict = Verdict::NotInitialized;
            return record;
        }
        let mut seen = self.seen(&camera, frame);
        let motion = self.ring.as_ref().and_then(|ring| ring.motion_at(frame.captured_at));
        let motion = motion.filter(|_| matches!(self.placement, Placement::Pad | Placement::Tags));
        if let Some((state, rate_radps)) = &motion {
            let view = Viewpoint::of(state, rate_radps);
            if self.is_frozen(camera_idx, frame, &seen, &view) {
                record.verdict = Verdict::Frozen;
                return record;
            }
            let news = self.tag_health.judge(state, &view, &seen.frame, &seen.points);
            self.notices.extend(news);
        }
        self.drop_excluded(&mut seen);
        record.n_tags_used = seen.points.len();
        record.n_points = seen.frame.points.len();
        if seen.frame.points.is_empty() {
            return record;
        }
        match (self.settings.update, &motion) {
            (Update::Tight, Some(_)) => self.take_frame(frame.captured_at, seen, &mut record),
            _ => self.take_loose(&seen, motion.as_ref(), &mut record),
        }
        record
    }

    /// The mapped tags of a frame; a tag that is reported twice is left out, since one of the two
    /// is wrong or both are the same.
    fn seen(&self, camera: &Arc<CameraModel>, frame: &TagDetections) -> Seen {
        let mut seen = Seen {
            tags: Vec::new(),
            frame: Frame {
                camera: Arc::clone(camera),
                points: Vec::new(),
                corner_sigma_px: self.settings.vision.corner_sigma_px,
                capture_sigma_s: self.settings.capture_sigma_s,
            },
            points: Vec::new(),
        };
        let is_unique = |tag: &&TagDetection| {
            frame.tags.iter().filter(|t| (t.family, t.id) == (tag.family, tag.id)).count() == 1
        };
        for tag in frame.tags.iter().filter(is_unique) {
            let Some(corners) = self.settings.marker_map.corners(tag.family, tag.id) else {
                continue;
            };
            let first = seen.frame.points.len();
            for (place, pixel) in corners.iter().zip(&tag.corners_px) {
                seen.frame.points.push(Sighting {
                    place: *place,
                    pixel: Vector2::from(*pixel),
                    offset_s: camera.row_offset_s(pixel[1]),
                });
            }
            let range = first..seen.frame.points.len();
            seen.points.push(TagPoints { name: (tag.family, tag.id), range });
            seen.tags.push(*tag);
        }
        seen
    }

    fn is_frozen(
        &mut self,
        camera_idx: usize,
        frame: &TagDetections,
        seen: &Seen,
        view: &Viewpoint,
    ) -> bool {
        let Some(watch) = self.frozen.get_mut(camera_idx) else { return false };
        let Picture::Frozen { is_news } = watch.judge(&frame.tags, &seen.frame, view) else {
            return false;
        };
        if is_news {
            self.notices.push(StatusText {
                severity: Severity::Warning,
                text: format!("camera {camera_idx} repeats its picture: refused"),
            });
        }
        true
    }

    fn drop_excluded(&self, seen: &mut Seen) {
        let is_out = |points: &TagPoints| self.tag_health.is_excluded(points.name);
        if !seen.points.iter().any(is_out) {
            return;
        }
        let (mut points, mut sightings) = (Vec::new(), Vec::new());
        for tag in seen.points.drain(..).filter(|tag| !is_out(tag)) {
            let first = sightings.len();
            sightings.extend_from_slice(seen.frame.points.get(tag.range).unwrap_or_default());
            points.push(TagPoints { name: tag.name, range: first..sightings.len() });
        }
        seen.tags.retain(|tag| !self.tag_health.is_excluded((tag.family, tag.id)));
        (seen.points, seen.frame.points) = (points, sightings);
    }

    /// Fuses the points of a frame, or the fix that stands in for them.
    fn take_frame(&mut self, at: Stamp<Mono>, seen: Seen, record: &mut FixRecord) {
        let Seen { tags, frame, points } = seen;
        let (settings, camera) = (&self.settings, Arc::clone(&frame.camera));
        let Some(ring) = &mut self.ring else { return };
        let solve = |state: &FilterState, rate_radps: &Vector3<f64>| {
            let features = vision_fix::features(&settings.marker_map, &tags);
            let prior = Some(&state.hall_from_body);
            let mut fix = solved(&camera, &features, prior, &settings.vision).ok()?;
            fix.pose_cov += capture_time_cov(state, rate_radps, settings.capture_sigma_s);
            Some(fix)
        };
        record.source = FixSource::Tight;
        match ring.insert_frame(at, frame, solve) {
            FrameInsertion::TooOld => record.verdict = Verdict::TooOld,
            FrameInsertion::FromTheFuture => record.verdict = Verdict::FromTheFuture,
            FrameInsertion::Placed(placed) => self.judge_frame(at, *placed, points.len(), record),
        }
    }

    fn judge_frame(
        &mut self,
        at: Stamp<Mono>,
        placed: FramePlaced,
        n_tags: usize,
        record: &mut FixRecord,
    ) {
        let FramePlaced { tight, fallback } = placed;
        record.n_points_used = tight.n_used;
        record.innovation = Some(tight.shift.into());
        record.innovation_cov = Some(tight.shift_cov.into());
        record.nis = Some(tight.nis);
        record.nis_gate = tight.nis_gate;
        record.verdict = Verdict::Gated;
        if tight.is_fused {
            self.note_fused(at, record);
        } else if let Some((fix, innovation)) = fallback {
            self.judge_fix(at, &fix, &innovation, n_tags, record);
            record.fix = Some(fix);
        }
    }

    /// Fuses a frame as one pose, or starts the filter with it.
    fn take_loose(
        &mut self,
        seen: &Seen,
        motion: Option<&(FilterState, Vector3<f64>)>,
        record: &mut FixRecord,
    ) {
        let features = vision_fix::features(&self.settings.marker_map, &seen.tags);
        let prior = motion.map(|(state, _)| &state.hall_from_body);
        match solved(&seen.frame.camera, &features, prior, &self.settings.vision) {
            Ok(mut fix) => {
                if let Some((state, rate_radps)) = motion {
                    let sigma_s = self.settings.capture_sigma_s;
                    fix.pose_cov += capture_time_cov(state, rate_radps, sigma_s);
                }
                record.n_points_used = record.n_points;
                self.take_fix(record.at, &fix, seen.points.len(), record);
                record.fix = Some(fix);
            }
            Err(NoFix::NoKnownTag) => {}
            Err(NoFix::NotObservable) => record.verdict = Verdict::NotObservable,
            Err(NoFix::BadResidual) => record.verdict = Verdict::BadResidual,
        }
    }

    fn take_fix(
        &mut self,
        at: Stamp<Mono>,
        fix: &FixOutcome,
        n_tags: usize,
        record: &mut FixRecord,
    ) {
        match self.placement {
            Placement::Unknown => {
                record.verdict = self.start(at, fix);
                return;
            }
            Placement::Stale => {
                let is_trusted = n_tags >= MIN_TAGS_TO_RELOCATE || self.is_on_ground;
                record.verdict = if is_trusted { self.restart(at, fix) } else { Verdict::Gated };
                return;
            }
            Placement::Pad | Placement::Tags => {}
        }
        let Some(ring) = &mut self.ring else { return };
        match ring.insert_fix(at, fix.clone()) {
            Insertion::TooOld => record.verdict = Verdict::TooOld,
            Insertion::FromTheFuture => record.verdict = Verdict::FromTheFuture,
            Insertion::Placed(innovation) => {
                self.judge_fix(at, fix, &innovation, n_tags, record);
            }
        }
    }

    /// Writes down how a fix met the state; enough refused ones that agree outvote the filter.
    fn judge_fix(
        &mut self,
        at: Stamp<Mono>,
        fix: &FixOutcome,
        innovation: &Innovation,
        n_tags: usize,
        record: &mut FixRecord,
    ) {
        record.source = FixSource::Loose;
        note(record, innovation);
        if innovation.is_within_gate() {
            self.note_fused(at, record);
            return;
        }
        let may_relocate = n_tags >= MIN_TAGS_TO_RELOCATE || self.is_on_ground;
        let is_outvoted = self.gated.outvotes_filter(at, &fix.hall_from_body) && may_relocate;
        record.verdict = if is_outvoted { self.restart(at, fix) } else { Verdict::Gated };
    }

    fn note_fused(&mut self, at: Stamp<Mono>, record: &mut FixRecord) {
        self.last_fused_at = self.last_fused_at.max(Some(at));
        self.placement = Placement::Tags;
        self.gated = GatedStreak::default();
        record.verdict = Verdict::Fused;
    }

    /// Starts the filter with this fix, at rest; with the biases of an alignment if there is one.
    fn start(&mut self, at: Stamp<Mono>, fix: &FixOutcome) -> Verdict {
        let Some(last_imu) = self.last_imu else { return Verdict::NotInitialized };
        let Some(rest) = self.rest.gyro_rest() else { return Verdict::NotInitialized };
        if !fits_gravity(fix, &rest) {
            return Verdict::AgainstGravity;
        }
        let mut state = FilterState {
            at,
            hall_from_body: fix.hall_from_body,
            velocity_mps: Vector3::zeros(),
            gyro_bias_radps: rest.gyro_radps,
            accel_bias_mps2: Vector3::zeros(),
            P: Covariance::zeros(),
        };
        state.P.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.pose_cov);
        set_sigma(&mut state.P, &AT_REST);
        self.begin_ring(state, last_imu);
        self.note_placed(at);
        Verdict::Initialized
    }

    /// Puts the filter onto fixes that its gate kept refusing, or the first one after a jump of the
    /// time; declares the jump of the pose.
    fn restart(&mut self, at: Stamp<Mono>, fix: &FixOutcome) -> Verdict {
        let (Some(ring), Some(last_imu)) = (&self.ring, self.last_imu) else {
            return Verdict::NotInitialized;
        };
        let rest = self.rest.standstill().filter(|_| self.is_on_ground);
        if rest.is_some_and(|rest| !fits_gravity(fix, &rest)) {
            return Verdict::AgainstGravity;
        }
        let mut state = ring.newest().clone();
        let apart_m = (state.hall_from_body.origin - fix.hall_from_body.origin).coords.norm();
        state.at = at;
        state.hall_from_body = fix.hall_from_body;
        // The old pose was wrong, so its correlations say nothing; the biases stay.
        state.P = Covariance::zeros();
        state.P.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.pose_cov);
        set_sigma(&mut state.P, &IN_FLIGHT);
        self.reset_counter = self.reset_counter.wrapping_add(1);
        self.notices.push(StatusText {
            severity: Severity::Warning,
            text: format!("position found anew, {apart_m:.2} m away"),
        });
        self.begin_ring(state, last_imu);
        self.note_placed(at);
        Verdict::Initialized
    }

    const fn note_placed(&mut self, at: Stamp<Mono>) {
        self.last_fused_at = Some(at);
        self.placement = Placement::Tags;
    }
}

/// What an uncertain capture time adds to the covariance of a fix in motion, 6×6.
///
/// ```text
/// σ_t² m mᵀ,   m = (v, ω)
/// ```
/// The position (hall axes) moves with the velocity, the attitude (body axes) with the rate.
fn capture_time_cov(
    state: &FilterState,
    rate_radps: &Vector3<f64>,
    capture_sigma_s: f64,
) -> Matrix6<f64> {
    let motion = Viewpoint::of(state, rate_radps).motion();
    motion * motion.transpose() * capture_sigma_s.powi(2)
}

/// A fix near the prior; from nothing where that fails, because a prior far from the truth can trap
/// the iteration.
fn solved(
    camera: &CameraModel,
    features: &[vision_fix::PointFeature],
    prior: Option<&Transform<Hall, Body>>,
    settings: &vision_fix::Settings,
) -> Result<FixOutcome, NoFix> {
    let first = vision_fix::solve(camera, features, prior, settings);
    match (&first, prior) {
        (Err(NoFix::BadResidual), Some(_)) => vision_fix::solve(camera, features, None, settings),
        _ => first,
    }
}

fn fits_gravity(fix: &FixOutcome, rest: &Rest) -> bool {
    let attitude_sigma_rad = (3..6).map(|k| fix.pose_cov[(k, k)].sqrt()).fold(0.0, f64::max);
    agrees_with_gravity(&fix.hall_from_body.rotation, rest, attitude_sigma_rad)
}

/// Writes an innovation of six numbers into a record.
pub(super) fn note(record: &mut FixRecord, innovation: &Innovation) {
    record.innovation = Some(innovation.pose.into());
    record.innovation_cov = Some(innovation.cov.into());
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
