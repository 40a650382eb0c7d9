//! Solves and plans: when they begin, and what follows from their results.

use super::gap_offer::GapOffer;
use super::survey_plan::PlanFacts;
use super::{Action, FlightSummary, Job, JobId, JobOutput, Pilot, PlanChoice, VolumeReport, say};
use crate::geometry::Point;
use crate::mapping::{SolveError, SolvedSurface};
use crate::messages::{DisturbedArea, Severity};
use crate::mission::Phase;
use crate::planning::Waypoint;
use crate::planning::planner::Plan;
use crate::units::wrapped_rad;

/// Smaller disturbed areas are not told of, m².
const LEAST_DISTURBED_M2: f64 = 0.5;

impl Pilot {
    pub(super) fn solve_if_due(&mut self, actions: &mut Vec<Action>) {
        let is_measuring =
            matches!(self.mission.phase(), Phase::Survey | Phase::Return | Phase::Hold);
        let is_due = self.now.since(self.jobs.last_solve_at) >= self.settings.solve_interval
            || self.route.plan.awaits_account();
        if is_measuring && is_due && self.jobs.solve.is_none() {
            self.start_solve(false, actions);
        }
    }

    pub(super) fn start_solve(&mut self, is_final: bool, actions: &mut Vec<Action>) {
        let id = self.new_job_id();
        self.jobs.solve = Some(id);
        self.jobs.last_solve_at = self.now;
        self.jobs.is_final_solve = is_final;
        let job = Job::SolveSurface(self.mapper.snapshot(self.now, is_final));
        actions.push(Action::Start { id, job: Box::new(job) });
    }

    /// Asks for waypoints; the first ones while the vehicle still climbs.
    pub(super) fn plan_if_due(&mut self, actions: &mut Vec<Action>) {
        if self.jobs.plan.is_some() {
            return;
        }
        let from = match self.mission.phase() {
            Phase::TakeOff => self.home.map(|home| self.above(&home)),
            Phase::Survey => self.route.path().trajectory().map(|trajectory| {
                let knot = trajectory.knot_at(self.now);
                Waypoint {
                    place: Point::from_coords(knot.position),
                    yaw_rad: wrapped_rad(knot.yaw.angle_rad),
                }
            }),
            _ => None,
        };
        let Some(from) = from else { return };
        if let Some(plan) = self.route.plan.plan_into_gaps(&from) {
            self.on_planned(&plan, actions);
            return;
        }
        let lidar = &self.settings.mapping.lidar;
        let whole = self.accounts.first();
        // The way home ends with what the mission would return on.
        let reserve_ratio = self.settings.mission.return_battery_ratio;
        let reach_m = self.energy.reach_m(reserve_ratio);
        let over_home = self.home.map(|home| self.above(&home).place);
        let facts = PlanFacts { from, whole, reach_m, over_home, now: self.now };
        if let Some(request) = self.route.plan.plan_due(&facts, &self.mapper, lidar) {
            let id = self.new_job_id();
            self.jobs.plan = Some(id);
            actions.push(Action::Start { id, job: Box::new(Job::Plan(Box::new(request))) });
        }
    }

    fn new_job_id(&mut self) -> JobId {
        let id = JobId(self.jobs.next_id);
        self.jobs.next_id += 1;
        id
    }

    pub(super) fn on_finished(&mut self, id: JobId, output: JobOutput, actions: &mut Vec<Action>) {
        match output {
            JobOutput::Planned(plan) if self.jobs.plan == Some(id) => {
                self.jobs.plan = None;
                self.on_planned(&plan, actions);
            }
            JobOutput::SurfaceSolved(solved) if self.jobs.solve == Some(id) => {
                self.jobs.solve = None;
                self.on_solved(solved, actions);
            }
            JobOutput::PlannedOutside(found) if self.jobs.plan == Some(id) => {
                self.jobs.plan = None;
                self.on_planned_outside(found, actions);
            }
            JobOutput::Died => self.on_died(id, actions),
            // A job that a later one has replaced.
            JobOutput::Planned(_) | JobOutput::PlannedOutside(_) | JobOutput::SurfaceSolved(_) => {}
        }
    }

    /// Flies a plan, and lets everybody know what it is expected to lead to.
    fn on_planned(&mut self, plan: &Plan, actions: &mut Vec<Action>) {
        if !self.route.on_plan(plan, self.now) {
            return;
        }
        let ahead: Vec<Waypoint> = self.route.plan.ahead().iter().copied().collect();
        let choice = PlanChoice { at: self.now, ahead, end: plan.end, prediction: plan.prediction };
        if let Some(text) = self.told_plan.news(&choice, self.accounts.first()) {
            say(actions, Severity::Info, text);
        }
        actions.push(Action::PlanChosen(Box::new(choice)));
    }

    /// Takes in what a program outside has planned, or tells the people that it failed.
    fn on_planned_outside(&mut self, found: Result<Plan, String>, actions: &mut Vec<Action>) {
        match found {
            Ok(plan) => self.on_planned(&plan, actions),
            Err(reason) => {
                let is_asked_again = self.route.plan.on_failure();
                let then = if is_asked_again { "asking again" } else { "ending the survey" };
                let text = format!("the planner outside failed: {reason}: {then}");
                say(actions, Severity::Error, text);
            }
        }
    }

    /// Goes on without the result of a job: no more waypoints, or the last volume.
    fn on_died(&mut self, id: JobId, actions: &mut Vec<Action>) {
        if self.jobs.plan == Some(id) {
            self.jobs.plan = None;
            self.route.plan.on_no_plan();
            say(actions, Severity::Error, "the planner died: ending the survey".to_owned());
        } else if self.jobs.solve == Some(id) {
            self.jobs.solve = None;
            say(actions, Severity::Error, "the surface could not be solved".to_owned());
            self.end_if_final(false, actions);
        }
    }

    fn on_solved(&mut self, solved: Result<SolvedSurface, SolveError>, actions: &mut Vec<Action>) {
        let is_solved = solved.is_ok();
        match solved {
            Ok(solved) => {
                self.mapper.absorb(&solved);
                self.tell_of_disturbed(&solved.disturbed, actions);
                self.accounts.clone_from(&solved.accounts);
                self.offer_gaps(&solved, actions);
                self.stop_at_target(actions);
                actions.push(Action::VolumesAccounted(solved.accounts));
                actions.push(Action::SurfaceSolved(Box::new(solved.surface)));
            }
            Err(error) => say(actions, Severity::Error, format!("no surface: {error}")),
        }
        self.end_if_final(is_solved, actions);
    }

    /// After landing: which gaps another flight could close.
    fn offer_gaps(&mut self, solved: &SolvedSurface, actions: &mut Vec<Action>) {
        if !self.jobs.is_final_solve {
            return;
        }
        let bay_at = |[x_m, y_m]: [f64; 2]| self.mapper.bay_at(x_m, y_m).map(str::to_owned);
        self.gaps = GapOffer::new(solved, &self.route.plan, bay_at);
        if let Some(text) = self.gaps.news() {
            say(actions, Severity::Notice, text);
        }
    }

    /// Tells the people that something moves in the hall: when it begins, each time it has doubled, and
    /// what is left of it in the end.
    fn tell_of_disturbed(&mut self, areas: &[DisturbedArea], actions: &mut Vec<Action>) {
        let Some(largest) = areas.first() else { return };
        let area_m2: f64 = areas.iter().map(|area| area.area_m2).sum();
        let is_more = area_m2 >= LEAST_DISTURBED_M2.max(2.0 * self.told_disturbed_m2);
        if is_more || (self.jobs.is_final_solve && area_m2 >= LEAST_DISTURBED_M2) {
            self.told_disturbed_m2 = area_m2;
            self.route.plan.ask_anew();
            let [x_m, y_m] = largest.centre_m;
            let bay = self.mapper.bay_at(x_m, y_m).map_or_else(String::new, |b| format!(" in {b}"));
            let text = format!(
                "something moved: {area_m2:.1} m2 not measured since, most near x {x_m:.1} y {y_m:.1} m{bay}"
            );
            say(actions, Severity::Warning, text);
        }
    }

    /// Ends the survey once the volume is sure enough.
    fn stop_at_target(&mut self, actions: &mut Vec<Action>) {
        let is_surveying = self.mission.phase() == Phase::Survey;
        let Some(whole) = self.accounts.first().filter(|_| is_surveying) else { return };
        if self.route.plan.stops_at_target(whole) {
            let percent = 100.0 * whole.estimate.sigma_m3 / whole.estimate.volume_m3;
            say(actions, Severity::Info, format!("volume known to {percent:.2} %: survey ends"));
        }
    }

    /// After the last solve of a flight: the final report, or word that there is none.
    fn end_if_final(&mut self, is_solved: bool, actions: &mut Vec<Action>) {
        if !self.jobs.is_final_solve {
            return;
        }
        if let Some(ending) = self.ending.take() {
            if self.accounts.is_empty() {
                self.accounts = self.mapper.cell_volumes(self.now);
            }
            if is_solved {
                self.report(true, actions);
            } else {
                let text =
                    "no final volume: `stockpilot merge` with the log tries again".to_owned();
                say(actions, Severity::Error, text);
            }
            actions.push(Action::Ended(Box::new(FlightSummary {
                at: self.now,
                volume: self.accounts[0].estimate,
                accounts: self.accounts.clone(),
                hits: self.mapper.counts(),
                steps_done: ending.steps_done,
                path_length_m: ending.path_length_m,
                is_complete: ending.is_complete,
                is_final: is_solved,
            })));
        }
    }

    pub(super) fn report(&self, is_final: bool, actions: &mut Vec<Action>) {
        let Some(estimate) = self.accounts.first().map(|account| account.estimate) else { return };
        actions.push(Action::ReportVolume(VolumeReport {
            estimate,
            hits: self.mapper.counts(),
            phase: self.mission.phase(),
            steps_done: self.route.plan.steps_done(),
            battery_ratio: self.battery.map(|battery| battery.remaining_ratio),
            position_sigma_m: self.localizer.position_sigma_m(),
            is_final,
        }));
    }
}
