//! The waypoints of the survey and the trajectory along them.

use crate::mapping::Mapper;
use crate::mapping::projection::LidarMount;
use crate::planning::free_space::FreeSpace;
use crate::planning::greedy::ChooseWaypoint;
use crate::planning::trajectory::{Knot, Segment, passing_velocity};
use crate::planning::{PlannerKind, Settings, Waypoint, square_wave};
use crate::time::{Mono, Stamp};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::sync::Arc;

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
    segment: Option<Segment>,
    /// The present segment leads to the first waypoint ahead.
    is_on_survey: bool,
}

impl Route {
    pub(super) fn new(settings: Settings, free_space: FreeSpace) -> Self {
        let mut route = Self {
            settings,
            free_space: Arc::new(free_space),
            ahead: VecDeque::new(),
            steps_done: 0,
            steps_decided: 0,
            is_exhausted: false,
            segment: None,
            is_on_survey: false,
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
        self.segment = None;
        self.is_on_survey = false;
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
                // The way to the present waypoint can pass it now instead of stopping there.
                if self.is_on_survey && self.ahead.len() >= 2 {
                    self.fly_to_first(now);
                }
            }
            None => self.is_exhausted = true,
        }
    }

    /// Begins or continues the survey from the present trajectory.
    pub(super) fn survey(&mut self, now: Stamp<Mono>) {
        if self.is_on_survey && self.segment.as_ref().is_some_and(|s| s.is_over(now)) {
            self.ahead.pop_front();
            self.steps_done += 1;
            self.is_on_survey = false;
        }
        if !self.is_on_survey && !self.ahead.is_empty() {
            self.fly_to_first(now);
        }
    }

    fn fly_to_first(&mut self, now: Stamp<Mono>) {
        let (Some(from), Some(first)) = (self.knot_at(now), self.ahead.front()) else { return };
        let velocity = self.ahead.get(1).map_or_else(Vector3::zeros, |second| {
            let limits = &self.settings.limits;
            passing_velocity(&from.position, &first.coords, &second.coords, limits)
        });
        let to = Knot { position: first.coords, velocity, accel: Vector3::zeros() };
        self.segment = Some(Segment::between(now, &from, &to, &self.settings.limits));
        self.is_on_survey = true;
    }

    /// Flies to a place off the survey and stops there.
    pub(super) fn go_to(&mut self, place: &Vector3<f64>, now: Stamp<Mono>) {
        let Some(from) = self.knot_at(now) else { return };
        let to = Knot::at_rest(*place);
        self.segment = Some(Segment::between(now, &from, &to, &self.settings.limits));
        self.is_on_survey = false;
    }

    /// Stops within the limits.
    pub(super) fn brake(&mut self, now: Stamp<Mono>) {
        let Some(from) = self.knot_at(now) else { return };
        self.segment = Some(Segment::brake(now, &from, &self.settings.limits));
        self.is_on_survey = false;
    }

    /// Starts the trajectory at rest at a place.
    pub(super) fn stand(&mut self, place: &Vector3<f64>, now: Stamp<Mono>) {
        self.segment = Some(Segment::hold(now, *place));
        self.is_on_survey = false;
    }

    /// Ends all steering.
    pub(super) fn let_go(&mut self) {
        self.segment = None;
        self.is_on_survey = false;
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
