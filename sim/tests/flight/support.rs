//! A flight like a campaign's, with hands on the sensors.

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use std::path::Path;
use std::time::Duration;
use stockpilot::config::Config;
use stockpilot::messages::{VehicleCommand, VolumeAccount};
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, PhaseChange};
use stockpilot::record::{LogHeader, Recorder};
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::autopilot::{Flavour, StubAutopilot};
use stockpilot_sim::camera::CameraModel;
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::scenario::{Conditions, Lidar, Planner, Scenario, Surface};
use stockpilot_sim::world::World;

/// A survey of a few waypoints over heaps.
pub(crate) fn short_survey(seed: u64, n_steps: usize) -> Scenario {
    Scenario {
        world: World::piles(seed).expect("a generated world"),
        planner: Planner::SquareWave,
        surface: Surface::KalmanGrid,
        variance: None,
        lidar: Lidar::Ld19,
        autopilot: Flavour::Px4,
        camera: CameraModel::ahead(),
        n_steps,
        seed,
        // Four legs; left to itself the square wave would choose fewer.
        conditions: Conditions { leg_spacing_m: Some(5.0), ..Conditions::default() },
    }
}

/// Flies to the end and records all of it in a new log.
pub(crate) fn record(scenario: &Scenario, config: &Config, path: &Path) {
    let header = LogHeader { config_toml: config.to_toml().expect("TOML"), ..LogHeader::default() };
    let mut recorder = Recorder::create(path, &header).expect("a log").waiting();
    let mut flight = DirectFlight::with_config(scenario, config).expect("a flight");
    while flight.summary().is_none() && flight.rig.now().seconds() < 300.0 {
        flight.step(&mut |now, seen| match seen {
            Witnessed::Event(event) => recorder.event(now, event),
            Witnessed::Action(action) => recorder.result(now, action),
            Witnessed::ToAutopilot(_) => {}
        });
    }
    assert!(flight.summary().is_some(), "no end: {:?}", flight.texts());
    assert_eq!(recorder.close().lost_in_queue, 0);
}

/// A direct flight with what a test wants to know of it.
pub(crate) struct Flight {
    pub(crate) direct: DirectFlight,
    pub(crate) seen: Seen,
}

/// What the brain decided and what went out.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    pub(crate) changes: Vec<PhaseChange>,
    /// Commands that the brain asked for.
    pub(crate) commands: Vec<(Stamp<Mono>, VehicleCommand)>,
    /// Modes and arming that were asked for on the wire.
    pub(crate) wire_commands: Vec<(Stamp<Mono>, MavCmd)>,
    pub(crate) last_setpoint_at: Option<Stamp<Mono>>,
}

impl Seen {
    fn note(&mut self, now: Stamp<Mono>, witnessed: Witnessed<'_>) {
        match witnessed {
            Witnessed::Action(Action::PhaseChanged(change)) => self.changes.push(change.clone()),
            Witnessed::Action(Action::Command(command)) => self.commands.push((now, *command)),
            Witnessed::ToAutopilot(MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)) => {
                self.last_setpoint_at = Some(now);
            }
            Witnessed::ToAutopilot(MavMessage::COMMAND_LONG(data))
                if moves_the_vehicle(data.command) =>
            {
                self.wire_commands.push((now, data.command));
            }
            Witnessed::Action(_) | Witnessed::ToAutopilot(_) | Witnessed::Event(_) => {}
        }
    }

    /// The phases entered since an instant, in order.
    pub(crate) fn phases_since(&self, since: Stamp<Mono>) -> Vec<Phase> {
        self.changes.iter().filter(|c| c.at >= since).map(|c| c.to).collect()
    }
}

impl Flight {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let direct = DirectFlight::new(scenario).expect("a configuration that fits");
        Self { direct, seen: Seen::default() }
    }

    /// A flight that has been in its survey for three seconds.
    pub(crate) fn in_survey(seed: u64) -> Self {
        Self::in_survey_of(Flavour::Px4, seed)
    }

    /// The same under either autopilot.
    pub(crate) fn in_survey_of(autopilot: Flavour, seed: u64) -> Self {
        Self::in_survey_with(autopilot, seed, |_| {})
    }

    /// The same with something done to the autopilot before the start.
    pub(crate) fn in_survey_with(
        autopilot: Flavour,
        seed: u64,
        change: impl FnOnce(&mut StubAutopilot),
    ) -> Self {
        let mut flight = Self::new(&Scenario { autopilot, ..short_survey(seed, 30) });
        change(flight.direct.rig.autopilot_mut());
        let is_there = flight.run_until(60.0, |f| f.phase() == Phase::Survey);
        assert!(is_there, "no survey: {:?} {:?}", flight.seen.changes, flight.direct.texts());
        flight.run(3.0);
        assert_eq!(flight.phase(), Phase::Survey);
        flight
    }

    pub(crate) fn phase(&self) -> Phase {
        self.direct.phase()
    }

    pub(crate) fn now(&self) -> Stamp<Mono> {
        self.direct.rig.now()
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.direct.summary().is_some()
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        self.run_until(seconds, |_| false);
    }

    /// Runs until `done`, at most `seconds`; says if it happened.
    pub(crate) fn run_until(&mut self, seconds: f64, done: impl Fn(&Self) -> bool) -> bool {
        let until = self.now().plus(Duration::from_secs_f64(seconds));
        while self.now() < until && !done(self) {
            let Self { direct, seen } = self;
            direct.step(&mut |now, witnessed| seen.note(now, witnessed));
        }
        done(self)
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

/// Accounts without the time when they were computed.
pub(crate) fn timeless(accounts: &[VolumeAccount]) -> Vec<VolumeAccount> {
    let mut accounts = accounts.to_vec();
    accounts.iter_mut().for_each(|account| account.estimate.at = Stamp::ZERO);
    accounts
}
