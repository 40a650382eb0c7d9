//! A place of now for the autopilot when inertial samples come late or not at all.
//!
//! The filter's belief ends with the newest inertial sample. Late by more than the autopilot can look back,
//! it would pull the vehicle to where it was; so it is carried on to now. Where it is too old for that, the
//! flight ends, and the autopilot would land blind although a camera sees where the vehicle is: it gets what two
//! frames show by themselves.
//!
//! ```text
//! v = (p₁ − p₀)/Δ,   Σ_v = (Σ₀ + Σ₁)/Δ² + (a Δ/2)² I,   cov(χ₁, v) = Σ^χp₁/Δ     of two frames
//! p(t) = p₁ + v τ,   P(t) = F P Fᵀ + Q,   τ = t − t₁                              carried on
//! ```
//! `a`: what a manoeuvre may do, m/s². Nothing is measured, planned or steered by it.
//! Checked: `a_straight_flight_is_told_at_the_instant_asked_for`, fault cases 17 and 30 of the simulator.

use crate::geometry::{Direction, Hall, Point};
use crate::localization::{MANOEUVRE_MPS2, PLAUSIBLE_SPEED_MPS};
use crate::messages::state::{ATT, GYRO_BIAS, POS, VEL};
use crate::messages::{CameraId, FixOutcome, NavEstimate};
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix3, SMatrix, Vector3};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// The velocity is that over so long at least, two pictures of a camera at 20 Hz, …
const LEAST_SPAN: Duration = Duration::from_millis(80);
/// … and at most.
const LONGEST_SPAN: Duration = Duration::from_secs(1);
/// How fast the attitude may change, σ, rad/s.
const TURN_RADPS: f64 = 0.3;
/// An autopilot that had no place from here for longer may be anywhere, in anybody's hands.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(5);
/// How far what is told may be from where the vehicle was going, m, beside manoeuvres and noise.
const TOLERANCE_M: f64 = 0.3;

/// What the latest frames showed, and what the autopilot was told.
#[derive(Debug, Clone, Default)]
pub(super) struct Sight {
    /// By camera: their mountings differ, so fixes are compared within one.
    tracks: BTreeMap<CameraId, Track>,
    /// The camera that was told of last; others only while it shows nothing.
    camera: Option<CameraId>,
    /// What the autopilot got last.
    told: Option<Told>,
}

#[derive(Debug, Clone, Copy)]
struct Told {
    at: Stamp<Mono>,
    place: Point<Hall>,
    velocity_mps: Vector3<f64>,
}

/// What one camera showed.
#[derive(Debug, Clone, Default)]
struct Track {
    /// The newest last, within [`LONGEST_SPAN`].
    fixes: VecDeque<Seen>,
    /// The newest was told, or must not be.
    is_spent: bool,
}

/// What a frame shows by itself.
#[derive(Debug, Clone)]
struct Seen {
    at: Stamp<Mono>,
    fix: FixOutcome,
}

impl Seen {
    fn place(&self) -> Point<Hall> {
        self.fix.hall_from_body.origin
    }

    fn cov_m2(&self) -> Matrix3<f64> {
        self.fix.pose_cov.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// True if the vehicle cannot have flown from the other place to this one.
    fn contradicts(&self, other: &Self) -> bool {
        let noise_m = 3.0 * (self.cov_m2() + other.cov_m2()).diagonal().max().sqrt();
        let reach_m = PLAUSIBLE_SPEED_MPS * self.at.seconds_since(other.at) + noise_m;
        (self.place() - other.place()).coords.norm() > reach_m
    }
}

impl Track {
    fn take(&mut self, seen: Seen) {
        let is_older = self.fixes.back().is_some_and(|newest| newest.at >= seen.at);
        // No two pictures of a camera are equal to the last bit, unless it repeats one.
        let is_repeated =
            self.fixes.iter().any(|old| old.fix.hall_from_body == seen.fix.hall_from_body);
        if is_older || is_repeated {
            return;
        }
        self.fixes.retain(|old| seen.at.since(old.at) <= LONGEST_SPAN);
        // Whichever of the two is wrong: the next ones decide.
        if self.fixes.back().is_some_and(|newest| seen.contradicts(newest)) {
            self.fixes.clear();
        }
        self.fixes.push_back(seen);
        self.is_spent = false;
    }

    /// The newest frame and the last one well before it, if the newest is young enough.
    fn pair(&self, now: Stamp<Mono>, oldest: Duration) -> Option<(&Seen, &Seen)> {
        let newest = self.fixes.back().filter(|seen| now.since(seen.at) <= oldest)?;
        let is_apart = |old: &&Seen| newest.at.since(old.at) >= LEAST_SPAN;
        Some((self.fixes.iter().rev().find(is_apart)?, newest))
    }
}

impl Sight {
    /// The autopilot was told this, by the filter or by sight.
    pub(super) fn note_told(&mut self, estimate: &NavEstimate) {
        self.told = Some(Told {
            at: estimate.at,
            place: estimate.hall_from_body.origin,
            velocity_mps: estimate.velocity_mps.coords,
        });
    }

    /// The autopilot has no place from here any more.
    pub(super) fn forget_told(&mut self) {
        self.told = None;
    }

    /// Until when the autopilot was told a place.
    pub(super) fn told_until(&self) -> Option<Stamp<Mono>> {
        self.told.map(|told| told.at)
    }

    /// True while the autopilot still goes by a place from here.
    pub(super) fn is_followed(&self, now: Stamp<Mono>) -> bool {
        self.told.is_some_and(|told| now.since(told.at) < FORGOTTEN_AFTER)
    }

    /// Which way is down by the newest frame of a camera, in body axes; `None` without one that is young enough.
    pub(super) fn down_body(
        &self,
        camera: CameraId,
        now: Stamp<Mono>,
        oldest: Duration,
    ) -> Option<Vector3<f64>> {
        let newest = self.tracks.get(&camera)?.fixes.back()?;
        let rotation = newest.fix.hall_from_body.rotation;
        (now.since(newest.at) <= oldest).then(|| rotation.inverse().quaternion() * -Vector3::z())
    }

    /// Takes in what a frame shows.
    pub(super) fn take(&mut self, at: Stamp<Mono>, camera: CameraId, fix: FixOutcome) {
        self.tracks.entry(camera).or_default().take(Seen { at, fix });
    }

    /// The pose and velocity now, once for each frame; `None` while two frames do not tell them, by
    /// frames older than `oldest`, with a σ above `most_sigma_m`, and where the vehicle was not going.
    pub(super) fn tell(
        &mut self,
        now: Stamp<Mono>,
        oldest: Duration,
        most_sigma_m: f64,
        reset_counter: u8,
    ) -> Option<NavEstimate> {
        let shows = |camera: &CameraId| {
            self.tracks.get(camera).is_some_and(|track| track.pair(now, oldest).is_some())
        };
        let kept = self.camera.filter(shows);
        let camera = kept.or_else(|| self.tracks.keys().copied().find(shows))?;
        let track = self.tracks.get_mut(&camera).filter(|track| !track.is_spent)?;
        let (before, newest) = track.pair(now, oldest)?;
        let estimate = carried_on(of_two_frames(before, newest, reset_counter), now);
        track.is_spent = true;
        self.camera = Some(camera);
        let sigma_m = estimate.position_sigma_m().max();
        let is_sound = sigma_m <= most_sigma_m
            && estimate.velocity_mps.coords.norm() <= PLAUSIBLE_SPEED_MPS
            && !self.is_jump(&estimate, sigma_m);
        is_sound.then_some(estimate)
    }

    /// True if it is not where the vehicle was going when the autopilot was told last; what is not known
    /// of the last second is all that is allowed for.
    fn is_jump(&self, estimate: &NavEstimate, sigma_m: f64) -> bool {
        self.told.is_some_and(|told| {
            let apart_s = estimate.at.since(told.at).min(LONGEST_SPAN).as_secs_f64();
            let going_to = told.place.coords + told.velocity_mps * apart_s;
            let off_m = (estimate.hall_from_body.origin.coords - going_to).norm();
            let manoeuvre_m = 0.5 * MANOEUVRE_MPS2 * apart_s * apart_s;
            off_m > TOLERANCE_M + manoeuvre_m + 3.0 * sigma_m
        })
    }
}

fn of_two_frames(before: &Seen, newest: &Seen, reset_counter: u8) -> NavEstimate {
    let span_s = newest.at.seconds_since(before.at);
    let place_cov = newest.cov_m2();
    let manoeuvre_mps = 0.5 * MANOEUVRE_MPS2 * span_s;
    let velocity_cov = (place_cov + before.cov_m2()) / span_s.powi(2)
        + Matrix3::identity() * manoeuvre_mps.powi(2);
    let crossed = newest.fix.pose_cov.fixed_view::<6, 3>(0, 0) / span_s;
    let mut error_cov = SMatrix::<f64, 15, 15>::zeros();
    error_cov.fixed_view_mut::<6, 6>(0, 0).copy_from(&newest.fix.pose_cov);
    error_cov.fixed_view_mut::<3, 3>(VEL.start, VEL.start).copy_from(&velocity_cov);
    error_cov.fixed_view_mut::<6, 3>(0, VEL.start).copy_from(&crossed);
    error_cov.fixed_view_mut::<3, 6>(VEL.start, 0).copy_from(&crossed.transpose());
    for axis in GYRO_BIAS {
        error_cov[(axis, axis)] = TURN_RADPS * TURN_RADPS;
    }
    NavEstimate {
        at: newest.at,
        hall_from_body: newest.fix.hall_from_body,
        velocity_mps: Direction::from_coords((newest.place() - before.place()).coords / span_s),
        gyro_radps: Vector3::zeros(),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        error_cov,
        reset_counter,
    }
}

/// The belief at a later instant, as if the vehicle went on as it did, with the σ that this deserves.
pub(super) fn carried_on(mut estimate: NavEstimate, now: Stamp<Mono>) -> NavEstimate {
    let age_s = now.since(estimate.at).as_secs_f64();
    let pose = &mut estimate.hall_from_body;
    pose.origin.coords += estimate.velocity_mps.coords * age_s;
    pose.rotation = pose.rotation.perturbed(&(estimate.gyro_radps * age_s));
    let mut transition = SMatrix::<f64, 15, 15>::identity();
    for (place, velocity) in std::iter::zip(POS, VEL) {
        transition[(place, velocity)] = age_s;
    }
    let mut cov = transition * estimate.error_cov * transition.transpose();
    let grown = [
        (POS, 0.5 * MANOEUVRE_MPS2 * age_s * age_s),
        (ATT, TURN_RADPS * age_s),
        (VEL, MANOEUVRE_MPS2 * age_s),
    ];
    for (axes, sigma) in grown {
        axes.for_each(|axis| cov[(axis, axis)] += sigma * sigma);
    }
    estimate.error_cov = cov;
    estimate.at = now;
    estimate
}

#[cfg(test)]
mod tests;
