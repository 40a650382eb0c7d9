//! The machine: state of the stub, one step, and what a test can do to it.

use super::guided::Guided;
use super::jitter::JitterCorrection;
use super::modes::ApMode;
use super::params::ApParams;
use super::telemetry;
use crate::autopilot::controller::Controller;
use crate::autopilot::estimator::{Belief, Ekf3, EkfNews, Inputs};
use crate::autopilot::frames::flipped;
use crate::autopilot::landing::{LandDetector, Signs};
use crate::autopilot::outbox::{Link, Outbox};
use crate::autopilot::streams::Streams;
use crate::autopilot::stub::Sensors;
use crate::autopilot::takeoff::TakeOff;
use crate::vehicle::MotorCommands;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{GPS_GLOBAL_ORIGIN_DATA, MavMessage, MavSeverity};
use nalgebra::Vector3;
use std::collections::BTreeSet;
use std::time::Duration;
use stockpilot::messages::ImuSample;
use stockpilot::time::{Boot, Mono, Stamp};

/// The links are silent for this long after a boot.
const SILENT_FOR: Duration = Duration::from_secs(2);
/// Home follows the origin after this long.
const HOME_AFTER: Duration = Duration::from_secs(1);

/// A stub of `ArduCopter` 4.7, system 1, component 1.
#[derive(Debug, Clone)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of the firmware's state")]
pub struct StubArduPilot {
    boot_lead_ns: i64,
    speaks_at: Stamp<Boot>,
    is_dead: bool,
    pub(super) wants_reboot: bool,
    pub(super) now: Stamp<Boot>,
    last_step: Stamp<Boot>,
    pub(super) params: ApParams,
    pub(super) param_list: Option<(Link, usize)>,
    pub(super) outbox: Outbox,
    pub(super) companion_streams: Streams,
    pub(super) ground_streams: Streams,
    pub(super) seen: BTreeSet<(u32, u8)>,
    pub(super) jitter: JitterCorrection,
    pub(super) ekf: Ekf3,
    pub(in crate::autopilot) belief: Belief,
    pub(super) controller: Controller,
    pub(super) takeoff: TakeOff,
    pub(super) landing: LandDetector,
    pub(super) mode: ApMode,
    /// Where the mode switch of the radio stands.
    pub(super) switch_mode: ApMode,
    pub(super) is_armed: bool,
    pub(super) armed_at: Stamp<Boot>,
    pub(super) has_flown: bool,
    pub(super) is_in_failsafe: bool,
    pub(super) has_said_ready: bool,
    pub(super) prearm_due: Stamp<Boot>,
    pub(super) position_lost_at: Option<Stamp<Boot>>,
    pub(super) guided: Guided,
    /// What the present mode holds on to.
    pub(super) place_m: Vector3<f64>,
    pub(super) yaw_rad: f64,
    pub(super) home_m: Vector3<f64>,
    pub(super) home_is_set: bool,
    pub(super) home_due: Option<Stamp<Boot>>,
    pub(super) origin: Option<GPS_GLOBAL_ORIGIN_DATA>,
    /// A changed mode is told at once.
    pub(super) heartbeat_is_due: bool,
    pub(super) sensors: Sensors,
    /// What its simulator says of the true motion, if it runs in one.
    pub(in crate::autopilot) truth: Option<MavMessage>,
    pub(super) accel_frd_mps2: Vector3<f64>,
    pub(super) gyro_frd_radps: Vector3<f64>,
}

impl StubArduPilot {
    /// An autopilot whose boot clock is ahead of the simulation's by `boot_lead`.
    #[must_use]
    pub fn new(params: ApParams, boot_lead: Duration) -> Self {
        let lead_ns = i64::try_from(boot_lead.as_nanos()).unwrap_or(i64::MAX);
        Self::booted(params, lead_ns, Stamp::ZERO)
    }

    fn booted(params: ApParams, boot_lead_ns: i64, speaks_at: Stamp<Boot>) -> Self {
        let ekf = Ekf3::new();
        let zero = Vector3::zeros();
        let imu = ImuSample { at: Stamp::ZERO, accel_mps2: zero, gyro_radps: zero };
        Self {
            boot_lead_ns,
            speaks_at,
            is_dead: false,
            wants_reboot: false,
            now: Stamp::ZERO,
            last_step: Stamp::ZERO,
            controller: Controller::new(params.real("MOT_THST_HOVER")),
            params,
            param_list: None,
            outbox: Outbox::default(),
            companion_streams: telemetry::streams(),
            ground_streams: telemetry::streams(),
            seen: BTreeSet::new(),
            jitter: JitterCorrection::default(),
            belief: ekf.belief(),
            ekf,
            takeoff: TakeOff::Disarmed,
            landing: LandDetector::new(),
            mode: ApMode::Stabilize,
            switch_mode: ApMode::Stabilize,
            is_armed: false,
            armed_at: Stamp::ZERO,
            has_flown: false,
            is_in_failsafe: false,
            has_said_ready: false,
            prearm_due: Stamp::ZERO,
            position_lost_at: None,
            guided: Guided::new(),
            place_m: zero,
            yaw_rad: 0.0,
            home_m: zero,
            home_is_set: false,
            home_due: None,
            origin: None,
            heartbeat_is_due: false,
            sensors: Sensors::nothing(imu),
            truth: None,
            accel_frd_mps2: zero,
            gyro_frd_radps: zero,
        }
    }

    /// Moves on by one inertial sample; returns the rotors' commands.
    pub fn step(&mut self, sensors: &Sensors) -> MotorCommands {
        self.set_now(sensors.imu.at);
        if self.wants_reboot {
            self.reboot(sensors.imu.at);
        }
        if self.is_silent() {
            return [0.0; 4];
        }
        let dt_s = self.now.seconds_since(self.last_step).clamp(1e-3, 0.02);
        self.last_step = self.now;
        self.sensors = *sensors;
        self.estimate(dt_s);
        self.judge();
        let commands = self.control(dt_s);
        self.send_param_list();
        self.send_streams();
        commands
    }

    fn estimate(&mut self, dt_s: f64) {
        self.accel_frd_mps2 = flipped(&self.sensors.imu.accel_mps2);
        self.gyro_frd_radps = flipped(&self.sensors.imu.gyro_radps);
        let inputs = Inputs {
            accel_mps2: self.accel_frd_mps2,
            gyro_radps: self.gyro_frd_radps,
            pressure_height_m: self.sensors.pressure_height_m,
            compass_rad: self.uses_compass().then_some(self.sensors.compass_rad),
            dt_s,
            is_at_rest: !self.is_armed && self.landing.is_landed(),
        };
        self.ekf.step(self.now, &inputs);
        self.belief = self.ekf.belief();
        for news in self.ekf.take_news() {
            let (severity, text) = match news {
                EkfNews::YawAligned => (MavSeverity::MAV_SEVERITY_INFO, "EKF3 IMU0 yaw aligned"),
                EkfNews::UsesExternalNav => {
                    (MavSeverity::MAV_SEVERITY_INFO, "EKF3 IMU0 is using external nav data")
                }
                EkfNews::StoppedAiding => {
                    (MavSeverity::MAV_SEVERITY_WARNING, "EKF3 IMU0 stopped aiding")
                }
            };
            self.outbox.text_to_all(severity, text);
        }
    }

    fn uses_compass(&self) -> bool {
        self.params.is("COMPASS_ENABLE", 1) && self.params.is("EK3_SRC1_YAW", 1)
    }

    fn judge(&mut self) {
        let signs = Signs {
            is_armed: self.is_armed,
            thrust_ratio: self.controller.thrust_ratio(),
            sink_wanted_mps: self.controller.sink_wanted_mps(),
            sink_mps: self.belief.velocity_mps.z,
        };
        let land_event = self.landing.step(self.now, &signs);
        self.look_after(land_event);
        if self.home_due.is_some_and(|due| self.now >= due) {
            self.home_due = None;
            self.home_is_set = true;
            self.home_m = self.belief.position_m;
        }
    }

    /// The first origin counts, later ones are ignored without a word.
    pub(super) fn set_origin(&mut self, link: Link, origin: GPS_GLOBAL_ORIGIN_DATA) {
        if self.origin.is_some() {
            return;
        }
        self.origin = Some(origin.clone());
        self.home_due = Some(self.now.plus(HOME_AFTER));
        self.outbox.text_to_all(MavSeverity::MAV_SEVERITY_INFO, "EKF3 IMU0 origin set");
        self.outbox.send(link, MavMessage::GPS_GLOBAL_ORIGIN(origin));
    }

    fn set_now(&mut self, now: Stamp<Mono>) {
        self.now = Stamp::from_nanos(now.nanos().saturating_add(self.boot_lead_ns));
    }

    fn is_silent(&self) -> bool {
        self.is_dead || self.now < self.speaks_at
    }

    /// Takes in a message of the companion, at `now` on the clock of the simulation.
    pub fn on_message(&mut self, now: Stamp<Mono>, header: MavHeader, message: &MavMessage) {
        self.set_now(now);
        if !self.is_silent() {
            self.receive(Link::Companion, header, message);
        }
    }

    /// Takes in a message of a ground station.
    pub fn forward(&mut self, now: Stamp<Mono>, header: MavHeader, message: &MavMessage) {
        self.set_now(now);
        if !self.is_silent() {
            self.receive(Link::Ground, header, message);
        }
    }

    /// Messages for the companion since the last call.
    pub fn take_outgoing(&mut self) -> Vec<(MavHeader, MavMessage)> {
        self.outbox.take(Link::Companion)
    }

    /// Messages for the ground station since the last call.
    pub fn to_ground_station(&mut self) -> Vec<(MavHeader, MavMessage)> {
        self.outbox.take(Link::Ground)
    }

    /// The pilot turns the mode switch; sticks stay centred.
    pub fn pilot_switches_to(&mut self, mode: ApMode) {
        self.switch_mode = mode;
        if self.belief.is_position_valid || !mode.needs_position() || !self.is_armed {
            self.enter(mode);
        }
    }

    /// The pilot throws the switch that stops the motors at once.
    pub fn pilot_kills_motors(&mut self) {
        self.stop_motors();
    }

    /// Starts anew: the boot clock begins at zero, motors stop, everything but parameters and the
    /// radio's switch is forgotten.
    pub fn reboot(&mut self, now: Stamp<Mono>) {
        let (unsent, switch_mode) = (std::mem::take(&mut self.outbox), self.switch_mode);
        let lead_ns = now.nanos().saturating_neg();
        *self = Self::booted(self.params.clone(), lead_ns, Stamp::ZERO.plus(SILENT_FOR));
        (self.outbox, self.switch_mode) = (unsent, switch_mode);
        self.set_now(now);
    }

    /// Loses its power: motors stop, the links fall silent, until [`Self::reboot`].
    pub fn kill(&mut self) {
        self.is_dead = true;
        self.outbox.clear();
    }

    /// The parameters.
    #[must_use]
    pub const fn params(&self) -> &ApParams {
        &self.params
    }

    /// The parameters, to change them behind the link's back.
    pub const fn params_mut(&mut self) -> &mut ApParams {
        &mut self.params
    }

    /// True while the motors may turn.
    #[must_use]
    pub const fn is_armed(&self) -> bool {
        self.is_armed
    }

    /// The mode that flies.
    #[must_use]
    pub const fn mode(&self) -> ApMode {
        self.mode
    }

    /// True while a failsafe flies.
    #[must_use]
    pub const fn is_in_failsafe(&self) -> bool {
        self.is_in_failsafe
    }

    /// True while the land detector sees the ground.
    #[must_use]
    pub const fn is_landed(&self) -> bool {
        self.landing.is_landed()
    }

    /// The autopilot believes its position.
    #[must_use]
    pub const fn is_position_valid(&self) -> bool {
        self.belief.is_position_valid
    }

    /// The autopilot's clock now.
    #[must_use]
    pub const fn boot_now(&self) -> Stamp<Boot> {
        self.now
    }
}
