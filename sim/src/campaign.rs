//! Flights that feed the brain directly: bit-reproducible and far faster than real time.
//!
//! The MAVLink session stays in between, message by message, so that frames, commands and clocks
//! are those of the real service; only bytes, sockets and threads are left out.

use crate::hall::{Devices, config};
use crate::judge::PoseJudge;
use crate::lidar::TurnAssembler;
use crate::operator::Operator;
use crate::report::{Measured, RunReport};
use crate::rig::Rig;
use crate::scenario::Scenario;
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use stockpilot::link::{Session, SessionOutput};
use stockpilot::pilot::{Action, Event, FlightSummary, JobId, JobOutput, Pilot, TICK_RATE_HZ};
use stockpilot::time::{Mono, Stamp};

/// A flight that has not ended by then will not end by itself.
const LONGEST_FLIGHT: Duration = Duration::from_secs(900);
/// Jobs take this long in virtual time, as they do beside a real brain.
const JOB_TIME: Duration = Duration::from_millis(100);

/// A flight did not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// The configuration does not fit.
    #[error(transparent)]
    Config(#[from] stockpilot::config::ConfigError),
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

/// The direct connection of brain and rig.
struct DirectFlight {
    rig: Rig,
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
    flight: Option<FlightSummary>,
}

/// Flies one scenario from start to landing; `on_action` sees everything the brain wants, for traces.
///
/// # Errors
/// A configuration that does not fit, or a flight without an end.
pub fn run(
    scenario: &Scenario,
    mut on_action: impl FnMut(Stamp<Mono>, &Action),
) -> Result<RunReport, CampaignError> {
    let began = wall_clock();
    let config = config(scenario, Devices::none());
    let mut flight = DirectFlight {
        rig: Rig::new(
            scenario.world.clone(),
            scenario.lidar.model(),
            scenario.camera.clone(),
            scenario.seed,
        ),
        operator: Operator::default(),
        session: Session::new(config.link_settings()?),
        answers: SessionOutput::default(),
        pilot: Pilot::new(config.pilot_settings()?),
        turns: TurnAssembler::default(),
        poses: PoseJudge::default(),
        n_ticks: 0,
        jobs: VecDeque::new(),
        n_samples_sent: 0,
        flight: None,
    };
    let limit = Stamp::ZERO.plus(LONGEST_FLIGHT);
    while flight.flight.is_none() && flight.rig.now() < limit {
        flight.step(&mut on_action);
    }
    let Some(summary) = flight.flight else {
        return Err(CampaignError::NoEnd {
            seed: scenario.seed,
            limit_s: LONGEST_FLIGHT.as_secs(),
            last_words: flight.operator.texts,
        });
    };
    let measured = Measured {
        flight: summary,
        poses: flight.poses,
        beams_sent: flight.n_samples_sent,
        // Nothing lies between sensor and brain here that could lose one.
        beams_dropped: 0,
        wall_time: began.elapsed(),
    };
    Ok(RunReport::new(scenario, &flight.rig, &measured, None))
}

/// The one place where a campaign looks at the wall's clock: to say how fast it was.
#[expect(clippy::disallowed_methods, reason = "measures the run, not the flight")]
fn wall_clock() -> Instant {
    Instant::now()
}

impl DirectFlight {
    /// 5 ms of flight.
    fn step(&mut self, on_action: &mut impl FnMut(Stamp<Mono>, &Action)) {
        let output = self.rig.step();
        let now = self.rig.now();
        let mut out = std::mem::take(&mut self.answers);
        for (header, message) in &output.to_companion {
            self.session.on_message(header, message, now, &mut out);
        }
        let mut events = std::mem::take(&mut out.events);
        events.extend(output.frames.into_iter().map(Event::TagsSeen));
        for packet in &output.packets {
            self.n_samples_sent += packet.samples.len() as u64;
            events.extend(self.turns.push(packet).map(Event::Scanned));
        }
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
            self.pilot.step(event, &mut actions);
        }
        for action in actions {
            on_action(now, &action);
            self.act(action, now, &mut out);
        }
        let header = self.session.header();
        for message in &out.messages {
            let vehicle = self.rig.vehicle();
            self.poses.hear(message, |at| vehicle.pose_at(at));
            self.rig.autopilot_mut().on_message(now, header, message);
        }
        // Answers leave at once: half a step of delay would shift the clock offset by as much.
        for (header, message) in self.rig.autopilot_mut().take_outgoing() {
            self.session.on_message(&header, &message, now, &mut self.answers);
        }
        self.operator.step(now, self.rig.autopilot_mut());
    }

    fn act(&mut self, action: Action, now: Stamp<Mono>, out: &mut SessionOutput) {
        self.session.on_action(&action, now, out);
        match action {
            Action::Start { id, job } => {
                self.jobs.push_back((now.plus(JOB_TIME), id, job.run()));
            }
            Action::Ended(summary) => self.flight = Some(*summary),
            _ => {}
        }
    }
}

/// When the brain's n-th tick is due.
fn tick_at(n: u64) -> Stamp<Mono> {
    let nanos = (n + 1) * 1_000_000_000 / u64::from(TICK_RATE_HZ);
    Stamp::ZERO.plus(Duration::from_nanos(nanos))
}
