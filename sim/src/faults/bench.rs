//! A flight in which things break, with a witness of everything that matters.

use super::expectations::{Expectations, finite_numbers};
use crate::autopilot::{Flavour, StubAutopilot};
use crate::camera::CameraModel;
use crate::campaign::{DirectFlight, Witnessed};
use crate::scenario::{Conditions, Lidar, Planner, Scenario, Surface};
use crate::world::World;
use anyhow::Context;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, PhaseChange};
use stockpilot::time::{Mono, Stamp};

/// What a case came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Nothing was found wanting.
    pub is_passed: bool,
    /// From the fault to the safe state, s; `None` if it was never reached.
    pub time_to_safe_s: Option<f64>,
    /// What was found wanting.
    pub complaints: Vec<String>,
}

/// What the companion was seen to do.
#[derive(Debug, Default)]
pub struct Seen {
    /// Phases.
    pub changes: Vec<PhaseChange>,
    /// Commands of the companion that move the vehicle, with their time.
    pub commands: Vec<(Stamp<Mono>, MavCmd)>,
    /// The last setpoint, in hall axes.
    pub setpoint: Option<(Stamp<Mono>, Vector3<f64>)>,
    /// The companion's last heartbeat.
    pub heartbeat_at: Option<Stamp<Mono>>,
    /// The reset counters of ODOMETRY, each change once.
    pub reset_counters: Vec<u8>,
    /// Acknowledgements that the companion gave.
    pub n_acks: u64,
    n_events: u64,
}

/// One flight of a case.
#[derive(Debug)]
pub struct Bench {
    /// The flight.
    pub flight: DirectFlight,
    /// What the companion was seen to do.
    pub seen: Seen,
    expectations: Expectations,
    struck_at: Option<Stamp<Mono>>,
    time_to_safe_s: Option<f64>,
}

/// A pile hall, a few legs, and a map that is quick to keep: the volume is not what is judged.
pub(super) fn scenario(flavour: Flavour, seed: u64) -> anyhow::Result<Scenario> {
    Ok(Scenario {
        world: World::piles(seed).context("a generated world")?,
        planner: Planner::SquareWave,
        surface: Surface::KalmanGrid,
        variance: None,
        lidar: Lidar::Ld19,
        autopilot: flavour,
        camera: CameraModel::ahead(),
        n_steps: 30,
        seed,
        conditions: Conditions { leg_spacing_m: Some(5.0), ..Conditions::default() },
    })
}

impl Bench {
    /// A vehicle on its pad.
    ///
    /// # Errors
    /// A world or a log that cannot be had.
    pub fn new(flavour: Flavour, seed: u64) -> anyhow::Result<Self> {
        Self::of(&scenario(flavour, seed)?)
    }

    /// The same with a scenario of its own.
    ///
    /// # Errors
    /// A configuration or a log that cannot be had.
    pub fn of(scenario: &Scenario) -> anyhow::Result<Self> {
        let mut flight = DirectFlight::new(scenario)?;
        flight.record_to_temporary_log()?;
        Ok(Self {
            flight,
            seen: Seen::default(),
            expectations: Expectations::default(),
            struck_at: None,
            time_to_safe_s: None,
        })
    }

    /// The family that is flown.
    #[must_use]
    pub const fn flavour(&self) -> Flavour {
        self.flight.rig.autopilot().flavour()
    }

    /// The autopilot.
    pub const fn autopilot(&mut self) -> &mut StubAutopilot {
        self.flight.rig.autopilot_mut()
    }

    /// The instant.
    #[must_use]
    pub const fn now(&self) -> Stamp<Mono> {
        self.flight.rig.now()
    }

    /// Seconds since the fault.
    #[must_use]
    pub fn since_s(&self) -> f64 {
        self.struck_at.map_or(0.0, |at| self.now().seconds_since(at))
    }

    /// The brain's phase.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.flight.phase()
    }

    /// Where the vehicle truly is.
    #[must_use]
    pub fn place(&self) -> Vector3<f64> {
        self.flight.rig.vehicle().hall_from_body().origin.coords
    }

    /// How fast it truly is, m/s.
    #[must_use]
    pub fn speed_mps(&self) -> f64 {
        self.flight.rig.vehicle().velocity_mps().coords.norm()
    }

    /// True on the ground with motors off.
    #[must_use]
    pub const fn is_down(&self) -> bool {
        let autopilot = self.flight.rig.autopilot();
        autopilot.is_landed() && !autopilot.is_armed()
    }

    /// 5 ms.
    pub fn step(&mut self) {
        let Self { flight, seen, expectations, .. } = self;
        flight.step(&mut |now, witnessed| seen.note(now, witnessed, expectations));
        self.expectations.watch(&self.flight, &self.seen);
    }

    /// Flies on.
    pub fn run(&mut self, seconds: f64) {
        self.until(seconds, |_| false);
    }

    /// Flies on until `done`, at most `seconds`; says if it happened.
    pub fn until(&mut self, seconds: f64, done: impl Fn(&Self) -> bool) -> bool {
        let until = self.now().plus(Duration::from_secs_f64(seconds));
        while self.now() < until && !done(self) {
            self.step();
        }
        done(self)
    }

    /// Flies into the survey and three seconds on.
    pub fn survey(&mut self) {
        let is_there = self.until(70.0, |bench| bench.phase() == Phase::Survey);
        self.demand(is_there, "the survey never began");
        self.run(3.0);
    }

    /// The fault begins now.
    pub fn strike(&mut self) {
        self.struck_at = Some(self.now());
    }

    /// Flies on until the safe state, which must come within `limit_s` of the fault.
    pub fn safe_within(&mut self, limit_s: f64, what: &str, is_safe: impl Fn(&Self) -> bool) {
        let left_s = (limit_s - self.since_s()).max(0.0);
        if self.until(left_s, is_safe) {
            self.safe_now();
        } else {
            let mode = self.flight.rig.autopilot().mode_name();
            let text = format!("not within {limit_s} s: {what}; {:?}, {mode}", self.phase());
            self.expectations.complain(text);
        }
    }

    /// The safe state is reached now, if it was not before.
    pub fn safe_now(&mut self) {
        let since_s = self.since_s();
        self.time_to_safe_s.get_or_insert(since_s);
    }

    /// How far the brain's own belief is from the truth, m; 0 without a belief.
    #[must_use]
    pub fn belief_error_m(&self) -> f64 {
        let error_m = self.flight.estimate().and_then(|estimate| {
            let truth = self.flight.rig.vehicle().pose_at(estimate.at)?;
            Some((truth.origin.coords - estimate.hall_from_body.origin.coords).norm())
        });
        error_m.unwrap_or(0.0)
    }

    /// How far the autopilot's belief is from the brain's, m; 0 without a belief.
    #[must_use]
    pub fn disagreement_m(&self) -> f64 {
        let (autopilot, _) = self.flight.rig.autopilot().believed_motion();
        self.flight
            .estimate()
            .map_or(0.0, |own| (autopilot.origin.coords - own.hall_from_body.origin.coords).norm())
    }

    /// The flight may stay as it is: it is safe already.
    pub fn safe_already(&mut self) {
        self.time_to_safe_s.get_or_insert(0.0);
    }

    /// Notes what was found wanting.
    pub fn demand(&mut self, holds: bool, what: &str) {
        if !holds {
            let text = format!("{what} ({:?}, {:.1} s after)", self.phase(), self.since_s());
            self.expectations.complain(text);
        }
    }

    /// Phases entered since the fault.
    #[must_use]
    pub fn phases(&self) -> Vec<Phase> {
        // The brain stamps with its last tick, up to 1/60 s before.
        let since = self.struck_at.unwrap_or(Stamp::ZERO).minus(Duration::from_millis(17));
        self.seen.changes.iter().filter(|change| change.at >= since).map(|c| c.to).collect()
    }

    /// Commands that move the vehicle since the fault.
    #[must_use]
    pub fn commands(&self) -> Vec<MavCmd> {
        let since = self.struck_at.unwrap_or(Stamp::ZERO);
        self.seen.commands.iter().filter(|(at, _)| *at >= since).map(|(_, c)| *c).collect()
    }

    /// Seconds from the fault to the last setpoint; 0 if none came after it.
    #[must_use]
    pub fn setpoints_for_s(&self) -> f64 {
        let last = self.seen.setpoint.map(|(at, _)| at);
        last.zip(self.struck_at).map_or(0.0, |(last, struck)| last.seconds_since(struck).max(0.0))
    }

    /// True if a setpoint left within the last tenth of a second.
    #[must_use]
    pub fn is_steered(&self) -> bool {
        self.seen.setpoint.is_some_and(|(at, _)| self.now().seconds_since(at) < 0.1)
    }

    /// What the brain said holds this.
    #[must_use]
    pub fn said(&self, part: &str) -> bool {
        self.flight.texts().join("").contains(part)
    }

    /// The vehicle may be touched from now on: its motors were stopped in the air.
    pub const fn falls(&mut self) {
        self.expectations.may_touch = true;
    }

    /// The vehicle may be this far from its setpoint, m.
    pub const fn tolerate(&mut self, off_m: f64) {
        self.expectations.largest_off_m = off_m;
    }

    /// The judgement.
    #[must_use]
    pub fn finish(mut self) -> Verdict {
        match self.flight.close_log() {
            Ok(n_logged) if n_logged == self.seen.n_events => {}
            Ok(n_logged) => {
                let n_events = self.seen.n_events;
                self.expectations.complain(format!("{n_logged} of {n_events} events in the log"));
            }
            Err(error) => self.expectations.complain(format!("the log: {error}")),
        }
        let mut complaints = self.expectations.into_complaints();
        if !complaints.is_empty() {
            let words = self.flight.texts();
            let last = words.iter().rev().take(4).rev().cloned().collect::<Vec<_>>().join(" | ");
            complaints.push(format!("last words: {last}"));
        }
        if self.time_to_safe_s.is_none() {
            complaints.push("no safe state".to_owned());
        }
        Verdict {
            is_passed: complaints.is_empty(),
            time_to_safe_s: self.time_to_safe_s,
            complaints,
        }
    }
}

impl Seen {
    fn note(&mut self, now: Stamp<Mono>, witnessed: Witnessed<'_>, judge: &mut Expectations) {
        match witnessed {
            Witnessed::Event(_) => self.n_events += 1,
            Witnessed::Action(Action::PhaseChanged(change)) => self.changes.push(change.clone()),
            Witnessed::ToAutopilot(message) => {
                if !finite_numbers(message) {
                    judge.complain(format!("a broken number left: {message:?}"));
                }
                self.note_message(now, message);
            }
            Witnessed::Action(_) => {}
        }
    }

    fn note_message(&mut self, now: Stamp<Mono>, message: &MavMessage) {
        match message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(data) => {
                let place = Vector3::new(data.x, -data.y, -data.z).map(f64::from);
                self.setpoint = Some((now, place));
            }
            MavMessage::HEARTBEAT(_) => self.heartbeat_at = Some(now),
            MavMessage::COMMAND_LONG(data) if moves_the_vehicle(data.command) => {
                self.commands.push((now, data.command));
            }
            MavMessage::COMMAND_ACK(_) => self.n_acks += 1,
            MavMessage::ODOMETRY(data)
                if self.reset_counters.last() != Some(&data.reset_counter) =>
            {
                self.reset_counters.push(data.reset_counter);
            }
            _ => {}
        }
    }
}

const fn moves_the_vehicle(command: MavCmd) -> bool {
    matches!(
        command,
        MavCmd::MAV_CMD_DO_SET_MODE
            | MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
            | MavCmd::MAV_CMD_NAV_LAND
            | MavCmd::MAV_CMD_NAV_TAKEOFF
    )
}
