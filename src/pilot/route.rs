//! The waypoints of the survey and the trajectory along them.

use crate::geometry::Point;
use crate::mapping::Mapper;
use crate::mapping::projection::LidarMount;
use crate::planning::free_space::FreeSpace;
use crate::planning::greedy::ChooseWaypoint;
use crate::planning::trajectory::{Knot, Segment, passing_velocity};
use crate::planning::way::{Demand, way_within};
use crate::planning::{PlannerKind, Settings, Waypoint, square_wave};
use crate::time::{Mono, Stamp};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::sync::Arc;

/// Waypoints whose braking is looked after. The last of them counts as a stop, so fewer would only
/// fly slower: 20 m of 2 m steps brake from 6 m/s at 2 m/s².
const LOOK_AHEAD: usize = 10;

/// Where the survey goes next, and the present piece of trajectory.
#[derive(Debug, Clone)]
pub(super) struct Route {
    settings: Settings,
    free_space: Arc<FreeSpace>,
    /// Decided, not reached; the first is being flown to during the survey.
    ahead: VecDeque<Waypoint>,
    steps_done: usize,
    /// Steps decided so far, reached ones included.
    steps_decided: usize,
    /// The planner found nothing more.
    is_exhausted: bool,
    /// Where to go off the survey.
    destination: Option<Vector3<f64>>,
    /// There is no way to the destination from here.
    is_shut_in: bool,
    /// Places on the way there, once it is under way.
    transit: VecDeque<Vector3<f64>>,
    segment: Option<Segment>,
    track: Track,
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
    pub(super) fn new(settings: Settings, free_space: FreeSpace) -> Self {
        let mut route = Self {
            settings,
            free_space: Arc::new(free_space),
            ahead: VecDeque::new(),
            steps_done: 0,
            steps_decided: 0,
            is_exhausted: false,
            destination: None,
            is_shut_in: false,
            transit: VecDeque::new(),
            segment: None,
            track: Track::Stop,
        };
        route.restart();
        route
    }

    /// Forgets the last flight.
    pub(super) fn restart(&mut self) {
        self.ahead = match self.settings.planner {
            PlannerKind::SquareWave => square_wave::waypoints(&self.settings)
                .into_iter()
                .filter(|w| {
                    self.free_space.nearest(w).is_some_and(|s| self.free_space.is_feasible(s))
                })
                .collect(),
            PlannerKind::Greedy => VecDeque::new(),
        };
        self.steps_decided = self.ahead.len();
        self.steps_done = 0;
        self.is_exhausted = self.settings.planner == PlannerKind::SquareWave;
        self.let_go();
    }

    /// True if there is somewhere to fly.
    pub(super) fn has_plan(&self) -> bool {
        match self.settings.planner {
            PlannerKind::SquareWave => !self.ahead.is_empty(),
            PlannerKind::Greedy => self.free_space.feasible().next().is_some(),
        }
    }

    /// All waypoints are reached and no more will come.
    pub(super) fn is_done(&self) -> bool {
        self.ahead.is_empty() && (self.is_exhausted || self.steps_decided >= self.settings.n_steps)
    }

    /// Every waypoint that was wished for is flown; false if the planner ran out of them.
    pub(super) fn is_complete(&self) -> bool {
        let wanted = match self.settings.planner {
            PlannerKind::SquareWave => self.steps_decided,
            PlannerKind::Greedy => self.settings.n_steps,
        };
        wanted > 0 && self.steps_done >= wanted
    }

    pub(super) const fn steps_done(&self) -> usize {
        self.steps_done
    }

    /// The greedy choice that is due, if any: one waypoint is kept decided beyond the present one.
    pub(super) fn choice_due(
        &self,
        from: &Waypoint,
        mapper: &Mapper,
        lidar: &LidarMount,
    ) -> Option<ChooseWaypoint> {
        let is_due = !self.is_exhausted
            && self.steps_decided < self.settings.n_steps
            && self.ahead.len() < 2;
        is_due.then(|| ChooseWaypoint {
            belief: mapper.grid().clone(),
            pending: std::iter::once(*from).chain(self.ahead.iter().copied()).collect(),
            free_space: Arc::clone(&self.free_space),
            lidar: lidar.clone(),
            cell_areas_m2: mapper.base().cell_areas_m2.clone().into(),
            settings: self.settings.clone(),
        })
    }

    /// Takes in what the planner chose.
    pub(super) fn on_choice(&mut self, chosen: Option<Waypoint>, now: Stamp<Mono>) {
        match chosen {
            Some(waypoint) => {
                self.ahead.push_back(waypoint);
                self.steps_decided += 1;
                // The way to the present waypoint can pass it now instead of stopping there, if
                // the present motion allows; otherwise it goes on as planned.
                if self.track == Track::Survey && self.ahead.len() >= 2 {
                    self.fly(Track::Survey, now, self.knot_at(now));
                }
            }
            None => self.is_exhausted = true,
        }
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
            Track::Survey => {
                self.ahead.pop_front();
                self.steps_done += 1;
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
            self.go_around(&from.position);
        }
        let places: Vec<Vector3<f64>> = match track {
            Track::Stop => return false,
            Track::Survey => self.ahead.iter().take(LOOK_AHEAD).map(|w| w.place.coords).collect(),
            Track::Transit => self.transit.iter().take(LOOK_AHEAD).copied().collect(),
        };
        let (Some(from), Some(&first)) = (from, places.first()) else { return false };
        let path: Vec<_> = std::iter::once(from.position).chain(places).collect();
        let velocity = passing_velocity(from.velocity.norm(), &path, &self.settings.limits);
        let to = Knot { position: first, velocity, accel: Vector3::zeros() };
        let Some(segment) = Segment::between(at, &from, &to, &self.settings.limits) else {
            return false;
        };
        self.segment = Some(segment);
        self.track = track;
        true
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
        let Some(corners) = self.way(&from.position, &place) else {
            self.is_shut_in = true;
            return false;
        };
        let corners: Vec<_> = std::iter::once(from.position).chain(corners).collect();
        self.transit = corners.windows(2).flat_map(|leg| pieces(&leg[0], &leg[1])).collect();
        self.fly(Track::Transit, now, Some(from))
    }

    /// The corners of a way around what stands between, its end included; `None` without any.
    ///
    /// Only geometry is asked: a search for good fixes may have to evaluate thousands of them, and
    /// the brain does not wait for that.
    fn way(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<Vec<Vector3<f64>>> {
        let at = |place: &Vector3<f64>| Waypoint {
            place: Point::from_coords(*place),
            yaw_rad: self.settings.yaw_rad,
        };
        let (from, to) = (at(from), at(to));
        let found = way_within(&self.free_space, &from, &to, Demand::Clear)?;
        Some(found.iter().map(|waypoint| waypoint.place.coords).collect())
    }

    /// Puts the way around what stands between two waypoints that come next in front of the second;
    /// a waypoint to which there is no way is left out.
    fn go_around(&mut self, from: &Vector3<f64>) {
        let later = self.ahead.split_off(self.ahead.len().min(LOOK_AHEAD));
        let mut before = *from;
        for next in std::mem::take(&mut self.ahead) {
            let place = next.place.coords;
            if self.free_space.clearance().is_way_clear(&before, &place) {
                self.ahead.push_back(next);
                before = place;
            } else if let Some(corners) = self.way(&before, &place) {
                self.steps_decided += corners.len() - 1;
                let corner = |place| Waypoint { place: Point::from_coords(place), ..next };
                self.ahead.extend(corners.into_iter().map(corner));
                before = place;
            }
        }
        self.ahead.extend(later);
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
        self.segment = Some(Segment::brake(now, &from, &self.settings.limits));
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
        &self.settings
    }
}

/// Places on a straight way, its end included.
fn pieces(from: &Vector3<f64>, to: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let n_pieces = ((to - from).norm() / TRANSIT_SPACING_M).ceil().max(1.0);
    std::iter::successors(Some(1.0), |k| (*k < n_pieces).then_some(k + 1.0))
        .map(|k| from.lerp(to, k / n_pieces))
        .collect()
}

#[cfg(test)]
mod tests;
