//! The waypoints of the survey and the trajectory along them.

use super::flight_path::FlightPath;
use crate::geometry::{Hall, Point};
use crate::mapping::Mapper;
use crate::mapping::projection::LidarMount;
use crate::planning::free_space::FreeSpace;
use crate::planning::greedy::ChooseWaypoint;
use crate::planning::{PlannerKind, Settings, Waypoint, square_wave};
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::sync::Arc;

/// Where the survey goes next, and the path that is flown.
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
    path: FlightPath,
}

impl Route {
    pub(super) fn new(settings: Settings, free_space: FreeSpace) -> Self {
        let path = FlightPath::new(settings.limits);
        let mut route = Self {
            settings,
            free_space: Arc::new(free_space),
            ahead: VecDeque::new(),
            steps_done: 0,
            steps_decided: 0,
            is_exhausted: false,
            path,
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
        self.path.let_go();
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
                // The way to the present waypoint can pass it now instead of stopping there.
                if self.path.is_surveying() {
                    self.survey(now);
                }
            }
            None => self.is_exhausted = true,
        }
    }

    /// Flies the survey from the present motion on; to be called again and again.
    pub(super) fn survey(&mut self, now: Stamp<Mono>) {
        let free_space = Arc::clone(&self.free_space);
        let is_free = |place: &Point<Hall>, yaw_rad: f64| {
            let waypoint = Waypoint { place: *place, yaw_rad };
            free_space.nearest(&waypoint).is_some_and(|site| free_space.is_feasible(site))
        };
        self.path.survey(self.ahead.iter(), &is_free, now);
    }

    /// Goes on to the next piece where the present one has ended.
    pub(super) fn advance(&mut self, now: Stamp<Mono>) {
        let n_reached = self.path.advance(now).min(self.ahead.len());
        self.ahead.drain(..n_reached);
        self.steps_done += n_reached;
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
        &self.settings
    }
}
