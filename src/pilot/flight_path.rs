//! The trajectory that is flown: along the survey, to a place off it, or to a stop.

use crate::geometry::{Hall, Point};
use crate::planning::Waypoint;
use crate::planning::trajectory::{Corridor, Knot, Limits, Trajectory};
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// What is being flown.
#[derive(Debug, Clone)]
pub(super) struct FlightPath {
    limits: Limits,
    trajectory: Option<Trajectory>,
    track: Track,
    /// Waypoints of the present trajectory that were reported as reached.
    n_reported: usize,
    /// The way off the survey; empty on it.
    destination: Vec<Waypoint>,
    /// No way is sought before this instant: the last search found none.
    retry_at: Stamp<Mono>,
    /// The waypoints ahead are others than those being flown.
    is_stale: bool,
}

/// What the present trajectory leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Track {
    /// Its own end: standing or braking.
    Stop,
    /// The waypoints ahead.
    Survey,
    /// The destination.
    Transit,
}

/// A survey is planned anew when it sees fewer waypoints than this and more are known: with fewer,
/// its stop at the last of them would be felt.
const LEAST_AHEAD: usize = 8;
/// Curves are judged at places this far apart, m.
const SPACING_M: f64 = 0.1;
/// Ways are sought again after this long.
const RETRY_AFTER: Duration = Duration::from_millis(100);

impl FlightPath {
    pub(super) const fn new(limits: Limits) -> Self {
        Self {
            limits,
            trajectory: None,
            track: Track::Stop,
            n_reported: 0,
            destination: Vec::new(),
            retry_at: Stamp::ZERO,
            is_stale: false,
        }
    }

    /// Flies the waypoints ahead, unless it is under way to as many of them as it can see.
    ///
    /// To be called again and again: from some accelerated states there is no way within the
    /// limits yet, and more waypoints come to be known. `is_free` judges the curve between them;
    /// where it says no even to the straight legs, those are flown with a stop at each waypoint,
    /// because the waypoints' planner answers for them.
    pub(super) fn survey<'a>(
        &mut self,
        ahead: impl ExactSizeIterator<Item = &'a Waypoint>,
        is_free: &dyn Fn(&Point<Hall>, f64) -> bool,
        now: Stamp<Mono>,
    ) {
        self.forget_destination();
        let Some(present) = &self.trajectory else { return };
        let n_wanted = ahead.len().min(LEAST_AHEAD);
        let n_seen = present.n_waypoints().saturating_sub(self.n_reported);
        let is_seen = self.track == Track::Survey && n_seen >= n_wanted && !self.is_stale;
        if n_wanted == 0 || is_seen || now < self.retry_at {
            return;
        }
        self.retry_at = now.plus(RETRY_AFTER);
        let waypoints: Vec<Waypoint> = ahead.take(Trajectory::LOOK_AHEAD).copied().collect();
        let corridor = Corridor { is_free, spacing_m: SPACING_M };
        let replanned = present.replanned(now, &waypoints, &self.limits, Some(&corridor)).ok();
        if let Some(trajectory) = replanned.or_else(|| self.straight(&waypoints, now)) {
            self.begin(Track::Survey, trajectory);
        }
    }

    /// The waypoints ahead have changed: the next [`Self::survey`] flies the new ones.
    pub(super) const fn forget_waypoints(&mut self) {
        self.is_stale = true;
        self.retry_at = Stamp::ZERO;
    }

    /// True on the way along the survey.
    pub(super) fn is_surveying(&self) -> bool {
        self.track == Track::Survey
    }

    /// The straight legs, once the present trajectory has come to rest; braking until then.
    fn straight(&self, waypoints: &[Waypoint], now: Stamp<Mono>) -> Option<Trajectory> {
        let present = self.trajectory.as_ref()?;
        let from = present.knot_at(now);
        if !from.is_at_rest() {
            return None;
        }
        Trajectory::straight(now, &from, waypoints, &self.limits)
    }

    /// Goes on where the present trajectory has ended. Says how many waypoints of the survey were
    /// reached since the last call.
    pub(super) fn advance(&mut self, now: Stamp<Mono>) -> usize {
        let Some(trajectory) = &self.trajectory else { return 0 };
        let (n_reached, is_over) = (trajectory.n_reached(now), trajectory.is_over(now));
        let n_new = match self.track {
            Track::Survey => n_reached.saturating_sub(self.n_reported),
            Track::Stop | Track::Transit => 0,
        };
        self.n_reported = n_reached;
        if is_over {
            if self.track == Track::Transit {
                self.destination.clear();
            }
            self.track = Track::Stop;
            self.depart(now);
        }
        n_new
    }

    /// Flies along a way off the survey and stops at its end; stops first where it must.
    pub(super) fn go_to(&mut self, way: Vec<Waypoint>, now: Stamp<Mono>) {
        self.destination = way;
        if !self.depart(now) {
            self.slow_down(now);
        }
    }

    /// Begins the way to the destination, if there is one; false if it cannot begin yet.
    fn depart(&mut self, now: Stamp<Mono>) -> bool {
        let Some(present) = self.trajectory.as_ref().filter(|_| !self.destination.is_empty())
        else {
            return false;
        };
        let Ok(trajectory) = present.replanned(now, &self.destination, &self.limits, None) else {
            return false;
        };
        self.begin(Track::Transit, trajectory);
        true
    }

    fn begin(&mut self, track: Track, trajectory: Trajectory) {
        self.trajectory = Some(trajectory);
        self.track = track;
        self.n_reported = 0;
        self.is_stale = false;
        self.retry_at = Stamp::ZERO;
    }

    fn forget_destination(&mut self) {
        self.destination.clear();
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
        if let Some(present) = &self.trajectory {
            let stop = present.braked(now, &self.limits);
            self.begin(Track::Stop, stop);
        }
    }

    /// Starts the trajectory at rest at a place.
    pub(super) fn stand(&mut self, place: &Waypoint, now: Stamp<Mono>) {
        self.forget_destination();
        self.begin(Track::Stop, Trajectory::hold(now, place.place.coords, place.yaw_rad));
    }

    /// Stops from this motion, whatever was flown before, as soon as an emergency allows.
    pub(super) fn stop_from(&mut self, motion: &Knot, now: Stamp<Mono>) {
        self.forget_destination();
        self.begin(Track::Stop, Trajectory::emergency_stop(now, motion, &self.limits));
    }

    /// Ends all steering.
    pub(super) fn let_go(&mut self) {
        self.forget_destination();
        self.trajectory = None;
        self.track = Track::Stop;
    }

    /// Where the trajectory ends, once everything on the way there is flown.
    pub(super) fn reached_end(&self, now: Stamp<Mono>) -> Option<Knot> {
        let is_there = self.track == Track::Stop && self.destination.is_empty();
        let trajectory = self.trajectory.as_ref().filter(|t| is_there && t.is_over(now))?;
        Some(*trajectory.end())
    }

    pub(super) const fn trajectory(&self) -> Option<&Trajectory> {
        self.trajectory.as_ref()
    }
}
