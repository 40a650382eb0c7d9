//! Either of the stubs, with what a simulation and a test ask of both.

use super::ardupilot::{ApMode, ApParams, StubArduPilot};
use super::modes::Px4Mode;
use super::params::ParamTable;
use super::stub::{Sensors, StubPx4, believed_motion};
use crate::vehicle::MotorCommands;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Transform};
use stockpilot::time::{Boot, Mono, Stamp};

/// The family of an autopilot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Flavour {
    /// PX4 v1.16.
    #[default]
    Px4,
    /// `ArduCopter` 4.7.
    #[value(name = "ardupilot")]
    ArduPilot,
}

impl Flavour {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Px4, Self::ArduPilot];

    /// Its name on the command line and in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Px4 => "px4",
            Self::ArduPilot => "ardupilot",
        }
    }
}

/// A stub of either family, system 1, component 1.
#[derive(Debug, Clone)]
pub enum StubAutopilot {
    /// PX4.
    Px4(StubPx4),
    /// `ArduPilot`.
    ArduPilot(StubArduPilot),
}

macro_rules! either {
    ($self:ident, $stub:ident => $body:expr) => {
        match $self {
            Self::Px4($stub) => $body,
            Self::ArduPilot($stub) => $body,
        }
    };
}

impl StubAutopilot {
    /// With the parameters that fly indoors, its clock ahead of the simulation's by `boot_lead`.
    #[must_use]
    pub fn indoor(flavour: Flavour, boot_lead: Duration) -> Self {
        match flavour {
            Flavour::Px4 => Self::Px4(StubPx4::new(ParamTable::indoor(), boot_lead)),
            Flavour::ArduPilot => {
                Self::ArduPilot(StubArduPilot::new(ApParams::indoor(), boot_lead))
            }
        }
    }

    /// Which of them it is.
    #[must_use]
    pub const fn flavour(&self) -> Flavour {
        match self {
            Self::Px4(_) => Flavour::Px4,
            Self::ArduPilot(_) => Flavour::ArduPilot,
        }
    }

    /// The stub of PX4, if it is one.
    pub const fn px4_mut(&mut self) -> Option<&mut StubPx4> {
        match self {
            Self::Px4(stub) => Some(stub),
            Self::ArduPilot(_) => None,
        }
    }

    /// The stub of `ArduPilot`, if it is one.
    pub const fn ardupilot_mut(&mut self) -> Option<&mut StubArduPilot> {
        match self {
            Self::Px4(_) => None,
            Self::ArduPilot(stub) => Some(stub),
        }
    }

    /// Moves on by one inertial sample; returns the rotors' commands.
    pub fn step(&mut self, sensors: &Sensors) -> MotorCommands {
        either!(self, stub => stub.step(sensors))
    }

    /// Takes in a message of the companion, at `now` on the clock of the simulation.
    pub fn on_message(&mut self, now: Stamp<Mono>, header: MavHeader, message: &MavMessage) {
        either!(self, stub => stub.on_message(now, header, message));
    }

    /// Takes in a message of a ground station.
    pub fn forward(&mut self, now: Stamp<Mono>, header: MavHeader, message: &MavMessage) {
        either!(self, stub => stub.forward(now, header, message));
    }

    /// The simulator that the autopilot runs in says where the vehicle truly is, in the message that
    /// the family tells it with; it leaves on request only.
    pub fn is_told_the_truth(&mut self, truth: MavMessage) {
        either!(self, stub => stub.truth = Some(truth));
    }

    /// Messages for the companion since the last call.
    pub fn take_outgoing(&mut self) -> Vec<(MavHeader, MavMessage)> {
        either!(self, stub => stub.take_outgoing())
    }

    /// Messages for the ground station since the last call.
    pub fn to_ground_station(&mut self) -> Vec<(MavHeader, MavMessage)> {
        either!(self, stub => stub.to_ground_station())
    }

    /// The pilot turns the mode switch to holding the place by the sticks: POSCTL or LOITER.
    pub fn pilot_takes_over(&mut self) {
        match self {
            Self::Px4(stub) => stub.pilot_switches_to(Px4Mode::Position),
            Self::ArduPilot(stub) => stub.pilot_switches_to(ApMode::Loiter),
        }
    }

    /// The pilot gives the vehicle back: OFFBOARD or GUIDED by the mode switch.
    pub fn pilot_gives_back(&mut self) {
        match self {
            Self::Px4(stub) => stub.pilot_switches_to(Px4Mode::Offboard),
            Self::ArduPilot(stub) => stub.pilot_switches_to(ApMode::Guided),
        }
    }

    /// The pilot throws the switch that stops the motors at once.
    pub fn pilot_kills_motors(&mut self) {
        either!(self, stub => stub.pilot_kills_motors());
    }

    /// Starts anew; see the stubs.
    pub fn reboot(&mut self, now: Stamp<Mono>) {
        either!(self, stub => stub.reboot(now));
    }

    /// Loses its power: motors stop, the links fall silent, until [`Self::reboot`].
    pub fn kill(&mut self) {
        either!(self, stub => stub.kill());
    }

    /// True while the motors may turn.
    #[must_use]
    pub const fn is_armed(&self) -> bool {
        either!(self, stub => stub.is_armed())
    }

    /// True while it follows the companion: OFFBOARD or GUIDED.
    #[must_use]
    pub fn follows_companion(&self) -> bool {
        match self {
            Self::Px4(stub) => stub.mode() == Px4Mode::Offboard,
            Self::ArduPilot(stub) => stub.mode() == ApMode::Guided,
        }
    }

    /// True while it lands.
    #[must_use]
    pub fn is_landing(&self) -> bool {
        match self {
            Self::Px4(stub) => stub.mode() == Px4Mode::Land,
            Self::ArduPilot(stub) => stub.mode() == ApMode::Land,
        }
    }

    /// True while the sticks fly: POSCTL or LOITER.
    #[must_use]
    pub fn is_with_pilot(&self) -> bool {
        match self {
            Self::Px4(stub) => stub.mode() == Px4Mode::Position,
            Self::ArduPilot(stub) => stub.mode() == ApMode::Loiter,
        }
    }

    /// The mode that flies, in the family's words.
    #[must_use]
    pub fn mode_name(&self) -> String {
        match self {
            Self::Px4(stub) => format!("{:?}", stub.mode()),
            Self::ArduPilot(stub) => format!("{:?}", stub.mode()),
        }
    }

    /// True while a failsafe flies.
    #[must_use]
    pub const fn is_in_failsafe(&self) -> bool {
        either!(self, stub => stub.is_in_failsafe())
    }

    /// True while the land detector sees the ground.
    #[must_use]
    pub const fn is_landed(&self) -> bool {
        either!(self, stub => stub.is_landed())
    }

    /// The autopilot believes its position.
    #[must_use]
    pub const fn is_position_valid(&self) -> bool {
        either!(self, stub => stub.is_position_valid())
    }

    /// The autopilot's clock now.
    #[must_use]
    pub const fn boot_now(&self) -> Stamp<Boot> {
        either!(self, stub => stub.boot_now())
    }

    /// Pose and velocity as the autopilot believes them, in `Hall` axes.
    #[must_use]
    pub fn believed_motion(&self) -> (Transform<Hall, Body>, Direction<Hall>) {
        either!(self, stub => believed_motion(&stub.belief))
    }
}
