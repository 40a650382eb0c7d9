//! Between mission and vehicle: what the mission is told, and what its phases make of the trajectory.

use super::gap_offer::GapOffer;
use super::plan_news::PlanNews;
use super::sight::carried_on;
use super::{Action, Ending, FlownPath, PhaseChange, Pilot, say};
use crate::geometry::{Hall, Point};
use crate::messages::{NavEstimate, OperatorAnswer, OperatorCommand, Severity, TagDetections};
use crate::mission::{Effect, Inputs, Phase};
use crate::planning::Waypoint;
use crate::planning::trajectory::Knot;
use crate::time::{Mono, Stamp};
use crate::units::wrapped_rad;
use nalgebra::Vector3;
use std::time::Duration;

/// Setpoints are sampled this long ahead: half of the 33 ms that each is in force, and what link
/// and autopilot take until they act on it. Without it the vehicle lags 7 cm behind at 2 m/s.
const STEER_LEAD: Duration = Duration::from_millis(30);
/// Without a beam of a turning head for this long the LiDAR counts as silent …
const LIDAR_SILENT_AFTER: Duration = Duration::from_secs(2);
/// … and as long without one that measures something: dark or wet ground may swallow them for a while.
const LIDAR_BLIND_AFTER: Duration = Duration::from_secs(5);
/// An older battery message says nothing; PX4 sends one every two seconds.
const BATTERY_OLD_AFTER: Duration = Duration::from_secs(10);
/// The end of a trajectory counts as reached within this distance, m.
const AT_TARGET_M: f64 = 0.3;
/// Disagreements beyond this are told as this, m: squares of absurd places are no numbers.
const FARTHEST_OFF_M: f64 = 10_000.0;
/// An older word of the autopilot on its place is not compared with the own one.
const DISAGREEMENT_OLD_AFTER: Duration = Duration::from_secs(1);
/// After a declared jump further than this, m, the trajectory begins anew where the vehicle is.
const JUMP_FOLLOWED_M: f64 = 0.3;
/// An own place older than this says nothing of where the vehicle is now: at 2 m/s, 0.3 m.
const PLACE_OLD_AFTER: Duration = Duration::from_millis(150);
/// An older place is of no use to the autopilot: its filter looks back no further.
const ODOMETRY_OLD_AFTER: Duration = Duration::from_millis(300);
/// Frames are looked at by themselves once samples are this old: two of them take their time, and an
/// autopilot that hears nothing for 0.4 s stops fusing.
const LOOKED_AFTER: Duration = Duration::from_millis(150);
/// Without an inertial sample for this long there are none.
const SAMPLES_SILENT_AFTER: Duration = Duration::from_secs(1);
/// Speed of a landing that the autopilot flies, m/s.
const LANDING_MPS: f64 = 0.5;

/// The pose that the autopilot told, against the own one of that instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disagreement {
    at: Stamp<Mono>,
    off_m: f64,
    /// Its heading minus the own one, rad; `None` where it told none.
    turned_rad: Option<f64>,
}

impl Pilot {
    pub(super) fn watch_samples(&mut self, actions: &mut Vec<Action>) {
        let newest = self.localizer.last_sample_at();
        if let Some(age) = self.sample_lag.look(self.now, newest) {
            let text = format!("autopilot's samples are {:.2} s old", age.as_secs_f64());
            say(actions, Severity::Warning, text);
        }
    }

    pub(super) fn on_operator(&mut self, command: OperatorCommand, actions: &mut Vec<Action>) {
        let mut effects = Vec::new();
        let inputs = self.mission_inputs();
        // The last survey's volumes would be taken for those of the next one.
        let is_too_early = command.verb.is_start() && self.ending.is_some();
        if is_too_early {
            let text = "no start yet: the last survey is still being computed".to_owned();
            say(actions, Severity::Warning, text);
        }
        let is_accepted =
            !is_too_early && self.mission.on_operator(command.verb, &inputs, &mut effects);
        self.apply(effects, actions);
        actions.push(Action::Answer(OperatorAnswer {
            verb: command.verb,
            to: command.from,
            is_accepted,
        }));
    }

    pub(super) fn run_mission(&mut self, actions: &mut Vec<Action>) {
        let mut effects = Vec::new();
        let inputs = self.mission_inputs();
        self.mission.step(&inputs, &mut effects);
        self.apply(effects, actions);
    }

    pub(super) fn mission_inputs(&self) -> Inputs {
        Inputs {
            now: self.now,
            vehicle: self.vehicle,
            is_autopilot_lost: self.is_autopilot_lost,
            has_position: self.localizer.is_trusted(self.now) && !self.sample_lag.is_late(),
            is_late: self.sample_lag.is_late(),
            has_samples: self
                .localizer
                .last_sample_at()
                .is_some_and(|at| self.now.since(at) < SAMPLES_SILENT_AFTER),
            has_lidar: self.measures(),
            battery_ratio: self
                .battery
                .filter(|battery| self.now.since(battery.at) < BATTERY_OLD_AFTER)
                .map(|battery| battery.remaining_ratio),
            battery_heard_at: self.battery.map(|battery| battery.at),
            has_plan: self.route.plan.has_somewhere_to_go(),
            is_plan_done: self.route.plan.is_done(),
            is_plan_complete: self.route.plan.is_complete(),
            has_gaps: self.ending.is_none() && !self.gaps.is_empty(),
            heading_error_rad: self.localizer.pose().map(|hall_from_body| {
                let yaw_rad = hall_from_body.rotation.yaw_rad();
                wrapped_rad(yaw_rad - self.route.settings().yaw_rad)
            }),
            position_sigma_m: self.localizer.position_sigma_m(),
            disagreement_m: self.recent_disagreement().map(|told| told.off_m),
            heading_disagreement_rad: self.recent_disagreement().and_then(|told| told.turned_rad),
            intrusion_m: self.intrusion_m(),
            off_track_m: self.off_track_now_m(),
            strayed_m: self.strayed_m,
            way_home_ratio: self.way_home_ratio(),
            height_over_home_m: self
                .localizer
                .pose()
                .zip(self.home)
                .map(|(hall_from_body, home)| hall_from_body.origin.coords.z - home.coords.z),
            is_trajectory_over: self.route.path().reached_end(self.now).is_some(),
            is_at_target: self.is_at_target(),
            storage: self.storage,
        }
    }

    /// True while the LiDAR measures something.
    fn measures(&self) -> bool {
        let is_recent =
            |at: Option<Stamp<Mono>>, within| at.is_some_and(|at| self.now.since(at) < within);
        is_recent(self.last_turn_at, LIDAR_SILENT_AFTER)
            && is_recent(self.last_beam_at, LIDAR_BLIND_AFTER)
    }

    /// Compares the two poses once the inertial samples have reached the autopilot's instant.
    pub(super) fn compare_with_autopilot(&mut self) {
        let Some(pose) = self.autopilot_pose else { return };
        if let Some((own, _)) = self.localizer.pose_at(pose.at) {
            let off_m = (pose.position.coords - own.origin.coords).norm().min(FARTHEST_OFF_M);
            let turned_rad = pose
                .hall_from_body_rot
                .map(|rotation| wrapped_rad(rotation.yaw_rad() - own.rotation.yaw_rad()));
            self.disagreement = Some(Disagreement { at: pose.at, off_m, turned_rad });
            self.autopilot_pose = None;
        }
    }

    fn recent_disagreement(&self) -> Option<Disagreement> {
        self.disagreement.filter(|told| self.now.since(told.at) < DISAGREEMENT_OLD_AFTER)
    }

    /// By how much the vehicle is nearer to anything than its trajectory, beyond what is demanded.
    fn intrusion_m(&self) -> f64 {
        let Some((place, planned)) = self.place_and_plan() else { return 0.0 };
        let clearance = self.route.plan.clearance();
        let is_at = clearance.shortfall(&place, &place);
        let is_planned = clearance.shortfall(&planned, &planned);
        let beyond =
            |at_m: f64, planned_m: f64| if at_m > planned_m { at_m - planned_m } else { 0.0 };
        beyond(is_at.around_m, is_planned.around_m).max(beyond(is_at.below_m, is_planned.below_m))
    }

    /// Where the vehicle was with the newest inertial sample, and where its trajectory had it then, m.
    fn place_and_plan(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let (place, at) = self.localizer.pose().zip(self.localizer.last_sample_at())?;
        let trajectory = self.route.path().trajectory()?;
        Some((place.origin.coords, trajectory.knot_at(at).position))
    }

    /// Distance from where the trajectory had the vehicle, at the newest inertial sample, m.
    fn off_track_m(&self) -> Option<f64> {
        self.place_and_plan().map(|(place, planned)| (place - planned).norm())
    }

    /// The same where that sample is of now.
    fn off_track_now_m(&self) -> Option<f64> {
        let is_new = |at| self.now.since(at) < PLACE_OLD_AFTER;
        self.off_track_m().filter(|_| self.localizer.last_sample_at().is_some_and(is_new))
    }

    /// Charge for the way over the pad and down, at the consumption so far.
    fn way_home_ratio(&self) -> Option<f64> {
        let place = self.localizer.pose()?.origin.coords;
        let over_home = self.above(&self.home?).place.coords;
        let way_s = (over_home - place).norm() / self.route.settings().limits.speed_mps;
        let landing_s = over_home.z / LANDING_MPS;
        self.energy.charge_for(way_s + landing_s)
    }

    /// After a declared jump of the own place the trajectory leads from where the vehicle was
    /// thought to be; and in a hold nothing is worth flying back to where the vehicle is not.
    pub(super) fn follow_vehicle(&mut self) {
        self.strayed_m = None;
        let Some(estimate) = self.localizer.estimate() else { return };
        let has_jumped = estimate.reset_counter != self.reset_counter;
        if has_jumped {
            self.reset_counter = estimate.reset_counter;
            self.disagreement = None;
            self.autopilot_pose = None;
        }
        if !self.mission.is_steering() {
            return;
        }
        if has_jumped {
            if self.off_track_m().is_some_and(|off_m| off_m > JUMP_FOLLOWED_M) {
                let motion = self.motion(&estimate);
                self.route.path_mut().stop_from(&motion, self.now);
                self.go_on_over_home();
            }
        } else if self.phase() == Phase::Hold {
            let held_within_m = self.settings.mission.max_off_track_m;
            let strayed_m = self.off_track_now_m().filter(|off_m| *off_m > held_within_m);
            if strayed_m.is_some() && self.stops_where_it_is() {
                self.strayed_m = strayed_m;
            }
        }
    }

    /// On the ways up and home: flies on from where it is.
    fn go_on_over_home(&mut self) {
        let over_home = self.home.map(|home| self.above(&home));
        if let (Phase::TakeOff | Phase::Return, Some(over_home)) = (self.phase(), over_home) {
            self.route.go_to(over_home, self.now);
        }
    }

    /// Has the trajectory stop from the motion that the vehicle really has. Not where that would end
    /// nearer to something than it may be: from there it is led back to where it was meant to be.
    /// True if so.
    fn stops_where_it_is(&mut self) -> bool {
        let Some(estimate) = self.trusted_estimate() else { return false };
        let motion = self.motion(&estimate);
        let mut path = self.route.path().clone();
        path.stop_from(&motion, self.now);
        let Some(end) = path.trajectory().map(|trajectory| trajectory.end().position) else {
            return false;
        };
        let is_clear = self.route.plan.clearance().is_way_clear(&motion.position, &end);
        if is_clear {
            *self.route.path_mut() = path;
        }
        is_clear
    }

    /// The motion that the vehicle has now: a trajectory that began at rest would shoot past it and be
    /// pulled back faster than anything that is planned.
    fn motion(&self, estimate: &NavEstimate) -> Knot {
        let planning = self.route.settings();
        let velocity = estimate.velocity_mps.coords.cap_magnitude(planning.limits.speed_mps);
        let age = self.now.since(estimate.at).min(PLACE_OLD_AFTER);
        let place = estimate.hall_from_body.origin.coords + velocity * age.as_secs_f64();
        Knot::steady(place, velocity, planning.yaw_rad)
    }

    fn is_at_target(&self) -> bool {
        let place = self.localizer.pose().map(|hall_from_body| hall_from_body.origin);
        self.route
            .path()
            .reached_end(self.now)
            .zip(place)
            .is_some_and(|(end, place)| (place.coords - end.position).norm() < AT_TARGET_M)
    }

    fn apply(&mut self, effects: Vec<Effect>, actions: &mut Vec<Action>) {
        for effect in effects {
            match effect {
                Effect::Command(command) => actions.push(Action::Command(command)),
                Effect::Say(severity, text) => say(actions, severity, text),
                Effect::Lifted => self.take_over_climb(),
                Effect::Enter { from, to, reason } => {
                    self.enter(from, to);
                    let change = PhaseChange { at: self.now, from, to, reason };
                    actions.push(Action::PhaseChanged(change));
                }
                Effect::Ended { is_complete } => {
                    self.ending = Some(Ending {
                        is_complete,
                        steps_done: self.route.plan.steps_done(),
                        path_length_m: self.flown.length_m,
                    });
                    self.start_solve(true, actions);
                }
            }
        }
    }

    /// Turns the trajectory to what the new phase is for.
    fn enter(&mut self, from: Phase, to: Phase) {
        let here = self.localizer.pose().map(|hall_from_body| hall_from_body.origin);
        match to {
            Phase::Preflight => {
                if self.mission.is_into_gaps() {
                    self.route.restart(Some(self.gaps.passes()));
                } else {
                    // The next survey measures anew: the material may have moved.
                    self.mapper.restart();
                    self.accounts.clear();
                    self.told_disturbed_m2 = 0.0;
                    self.gaps = GapOffer::default();
                    self.route.restart(None);
                }
                self.told_plan = PlanNews::default();
                self.jobs.plan = None;
                self.flown = FlownPath::default();
                self.energy.restart();
                self.home = here;
                if let Some(place) = here {
                    self.stand(place);
                }
            }
            Phase::TakeOff => {
                // The pose has settled since the preflight began; fly from where it is now.
                if let Some(place) = here.filter(|_| from == Phase::Preflight) {
                    self.home = Some(place);
                    self.stand(place);
                }
                if let Some(over_home) = self.home.map(|home| self.above(&home)) {
                    self.route.go_to(over_home, self.now);
                }
            }
            Phase::Return => {
                if let Some(over_home) = self.home.map(|home| self.above(&home)) {
                    self.route.go_to(over_home, self.now);
                }
            }
            Phase::Hold => {
                let is_off = self.off_track_now_m().is_some_and(|off_m| off_m > JUMP_FOLLOWED_M);
                if !(is_off && self.stops_where_it_is()) {
                    self.route.path_mut().brake(self.now);
                }
            }
            Phase::Idle | Phase::Land | Phase::Abort => self.route.path_mut().let_go(),
            // Where the flight was broken off the plan may not lead any more.
            Phase::Survey if from == Phase::Hold => self.route.plan.ask_from_here(),
            Phase::Survey => {}
        }
    }

    /// A command has lifted the vehicle: climb on from where it is.
    fn take_over_climb(&mut self) {
        let Some(hall_from_body) = self.localizer.pose() else { return };
        self.stand(hall_from_body.origin);
        if let Some(over_home) = self.home.map(|home| self.above(&home)) {
            self.route.go_to(over_home, self.now);
        }
    }

    /// The place over `place` at the height of the flight, with the usual heading.
    pub(super) fn above(&self, place: &Point<Hall>) -> Waypoint {
        let planning = self.route.settings();
        let place = Point::new(place.coords.x, place.coords.y, planning.height_m);
        Waypoint { place, yaw_rad: planning.yaw_rad }
    }

    /// Stands at a place with the usual heading.
    fn stand(&mut self, place: Point<Hall>) {
        let yaw_rad = self.route.settings().yaw_rad;
        self.route.path_mut().stand(&Waypoint { place, yaw_rad }, self.now);
    }

    pub(super) fn steer(&mut self, actions: &mut Vec<Action>) {
        if !self.mission.is_steering() {
            return;
        }
        if self.route.path().trajectory().is_none()
            && let Some(hall_from_body) = self.localizer.pose()
        {
            self.stand(hall_from_body.origin);
        }
        let Some(trajectory) = self.route.path().trajectory() else { return };
        let setpoint = trajectory.setpoint_at(self.now.plus(STEER_LEAD));
        if setpoint.is_finite() {
            self.flown.go_on(&setpoint.position.coords);
            actions.push(Action::Steer(setpoint));
        }
    }

    /// Tells the autopilot where the vehicle is. A place of the past would be fused as one of now by an
    /// autopilot that goes by the arrival, and a stamp that goes back would be dropped.
    pub(super) fn publish_odometry(&mut self, actions: &mut Vec<Action>) {
        if let Some(belief) = self.new_belief() {
            self.published_at = Some(belief.at);
            let told = self.of_now(belief);
            self.sight.note_told(&told);
            actions.push(Action::PublishOdometry(Box::new(told)));
        } else if let Some(told) = self.told_by_sight() {
            self.sight.note_told(&told);
            actions.push(Action::PublishSight(Box::new(told)));
        }
    }

    /// A late belief carried on to now; one that is in time again only past what was told already.
    fn of_now(&self, belief: NavEstimate) -> NavEstimate {
        let after_told = self.sight.told_until().map(|told| told.plus(Duration::from_millis(1)));
        if self.sample_lag.is_late() {
            carried_on(belief, self.now)
        } else if let Some(after_told) = after_told.filter(|after_told| belief.at < *after_told) {
            carried_on(belief, after_told)
        } else {
            belief
        }
    }

    /// The belief, if it can be flown on, is not too old, and was not published before.
    fn new_belief(&self) -> Option<NavEstimate> {
        self.trusted_estimate().filter(|estimate| {
            let is_new = self.published_at.is_none_or(|last| estimate.at > last);
            is_new && self.now.since(estimate.at) < ODOMETRY_OLD_AFTER
        })
    }

    /// Keeps what a frame shows by itself, as soon as it may be needed.
    pub(super) fn look_by_sight(&mut self, frame: &TagDetections) {
        if !self.goes_by_sight(LOOKED_AFTER) {
            return;
        }
        let by_filter = || {
            let pose = self.localizer.pose()?;
            Some(pose.rotation.inverse().quaternion() * -Vector3::z())
        };
        let by_sight = self.sight.down_body(frame.camera, self.now, ODOMETRY_OLD_AFTER);
        let down_body = by_sight.or_else(by_filter);
        if let Some(fix) = down_body.and_then(|down| self.localizer.pose_by_sight(frame, &down)) {
            self.sight.take(frame.captured_at, frame.camera, fix);
        }
    }

    /// What frames show, while only they say where the vehicle is, to an autopilot that goes by it.
    fn told_by_sight(&mut self) -> Option<NavEstimate> {
        if !self.goes_by_sight(ODOMETRY_OLD_AFTER) {
            return None;
        }
        let most_sigma_m = self.settings.localization.lost_sigma_m;
        let told = self.sight.tell(self.now, ODOMETRY_OLD_AFTER, most_sigma_m, self.reset_counter);
        told.filter(NavEstimate::is_finite)
    }

    /// True in flight, while the samples are older than this and the autopilot goes by a place from here.
    fn goes_by_sight(&self, age: Duration) -> bool {
        let is_old = |at| self.now.since(at) >= age;
        self.vehicle.is_some_and(|vehicle| vehicle.is_armed)
            && self.sight.is_followed(self.now)
            && self.localizer.last_sample_at().is_some_and(is_old)
    }

    /// The belief, if it can be flown on.
    pub(super) fn trusted_estimate(&self) -> Option<NavEstimate> {
        let is_trusted = self.localizer.is_trusted(self.now);
        let estimate = is_trusted.then(|| self.localizer.estimate()).flatten();
        estimate.filter(NavEstimate::is_finite)
    }
}

impl FlownPath {
    fn go_on(&mut self, place: &Vector3<f64>) {
        if let Some(last) = self.last {
            self.length_m += (place - last).norm();
        }
        self.last = Some(*place);
    }
}
