//! The brain: wires localisation, mapping, planning and mission, and owns their state.
//!
//! It does no I/O and never asks for the time: one [`Event`] goes in, [`Action`]s come out. The
//! same events give the same actions, bit for bit, behind real sensors, in the simulator and in
//! a replay.
//!
//! ```text
//! Imu, TagsSeen ─▶ localizer ─ pose ─▶ mapper ◀─ Scanned
//!                      │                 │ snapshot ─▶ Start(SolveSurface) ┄▶ Finished ─▶ volume
//! Vehicle, Battery, Operator ─▶ mission ─ phase ─▶ route ─▶ Steer
//! ```

mod event;
mod flight_path;
mod gap_offer;
mod intake;
mod job;
mod outlook;
mod plan_news;
mod route;
mod sample_lag;
mod storage_news;
mod survey_plan;

pub use event::{Action, Event, FlightSummary, JobId, PhaseChange, PlanChoice, VolumeReport};
pub use gap_offer::OfferedGap;
pub use job::{Job, JobOutput};
pub use outlook::Outlook;

use crate::geometry::{Hall, Point};
use crate::localization::{self, Localizer};
use crate::mapping::{self, Mapper, SolveError, SolvedSurface};
use crate::messages::{
    AutopilotPose, BatterySample, DisturbedArea, NavEstimate, OperatorAnswer, OperatorCommand,
    Scan, ScanCorrection, Severity, StatusText, StorageState, VehicleState, VolumeAccount,
};
use crate::mission::{self, Effect, EnergyGauge, Inputs, Mission, Phase};
use crate::planning;
use crate::planning::Waypoint;
use crate::planning::free_space::FreeSpace;
use crate::planning::planner::Plan;
use crate::planning::trajectory::Knot;
use crate::time::{Mono, Stamp};
use crate::units::wrapped_rad;
use gap_offer::GapOffer;
use intake::FrameWatch;
use nalgebra::Vector3;
use plan_news::PlanNews;
use route::Route;
use sample_lag::SampleLag;
use std::collections::VecDeque;
use std::time::Duration;
use survey_plan::{PlanFacts, SurveyPlan};

/// How often the brain wants [`Event::Ticked`], Hz. Odd ticks steer, even ones publish odometry.
pub const TICK_RATE_HZ: u32 = 60;

/// What the brain needs to know before a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Cameras, markers, filter.
    pub localization: localization::Settings,
    /// Region, LiDAR, surface.
    pub mapping: mapping::Settings,
    /// Planner, height, limits.
    pub planning: planning::Settings,
    /// Times and levels of the mission.
    pub mission: mission::Settings,
    /// What is known to be wrong with every beam.
    pub scan_correction: ScanCorrection,
    /// The surface is solved this often in flight.
    pub solve_interval: Duration,
    /// The volume is reported this often.
    pub report_interval: Duration,
}

/// Setpoints are sampled this long ahead: half of the 33 ms that each is in force, and what link
/// and autopilot take until they act on it. Without it the vehicle lags 7 cm behind at 2 m/s.
const STEER_LEAD: Duration = Duration::from_millis(30);
/// Without a beam for this long the LiDAR counts as silent.
const LIDAR_SILENT_AFTER: Duration = Duration::from_secs(2);
/// An older battery message says nothing; PX4 sends one every two seconds.
const BATTERY_OLD_AFTER: Duration = Duration::from_secs(10);
/// Scans wait at most this long for the pose at their end, and for the frames that shape it.
const SCAN_PATIENCE: Duration = Duration::from_millis(300);
/// Smaller disturbed areas are not told of, m².
const LEAST_DISTURBED_M2: f64 = 0.5;
/// The end of a trajectory counts as reached within this distance, m.
const AT_TARGET_M: f64 = 0.3;

/// Disagreements beyond this are told as this, m: squares of absurd places are no numbers.
const FARTHEST_OFF_M: f64 = 10_000.0;
/// An older word of the autopilot on its place is not compared with the own one.
const DISAGREEMENT_OLD_AFTER: Duration = Duration::from_secs(1);
/// After a declared jump further than this, m, the trajectory begins anew where the vehicle is.
const JUMP_FOLLOWED_M: f64 = 0.3;
/// Speed of a landing that the autopilot flies, m/s.
const LANDING_MPS: f64 = 0.5;

/// The brain.
#[derive(Debug, Clone)]
pub struct Pilot {
    settings: Settings,
    localizer: Localizer,
    mapper: Mapper,
    mission: Mission,
    route: Route,
    now: Stamp<Mono>,
    n_ticks: u64,
    vehicle: Option<VehicleState>,
    is_autopilot_lost: bool,
    battery: Option<BatterySample>,
    /// Where the autopilot believes to be, until the own pose of that instant is known.
    autopilot_pose: Option<AutopilotPose>,
    /// When the autopilot told its place, and how far that is from the own one, m.
    disagreement: Option<(Stamp<Mono>, f64)>,
    /// The localisation's count of declared jumps, as it was last looked at.
    reset_counter: u8,
    last_beam_at: Option<Stamp<Mono>>,
    sample_lag: SampleLag,
    /// Scans whose pose can still change: see [`Self::map_waiting_scans`].
    waiting_scans: VecDeque<Scan>,
    frames: FrameWatch,
    jobs: Jobs,
    /// The newest volumes: of the whole region, then of its bays.
    accounts: Vec<VolumeAccount>,
    last_report_at: Stamp<Mono>,
    /// Where the flight began; the return leads here.
    home: Option<Point<Hall>>,
    flown: FlownPath,
    energy: EnergyGauge,
    /// Landed, waiting for the last solve.
    ending: Option<Ending>,
    /// The disturbed area that the people were told of last, m².
    told_disturbed_m2: f64,
    told_plan: PlanNews,
    /// The last word on the disk.
    storage: Option<StorageState>,
    /// What the last flight has left out.
    gaps: GapOffer,
}

/// What a flight came to, before its last solve.
#[derive(Debug, Clone, Copy)]
struct Ending {
    is_complete: bool,
    steps_done: usize,
    path_length_m: f64,
}

/// Work that is under way.
#[derive(Debug, Clone, Default)]
struct Jobs {
    next_id: u64,
    solve: Option<JobId>,
    last_solve_at: Stamp<Mono>,
    plan: Option<JobId>,
    /// The solve under way is the one after landing.
    is_final_solve: bool,
}

/// Length of the commanded path, m.
#[derive(Debug, Clone, Default)]
struct FlownPath {
    length_m: f64,
    last: Option<Vector3<f64>>,
}

impl Pilot {
    /// A brain on the ground, at rest.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let localizer = Localizer::new(settings.localization.clone());
        let free_space = FreeSpace::evaluate(
            &settings.planning,
            &settings.localization.cameras,
            &settings.localization.marker_map,
            settings.localization.vision.corner_sigma_px,
        );
        let mapper = Mapper::new(settings.mapping.clone());
        let plan = SurveyPlan::new(settings.planning.clone(), free_space, &mapper);
        Self {
            localizer,
            mapper,
            mission: Mission::new(settings.mission),
            route: Route::new(plan),
            frames: FrameWatch::new(settings.localization.cameras.len()),
            settings,
            now: Stamp::ZERO,
            n_ticks: 0,
            vehicle: None,
            is_autopilot_lost: false,
            battery: None,
            autopilot_pose: None,
            disagreement: None,
            reset_counter: 0,
            sample_lag: SampleLag::default(),
            last_beam_at: None,
            waiting_scans: VecDeque::new(),
            jobs: Jobs::default(),
            accounts: Vec::new(),
            last_report_at: Stamp::ZERO,
            home: None,
            flown: FlownPath::default(),
            energy: EnergyGauge::default(),
            ending: None,
            told_disturbed_m2: 0.0,
            told_plan: PlanNews::default(),
            storage: None,
            gaps: GapOffer::default(),
        }
    }

    /// Takes in one event and appends what is to be done, in order, to `actions`.
    pub fn step(&mut self, event: Event, actions: &mut Vec<Action>) {
        match event {
            Event::Ticked(now) => self.on_tick(now, actions),
            Event::Imu(imu) => {
                if intake::believes_imu(&imu, self.now) {
                    self.localizer.on_imu(imu);
                    self.tell_of_localizer(actions);
                    self.map_waiting_scans();
                }
            }
            Event::Scanned(scan) => {
                let scan = scan.corrected(&self.settings.scan_correction);
                if !intake::believes_scan(&scan, self.now) {
                    self.mapper.refuse(&scan);
                    return;
                }
                self.last_beam_at = self.last_beam_at.max(Some(scan.end()));
                self.waiting_scans.push_back(scan);
                self.map_waiting_scans();
            }
            Event::TagsSeen(frame) => {
                let refusal = intake::refusal_of_frame(&frame, self.now);
                let record = refusal.unwrap_or_else(|| self.localizer.on_tags(&frame));
                self.frames.note(&frame, record.verdict);
                actions.push(Action::FixTreated(Box::new(record)));
                self.tell_of_localizer(actions);
                self.map_waiting_scans();
            }
            Event::Vehicle(vehicle) => {
                self.vehicle = Some(vehicle);
                self.is_autopilot_lost = false;
                self.localizer.set_on_ground(intake::is_on_ground(&vehicle));
                // The pilot's switch must not wait for the next tick.
                self.run_mission(actions);
            }
            Event::Battery(battery) => {
                self.battery = Some(battery);
                if matches!(self.mission.phase(), Phase::TakeOff | Phase::Survey) {
                    self.energy.read(battery.at, battery.remaining_ratio, self.flown.length_m);
                }
            }
            Event::AutopilotPose(pose) => self.autopilot_pose = Some(pose),
            Event::CommandAnswered(outcome) => {
                if !outcome.is_accepted {
                    let text = format!("autopilot did not accept {:?}", outcome.command);
                    say(actions, Severity::Warning, text);
                }
            }
            Event::Operator(command) => self.on_operator(command, actions),
            Event::AutopilotLost(_) => {
                if !self.is_autopilot_lost {
                    say(actions, Severity::Error, "no heartbeat of the autopilot".to_owned());
                }
                self.is_autopilot_lost = true;
                self.localizer.set_on_ground(false);
            }
            Event::AutopilotRebooted(_) => {
                // Its map began anew with the next position that it takes from here.
                say(actions, Severity::Critical, "the autopilot has restarted".to_owned());
                self.run_mission(actions);
            }
            Event::StorageLooked(storage) => {
                storage_news::tell(self.storage.as_ref(), &storage, actions);
                self.storage = Some(storage);
            }
            Event::Finished { id, output, .. } => self.on_finished(id, *output, actions),
        }
    }

    /// Where the flight stands.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.mission.phase()
    }

    /// The map as it grows.
    #[must_use]
    pub const fn mapper(&self) -> &Mapper {
        &self.mapper
    }

    /// Keeps every hit that changes the map, for reports: see [`Mapper::keep_hits`].
    pub fn keep_hits(&mut self) {
        self.mapper.keep_hits();
    }

    /// The localisation.
    #[must_use]
    pub const fn localizer(&self) -> &Localizer {
        &self.localizer
    }

    /// What it was made with.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// True once no frame that is still to come can move the pose of an instant.
    #[must_use]
    pub fn has_settled(&self, at: Stamp<Mono>) -> bool {
        self.localizer.newest_at().is_some_and(|newest| newest >= at) && self.frames.have_passed(at)
    }

    /// The newest belief of the localisation, whether it can be flown on or not.
    #[must_use]
    pub fn estimate(&self) -> Option<NavEstimate> {
        self.localizer.estimate()
    }

    fn on_tick(&mut self, now: Stamp<Mono>, actions: &mut Vec<Action>) {
        self.now = now;
        self.n_ticks += 1;
        self.map_waiting_scans();
        self.route.advance(now);
        self.follow_jump();
        self.compare_with_autopilot();
        self.watch_samples(actions);
        self.run_mission(actions);
        if self.mission.phase() == Phase::Survey {
            self.route.survey(now);
        }
        self.plan_if_due(actions);
        if self.n_ticks % 2 == 1 {
            self.steer(actions);
        } else {
            self.publish_odometry(actions);
        }
        self.solve_if_due(actions);
        if now.since(self.last_report_at) >= self.settings.report_interval {
            self.last_report_at = now;
            self.report(false, actions);
        }
    }

    fn watch_samples(&mut self, actions: &mut Vec<Action>) {
        let newest = self.localizer.last_sample_at();
        if let Some(age) = self.sample_lag.look(self.now, newest) {
            let text = format!("autopilot's samples are {:.2} s old", age.as_secs_f64());
            say(actions, Severity::Warning, text);
        }
    }

    fn tell_of_localizer(&mut self, actions: &mut Vec<Action>) {
        let records = self.localizer.take_records().into_iter();
        actions.extend(records.map(|record| Action::FixTreated(Box::new(record))));
        actions.extend(self.localizer.take_notices().into_iter().map(Action::Say));
        if let Some(since) = self.localizer.take_doubt() {
            self.forget_since(since, actions);
        }
    }

    /// Takes back what was mapped from poses that turned out to be wrong.
    fn forget_since(&mut self, since: Stamp<Mono>, actions: &mut Vec<Action>) {
        let n_beams = self.mapper.forget_since(since);
        if n_beams == 0 {
            return;
        }
        self.route.plan.ask_anew();
        let age_s = self.now.seconds_since(since);
        let text = format!("{n_beams} beams of the last {age_s:.1} s had a wrong pose: dropped");
        say(actions, Severity::Warning, text);
        // A solve under way still has them: another one takes its place.
        if self.jobs.solve.is_some() {
            self.start_solve(self.jobs.is_final_solve, actions);
        }
    }

    fn on_operator(&mut self, command: OperatorCommand, actions: &mut Vec<Action>) {
        let mut effects = Vec::new();
        let inputs = self.mission_inputs();
        let is_accepted = self.mission.on_operator(command.verb, &inputs, &mut effects);
        self.apply(effects, actions);
        actions.push(Action::Answer(OperatorAnswer {
            verb: command.verb,
            to: command.from,
            is_accepted,
        }));
    }

    fn run_mission(&mut self, actions: &mut Vec<Action>) {
        let mut effects = Vec::new();
        let inputs = self.mission_inputs();
        self.mission.step(&inputs, &mut effects);
        self.apply(effects, actions);
    }

    fn mission_inputs(&self) -> Inputs {
        Inputs {
            now: self.now,
            vehicle: self.vehicle,
            is_autopilot_lost: self.is_autopilot_lost,
            has_position: self.localizer.is_trusted(self.now) && !self.sample_lag.is_late(),
            is_late: self.sample_lag.is_late(),
            has_lidar: self.last_beam_at.is_some_and(|at| self.now.since(at) < LIDAR_SILENT_AFTER),
            battery_ratio: self
                .battery
                .filter(|battery| self.now.since(battery.at) < BATTERY_OLD_AFTER)
                .map(|battery| battery.remaining_ratio),
            has_plan: self.route.plan.has_somewhere_to_go(),
            is_plan_done: self.route.plan.is_done(),
            is_plan_complete: self.route.plan.is_complete(),
            has_gaps: self.ending.is_none() && !self.gaps.is_empty(),
            heading_error_rad: self.localizer.pose().map(|hall_from_body| {
                let yaw_rad = hall_from_body.rotation.yaw_rad();
                wrapped_rad(yaw_rad - self.route.settings().yaw_rad)
            }),
            position_sigma_m: self.localizer.position_sigma_m(),
            disagreement_m: self.disagreement_m(),
            intrusion_m: self.intrusion_m(),
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

    /// Compares the two places once the inertial samples have reached the autopilot's instant.
    fn compare_with_autopilot(&mut self) {
        let Some(pose) = self.autopilot_pose else { return };
        if let Some((own, _)) = self.localizer.pose_at(pose.at) {
            let off_m = (pose.position.coords - own.origin.coords).norm().min(FARTHEST_OFF_M);
            self.disagreement = Some((pose.at, off_m));
            self.autopilot_pose = None;
        }
    }

    /// Distance of the autopilot's place to the own one, m, if it was told lately.
    fn disagreement_m(&self) -> Option<f64> {
        let (at, off_m) = self.disagreement?;
        (self.now.since(at) < DISAGREEMENT_OLD_AFTER).then_some(off_m)
    }

    /// By how much the vehicle is nearer to anything than its trajectory, beyond what is demanded.
    fn intrusion_m(&self) -> f64 {
        let trajectory = self.route.path().trajectory();
        let Some((place, trajectory)) = self.localizer.pose().zip(trajectory) else { return 0.0 };
        let planned = trajectory.knot_at(self.now).position;
        let clearance = self.route.plan.clearance();
        let is_at = clearance.shortfall(&place.origin.coords, &place.origin.coords);
        let is_planned = clearance.shortfall(&planned, &planned);
        let beyond =
            |at_m: f64, planned_m: f64| if at_m > planned_m { at_m - planned_m } else { 0.0 };
        beyond(is_at.around_m, is_planned.around_m).max(beyond(is_at.below_m, is_planned.below_m))
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
    /// thought to be. It begins anew in the motion that the vehicle really has: from rest there, the
    /// vehicle would shoot past it and be pulled back faster than anything that is planned.
    fn follow_jump(&mut self) {
        let Some(estimate) = self.localizer.estimate() else { return };
        if estimate.reset_counter == self.reset_counter {
            return;
        }
        self.reset_counter = estimate.reset_counter;
        self.disagreement = None;
        self.autopilot_pose = None;
        let place = estimate.hall_from_body.origin;
        let planned = self.route.path().trajectory().map(|t| t.knot_at(self.now).position);
        let is_far = planned.is_some_and(|p| (p - place.coords).norm() > JUMP_FOLLOWED_M);
        if !self.mission.is_steering() || !is_far {
            return;
        }
        let limits = &self.route.settings().limits;
        let velocity = estimate.velocity_mps.coords.cap_magnitude(limits.speed_mps);
        let motion = Knot::steady(place.coords, velocity, self.route.settings().yaw_rad);
        self.route.path_mut().stop_from(&motion, self.now);
        let over_home = self.home.map(|home| self.above(&home));
        if let (Phase::TakeOff | Phase::Return, Some(over_home)) = (self.phase(), over_home) {
            self.route.go_to(over_home, self.now);
        }
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
            Phase::Hold => self.route.path_mut().brake(self.now),
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
    fn above(&self, place: &Point<Hall>) -> Waypoint {
        let planning = self.route.settings();
        let place = Point::new(place.coords.x, place.coords.y, planning.height_m);
        Waypoint { place, yaw_rad: planning.yaw_rad }
    }

    /// Stands at a place with the usual heading.
    fn stand(&mut self, place: Point<Hall>) {
        let yaw_rad = self.route.settings().yaw_rad;
        self.route.path_mut().stand(&Waypoint { place, yaw_rad }, self.now);
    }

    fn steer(&mut self, actions: &mut Vec<Action>) {
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

    fn publish_odometry(&self, actions: &mut Vec<Action>) {
        if let Some(estimate) = self.trusted_estimate() {
            actions.push(Action::PublishOdometry(Box::new(estimate)));
        }
    }

    /// The belief, if it can be flown on.
    fn trusted_estimate(&self) -> Option<NavEstimate> {
        let is_trusted = self.localizer.is_trusted(self.now);
        let estimate = is_trusted.then(|| self.localizer.estimate()).flatten();
        estimate.filter(NavEstimate::is_finite)
    }

    /// Maps the scans whose poses are known for good, and those for which no pose will come.
    ///
    /// A frame that was captured before the end of a scan and arrives later would move the pose
    /// that the scan was mapped with. So a scan waits until every camera has delivered a frame
    /// captured after its end: then the pose that the map used is the one that the chain of
    /// [`crate::messages::PoseError`] describes.
    fn map_waiting_scans(&mut self) {
        while let Some(scan) = self.waiting_scans.front() {
            let end = scan.end();
            if !self.has_settled(end) && self.now.since(end) <= SCAN_PATIENCE {
                break;
            }
            let Some(scan) = self.waiting_scans.pop_front() else { break };
            let is_measuring = matches!(
                self.mission.phase(),
                Phase::TakeOff | Phase::Survey | Phase::Return | Phase::Hold
            );
            if !is_measuring {
                // Beams from the pad would count the same few cells for minutes.
                self.mapper.count_on_ground(&scan);
            } else {
                let localizer = &self.localizer;
                self.mapper.insert(
                    &scan,
                    |at| localizer.pose_at(at),
                    |at, previous| localizer.pose_error_at(at, previous),
                );
            }
        }
    }

    fn solve_if_due(&mut self, actions: &mut Vec<Action>) {
        let is_measuring =
            matches!(self.mission.phase(), Phase::Survey | Phase::Return | Phase::Hold);
        let is_due = self.now.since(self.jobs.last_solve_at) >= self.settings.solve_interval
            || self.route.plan.awaits_account();
        if is_measuring && is_due && self.jobs.solve.is_none() {
            self.start_solve(false, actions);
        }
    }

    fn start_solve(&mut self, is_final: bool, actions: &mut Vec<Action>) {
        let id = self.new_job_id();
        self.jobs.solve = Some(id);
        self.jobs.last_solve_at = self.now;
        self.jobs.is_final_solve = is_final;
        let job = Job::SolveSurface(self.mapper.snapshot(self.now, is_final));
        actions.push(Action::Start { id, job: Box::new(job) });
    }

    /// Asks for waypoints; the first ones while the vehicle still climbs.
    fn plan_if_due(&mut self, actions: &mut Vec<Action>) {
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

    fn on_finished(&mut self, id: JobId, output: JobOutput, actions: &mut Vec<Action>) {
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
            self.end_if_final(actions);
        }
    }

    fn on_solved(&mut self, solved: Result<SolvedSurface, SolveError>, actions: &mut Vec<Action>) {
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
        self.end_if_final(actions);
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

    /// After the last solve of a flight: the final report.
    fn end_if_final(&mut self, actions: &mut Vec<Action>) {
        if !self.jobs.is_final_solve {
            return;
        }
        if let Some(ending) = self.ending.take() {
            if self.accounts.is_empty() {
                self.accounts = self.mapper.cell_volumes(self.now);
            }
            self.report(true, actions);
            actions.push(Action::Ended(Box::new(FlightSummary {
                at: self.now,
                volume: self.accounts[0].estimate,
                accounts: self.accounts.clone(),
                hits: self.mapper.counts(),
                steps_done: ending.steps_done,
                path_length_m: ending.path_length_m,
                is_complete: ending.is_complete,
            })));
        }
    }

    fn report(&self, is_final: bool, actions: &mut Vec<Action>) {
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

impl FlownPath {
    fn go_on(&mut self, place: &Vector3<f64>) {
        if let Some(last) = self.last {
            self.length_m += (place - last).norm();
        }
        self.last = Some(*place);
    }
}

fn say(actions: &mut Vec<Action>, severity: Severity, text: String) {
    actions.push(Action::Say(StatusText { severity, text }));
}
