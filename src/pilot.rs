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
mod flying;
mod gap_offer;
mod intake;
mod job;
mod outlook;
mod plan_news;
mod route;
mod sample_lag;
mod sight;
mod storage_news;
mod survey_plan;
mod waiting_frames;
mod work;

pub use event::{Action, Event, FlightSummary, JobId, PhaseChange, PlanChoice, VolumeReport};
pub use gap_offer::OfferedGap;
pub use job::{Job, JobOutput};
pub use outlook::Outlook;

use self::flying::Disagreement;
use crate::geometry::{Hall, Point};
use crate::localization::{self, Localizer};
use crate::mapping::{self, Mapper};
use crate::messages::{
    AutopilotPose, BatterySample, LandedState, NavEstimate, Scan, ScanCorrection, Severity,
    StatusText, StorageState, VehicleState, Verdict, VolumeAccount,
};
use crate::mission::{self, EnergyGauge, Mission, Phase};
use crate::planning;
use crate::planning::free_space::FreeSpace;
use crate::time::{Mono, Stamp};
use gap_offer::GapOffer;
use intake::FrameWatch;
use nalgebra::Vector3;
use plan_news::PlanNews;
use route::Route;
use sample_lag::SampleLag;
use sight::Sight;
use std::collections::VecDeque;
use std::time::Duration;
use survey_plan::SurveyPlan;
use waiting_frames::WaitingFrames;

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

/// Scans wait at most this long for the pose at their end, and for the frames that shape it.
const SCAN_PATIENCE: Duration = waiting_frames::PATIENCE;

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
    disagreement: Option<Disagreement>,
    /// In a hold, at this tick: how far the vehicle was from where it was held, m, when it began to be held
    /// where it is.
    strayed_m: Option<f64>,
    /// The localisation's count of declared jumps, as it was last looked at.
    reset_counter: u8,
    /// When the LiDAR's head was last seen to turn.
    last_turn_at: Option<Stamp<Mono>>,
    /// When a beam last measured something.
    last_beam_at: Option<Stamp<Mono>>,
    /// The instant of the newest place that the autopilot got.
    published_at: Option<Stamp<Mono>>,
    sample_lag: SampleLag,
    /// Where the vehicle is by frames alone, while the belief is too old.
    sight: Sight,
    /// Scans whose pose can still change: see [`Self::map_waiting_scans`].
    waiting_scans: VecDeque<Scan>,
    waiting_frames: WaitingFrames,
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
            waiting_frames: WaitingFrames::default(),
            frames: FrameWatch::new(settings.localization.cameras.len()),
            settings,
            now: Stamp::ZERO,
            n_ticks: 0,
            vehicle: None,
            is_autopilot_lost: false,
            battery: None,
            autopilot_pose: None,
            disagreement: None,
            strayed_m: None,
            reset_counter: 0,
            sample_lag: SampleLag::default(),
            sight: Sight::default(),
            last_turn_at: None,
            last_beam_at: None,
            published_at: None,
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
                    self.take_frames(actions);
                    self.map_waiting_scans();
                }
            }
            Event::Scanned(scan) => {
                let scan = scan.corrected(&self.settings.scan_correction);
                if !intake::believes_scan(&scan, self.now) {
                    self.mapper.refuse(&scan);
                    return;
                }
                if scan.is_turning() {
                    self.last_turn_at = self.last_turn_at.max(Some(scan.end()));
                    self.last_beam_at = self.last_beam_at.max(self.mapper.measured_at(&scan));
                }
                self.waiting_scans.push_back(scan);
                self.map_waiting_scans();
            }
            Event::TagsSeen(frame) => {
                if intake::refusal_of_frame(&frame, self.now).is_none() {
                    self.look_by_sight(&frame);
                }
                self.waiting_frames.push(frame);
                self.take_frames(actions);
            }
            Event::Vehicle(vehicle) => {
                self.vehicle = Some(vehicle);
                self.is_autopilot_lost = false;
                self.localizer.set_on_ground(intake::is_on_ground(&vehicle));
                if !vehicle.is_armed {
                    self.sight.forget_told();
                }
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
                self.sight.forget_told();
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

    /// No vehicle is in the air with the own position, not even in somebody else's hands, none may start
    /// yet, and the last surface is solved.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        let is_flying = self
            .vehicle
            .is_some_and(|vehicle| vehicle.is_armed && vehicle.landed != LandedState::OnGround);
        let has_let_go = matches!(self.mission.phase(), Phase::Idle | Phase::Abort);
        let may_start = self.mission.may_arm_yet(self.now);
        has_let_go && !is_flying && !may_start && self.ending.is_none()
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
        self.take_frames(actions);
        self.map_waiting_scans();
        self.route.advance(now);
        self.follow_vehicle();
        self.compare_with_autopilot();
        self.watch_samples(actions);
        self.run_mission(actions);
        self.strayed_m = None;
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

    /// Takes in the frames that the inertial samples have reached, and writes down those that waited in vain.
    fn take_frames(&mut self, actions: &mut Vec<Action>) {
        while let Some(frame) = self.waiting_frames.pop(self.now, &self.localizer) {
            let refusal = intake::refusal_of_frame(&frame, self.now);
            let record = refusal.unwrap_or_else(|| {
                if self.localizer.can_take(frame.captured_at) {
                    self.localizer.on_tags(&frame)
                } else {
                    intake::refused_frame(&frame, Verdict::FromTheFuture)
                }
            });
            self.frames.note(&frame, record.verdict);
            actions.push(Action::FixTreated(Box::new(record)));
            self.tell_of_localizer(actions);
            self.map_waiting_scans();
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
}

fn say(actions: &mut Vec<Action>, severity: Severity, text: String) {
    actions.push(Action::Say(StatusText { severity, text }));
}
