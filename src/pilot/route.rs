//! The waypoints of the survey and the trajectory along them.

use super::survey_plan::SurveyPlan;
use crate::planning::Settings;
use crate::planning::planner::Plan;
use crate::planning::trajectory::{Knot, Limits, Segment, passing_velocity};
use crate::time::{Mono, Stamp};
use crate::units::wrapped_rad;
use nalgebra::Vector3;
use std::collections::VecDeque;

/// Waypoints whose braking is looked after. The last of them counts as a stop, so fewer would only
/// fly slower: 20 m of 2 m steps brake from 6 m/s at 2 m/s².
const LOOK_AHEAD: usize = 10;

/// Where the survey goes next, and the present piece of trajectory.
#[derive(Debug, Clone)]
pub(super) struct Route {
    /// The waypoints.
    pub(super) plan: SurveyPlan,
    /// Where to go off the survey.
    destination: Option<Vector3<f64>>,
    /// There is no way to the destination from here.
    is_shut_in: bool,
    /// Places on the way there, once it is under way.
    transit: VecDeque<Vector3<f64>>,
    segment: Option<Segment>,
    track: Track,
    /// Heading that is commanded, rad, and since when.
    yaw: Option<(f64, Stamp<Mono>)>,
}

/// What the present segment leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Track {
    /// Its own end: standing or braking.
    Stop,
    /// The first waypoint ahead.
    Survey,
    /// The first place in transit.
    Transit,
}

/// Places in transit are this far apart, m: one quintic over a long way would be slow.
const TRANSIT_SPACING_M: f64 = 2.5;

impl Route {
    pub(super) fn new(plan: SurveyPlan) -> Self {
        Self {
            plan,
            destination: None,
            is_shut_in: false,
            transit: VecDeque::new(),
            segment: None,
            track: Track::Stop,
            yaw: None,
        }
    }

    /// Forgets the last flight.
    pub(super) fn restart(&mut self) {
        self.plan.restart();
        self.let_go();
    }

    /// Takes in what the planner chose.
    pub(super) fn on_plan(&mut self, plan: Plan, now: Stamp<Mono>) {
        // The way to the present waypoint can pass it now instead of stopping there, or has to stop
        // there, if the present motion allows; otherwise it goes on as planned.
        if self.plan.on_plan(plan) && self.track == Track::Survey {
            self.fly(Track::Survey, now, self.knot_at(now));
        }
    }

    /// Heading to command, rad: turns evenly towards that of the next waypoint.
    pub(super) fn yaw_at(&mut self, now: Stamp<Mono>) -> f64 {
        let settings = self.plan.settings();
        let wanted_rad = match self.track {
            Track::Survey => self.plan.ahead().front().map(|waypoint| waypoint.yaw_rad),
            Track::Transit => Some(settings.yaw_rad),
            Track::Stop => None,
        };
        let (present_rad, since) = self.yaw.unwrap_or((settings.yaw_rad, now));
        let most_rad = settings.turn_rate_radps * now.seconds_since(since).clamp(0.0, 0.1);
        let turn_rad = wanted_rad.map_or(0.0, |wanted_rad| wrapped_rad(wanted_rad - present_rad));
        let yaw_rad = wrapped_rad(present_rad + turn_rad.clamp(-most_rad, most_rad));
        self.yaw = Some((yaw_rad, now));
        yaw_rad
    }

    /// Leaves the present trajectory for the survey, unless it is on it already.
    ///
    /// To be called again until it is: from some accelerated states there is no way within the
    /// limits yet.
    pub(super) fn survey(&mut self, now: Stamp<Mono>) {
        self.forget_destination();
        if self.track != Track::Survey {
            self.fly(Track::Survey, now, self.knot_at(now));
        }
    }

    /// Goes on to the next piece where the present one has ended.
    pub(super) fn advance(&mut self, now: Stamp<Mono>) {
        let finished = self.segment.as_ref().filter(|segment| segment.is_over(now));
        let Some((end_at, end)) = finished.map(|s| (s.end_at(), *s.end())) else { return };
        let track = self.track;
        match track {
            Track::Survey if !self.has_turned() => return,
            Track::Survey => {
                self.plan.reach();
            }
            Track::Transit => {
                self.transit.pop_front();
                if self.transit.is_empty() {
                    self.destination = None;
                }
            }
            Track::Stop => {
                self.depart(now);
                return;
            }
        }
        self.track = Track::Stop;
        // At its speed, not from rest.
        self.fly(track, end_at, Some(end));
    }

    /// Begins the piece to the first place of a track; false if there is none within the limits.
    fn fly(&mut self, track: Track, at: Stamp<Mono>, from: Option<Knot>) -> bool {
        if let (Track::Survey, Some(from)) = (track, &from) {
            self.plan.go_around(&from.position);
        }
        let places: Vec<Vector3<f64>> = match track {
            Track::Stop => return false,
            Track::Survey => {
                self.plan.ahead().iter().take(LOOK_AHEAD).map(|w| w.place.coords).collect()
            }
            Track::Transit => self.transit.iter().take(LOOK_AHEAD).copied().collect(),
        };
        let (Some(from), Some(&first)) = (from, places.first()) else { return false };
        let path: Vec<_> = std::iter::once(from.position).chain(places).collect();
        let limits = self.limits_while_turning(track, &from.position);
        let velocity = passing_velocity(from.velocity.norm(), &path, &limits);
        let to = Knot { position: first, velocity, accel: Vector3::zeros() };
        let all = &self.plan.settings().limits;
        let segment = Segment::between(at, &from, &to, &limits)
            .or_else(|| Segment::between(at, &from, &to, all));
        let Some(segment) = segment else {
            return false;
        };
        self.segment = Some(segment);
        self.track = track;
        true
    }

    /// Slow enough for the heading to come along.
    fn limits_while_turning(&self, track: Track, from: &Vector3<f64>) -> Limits {
        let settings = self.plan.settings();
        let mut limits = settings.limits;
        if let (Track::Survey, Some(to), Some((yaw_rad, _))) =
            (track, self.plan.ahead().front(), self.yaw)
        {
            let turn_s = wrapped_rad(to.yaw_rad - yaw_rad).abs() / settings.turn_rate_radps;
            let way_m = (to.place.coords - from).norm();
            if turn_s > 0.0 {
                limits.speed_mps = limits.speed_mps.min((way_m / turn_s).max(0.1));
            }
        }
        limits
    }

    /// True once the heading is that of the first waypoint ahead.
    fn has_turned(&self) -> bool {
        let wanted = self.plan.ahead().front().map(|waypoint| waypoint.yaw_rad);
        let turn_rad = wanted.zip(self.yaw).map_or(0.0, |(to, (yaw, _))| wrapped_rad(to - yaw));
        turn_rad.abs() < 0.15
    }

    /// Flies to a place off the survey, around what stands between, and stops there; stops first
    /// where it must, and for good where there is no way.
    pub(super) fn go_to(&mut self, place: &Vector3<f64>, now: Stamp<Mono>) {
        self.destination = Some(*place);
        self.is_shut_in = false;
        if !self.depart(now) {
            self.slow_down(now);
        }
    }

    /// Begins the way to the destination, if there is one; false if it cannot begin yet.
    fn depart(&mut self, now: Stamp<Mono>) -> bool {
        let (Some(place), Some(from)) = (self.destination, self.knot_at(now)) else { return false };
        if self.is_shut_in {
            return false;
        }
        let Some(corners) = self.plan.way(&from.position, &place) else {
            self.is_shut_in = true;
            return false;
        };
        let corners: Vec<_> = std::iter::once(from.position).chain(corners).collect();
        self.transit = corners.windows(2).flat_map(|leg| pieces(&leg[0], &leg[1])).collect();
        self.fly(Track::Transit, now, Some(from))
    }

    fn forget_destination(&mut self) {
        self.destination = None;
        self.transit.clear();
        if self.track == Track::Transit {
            self.track = Track::Stop;
        }
    }

    /// Stops within the limits and stays.
    pub(super) fn brake(&mut self, now: Stamp<Mono>) {
        self.forget_destination();
        self.slow_down(now);
    }

    fn slow_down(&mut self, now: Stamp<Mono>) {
        let Some(from) = self.knot_at(now) else { return };
        self.segment = Some(Segment::brake(now, &from, &self.plan.settings().limits));
        self.track = Track::Stop;
    }

    /// Starts the trajectory at rest at a place.
    pub(super) fn stand(&mut self, place: &Vector3<f64>, now: Stamp<Mono>) {
        self.forget_destination();
        self.segment = Some(Segment::hold(now, *place));
        self.track = Track::Stop;
    }

    /// Ends all steering.
    pub(super) fn let_go(&mut self) {
        self.forget_destination();
        self.segment = None;
        self.track = Track::Stop;
        self.yaw = None;
    }

    /// Where the trajectory ends, once everything on the way there is flown.
    pub(super) fn reached_end(&self, now: Stamp<Mono>) -> Option<Vector3<f64>> {
        let is_there = self.track == Track::Stop && self.destination.is_none();
        let segment = self.segment.as_ref().filter(|s| is_there && s.is_over(now))?;
        Some(segment.end().position)
    }

    pub(super) fn knot_at(&self, now: Stamp<Mono>) -> Option<Knot> {
        self.segment.as_ref().map(|segment| segment.knot_at(now))
    }

    pub(super) const fn segment(&self) -> Option<&Segment> {
        self.segment.as_ref()
    }

    pub(super) const fn settings(&self) -> &Settings {
        self.plan.settings()
    }
}

/// Places on a straight way, its end included.
fn pieces(from: &Vector3<f64>, to: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let n_pieces = ((to - from).norm() / TRANSIT_SPACING_M).ceil().max(1.0);
    std::iter::successors(Some(1.0), |k| (*k < n_pieces).then_some(k + 1.0))
        .map(|k| from.lerp(to, k / n_pieces))
        .collect()
}
