//! The list of cases.

mod autopilot;
mod companion;
mod hazards;
mod heading;
mod limits;
mod link;
mod people;
mod sensors;

use super::bench::{Bench, Verdict};
use crate::autopilot::Flavour;

/// One line of the fault matrix.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Its number: 1 to 33 in the matrix, 34 the loss of one way, from 101 on for hazards of real autopilots.
    pub number: u32,
    /// What goes wrong.
    pub name: &'static str,
    /// The only family that it concerns; `None` for both.
    pub only: Option<Flavour>,
    pub(super) script: fn(&mut Lab) -> anyhow::Result<()>,
}

/// Where a case makes its flights.
#[derive(Debug)]
pub(super) struct Lab {
    pub(super) flavour: Flavour,
    pub(super) seed: u64,
    pub(super) verdicts: Vec<Verdict>,
}

impl Lab {
    /// One flight.
    fn fly(&mut self, script: impl FnOnce(&mut Bench)) -> anyhow::Result<()> {
        let bench = Bench::new(self.flavour, self.seed)?;
        self.fly_on(bench, script);
        Ok(())
    }

    fn fly_on(&mut self, mut bench: Bench, script: impl FnOnce(&mut Bench)) {
        script(&mut bench);
        self.verdicts.push(bench.finish());
    }
}

const fn both(number: u32, name: &'static str, script: fn(&mut Lab) -> anyhow::Result<()>) -> Case {
    Case { number, name, only: None, script }
}

const fn only(
    flavour: Flavour,
    number: u32,
    name: &'static str,
    script: fn(&mut Lab) -> anyhow::Result<()>,
) -> Case {
    Case { number, name, only: Some(flavour), script }
}

use Flavour::{ArduPilot, Px4};

/// Every case, in the order of its number.
pub const CASES: &[Case] = &[
    both(1, "companion killed", companion::killed),
    both(2, "estimator loop hangs", companion::hung),
    both(3, "pilot changes the mode", people::mode_switch),
    both(4, "pilot stops the motors", people::kill_switch),
    both(5, "autopilot reboots", autopilot::reboot),
    both(6, "link unplugged for 5 s", link::unplugged),
    both(7, "ground station lost", people::ground_station_lost),
    both(8, "second autopilot on the link", autopilot::second_autopilot),
    both(9, "markers lost for 0.5, 2, 10, 40 s", sensors::markers_lost),
    both(10, "relocalisation jumps", sensors::relocalisation),
    both(11, "wrong markers", sensors::wrong_markers),
    both(12, "LiDAR silent", sensors::lidar_silent),
    both(13, "camera unplugged, frozen", sensors::camera_dead),
    both(14, "clocks jump, suspend", companion::clocks),
    both(15, "TIMESYNC slow, lopsided, unanswered", link::timesync),
    both(16, "detections late and out of order", sensors::late_detections),
    both(17, "inertial samples thin out", link::thin_imu),
    both(18, "NaN and infinity inbound", link::broken_numbers),
    both(19, "rubbish on the wire", link::rubbish),
    both(20, "signing: unsigned, wrong key, replay, future", link::signing),
    both(21, "spoofed commands, flood", people::spoof_and_flood),
    both(22, "commands repeated, lost, broadcast", people::repeated_commands),
    both(23, "mode and arming refused or without effect", autopilot::refusals),
    both(24, "battery low, critical, absent", autopilot::battery),
    both(25, "narrow halls", sensors::narrow_halls),
    both(26, "autopilot's estimate disagrees", autopilot::disagreement),
    both(27, "frames, closed loop", sensors::frames),
    both(28, "power cut: the log up to then", limits::power_cut),
    both(29, "computer at a third of its speed", limits::slow_computer),
    both(30, "link saturated at 57600 baud", limits::slow_link),
    both(31, "no marker in view, no origin", autopilot::no_take_off),
    both(32, "ODOMETRY too seldom, wrong frame", autopilot::odometry_refused),
    both(33, "49.7 days wrap, parameters set in flight", limits::wraps),
    both(34, "only the way to the autopilot is lost", link::one_way_lost),
    only(Px4, 101, "PX4: origin at 489 m, then a gap of vision", hazards::high_origin),
    only(Px4, 102, "PX4: Hold after loss needs a level origin", hazards::hold_on_loss),
    only(Px4, 103, "PX4: defaults after setpoint loss", hazards::default_loss_action),
    only(Px4, 104, "PX4: would follow again by itself", hazards::reentry),
    only(ArduPilot, 105, "ArduPilot: setpoint on the ground", hazards::early_setpoint),
    only(ArduPilot, 106, "ArduPilot: notices lost vision late", hazards::late_notice),
    only(ArduPilot, 107, "ArduPilot: mode before it is ready", hazards::early_mode),
    only(ArduPilot, 108, "ArduPilot: moves with a reset of vision", hazards::moves_with_reset),
];
