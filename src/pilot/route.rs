//! The waypoints of the survey, and the path that is flown along them.

use super::flight_path::FlightPath;
use super::survey_plan::SurveyPlan;
use crate::geometry::{Hall, Point};
use crate::planning::planner::Plan;
use crate::planning::{Settings, Waypoint};
use crate::time::{Mono, Stamp};

/// Where the survey goes next, and the path that is flown.
#[derive(Debug, Clone)]
pub(super) struct Route {
    /// The waypoints.
    pub(super) plan: SurveyPlan,
    path: FlightPath,
}

impl Route {
    pub(super) const fn new(plan: SurveyPlan) -> Self {
        let path = FlightPath::new(plan.settings().limits);
        Self { plan, path }
    }

    /// Forgets the last flight; the next one leads over these passes only, if there are some.
    pub(super) fn restart(&mut self, gaps: Option<Vec<Vec<Waypoint>>>) {
        self.plan.restart(gaps);
        self.path.let_go();
    }

    /// Takes in what the planner chose; false if it came too late.
    pub(super) fn on_plan(&mut self, plan: &Plan, now: Stamp<Mono>) -> bool {
        let is_taken = self.plan.on_plan(plan);
        if is_taken && self.path.is_surveying() {
            self.go_around(now);
            self.path.forget_waypoints();
            self.survey(now);
        }
        is_taken
    }

    /// Flies the survey from the present motion on; to be called again and again.
    pub(super) fn survey(&mut self, now: Stamp<Mono>) {
        if !self.path.is_surveying() {
            self.go_around(now);
        }
        let plan = &self.plan;
        let is_free =
            |place: &Point<Hall>, yaw_rad| plan.is_free(&Waypoint { place: *place, yaw_rad });
        self.path.survey(plan.ahead().iter(), &is_free, now);
    }

    /// Leads the waypoints ahead around what stands between.
    fn go_around(&mut self, now: Stamp<Mono>) {
        if let Some(present) = self.path.trajectory() {
            self.plan.go_around(&present.knot_at(now).position);
        }
    }

    /// Goes on to the next piece where the present one has ended.
    pub(super) fn advance(&mut self, now: Stamp<Mono>) {
        let n_reached = self.path.advance(now);
        self.plan.reach(n_reached);
    }

    /// Flies to a place off the survey, around what stands between, and stops there; stops first
    /// where it must, and for good where there is no way.
    pub(super) fn go_to(&mut self, place: Waypoint, now: Stamp<Mono>) {
        let Some(present) = self.path.trajectory() else { return };
        let from = present.knot_at(now).position;
        match self.plan.way(&from, &place.place.coords) {
            Some(corners) => {
                let corner = |p| Waypoint { place: Point::from_coords(p), ..place };
                self.path.go_to(corners.into_iter().map(corner).collect(), now);
            }
            None => self.path.brake(now),
        }
    }

    /// The path that is flown.
    pub(super) const fn path(&self) -> &FlightPath {
        &self.path
    }

    /// The same, to steer it off the survey.
    pub(super) const fn path_mut(&mut self) -> &mut FlightPath {
        &mut self.path
    }

    pub(super) const fn settings(&self) -> &Settings {
        self.plan.settings()
    }
}

#[cfg(test)]
mod tests;
