//! A flight like a campaign's, with hands on the sensors.

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::link::{Session, SessionOutput};
use stockpilot::messages::VehicleCommand;
use stockpilot::mission::Phase;
use stockpilot::pilot::{
    Action, Event, FlightSummary, JobId, JobOutput, PhaseChange, Pilot, TICK_RATE_HZ,
};
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::camera::CameraModel;
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::lidar::TurnAssembler;
use stockpilot_sim::operator::Operator;
use stockpilot_sim::rig::Rig;
use stockpilot_sim::scenario::{Lidar, Planner, Scenario, Surface};
use stockpilot_sim::world::World;

/// Jobs return after this long, as they do beside a real brain.
const JOB_TIME: Duration = Duration::from_millis(100);

/// A survey of a few waypoints over heaps.
pub(crate) fn short_survey(seed: u64, n_steps: usize) -> Scenario {
    Scenario {
        world: World::piles(seed).expect("a generated world"),
        planner: Planner::SquareWave,
        surface: Surface::KalmanGrid,
        lidar: Lidar::Ld19,
        camera: CameraModel::ahead(),
        n_steps,
        seed,
    }
}

/// Brain and rig, with sensors that can be covered.
pub(crate) struct Flight {
    pub(crate) rig: Rig,
    pub(crate) is_camera_covered: bool,
    pub(crate) is_lidar_silent: bool,
    pub(crate) changes: Vec<PhaseChange>,
    /// Commands that the brain asked for.
    pub(crate) commands: Vec<(Stamp<Mono>, VehicleCommand)>,
    /// Modes and arming that were asked for on the wire.
    pub(crate) wire_commands: Vec<(Stamp<Mono>, MavCmd)>,
    pub(crate) last_setpoint_at: Option<Stamp<Mono>>,
    pub(crate) summary: Option<FlightSummary>,
    pilot: Pilot,
    session: Session,
    answers: SessionOutput,
    operator: Operator,
    turns: TurnAssembler,
    n_ticks: u64,
    jobs: VecDeque<(Stamp<Mono>, JobId, JobOutput)>,
}

impl Flight {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let config = config(scenario, Devices::none());
        Self {
            rig: Rig::new(
                scenario.world.clone(),
                scenario.lidar.model(),
                scenario.camera.clone(),
                scenario.seed,
            ),
            is_camera_covered: false,
            is_lidar_silent: false,
            changes: Vec::new(),
            commands: Vec::new(),
            wire_commands: Vec::new(),
            last_setpoint_at: None,
            summary: None,
            pilot: Pilot::new(config.pilot_settings().expect("settings that fit")),
            session: Session::new(config.link_settings().expect("a link that fits")),
            answers: SessionOutput::default(),
            operator: Operator::default(),
            turns: TurnAssembler::default(),
            n_ticks: 0,
            jobs: VecDeque::new(),
        }
    }

    /// A flight that has been in its survey for three seconds.
    pub(crate) fn in_survey(seed: u64) -> Self {
        let mut flight = Self::new(&short_survey(seed, 30));
        let is_there = flight.run_until(60.0, |f| f.phase() == Phase::Survey);
        assert!(is_there, "no survey: {:?} {:?}", flight.changes, flight.operator.texts);
        flight.run(3.0);
        assert_eq!(flight.phase(), Phase::Survey);
        flight
    }

    pub(crate) fn phase(&self) -> Phase {
        self.pilot.phase()
    }

    pub(crate) fn now(&self) -> Stamp<Mono> {
        self.rig.now()
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        self.run_until(seconds, |_| false);
    }

    /// Runs until `done`, at most `seconds`; says if it happened.
    pub(crate) fn run_until(&mut self, seconds: f64, done: impl Fn(&Self) -> bool) -> bool {
        let until = self.now().plus(Duration::from_secs_f64(seconds));
        while self.now() < until && !done(self) {
            self.step();
        }
        done(self)
    }

    /// 5 ms of flight.
    fn step(&mut self) {
        let output = self.rig.step();
        let now = self.rig.now();
        let mut out = std::mem::take(&mut self.answers);
        for (header, message) in &output.to_companion {
            self.session.on_message(header, message, now, &mut out);
        }
        let mut events = std::mem::take(&mut out.events);
        for mut frame in output.frames {
            if self.is_camera_covered {
                frame.tags.clear();
            }
            events.push(Event::TagsSeen(frame));
        }
        for packet in &output.packets {
            let turn = self.turns.push(packet);
            events.extend(turn.filter(|_| !self.is_lidar_silent).map(Event::Scanned));
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
            self.session.on_action(&action, now, &mut out);
            self.act(action, now);
        }
        self.deliver(&out.messages, now);
        self.operator.step(now, self.rig.autopilot_mut());
    }

    fn act(&mut self, action: Action, now: Stamp<Mono>) {
        match action {
            Action::Start { id, job } => self.jobs.push_back((now.plus(JOB_TIME), id, job.run())),
            Action::PhaseChanged(change) => self.changes.push(change),
            Action::Command(command) => self.commands.push((now, command)),
            Action::Ended(summary) => self.summary = Some(*summary),
            _ => {}
        }
    }

    fn deliver(&mut self, messages: &[MavMessage], now: Stamp<Mono>) {
        for message in messages {
            match message {
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) => self.last_setpoint_at = Some(now),
                MavMessage::COMMAND_LONG(data) if moves_the_vehicle(data.command) => {
                    self.wire_commands.push((now, data.command));
                }
                _ => {}
            }
            self.rig.autopilot_mut().on_message(now, self.session.header(), message);
        }
        for (header, message) in self.rig.autopilot_mut().take_outgoing() {
            self.session.on_message(&header, &message, now, &mut self.answers);
        }
    }

    /// The phases entered since an instant, in order.
    pub(crate) fn phases_since(&self, since: Stamp<Mono>) -> Vec<Phase> {
        self.changes.iter().filter(|c| c.at >= since).map(|c| c.to).collect()
    }
}

fn moves_the_vehicle(command: MavCmd) -> bool {
    matches!(
        command,
        MavCmd::MAV_CMD_DO_SET_MODE
            | MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
            | MavCmd::MAV_CMD_NAV_LAND
            | MavCmd::MAV_CMD_NAV_TAKEOFF
    )
}

fn tick_at(n: u64) -> Stamp<Mono> {
    let nanos = (n + 1) * 1_000_000_000 / u64::from(TICK_RATE_HZ);
    Stamp::ZERO.plus(Duration::from_nanos(nanos))
}
