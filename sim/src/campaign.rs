//! Flights that feed the brain directly: bit-reproducible and far faster than real time.
//!
//! The MAVLink session stays in between, message by message, so that frames, commands and clocks
//! are those of the real service; only bytes, sockets and threads are left out.

use crate::camera_faults::{CameraFault, CameraFaultLayer, keep_largest};
use crate::faults::{LinkLayer, Way};
use crate::hall::{Devices, config};
use crate::judge::PoseJudge;
use crate::lidar::TurnAssembler;
use crate::lidar_faults::LidarFault;
use crate::operator::Operator;
use crate::report::{Measured, RunReport};
use crate::rig::{Rig, RigOutput};
use crate::scenario::Scenario;
use crate::temporary_log::TemporaryLog;
use anyhow::Context as _;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use stockpilot::config::{Config, ConfigError};
use stockpilot::link::{Session, SessionOutput};
use stockpilot::messages::{NavEstimate, TagDetections};
use stockpilot::mission::Phase;
use stockpilot::pilot::{
    Action, Event, FlightSummary, Job, JobId, JobOutput, Outlook, Pilot, TICK_RATE_HZ,
};
use stockpilot::planning::PlannerKind;
use stockpilot::service::external_planner;
use stockpilot::time::{Mono, Stamp};

/// A flight that has not ended by then will not end by itself.
pub const LONGEST_FLIGHT: Duration = Duration::from_secs(900);
/// Ticks that are late by no more than this are made up for, as the service does.
const TICKS_MADE_UP_FOR: Duration = Duration::from_millis(100);
/// Scans and frames that wait for a loop that hangs, as the service's channels hold them.
const MOST_WAITING: usize = 96;
/// Jobs take this long in virtual time, as they do beside a real brain.
const JOB_TIME: Duration = Duration::from_millis(100);
/// A search among whole paths takes longer; about so much on the computers that this was measured on, whatever is left to
/// find: the first takes more, those near a target less.
const SEARCH_TIME: Duration = Duration::from_millis(800);

/// A flight did not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// The configuration does not fit.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Still in the air, or never left.
    #[error("seed {seed}: the flight has not ended after {limit_s} s; last words: {last_words:?}")]
    NoEnd {
        /// The run.
        seed: u64,
        /// How long it was watched, s.
        limit_s: u64,
        /// What the service said last.
        last_words: Vec<String>,
    },
}

/// What a flight shows of itself while it goes on.
#[derive(Debug, Clone, Copy)]
pub enum Witnessed<'a> {
    /// The brain is told something.
    Event(&'a Event),
    /// The brain wants something.
    Action(&'a Action),
    /// A message leaves for the autopilot.
    ToAutopilot(&'a MavMessage),
}

/// What a tester may do to the sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SensorFaults {
    /// Frames arrive without a tag.
    pub is_camera_covered: bool,
    /// What is wrong with the LiDAR.
    pub lidar: Option<LidarFault>,
    /// What the detector gets wrong.
    pub camera: Option<CameraFault>,
    /// No more markers than this, the largest in the picture.
    pub n_tags_max: Option<usize>,
    /// No frame arrives at all.
    pub is_camera_dead: bool,
    /// The detector's clock is ahead by this, ns.
    pub camera_offset_ns: i64,
    /// Frames arrive this much later, one delay after the other; none if empty.
    pub camera_delays_ms: &'static [u64],
}

/// Whether the companion computer works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Companion {
    Runs,
    /// Its loop hangs; what comes in waits.
    Frozen,
    Dead,
}

/// Brain and rig, connected directly.
#[derive(Debug)]
pub struct DirectFlight {
    /// The true hall.
    pub rig: Rig,
    /// What is wrong with the sensors now.
    pub faults: SensorFaults,
    /// The link in a tester's hands.
    pub link: LinkLayer,
    companion: Companion,
    log: Option<TemporaryLog>,
    config: Config,
    late_frames: Vec<(Stamp<Mono>, TagDetections)>,
    n_frames: usize,
    camera_faults: CameraFaultLayer,
    operator: Operator,
    session: Session,
    /// What followed from messages after the last step's events were handed over.
    answers: SessionOutput,
    /// What came while the companion's loop hung: messages, and scans and frames.
    waiting: Vec<(MavHeader, MavMessage)>,
    waiting_samples: Vec<Event>,
    pilot: Pilot,
    turns: TurnAssembler,
    poses: PoseJudge,
    n_ticks: u64,
    /// By rising time at which they are done.
    jobs: VecDeque<(Stamp<Mono>, JobId, JobOutput)>,
    n_samples_sent: u64,
    plan_times: Vec<Duration>,
    summary: Option<FlightSummary>,
}

/// Flies one scenario from start to landing; `witness` sees all of it, for traces.
///
/// # Errors
/// A configuration that does not fit, or a flight without an end.
pub fn run(
    scenario: &Scenario,
    mut witness: impl FnMut(Stamp<Mono>, Witnessed<'_>),
) -> Result<RunReport, CampaignError> {
    let began = wall_clock();
    let mut flight = DirectFlight::new(scenario)?;
    let limit = Stamp::ZERO.plus(LONGEST_FLIGHT);
    while flight.summary.is_none() && flight.rig.now() < limit {
        flight.step(&mut witness);
    }
    flight.report(scenario, began.elapsed()).ok_or_else(|| CampaignError::NoEnd {
        seed: scenario.seed,
        limit_s: LONGEST_FLIGHT.as_secs(),
        last_words: flight.operator.texts,
    })
}

/// The one place where a campaign looks at the wall's clock: to say how fast it was.
#[expect(clippy::disallowed_methods, reason = "measures the run, not the flight")]
#[must_use]
pub fn wall_clock() -> Instant {
    Instant::now()
}

impl DirectFlight {
    /// A vehicle on its pad, and a brain that has seen nothing yet.
    ///
    /// # Errors
    /// A configuration that does not fit.
    pub fn new(scenario: &Scenario) -> Result<Self, ConfigError> {
        Self::with_config(scenario, &config(scenario, Devices::none()))
    }

    /// The same with a configuration of its own.
    ///
    /// # Errors
    /// A configuration that does not fit.
    pub fn with_config(scenario: &Scenario, config: &Config) -> Result<Self, ConfigError> {
        Ok(Self {
            rig: scenario.rig(),
            faults: SensorFaults::default(),
            link: LinkLayer::default(),
            companion: Companion::Runs,
            log: None,
            config: config.clone(),
            late_frames: Vec::new(),
            n_frames: 0,
            camera_faults: CameraFaultLayer::new(scenario.seed),
            operator: Operator::default(),
            session: Session::new(config.link_settings()?),
            answers: SessionOutput::default(),
            waiting: Vec::new(),
            waiting_samples: Vec::new(),
            pilot: Pilot::new(config.pilot_settings()?),
            turns: TurnAssembler::default(),
            poses: PoseJudge::default(),
            n_ticks: 0,
            jobs: VecDeque::new(),
            n_samples_sent: 0,
            plan_times: Vec::new(),
            summary: None,
        })
    }

    /// The same flight once more from here on, with a whole link and without a log.
    #[must_use]
    pub fn fork(&self) -> Self {
        Self {
            rig: self.rig.clone(),
            faults: self.faults,
            link: LinkLayer::default(),
            companion: self.companion,
            log: None,
            config: self.config.clone(),
            late_frames: self.late_frames.clone(),
            n_frames: self.n_frames,
            camera_faults: self.camera_faults.clone(),
            operator: self.operator.clone(),
            session: self.session.clone(),
            answers: self.answers.clone(),
            waiting: self.waiting.clone(),
            waiting_samples: self.waiting_samples.clone(),
            pilot: self.pilot.clone(),
            turns: self.turns.clone(),
            poses: self.poses,
            n_ticks: self.n_ticks,
            jobs: self.jobs.clone(),
            n_samples_sent: self.n_samples_sent,
            plan_times: self.plan_times.clone(),
            summary: self.summary.clone(),
        }
    }

    /// The companion computer loses its power.
    pub const fn kill_companion(&mut self) {
        self.companion = Companion::Dead;
    }

    /// The companion's loop hangs from now on; what comes in waits for it.
    pub const fn freeze_companion(&mut self) {
        self.companion = Companion::Frozen;
    }

    /// The loop goes on; ticks that were missed by more than a tenth of a second are left out, the
    /// others made up for, as the service does.
    pub fn thaw_companion(&mut self) {
        self.companion = Companion::Runs;
        self.leave_out_ticks_before(self.rig.now().minus(TICKS_MADE_UP_FOR));
    }

    fn leave_out_ticks_before(&mut self, instant: Stamp<Mono>) {
        while tick_at(self.n_ticks) < instant {
            self.n_ticks += 1;
        }
    }

    /// The companion starts anew and knows nothing; its log goes on in the same file.
    ///
    /// # Panics
    /// If the configuration that it flew with is none any more.
    #[expect(clippy::expect_used, reason = "the same configuration was good before")]
    pub fn restart_companion(&mut self) {
        let link = self.config.link_settings().expect("a configuration that was good");
        let pilot = self.config.pilot_settings().expect("a configuration that was good");
        self.session = Session::new(link);
        self.pilot = Pilot::new(pilot);
        self.answers.clear();
        self.waiting.clear();
        self.waiting_samples.clear();
        self.jobs.clear();
        self.companion = Companion::Runs;
        self.leave_out_ticks_before(self.rig.now());
    }

    /// The id under which the companion speaks.
    #[must_use]
    pub fn companion_header(&self) -> MavHeader {
        self.session.header()
    }

    /// From now on every event and result goes into a log beside the system's temporary files.
    ///
    /// # Errors
    /// A file that cannot be created.
    pub fn record_to_temporary_log(&mut self) -> anyhow::Result<()> {
        self.log = Some(TemporaryLog::create(&self.config)?);
        Ok(())
    }

    /// Ends the log and says how many events are in it.
    ///
    /// # Errors
    /// No log, a log that cannot be read, or one that is not complete.
    pub fn close_log(&mut self) -> anyhow::Result<u64> {
        self.log.take().context("there is no log")?.close()
    }

    /// True if the log, cut at this share of its bytes as they are on the disk now, holds the same
    /// entries from the beginning on, and says that it was cut.
    ///
    /// # Errors
    /// No log, or one that cannot be read.
    pub fn log_cut_at(&self, share: f64) -> anyhow::Result<bool> {
        self.log.as_ref().context("there is no log")?.is_prefix_when_cut_at(share)
    }

    /// The brain's phase.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.pilot.phase()
    }

    /// The brain's newest belief, before it is rounded for the wire.
    #[must_use]
    pub fn estimate(&self) -> Option<NavEstimate> {
        self.pilot.estimate()
    }

    /// Where the brain believes the flight to stand.
    #[must_use]
    pub fn outlook(&self) -> Outlook {
        self.pilot.outlook()
    }

    /// The marker that the camera's fault of the moment is about.
    #[must_use]
    pub const fn faulty_tag(&self) -> Option<u32> {
        self.camera_faults.picked()
    }

    /// The person at the ground station.
    pub const fn operator_mut(&mut self) -> &mut Operator {
        &mut self.operator
    }

    /// What the flight came to, once it has ended.
    #[must_use]
    pub const fn summary(&self) -> Option<&FlightSummary> {
        self.summary.as_ref()
    }

    /// What the flight came to beside the truth; `None` before its end.
    #[must_use]
    pub fn report(&self, scenario: &Scenario, wall_time: Duration) -> Option<RunReport> {
        let measured = Measured {
            flight: self.summary.clone()?,
            poses: self.poses,
            beams_sent: self.n_samples_sent,
            // Nothing lies between sensor and brain here that could lose one.
            beams_dropped: 0,
            wall_time,
            load: None,
        };
        Some(RunReport::new(scenario, &self.rig, &measured, None))
    }

    /// Samples that the LiDAR has sent so far.
    #[must_use]
    pub const fn n_samples_sent(&self) -> u64 {
        self.n_samples_sent
    }

    /// What each planning job so far took on this machine.
    #[must_use]
    pub fn plan_times(&self) -> &[Duration] {
        &self.plan_times
    }

    /// What the brain has said to the ground station.
    #[must_use]
    pub fn texts(&self) -> &[String] {
        &self.operator.texts
    }

    /// 5 ms of flight.
    pub fn step(&mut self, witness: &mut impl FnMut(Stamp<Mono>, Witnessed<'_>)) {
        let mut output = self.rig.step();
        let now = self.rig.now();
        let sent = std::mem::take(&mut output.to_companion);
        let arrived = self.link.pass(Way::ToCompanion, now, sent);
        match self.companion {
            Companion::Runs => self.step_companion(output, &arrived, witness),
            Companion::Frozen => {
                self.waiting.extend(arrived);
                let mut samples = std::mem::take(&mut self.waiting_samples);
                self.sense(output, &mut samples);
                samples.truncate(MOST_WAITING);
                self.waiting_samples = samples;
                self.rig_hears_nothing(now);
            }
            Companion::Dead => {
                self.sense(output, &mut Vec::new());
                self.rig_hears_nothing(now);
            }
        }
        self.operator.step(now, self.rig.autopilot_mut());
    }

    /// What was sent before goes on arriving, and the autopilot goes on speaking.
    fn rig_hears_nothing(&mut self, now: Stamp<Mono>) {
        let header = self.session.header();
        for (_, message) in self.link.pass(Way::ToAutopilot, now, Vec::new()) {
            self.rig.autopilot_mut().on_message(now, header, &message);
        }
    }

    fn step_companion(
        &mut self,
        output: RigOutput,
        arrived: &[(MavHeader, MavMessage)],
        witness: &mut impl FnMut(Stamp<Mono>, Witnessed<'_>),
    ) {
        let now = self.rig.now();
        let mut out = std::mem::take(&mut self.answers);
        let waited = std::mem::take(&mut self.waiting);
        for (header, message) in waited.iter().chain(arrived) {
            self.session.on_message(header, message, now, &mut out);
        }
        let mut events = std::mem::take(&mut out.events);
        events.append(&mut self.waiting_samples);
        self.sense(output, &mut events);
        while self.jobs.front().is_some_and(|(due, ..)| *due <= now) {
            if let Some((at, id, output)) = self.jobs.pop_front() {
                events.push(Event::Finished { at, id, output: Box::new(output) });
            }
        }
        if now >= tick_at(self.n_ticks) {
            self.session.on_time(now, &mut out);
            events.append(&mut out.events);
            events.push(Event::Ticked(tick_at(self.n_ticks)));
            self.n_ticks += 1;
        }
        let mut actions = Vec::new();
        for event in events {
            witness(now, Witnessed::Event(&event));
            if let Some(log) = &mut self.log {
                log.event(now, &event);
            }
            let n_before = actions.len();
            self.pilot.step(event, &mut actions);
            for action in &actions[n_before..] {
                witness(now, Witnessed::Action(action));
                if let Some(log) = &mut self.log {
                    log.action(now, action);
                }
            }
        }
        for action in actions {
            self.session.on_action(&action, now, &mut out);
            self.act(action, now);
        }
        self.deliver(&out.messages, now, witness);
    }

    /// What the sensors give, as events.
    fn sense(&mut self, output: RigOutput, events: &mut Vec<Event>) {
        for frame in output.frames {
            let frame = keep_largest(frame, self.faults.n_tags_max);
            let mut frame = self.camera_faults.apply(self.faults.camera, frame, &mut self.rig);
            if self.faults.is_camera_covered {
                frame.tags.clear();
            }
            self.hand_on(frame, events);
        }
        let now = self.rig.now();
        self.late_frames.sort_by_key(|(due, _)| *due);
        let n_due = self.late_frames.iter().take_while(|(due, _)| *due <= now).count();
        events.extend(
            self.late_frames
                .drain(..n_due)
                .map(|(due, frame)| Event::TagsSeen(TagDetections { received_at: due, ..frame })),
        );
        for packet in &output.packets {
            self.n_samples_sent += packet.samples.len() as u64;
            let turn = self.turns.push(packet);
            let heard = turn.and_then(|turn| match self.faults.lidar {
                Some(fault) => fault.spoilt(turn),
                None => Some(turn),
            });
            events.extend(heard.map(Event::Scanned));
        }
    }

    /// A frame on its way from the detector.
    fn hand_on(&mut self, mut frame: TagDetections, events: &mut Vec<Event>) {
        self.n_frames += 1;
        let offset_ns = self.faults.camera_offset_ns;
        frame.captured_at = Stamp::from_nanos(frame.captured_at.nanos() + offset_ns);
        let delays = self.faults.camera_delays_ms;
        match delays.get(self.n_frames % delays.len().max(1)) {
            _ if self.faults.is_camera_dead => {}
            Some(ms) => {
                let due = self.rig.now().plus(Duration::from_millis(*ms));
                self.late_frames.push((due, frame));
            }
            None => events.push(Event::TagsSeen(frame)),
        }
    }

    fn act(&mut self, action: Action, now: Stamp<Mono>) {
        match action {
            Action::Start { id, job } => {
                let began = wall_clock();
                let is_plan = !matches!(*job, Job::SolveSurface(_));
                let takes = time_of(&job);
                let output = external_planner::run_and_wait(*job);
                if is_plan {
                    self.plan_times.push(began.elapsed());
                }
                let due = now.plus(takes);
                let place = self.jobs.partition_point(|(other, ..)| *other <= due);
                self.jobs.insert(place, (due, id, output));
            }
            Action::Ended(summary) => self.summary = Some(*summary),
            _ => {}
        }
    }

    fn deliver(
        &mut self,
        messages: &[MavMessage],
        now: Stamp<Mono>,
        witness: &mut impl FnMut(Stamp<Mono>, Witnessed<'_>),
    ) {
        let header = self.session.header();
        let mut sent = Vec::with_capacity(messages.len());
        for message in messages {
            witness(now, Witnessed::ToAutopilot(message));
            let vehicle = self.rig.vehicle();
            self.poses.hear(message, |at| vehicle.pose_at(at));
            sent.push((header, message.clone()));
        }
        for (header, message) in self.link.pass(Way::ToAutopilot, now, sent) {
            self.rig.autopilot_mut().on_message(now, header, &message);
        }
        // Answers leave at once: half a step of delay would shift the clock offset by as much.
        let answers = self.rig.autopilot_mut().take_outgoing();
        for (header, message) in self.link.pass(Way::ToCompanion, now, answers) {
            self.session.on_message(&header, &message, now, &mut self.answers);
        }
    }
}

/// How long a job takes in virtual time.
fn time_of(job: &Job) -> Duration {
    match job {
        Job::Plan(request) if request.settings.planner == PlannerKind::Horizon => SEARCH_TIME,
        _ => JOB_TIME,
    }
}

/// When the brain's n-th tick is due.
fn tick_at(n: u64) -> Stamp<Mono> {
    let nanos = (n + 1) * 1_000_000_000 / u64::from(TICK_RATE_HZ);
    Stamp::ZERO.plus(Duration::from_nanos(nanos))
}
