//! Flights that feed the brain directly: bit-reproducible and far faster than real time.
//!
//! The MAVLink session stays in between, message by message, so that frames, commands and clocks
//! are those of the real service; only bytes, sockets and threads are left out.

use crate::camera_faults::{CameraFault, CameraFaultLayer, keep_largest};
use crate::hall::{Devices, config};
use crate::judge::PoseJudge;
use crate::lidar::TurnAssembler;
use crate::operator::Operator;
use crate::report::{Measured, RunReport};
use crate::rig::{Rig, RigOutput};
use crate::scenario::Scenario;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use stockpilot::config::{Config, ConfigError};
use stockpilot::link::{Session, SessionOutput};
use stockpilot::messages::NavEstimate;
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, Event, FlightSummary, Job, JobId, JobOutput, Pilot, TICK_RATE_HZ};
use stockpilot::service::external_planner;
use stockpilot::time::{Mono, Stamp};

/// A flight that has not ended by then will not end by itself.
pub const LONGEST_FLIGHT: Duration = Duration::from_secs(900);
/// Jobs take this long in virtual time, as they do beside a real brain.
const JOB_TIME: Duration = Duration::from_millis(100);

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
    /// No scan arrives.
    pub is_lidar_silent: bool,
    /// What the detector gets wrong.
    pub camera: Option<CameraFault>,
    /// No more markers than this, the largest in the picture.
    pub n_tags_max: Option<usize>,
}

/// Brain and rig, connected directly.
#[derive(Debug)]
pub struct DirectFlight {
    /// The true hall.
    pub rig: Rig,
    /// What is wrong with the sensors now.
    pub faults: SensorFaults,
    camera_faults: CameraFaultLayer,
    operator: Operator,
    session: Session,
    /// What followed from messages after the last step's events were handed over.
    answers: SessionOutput,
    pilot: Pilot,
    turns: TurnAssembler,
    poses: PoseJudge,
    n_ticks: u64,
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
            camera_faults: CameraFaultLayer::new(scenario.seed),
            operator: Operator::default(),
            session: Session::new(config.link_settings()?),
            answers: SessionOutput::default(),
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
        let output = self.rig.step();
        let now = self.rig.now();
        let mut out = std::mem::take(&mut self.answers);
        for (header, message) in &output.to_companion {
            self.session.on_message(header, message, now, &mut out);
        }
        let mut events = std::mem::take(&mut out.events);
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
            let n_before = actions.len();
            self.pilot.step(event, &mut actions);
            for action in &actions[n_before..] {
                witness(now, Witnessed::Action(action));
            }
        }
        for action in actions {
            self.session.on_action(&action, now, &mut out);
            self.act(action, now);
        }
        self.deliver(&out.messages, now, witness);
        self.operator.step(now, self.rig.autopilot_mut());
    }

    /// What the sensors give, as events.
    fn sense(&mut self, output: RigOutput, events: &mut Vec<Event>) {
        for frame in output.frames {
            let frame = keep_largest(frame, self.faults.n_tags_max);
            let mut frame = self.camera_faults.apply(self.faults.camera, frame, &mut self.rig);
            if self.faults.is_camera_covered {
                frame.tags.clear();
            }
            events.push(Event::TagsSeen(frame));
        }
        for packet in &output.packets {
            self.n_samples_sent += packet.samples.len() as u64;
            let turn = self.turns.push(packet).filter(|_| !self.faults.is_lidar_silent);
            events.extend(turn.map(Event::Scanned));
        }
    }

    fn act(&mut self, action: Action, now: Stamp<Mono>) {
        match action {
            Action::Start { id, job } => {
                let began = wall_clock();
                let is_plan = !matches!(*job, Job::SolveSurface(_));
                let output = external_planner::run_and_wait(*job);
                if is_plan {
                    self.plan_times.push(began.elapsed());
                }
                self.jobs.push_back((now.plus(JOB_TIME), id, output));
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
        for message in messages {
            witness(now, Witnessed::ToAutopilot(message));
            let vehicle = self.rig.vehicle();
            self.poses.hear(message, |at| vehicle.pose_at(at));
            self.rig.autopilot_mut().on_message(now, header, message);
        }
        // Answers leave at once: half a step of delay would shift the clock offset by as much.
        for (header, message) in self.rig.autopilot_mut().take_outgoing() {
            self.session.on_message(&header, &message, now, &mut self.answers);
        }
    }
}

/// When the brain's n-th tick is due.
fn tick_at(n: u64) -> Stamp<Mono> {
    let nanos = (n + 1) * 1_000_000_000 / u64::from(TICK_RATE_HZ);
    Stamp::ZERO.plus(Duration::from_nanos(nanos))
}
