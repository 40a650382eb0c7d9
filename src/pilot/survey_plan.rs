//! Which waypoints the survey still has, when to ask for others, and when it is done.

use crate::geometry::{Hall, Point};
use crate::mapping::Mapper;
use crate::mapping::belief::CoarseField;
use crate::mapping::gaps::Gap;
use crate::mapping::projection::LidarMount;
use crate::messages::{BudgetSource, GridGeometry, VolumeAccount, VolumeEstimate};
use crate::planning::clearance::Clearance;
use crate::planning::free_space::FreeSpace;
use crate::planning::gap_way;
use crate::planning::planner::{Belief, Plan, PlanEnd, PlanRequest};
use crate::planning::way::{Demand, way_within};
use crate::planning::{PlannerKind, Settings, Waypoint};
use crate::time::{Mono, Stamp};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::sync::Arc;

/// A plan is made anew this many waypoints after the last was asked for.
const REPLAN_AFTER_STEPS: usize = 2;
/// This many waypoints stand while a plan is made: the vehicle flies on meanwhile.
const N_PENDING: usize = 2;

/// Waypoints whose ways are looked at.
const N_LOOKED_AT: usize = 10;
/// A program outside that fails so often in a row is not asked again.
const MOST_FAILURES: u32 = 3;

/// The waypoints of the survey.
#[derive(Debug, Clone)]
pub(super) struct SurveyPlan {
    settings: Settings,
    free_space: Arc<FreeSpace>,
    /// None if the surface has no field that could be weighed.
    field: Option<Arc<CoarseField>>,
    /// Decided, not reached; the first is being flown to during the survey.
    ahead: VecDeque<Waypoint>,
    steps_done: usize,
    /// Waypoints reached when the present plan was asked for.
    planned_at_step: Option<usize>,
    /// The plan that is being made.
    asked: Option<Asked>,
    /// Why no further plan is asked for.
    end: Option<PlanEnd>,
    /// Something has changed since the plan was asked for.
    is_stale: bool,
    /// Failures of the program outside since its last plan.
    n_failures: u32,
    /// The planner believes that the target is reached; the next account says whether it is.
    awaits_account: bool,
    /// The survey is kept, and this flight leads into its gaps only.
    gaps: Option<GapPasses>,
}

/// A plan that was asked for.
#[derive(Debug, Clone, Copy)]
struct Asked {
    /// Behind which waypoint it goes on.
    behind: Waypoint,
    /// Waypoints reached by then.
    at_step: usize,
}

/// Ways over the gaps of a survey, in no order yet.
type GapPasses = Vec<Vec<Waypoint>>;

/// What a plan rests on besides map and free space.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlanFacts<'a> {
    /// Where the vehicle is.
    pub(super) from: Waypoint,
    /// The newest account of the whole region.
    pub(super) whole: Option<&'a VolumeAccount>,
    /// How far the battery reaches, the way home included, m.
    pub(super) reach_m: Option<f64>,
    /// Where the way home ends.
    pub(super) over_home: Option<Point<Hall>>,
    pub(super) now: Stamp<Mono>,
}

impl SurveyPlan {
    pub(super) fn new(settings: Settings, free_space: FreeSpace, mapper: &Mapper) -> Self {
        Self {
            settings,
            free_space: Arc::new(free_space),
            field: mapper.coarse_field().ok().map(Arc::new),
            ahead: VecDeque::new(),
            steps_done: 0,
            planned_at_step: None,
            asked: None,
            end: None,
            is_stale: false,
            n_failures: 0,
            awaits_account: false,
            gaps: None,
        }
    }

    /// Forgets the last flight; the next one leads over these passes only, if there are some.
    pub(super) fn restart(&mut self, gaps: Option<GapPasses>) {
        self.gaps = gaps;
        self.ahead.clear();
        self.steps_done = 0;
        self.planned_at_step = None;
        self.asked = None;
        self.end = None;
        self.is_stale = false;
        self.n_failures = 0;
        self.awaits_account = false;
    }

    /// The whole way into the gaps, once, if that is what the flight is for. It is no job: nothing of it is
    /// searched.
    pub(super) fn plan_into_gaps(&mut self, from: &Waypoint) -> Option<Plan> {
        if self.planned_at_step.is_some() {
            return None;
        }
        let mut waypoints = gap_way::ordered(self.gaps.clone()?, from);
        waypoints.truncate(self.settings.n_steps);
        let end = if waypoints.is_empty() { PlanEnd::NothingFree } else { PlanEnd::Complete };
        self.asked = Some(Asked { behind: *from, at_step: self.steps_done });
        Some(Plan { waypoints, end, prediction: None })
    }

    /// Ways over a gap from which the vehicle could look into it.
    pub(super) fn passes_over(&self, gap: &Gap, grid: &GridGeometry) -> GapPasses {
        gap_way::passes(gap, grid, &self.settings, &self.free_space)
    }

    pub(super) const fn settings(&self) -> &Settings {
        &self.settings
    }

    pub(super) fn free_space(&self) -> Arc<FreeSpace> {
        Arc::clone(&self.free_space)
    }

    pub(super) const fn ahead(&self) -> &VecDeque<Waypoint> {
        &self.ahead
    }

    pub(super) const fn steps_done(&self) -> usize {
        self.steps_done
    }

    /// True if there is somewhere to fly.
    pub(super) fn has_somewhere_to_go(&self) -> bool {
        self.free_space.feasible().next().is_some()
    }

    /// The first waypoints ahead are reached.
    pub(super) fn reach(&mut self, n_reached: usize) {
        let n_reached = n_reached.min(self.ahead.len());
        self.ahead.drain(..n_reached);
        self.steps_done += n_reached;
    }

    /// True if the vehicle may be there.
    pub(super) fn is_free(&self, waypoint: &Waypoint) -> bool {
        self.free_space.is_free(waypoint)
    }

    /// What the vehicle keeps away from.
    pub(super) fn clearance(&self) -> &Clearance {
        self.free_space.clearance()
    }

    /// All waypoints are reached and no more will come.
    pub(super) fn is_done(&self) -> bool {
        self.ahead.is_empty() && (self.end.is_some() || self.steps_done >= self.settings.n_steps)
    }

    /// Everything that was wished for is flown; false if the planner ran out of waypoints.
    pub(super) fn is_complete(&self) -> bool {
        let is_whole =
            matches!(self.end, Some(PlanEnd::Complete | PlanEnd::Target | PlanEnd::SmallGain));
        let is_cut_short = !is_whole && self.steps_done < self.settings.n_steps;
        self.is_done() && !is_cut_short
    }

    /// Ends the survey where it is once the volume is sure enough. True if it does.
    pub(super) fn stops_at_target(&mut self, whole: &VolumeAccount) -> bool {
        self.awaits_account = false;
        let estimate = &whole.estimate;
        let is_reached = self
            .settings
            .target_ratio
            .is_some_and(|ratio| estimate.sigma_m3 <= ratio * estimate.volume_m3.abs());
        // Without a step nothing of the material was looked at on purpose; and who wants the gaps flown
        // may have known the target to be reached.
        if is_reached
            && self.gaps.is_none()
            && self.steps_done > 0
            && self.end != Some(PlanEnd::Target)
        {
            self.ahead.clear();
            self.end = Some(PlanEnd::Target);
            // A plan that is being made must not begin the survey again.
            self.asked = None;
            return true;
        }
        false
    }

    /// The plan that is to be made, if one is due and none is being made.
    pub(super) fn plan_due(
        &mut self,
        facts: &PlanFacts<'_>,
        mapper: &Mapper,
        lidar: &LidarMount,
    ) -> Option<PlanRequest> {
        if !self.is_due() {
            return None;
        }
        let PlanFacts { from, whole, reach_m, over_home, now } = *facts;
        let n_pending = self.ahead.len().min(N_PENDING);
        let pending: Vec<Waypoint> =
            std::iter::once(from).chain(self.ahead.iter().take(n_pending).copied()).collect();
        let pending_m: f64 = pending.windows(2).map(|pair| pair[0].distance_m(&pair[1])).sum();
        self.asked =
            pending.last().map(|behind| Asked { behind: *behind, at_step: self.steps_done });
        self.is_stale = false;
        Some(PlanRequest {
            settings: self.settings.clone(),
            current: self.ahead.iter().skip(n_pending).copied().collect(),
            n_waypoints: self.settings.n_steps.saturating_sub(self.steps_done + n_pending),
            longest_m: reach_m.map(|reach_m| (reach_m - pending_m).max(0.0)),
            over_home,
            pending,
            free_space: Arc::clone(&self.free_space),
            lidar: lidar.clone(),
            belief: self.belief(mapper, now),
            volume_m3: whole
                .map_or_else(|| self.nominal_volume_m3(mapper), |a| likely_most_m3(&a.estimate)),
            constant_var_m6: whole.map_or(0.0, constant_var_m6),
            accounted: whole.map(|account| account.estimate),
        })
    }

    fn is_due(&self) -> bool {
        let is_open = self.end.is_none()
            && self.gaps.is_none()
            && !self.awaits_account
            && self.steps_done + self.ahead.len().min(N_PENDING) < self.settings.n_steps;
        is_open
            && match self.settings.planner {
                PlannerKind::Greedy => self.ahead.len() < N_PENDING,
                PlannerKind::SquareWave => self.planned_at_step.is_none(),
                PlannerKind::Horizon | PlannerKind::External => {
                    self.is_stale
                        || self.ahead.is_empty()
                        || self
                            .planned_at_step
                            .is_none_or(|step| self.steps_done >= step + REPLAN_AFTER_STEPS)
                }
            }
    }

    fn belief(&self, mapper: &Mapper, now: Stamp<Mono>) -> Belief {
        match (&self.field, self.settings.planner) {
            (Some(field), PlannerKind::SquareWave | PlannerKind::Horizon) => Belief::Field {
                field: Arc::clone(field),
                surface: Box::new(mapper.snapshot(now, false)),
            },
            _ => Belief::Grid {
                cells: Box::new(mapper.grid().clone()),
                areas_m2: mapper.base().cell_areas_m2.clone().into(),
            },
        }
    }

    /// The volume that the nominal height would have, m³.
    fn nominal_volume_m3(&self, mapper: &Mapper) -> f64 {
        let n_cells = mapper.grid().geometry().n_cells();
        mapper.base().volume_m3(&vec![self.settings.nominal_height_m; n_cells])
    }

    /// Takes in a plan. False if the vehicle has left the place from which it goes on.
    pub(super) fn on_plan(&mut self, plan: &Plan) -> bool {
        let Some(asked) = self.asked.take() else { return false };
        let place = self.ahead.iter().position(|waypoint| *waypoint == asked.behind);
        match place {
            Some(place) => self.ahead.truncate(place + 1),
            // It was asked for while nothing was ahead.
            None if self.ahead.is_empty() => {}
            None => return false,
        }
        self.ahead.extend(plan.waypoints.iter().copied());
        self.planned_at_step = Some(asked.at_step);
        self.n_failures = 0;
        // A search goes on to better what it found; the others stand by their word.
        self.end = match (self.settings.planner, plan.end) {
            // A search is asked again; and whether the target is reached is the account's to say.
            (_, PlanEnd::Open) | (PlannerKind::Horizon, PlanEnd::Target) => None,
            (PlannerKind::Horizon, PlanEnd::Budget) if !self.ahead.is_empty() => None,
            (_, end) => Some(end),
        };
        self.awaits_account = self.settings.planner == PlannerKind::Horizon
            && plan.end == PlanEnd::Target
            && self.ahead.is_empty();
        true
    }

    /// True if nothing is flown until the next account is there.
    pub(super) const fn awaits_account(&self) -> bool {
        self.awaits_account
    }

    /// Something has changed that the plan did not know: a search is asked again at once, even if it
    /// had found that more flying hardly pays.
    pub(super) fn ask_anew(&mut self) {
        self.is_stale = true;
        if self.end == Some(PlanEnd::SmallGain) {
            self.end = None;
        }
    }

    /// The waypoints ahead are not flown any more: a search goes on from where the vehicle is. What was
    /// laid out once and for all stays.
    pub(super) fn ask_from_here(&mut self) {
        self.ask_anew();
        if self.gaps.is_none()
            && matches!(self.settings.planner, PlannerKind::Horizon | PlannerKind::External)
        {
            self.ahead.clear();
            // A plan that is being made goes on from elsewhere.
            self.asked = None;
        }
    }

    /// A program outside gave no plan: what is ahead stands, and it is asked again. False once that has
    /// happened too often.
    pub(super) fn on_failure(&mut self) -> bool {
        self.asked = None;
        self.n_failures += 1;
        if self.n_failures >= MOST_FAILURES {
            self.end = Some(PlanEnd::NothingFree);
        }
        self.end.is_none()
    }

    /// The planner gave nothing.
    pub(super) fn on_no_plan(&mut self) {
        self.asked = None;
        self.end = Some(PlanEnd::NothingFree);
    }

    /// The corners of a way around what stands between, its end included: where fixes are good all
    /// along if there is such a way, else where nothing is touched; `None` without any.
    pub(super) fn way(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<Vec<Vector3<f64>>> {
        let at = |place: &Vector3<f64>| Waypoint {
            place: Point::from_coords(*place),
            yaw_rad: self.settings.yaw_rad,
        };
        let (from, to) = (at(from), at(to));
        let of = |demand| way_within(&self.free_space, &from, &to, demand);
        let found = of(Demand::Free).or_else(|| of(Demand::Clear))?;
        Some(found.iter().map(|waypoint| waypoint.place.coords).collect())
    }

    /// Puts the way around what stands between two waypoints that come next in front of the second;
    /// a waypoint to which there is no way is left out.
    pub(super) fn go_around(&mut self, from: &Vector3<f64>) {
        let later = self.ahead.split_off(self.ahead.len().min(N_LOOKED_AT));
        let mut before = *from;
        for next in std::mem::take(&mut self.ahead) {
            let place = next.place.coords;
            if self.free_space.clearance().is_way_clear(&before, &place) {
                self.ahead.push_back(next);
                before = place;
            } else if let Some(corners) = self.way(&before, &place) {
                let corner = |place| Waypoint { place: Point::from_coords(place), ..next };
                self.ahead.extend(corners.into_iter().map(corner));
                before = place;
            }
        }
        self.ahead.extend(later);
    }
}

/// As much material as there may well be, m³: the target is a share of it. An early account is too low
/// as often as too high; a plan for too small a target goes into corners that nobody needs, and one
/// for too large a target is only made longer by the next.
fn likely_most_m3(estimate: &VolumeEstimate) -> f64 {
    estimate.volume_m3.abs() + estimate.sigma_m3
}

/// Variance of the volume that no flight changes: calibration, markers, base. The density concerns
/// tonnes only.
fn constant_var_m6(account: &VolumeAccount) -> f64 {
    let constant = [
        BudgetSource::LidarMounting,
        BudgetSource::RangeBias,
        BudgetSource::RangeScale,
        BudgetSource::ClockOffset,
        BudgetSource::MarkerMap,
        BudgetSource::Base,
    ];
    let rows = account.budget.rows.iter();
    rows.filter(|row| constant.contains(&row.source)).map(|row| row.var_m6).sum()
}
