//! From the tags of a frame to an update of the filter.

use super::super::camera_model::CameraModel;
use super::super::filter::{Covariance, FilterState, Innovation, PlacedFix};
use super::super::frozen::Picture;
use super::super::marker_map::MarkerMap;
use super::super::place_errors::PlaceErrors;
use super::super::ring::{FrameInsertion, FramePlaced, Insertion};
use super::super::start::{AT_REST, IN_FLIGHT, Rest, agrees_with_gravity, set_sigma};
use super::super::tag_health::{TagName, TagPoints};
use super::super::tight_update::{Frame, Projector, Sighting, Viewpoint};
use super::super::vision_fix::{self, NoFix, PointFeature, Start};
use super::gated_streak::{GatedStreak, Velocity};
use super::{Localizer, Placement, Update};
use crate::geometry::{Hall, Point};
use crate::messages::state::VEL;
use crate::messages::{
    FixOutcome, FixRecord, FixSource, PointDetection, Severity, StatusText, TagDetection,
    TagDetections, Verdict,
};
use crate::stats::chi2_gate_99;
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, Vector2, Vector3};
use std::sync::Arc;

/// Biases of sensors that fly, at most.
const LARGEST_ACCEL_BIAS_MPS2: f64 = 0.5;
const LARGEST_GYRO_BIAS_RADPS: f64 = 0.1;
/// In flight one tag alone, which may have been moved, outvotes nobody.
const MIN_TAGS_TO_RELOCATE: usize = 2;

/// The mapped tags and points of a frame.
struct Seen {
    /// Four corners of each tag, then the points that belong to none.
    frame: Frame,
    tags: Vec<TagPoints>,
}

impl Seen {
    /// How many tags the points are worth: four points that belong to none count as one.
    fn n_tags(&self) -> usize {
        self.frame.points.len() / 4
    }

    /// The points as a fix wants them, all at the frame's stamp: what the rows' offsets moved is
    /// taken back as far as the motion is known.
    fn features(&self, view: Option<&Viewpoint>) -> Vec<PointFeature> {
        let projector = view.map(|view| Projector::new(&self.frame, view));
        let at_stamp = |point: &Sighting| {
            let still = Sighting { offset_s: 0.0, ..*point };
            let moved_px = projector.as_ref().filter(|_| point.offset_s != 0.0).and_then(|p| {
                let by = p.residual(point)?.r - p.residual(&still)?.r;
                Some(by * self.frame.corner_sigma_px)
            });
            let pixel = point.pixel + moved_px.unwrap_or_else(Vector2::zeros);
            PointFeature { place: point.place, pixel }
        };
        self.frame.points.iter().map(at_stamp).collect()
    }
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
            let news = self.tag_health.judge(state, &view, &seen.frame, &seen.tags);
            self.notices.extend(news);
        }
        self.drop_excluded(&mut seen);
        record.n_tags_used = seen.tags.len();
        record.n_points = seen.frame.points.len();
        if seen.frame.points.is_empty() {
            return record;
        }
        let tags: Vec<TagName> = seen.tags.iter().map(|tag| tag.name).collect();
        match (self.settings.update, &motion) {
            (Update::Tight, Some(_)) => self.take_frame(frame.captured_at, &seen, &mut record),
            _ => self.take_loose(&seen, motion.as_ref(), &mut record),
        }
        if matches!(record.verdict, Verdict::Fused | Verdict::Initialized) {
            self.last_fused_tags = Some((camera_idx, tags));
        }
        record
    }

    /// The pose that a frame shows by itself, whatever the filter believes, and whatever the motion
    /// between its rows; `None` with less than two tags that can be trusted.
    ///
    /// `down_body`: direction of gravity in body axes, within some degrees.
    #[must_use]
    pub fn pose_by_sight(
        &self,
        frame: &TagDetections,
        down_body: &Vector3<f64>,
    ) -> Option<FixOutcome> {
        let camera = self.cameras.get(usize::from(frame.camera.0))?;
        let mut seen = self.seen(camera, frame);
        self.drop_excluded(&mut seen);
        if seen.n_tags() < MIN_TAGS_TO_RELOCATE {
            return None;
        }
        let start = Start::Cold { gravity_body: Some(*down_body) };
        let vision = &self.settings.vision;
        let mut fix = vision_fix::solve_from(camera, &seen.features(None), start, vision).ok()?;
        let place_var_m2 = self.settings.marker_map.place_sigma_m().powi(2);
        for axis in 0..3 {
            fix.pose_cov[(axis, axis)] += place_var_m2;
        }
        Some(fix)
    }

    /// The mapped tags of a frame; a tag that is reported twice is left out, since one of the two
    /// is wrong or both are the same.
    fn seen(&self, camera: &Arc<CameraModel>, frame: &TagDetections) -> Seen {
        let mut seen = Seen {
            frame: Frame {
                camera: Arc::clone(camera),
                points: Vec::new(),
                corner_sigma_px: self.settings.vision.corner_sigma_px,
                capture_sigma_s: self.settings.capture_sigma_s,
            },
            tags: Vec::new(),
        };
        let sighting = |place_idx: usize, place: &Point<Hall>, pixel: &[f64; 2]| Sighting {
            place: *place,
            pixel: Vector2::from(*pixel),
            offset_s: camera.row_offset_s(pixel[1]),
            place_idx,
        };
        let map = &self.settings.marker_map;
        let is_unique = |tag: &&TagDetection| {
            frame.tags.iter().filter(|t| (t.family, t.id) == (tag.family, tag.id)).count() == 1
        };
        for tag in frame.tags.iter().filter(is_unique) {
            let place_idx = map.index(tag.family, tag.id);
            let Some((idx, corners)) = place_idx.zip(map.corners(tag.family, tag.id)) else {
                continue;
            };
            let first = seen.frame.points.len();
            let corners = corners.iter().zip(&tag.corners_px);
            seen.frame.points.extend(corners.map(|(place, pixel)| sighting(idx, place, pixel)));
            let range = first..seen.frame.points.len();
            seen.tags.push(TagPoints { name: (tag.family, tag.id), range });
        }
        let is_single = |point: &&PointDetection| {
            frame.points.iter().filter(|other| other.id == point.id).count() == 1
        };
        for point in frame.points.iter().filter(is_single) {
            let place = map.point_index(point.id).zip(map.point(point.id));
            let sighting = place.map(|(idx, place)| sighting(idx, &place, &point.pixel_px));
            seen.frame.points.extend(sighting);
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
        let is_out = |tag: &TagPoints| self.tag_health.is_excluded(tag.name);
        if !seen.tags.iter().any(is_out) {
            return;
        }
        let n_corners = seen.tags.last().map_or(0, |tag| tag.range.end);
        let (mut tags, mut kept) = (Vec::new(), Vec::new());
        for tag in seen.tags.drain(..).filter(|tag| !is_out(tag)) {
            let first = kept.len();
            kept.extend_from_slice(seen.frame.points.get(tag.range).unwrap_or_default());
            tags.push(TagPoints { name: tag.name, range: first..kept.len() });
        }
        kept.extend(seen.frame.points.drain(..).skip(n_corners));
        (seen.tags, seen.frame.points) = (tags, kept);
    }

    /// Fuses the points of a frame, or the fix that stands in for them.
    fn take_frame(&mut self, at: Stamp<Mono>, seen: &Seen, record: &mut FixRecord) {
        let (settings, n_tags) = (&self.settings, seen.n_tags());
        let marker_map = &self.settings.marker_map;
        let Some(ring) = &mut self.ring else { return };
        let frame = seen.frame.clone();
        let solve = |state: &FilterState, rate_radps: &Vector3<f64>| {
            let features = seen.features(Some(&Viewpoint::of(state, rate_radps)));
            let mut fix = near(&seen.frame.camera, &features, state, &settings.vision).ok()?;
            fix.pose_cov += capture_time_cov(state, rate_radps, settings.capture_sigma_s);
            Some(placed(fix, seen, marker_map))
        };
        record.source = FixSource::Tight;
        match ring.insert_frame(at, frame, solve) {
            FrameInsertion::TooOld => record.verdict = Verdict::TooOld,
            FrameInsertion::FromTheFuture => record.verdict = Verdict::FromTheFuture,
            FrameInsertion::Placed(placed) => self.judge_frame(at, *placed, n_tags, record),
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
            record.fix = Some(fix.outcome);
        }
    }

    /// Fuses a frame as one pose, or starts the filter with it.
    fn take_loose(
        &mut self,
        seen: &Seen,
        motion: Option<&(FilterState, Vector3<f64>)>,
        record: &mut FixRecord,
    ) {
        let (camera, vision) = (&seen.frame.camera, &self.settings.vision);
        let solved = match motion {
            Some((state, rate_radps)) => {
                let view = Viewpoint::of(state, rate_radps);
                near(camera, &seen.features(Some(&view)), state, vision)
            }
            None => {
                let gravity_body = self.rest.gyro_rest().map(|rest| -rest.accel_mps2);
                let start = Start::Cold { gravity_body };
                vision_fix::solve_from(camera, &seen.features(None), start, vision)
            }
        };
        match solved {
            Ok(mut fix) => {
                if let Some((state, rate_radps)) = motion {
                    let sigma_s = self.settings.capture_sigma_s;
                    fix.pose_cov += capture_time_cov(state, rate_radps, sigma_s);
                }
                record.n_points_used = fix.n_points;
                let fix = placed(fix, seen, &self.settings.marker_map);
                self.take_fix(record.at, &fix, seen.n_tags(), record);
                record.fix = Some(fix.outcome);
            }
            Err(NoFix::NoKnownTag) => {}
            Err(NoFix::NotObservable) => record.verdict = Verdict::NotObservable,
            Err(NoFix::BadResidual) => record.verdict = Verdict::BadResidual,
        }
    }

    fn take_fix(
        &mut self,
        at: Stamp<Mono>,
        fix: &PlacedFix,
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
                record.verdict =
                    if is_trusted { self.restart_after_gap(at, fix) } else { Verdict::Gated };
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
        fix: &PlacedFix,
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
        let is_outvoted = self.gated.outvotes_filter(at, &fix.outcome) && may_relocate;
        let velocity = self.velocity_of_fixes().filter(|_| is_outvoted);
        record.verdict = velocity.map_or(Verdict::Gated, |of_fixes| {
            // The filter knows its velocity far better, unless it has run away with it.
            let own = self.ring.as_ref().map(|ring| ring.newest().velocity_mps);
            let velocity = own.and_then(|own| of_fixes.not_contradicted(own));
            self.restart(at, fix, velocity.unwrap_or(of_fixes))
        });
    }

    fn note_fused(&mut self, at: Stamp<Mono>, record: &mut FixRecord) {
        self.last_fused_at = self.last_fused_at.max(Some(at));
        self.last_agreed_at = self.last_agreed_at.max(Some(at));
        self.placement = Placement::Tags;
        self.gated = GatedStreak::default();
        record.verdict = Verdict::Fused;
    }

    /// Starts the filter with this fix, at rest; with the biases of an alignment if there is one.
    fn start(&mut self, at: Stamp<Mono>, placed: &PlacedFix) -> Verdict {
        let fix = &placed.outcome;
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
            places: self.places_of(placed),
        };
        state.P.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.pose_cov);
        set_sigma(&mut state.P, &AT_REST);
        self.begin_ring(state, last_imu);
        self.note_placed(at);
        Verdict::Initialized
    }

    /// After a gap in the inertial samples nobody knows how fast the vehicle is: in flight that takes a
    /// second fix.
    fn restart_after_gap(&mut self, at: Stamp<Mono>, placed: &PlacedFix) -> Verdict {
        self.gated.outvotes_filter(at, &placed.outcome);
        let velocity = self.velocity_of_fixes();
        velocity.map_or(Verdict::Gated, |velocity| self.restart(at, placed, velocity))
    }

    /// How fast the vehicle is by fixes that agree with each other; `None` while they do not tell.
    fn velocity_of_fixes(&self) -> Option<Velocity> {
        if self.is_on_ground { Some(Velocity::NONE) } else { self.gated.velocity() }
    }

    /// Puts the filter onto fixes that its gate kept refusing, or those after a jump of the time;
    /// declares the jump of the pose.
    fn restart(&mut self, at: Stamp<Mono>, placed: &PlacedFix, velocity: Velocity) -> Verdict {
        let fix = &placed.outcome;
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
        // The old pose was wrong, so its correlations say nothing.
        state.P = Covariance::zeros();
        state.P.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.pose_cov);
        set_sigma(&mut state.P, &IN_FLIGHT);
        state.velocity_mps = velocity.mps;
        set_sigma(&mut state.P, &[(VEL, velocity.sigma_mps)]);
        // What has led the filter astray may be in its biases; no sensor has larger ones than these.
        state.accel_bias_mps2 = state.accel_bias_mps2.cap_magnitude(LARGEST_ACCEL_BIAS_MPS2);
        state.gyro_bias_radps = state.gyro_bias_radps.cap_magnitude(LARGEST_GYRO_BIAS_RADPS);
        state.places = self.places_of(placed);
        // The fixes agreed for the last time then; what followed was seen from a wrong pose.
        self.doubtful_since = self.doubtful_since.or(self.last_agreed_at);
        self.reset_counter = self.reset_counter.wrapping_add(1);
        self.notices.push(StatusText {
            severity: Severity::Warning,
            text: format!("position found anew, {apart_m:.2} m away"),
        });
        self.begin_ring(state, last_imu);
        self.note_placed(at);
        Verdict::Initialized
    }

    /// What misplaced tags do to a state that is put onto this fix.
    fn places_of(&self, fix: &PlacedFix) -> Option<Box<PlaceErrors>> {
        PlaceErrors::of_fix(self.settings.marker_map.place_sigma_m(), &fix.by_place)
    }

    const fn note_placed(&mut self, at: Stamp<Mono>) {
        self.last_fused_at = Some(at);
        self.last_agreed_at = Some(at);
        self.placement = Placement::Tags;
    }
}

/// A fix with what it owes to the places of its tags. Points that belong to no tag are left out:
/// as one pose they count as exact.
fn placed(outcome: FixOutcome, seen: &Seen, map: &MarkerMap) -> PlacedFix {
    if map.place_sigma_m() <= 0.0 {
        return PlacedFix::from(outcome);
    }
    let tags: Vec<TagName> = seen.tags.iter().map(|tag| tag.name).collect();
    let pose = &outcome.hall_from_body;
    let by_place = vision_fix::tag_sensitivity(&seen.frame.camera, map, &tags, pose);
    PlacedFix { outcome, by_place }
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

/// A fix near the state; from nothing but the state's tilt where that fails, because a prior far from
/// the truth can trap the iteration.
fn near(
    camera: &CameraModel,
    features: &[PointFeature],
    state: &FilterState,
    settings: &vision_fix::Settings,
) -> Result<FixOutcome, NoFix> {
    let start = Start::Prior(&state.hall_from_body);
    match vision_fix::solve_from(camera, features, start, settings) {
        Err(NoFix::BadResidual) => {
            let down = state.hall_from_body.rotation.inverse().quaternion() * -Vector3::z();
            let start = Start::Cold { gravity_body: Some(down) };
            vision_fix::solve_from(camera, features, start, settings)
        }
        solved => solved,
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
