//! The machine: state of the stub autopilot, one step, and what a test can do to it.

use super::commander::{Commander, Facts};
use super::controller::Controller;
use super::estimator::{Belief, Estimator, Inputs};
use super::frames::flipped;
use super::guidance::Guidance;
use super::landing::{LandDetector, Signs};
use super::limits::{Lift, Limits};
use super::modes::Px4Mode;
use super::outbox::{Link, Outbox};
use super::params::ParamTable;
use super::setpoint::Target;
use super::status::Status;
use super::streams::{Streams, id};
use super::takeoff::TakeOff;
use super::timesync::TimeSync;
use crate::vehicle::{MotorCommands, Vehicle};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{GPS_GLOBAL_ORIGIN_DATA, MavMessage, MavSeverity};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Point, Rotation, Transform};
use stockpilot::messages::ImuSample;
use stockpilot::time::{Boot, Mono, Stamp};

/// Component id of the companion computer.
pub const COMPANION_COMPONENT: u8 = 191;

/// Time that a boot takes; the links are silent meanwhile.
const BOOT_TIME: Duration = Duration::from_secs(2);
/// Time after which a silent companion counts as lost: `COM_OBC_LOSS_T` and PX4's own delay.
const COMPANION_LOST_AFTER: Duration = Duration::from_secs(7);

/// The hall's x axis points this far east of magnetic north, rad: no hall stands by the compass.
const HALL_BEARING_RAD: f64 = 0.7;

/// What the autopilot measures itself.
#[derive(Debug, Clone, Copy)]
pub struct Sensors {
    /// Inertial sample in `Body`, stamped on the clock of the simulation.
    pub imu: ImuSample,
    /// Height by air pressure, m.
    pub pressure_height_m: f64,
    /// Heading against magnetic north, clockwise, rad.
    pub compass_rad: f64,
    /// Battery voltage, V.
    pub battery_voltage_v: f64,
    /// Battery current, A.
    pub battery_current_a: f64,
    /// State of charge, 0 to 1.
    pub battery_charge_ratio: f64,
}

impl Sensors {
    /// Before anything is measured.
    pub(super) const fn nothing(imu: ImuSample) -> Self {
        Self {
            imu,
            pressure_height_m: 0.0,
            compass_rad: HALL_BEARING_RAD,
            battery_voltage_v: 0.0,
            battery_current_a: 0.0,
            battery_charge_ratio: 1.0,
        }
    }

    /// Reads the sensors of a vehicle together with its latest inertial sample.
    #[must_use]
    pub fn read(vehicle: &mut Vehicle, imu: ImuSample) -> Self {
        let pressure_height_m = vehicle.barometer_height_m();
        let yaw_rad = vehicle.hall_from_body().rotation.yaw_rad();
        let battery = vehicle.battery();
        Self {
            imu,
            pressure_height_m,
            compass_rad: HALL_BEARING_RAD - yaw_rad,
            battery_voltage_v: battery.voltage_v(),
            battery_current_a: battery.current_a(),
            battery_charge_ratio: battery.charge_ratio(),
        }
    }
}

/// A stub of PX4 v1.16, system 1, component 1.
#[derive(Debug, Clone)]
pub struct StubPx4 {
    /// Boot clock minus the clock of the simulation, ns.
    boot_lead_ns: i64,
    ready_at: Stamp<Boot>,
    is_dead: bool,
    pub(super) wants_reboot: bool,
    pub(super) now: Stamp<Boot>,
    last_step: Stamp<Boot>,
    pub(super) params: ParamTable,
    pub(super) param_list: Option<(Link, usize)>,
    pub(super) outbox: Outbox,
    pub(super) companion_streams: Streams,
    pub(super) ground_streams: Streams,
    pub(super) status: Status,
    pub(super) timesync: TimeSync,
    pub(super) estimator: Estimator,
    pub(super) belief: Belief,
    pub(super) controller: Controller,
    pub(super) guidance: Guidance,
    pub(super) takeoff: TakeOff,
    pub(super) landing: LandDetector,
    pub(super) commander: Commander,
    pub(super) setpoint: Option<(Target, Stamp<Boot>)>,
    pub(super) origin: Option<GPS_GLOBAL_ORIGIN_DATA>,
    pub(super) companion_heard_at: Option<Stamp<Boot>>,
    pub(super) is_companion_lost: bool,
    pub(super) sensors: Sensors,
    /// What its simulator says of the true motion, if it runs in one.
    pub(in crate::autopilot) truth: Option<MavMessage>,
    pub(super) accel_frd_mps2: Vector3<f64>,
    pub(super) gyro_frd_radps: Vector3<f64>,
}

impl StubPx4 {
    /// An autopilot whose boot clock is ahead of the simulation's by `boot_lead`.
    #[must_use]
    pub fn new(params: ParamTable, boot_lead: Duration) -> Self {
        let lead_ns = i64::try_from(boot_lead.as_nanos()).unwrap_or(i64::MAX);
        Self::booted(params, lead_ns, Stamp::ZERO)
    }

    fn booted(params: ParamTable, boot_lead_ns: i64, ready_at: Stamp<Boot>) -> Self {
        let estimator = Estimator::new();
        let zero = Vector3::zeros();
        let imu = ImuSample { at: Stamp::ZERO, accel_mps2: zero, gyro_radps: zero };
        Self {
            boot_lead_ns,
            ready_at,
            is_dead: false,
            wants_reboot: false,
            now: Stamp::ZERO,
            last_step: Stamp::ZERO,
            controller: Controller::new(params.real("MPC_THR_HOVER")),
            params,
            param_list: None,
            outbox: Outbox::default(),
            companion_streams: Streams::companion(),
            ground_streams: Streams::ground(),
            status: Status::default(),
            timesync: TimeSync::default(),
            belief: estimator.belief(),
            estimator,
            guidance: Guidance::new(),
            takeoff: TakeOff::Disarmed,
            landing: LandDetector::new(),
            commander: Commander::new(),
            setpoint: None,
            origin: None,
            companion_heard_at: None,
            is_companion_lost: false,
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
            is_at_rest: !self.commander.is_armed() && self.landing.is_landed(),
        };
        self.estimator.step(self.now, &inputs);
        self.belief = self.estimator.belief();
    }

    /// Vision's heading, where it is fused, displaces the compass.
    fn uses_compass(&self) -> bool {
        let fuses_vision_yaw = self.params.int("EKF2_EV_CTRL") & 8 != 0;
        let is_there = self.params.int("SYS_HAS_MAG") != 0 && self.params.int("EKF2_MAG_TYPE") != 5;
        is_there && !fuses_vision_yaw
    }

    fn judge(&mut self) {
        let signs = Signs {
            is_armed: self.commander.is_armed(),
            thrust_ratio: self.controller.thrust_ratio(),
            sink_wanted_mps: self.controller.sink_wanted_mps(),
            sink_mps: self.belief.velocity_mps.z,
        };
        let land_event = self.landing.step(self.now, &signs);
        let facts = self.facts();
        self.commander.step(self.now, &facts, &self.params, land_event, &mut self.outbox);
        let is_climb_done =
            self.commander.active() == Px4Mode::TakeOff && self.guidance.is_climb_done();
        if is_climb_done && facts.allow(Px4Mode::Loiter) {
            self.commander.request(Px4Mode::Loiter, &facts);
        }
        let is_silent =
            self.companion_heard_at.is_some_and(|at| self.now.since(at) > COMPANION_LOST_AFTER);
        if is_silent && !self.is_companion_lost {
            self.is_companion_lost = true;
            let text = "Connection to mission computer lost";
            self.outbox.text(MavSeverity::MAV_SEVERITY_CRITICAL, text);
        }
    }

    fn control(&mut self, dt_s: f64) -> MotorCommands {
        let offboard = self.setpoint.map_or_else(Target::default, |(target, _)| target);
        let mode = self.commander.active();
        let target = self.guidance.target(mode, &self.belief, &offboard, &self.params);
        let wants_up = target.position_m[2].is_some_and(|z| z < self.belief.position_m.z - 0.05)
            || target.velocity_mps[2].is_some_and(|v| v < -0.05);
        let is_armed = self.commander.is_armed();
        let is_landed = self.landing.is_landed();
        let lift = Lift::px4(&self.params);
        self.takeoff.step(self.now, &lift, is_armed, wants_up, is_landed);
        match self.takeoff.climb_limit_mps(self.now, &lift) {
            Some(climb_limit_mps) => {
                let limits = Limits::px4(&self.params);
                self.controller.step(&self.belief, &target, &limits, climb_limit_mps, dt_s)
            }
            None if is_armed => self.controller.idle(&self.belief),
            None => {
                self.controller.idle(&self.belief);
                [0.0; 4]
            }
        }
    }

    fn send_streams(&mut self) {
        let mode = (self.commander.active(), self.commander.is_armed());
        self.status.publish(self.now, mode);
        for link in [Link::Companion, Link::Ground] {
            let mut streams = std::mem::take(self.streams_mut(link));
            streams.poll(self.now, |id| self.send_stream(link, id));
            *self.streams_mut(link) = streams;
        }
    }

    pub(super) const fn streams_mut(&mut self, link: Link) -> &mut Streams {
        match link {
            Link::Companion => &mut self.companion_streams,
            Link::Ground => &mut self.ground_streams,
        }
    }

    /// False if there is nothing to say.
    fn send_stream(&mut self, link: Link, id: u32) -> bool {
        if id == id::CURRENT_MODE && !self.status.is_news_for(link) {
            return false;
        }
        let message = self.message(id);
        let is_sent = message.is_some();
        if let Some(message) = message {
            self.outbox.send(link, message);
        }
        is_sent
    }

    pub(super) fn facts(&self) -> Facts {
        let loss_s = self.params.real("COM_OF_LOSS_T");
        let has_setpoints =
            self.setpoint.is_some_and(|(_, at)| self.now.seconds_since(at) < loss_s);
        let is_position_valid = self.belief.is_position_valid;
        Facts {
            is_position_valid,
            is_global_valid: is_position_valid
                && self.origin.is_some()
                && self.estimator.is_vision_north_aligned(),
            has_setpoints,
            is_landed: self.landing.is_landed(),
            land_changed_at: self.landing.became_at(),
        }
    }

    fn set_now(&mut self, now: Stamp<Mono>) {
        self.now = Stamp::from_nanos(now.nanos().saturating_add(self.boot_lead_ns));
    }

    fn is_silent(&self) -> bool {
        self.is_dead || self.now < self.ready_at
    }

    /// Takes in a message of the companion, at `now` on the clock of the simulation.
    pub fn on_message(&mut self, now: Stamp<Mono>, header: MavHeader, message: &MavMessage) {
        self.set_now(now);
        if !self.is_silent() {
            self.receive(Link::Companion, header, message);
        }
    }

    /// Takes in a message of a ground station; it reaches the companion unless it is for the
    /// autopilot alone.
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

    /// Messages for the ground station since the last call, with those of the companion.
    pub fn to_ground_station(&mut self) -> Vec<(MavHeader, MavMessage)> {
        self.outbox.take(Link::Ground)
    }

    /// The pilot turns the mode switch; from now on the sticks are held, centred.
    pub fn pilot_switches_to(&mut self, mode: Px4Mode) {
        self.guidance.give_to_pilot();
        let facts = self.facts();
        self.commander.request(mode, &facts);
    }

    /// The pilot throws the switch that stops the motors at once.
    pub fn pilot_kills_motors(&mut self) {
        self.commander.stop();
    }

    /// Starts anew: the boot clock begins at zero, motors stop, everything but the parameters is
    /// forgotten, and the links are silent for two seconds.
    pub fn reboot(&mut self, now: Stamp<Mono>) {
        let unsent = std::mem::take(&mut self.outbox);
        *self = Self::booted(
            self.params.clone(),
            now.nanos().saturating_neg(),
            Stamp::ZERO.plus(BOOT_TIME),
        );
        self.outbox = unsent;
        self.set_now(now);
    }

    /// Loses its power: motors stop, the links fall silent, until [`Self::reboot`].
    pub fn kill(&mut self) {
        self.is_dead = true;
        self.outbox.clear();
    }

    /// The companion's link is a serial port of this speed: PX4 sends `MAV_1_RATE` bytes/s at most, half
    /// of what the line carries if that is 0.
    pub fn speaks_over_serial(&mut self, baud: u32) {
        let rate = self.params.int("MAV_1_RATE");
        let most = if rate > 0 { f64::from(rate) } else { f64::from(baud / 20) };
        self.companion_streams.most_bytes_per_s = Some(most);
    }

    /// From now on it is a firmware from before v1.15, which knows no `CURRENT_MODE`.
    pub fn forgets_current_mode(&mut self) {
        self.companion_streams.forget(id::CURRENT_MODE);
        self.ground_streams.forget(id::CURRENT_MODE);
    }

    /// The parameters.
    #[must_use]
    pub const fn params(&self) -> &ParamTable {
        &self.params
    }

    /// The parameters, to change them behind the link's back.
    pub const fn params_mut(&mut self) -> &mut ParamTable {
        &mut self.params
    }

    /// True while the motors may turn.
    #[must_use]
    pub const fn is_armed(&self) -> bool {
        self.commander.is_armed()
    }

    /// The mode that flies.
    #[must_use]
    pub fn mode(&self) -> Px4Mode {
        self.commander.active()
    }

    /// True while a failsafe flies.
    #[must_use]
    pub const fn is_in_failsafe(&self) -> bool {
        self.commander.is_in_failsafe()
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

    /// Pose and velocity as the autopilot believes them, in `Hall` axes.
    #[must_use]
    pub fn believed_motion(&self) -> (Transform<Hall, Body>, Direction<Hall>) {
        believed_motion(&self.belief)
    }
}

/// Pose and velocity of a belief, in `Hall` axes.
pub(super) fn believed_motion(belief: &Belief) -> (Transform<Hall, Body>, Direction<Hall>) {
    let q = belief.attitude.quaternion();
    let turned = UnitQuaternion::new_normalize(Quaternion::new(q.w, q.i, -q.j, -q.k));
    let origin = Point::from_coords(flipped(&belief.position_m));
    let velocity = Direction::from_coords(flipped(&belief.velocity_mps));
    (Transform::new(Rotation::from_quaternion(turned), origin), velocity)
}
