//! A vehicle, a stub and a companion that knows the truth.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};
use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::geometry::{Point, Rotation, Transform};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::autopilot::{
    ApParams, COMPANION_COMPONENT, ParamTable, Sensors, StubArduPilot, StubPx4,
};
use stockpilot_sim::vehicle::{Surroundings, Vehicle, VehicleSettings};

/// The companion's boot clock is 12.345 s behind the autopilot's.
pub(crate) const BOOT_LEAD: Duration = Duration::from_millis(12_345);

pub(crate) const COMPANION: MavHeader =
    MavHeader { system_id: 1, component_id: COMPANION_COMPONENT, sequence: 0 };
pub(crate) const OPERATOR: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };

/// What the companion wants of the vehicle: position, velocity, acceleration in `Hall`.
#[derive(Clone, Copy)]
pub(crate) struct Wish {
    pub(crate) position: [f64; 3],
    pub(crate) velocity: [f64; 3],
    pub(crate) accel: [f64; 3],
}

impl Wish {
    pub(crate) const fn stay(position: [f64; 3]) -> Self {
        Self { position, velocity: [0.0; 3], accel: [0.0; 3] }
    }
}

/// What the loop needs of a stub.
pub(crate) trait Stub {
    fn step(&mut self, sensors: &Sensors) -> [f64; 4];
    fn on_message(&mut self, now: Stamp<Mono>, header: MavHeader, message: &MavMessage);
    fn take_outgoing(&mut self) -> Vec<(MavHeader, MavMessage)>;
    fn to_ground_station(&mut self) -> Vec<(MavHeader, MavMessage)>;
}

macro_rules! is_stub {
    ($stub:ty) => {
        impl Stub for $stub {
            fn step(&mut self, sensors: &Sensors) -> [f64; 4] {
                <$stub>::step(self, sensors)
            }
            fn on_message(&mut self, now: Stamp<Mono>, header: MavHeader, message: &MavMessage) {
                <$stub>::on_message(self, now, header, message);
            }
            fn take_outgoing(&mut self) -> Vec<(MavHeader, MavMessage)> {
                <$stub>::take_outgoing(self)
            }
            fn to_ground_station(&mut self) -> Vec<(MavHeader, MavMessage)> {
                <$stub>::to_ground_station(self)
            }
        }
    };
}

is_stub!(StubPx4);
is_stub!(StubArduPilot);

/// Everything in one loop of 1 ms.
pub(crate) struct Loop<S = StubPx4> {
    pub(crate) vehicle: Vehicle,
    pub(crate) stub: S,
    pub(crate) odometry_frame: m::MavFrame,
    pub(crate) wish: Option<Wish>,
    pub(crate) sends_odometry: bool,
    pub(crate) odometry_hz: u64,
    pub(crate) odometry_sigma_m: f64,
    /// Sends the velocity in FRD with ODOMETRY.
    pub(crate) sends_velocity: bool,
    /// From measurement to arrival.
    pub(crate) odometry_delay: Duration,
    /// Added to the true position in ODOMETRY, `Hall`, m.
    pub(crate) odometry_error_m: [f64; 3],
    pub(crate) reset_counter: u8,
    pub(crate) estimator: m::MavEstimatorType,
    pub(crate) received: Vec<MavMessage>,
    pub(crate) ground: Vec<(MavHeader, MavMessage)>,
    on_the_way: VecDeque<(Stamp<Mono>, MavMessage)>,
    commands: [f64; 4],
    noise: Noise,
    n_steps: u64,
}

impl Loop {
    pub(crate) fn new(params: ParamTable, seed: u64) -> Self {
        Self::around(StubPx4::new(params, BOOT_LEAD), m::MavFrame::MAV_FRAME_LOCAL_NED, seed)
    }
}

impl Loop<StubArduPilot> {
    pub(crate) fn ardupilot(params: ApParams, seed: u64) -> Self {
        let stub = StubArduPilot::new(params, BOOT_LEAD);
        Self::around(stub, m::MavFrame::MAV_FRAME_LOCAL_FRD, seed)
    }
}

impl<S: Stub> Loop<S> {
    fn around(stub: S, odometry_frame: m::MavFrame, seed: u64) -> Self {
        let seeds = SeedBook::new(seed);
        let pad =
            Transform::new(Rotation::from_euler_rad(0.0, 0.0, 0.4), Point::new(3.0, 2.0, 0.15));
        let vehicle = Vehicle::new(VehicleSettings::default(), &pad, Stamp::ZERO, seeds);
        Self {
            vehicle,
            stub,
            odometry_frame,
            wish: None,
            sends_odometry: true,
            odometry_hz: 30,
            odometry_sigma_m: 0.0,
            sends_velocity: false,
            odometry_delay: Duration::ZERO,
            on_the_way: VecDeque::new(),
            odometry_error_m: [0.0; 3],
            reset_counter: 0,
            estimator: m::MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
            received: Vec::new(),
            ground: Vec::new(),
            commands: [0.0; 4],
            noise: seeds.stream("odometry"),
            n_steps: 0,
        }
    }

    pub(crate) fn now(&self) -> Stamp<Mono> {
        self.vehicle.now()
    }

    pub(crate) fn step(&mut self) {
        self.n_steps += 1;
        let floor = Surroundings::open_floor();
        if let Some(imu) = self.vehicle.step(&self.commands, &floor) {
            let sensors = Sensors::read(&mut self.vehicle, imu);
            self.commands = self.stub.step(&sensors);
        }
        if self.n_steps.is_multiple_of(1000 / self.odometry_hz) && self.sends_odometry {
            let due = self.now().plus(self.odometry_delay);
            let odometry = self.odometry();
            self.on_the_way.push_back((due, odometry));
        }
        while self.on_the_way.front().is_some_and(|(due, _)| *due <= self.vehicle.now()) {
            if let Some((_, odometry)) = self.on_the_way.pop_front() {
                self.send(&odometry);
            }
        }
        if let Some(wish) = self.wish.filter(|_| self.n_steps.is_multiple_of(33)) {
            self.send(&setpoint(&wish));
        }
        if self.n_steps.is_multiple_of(1000) {
            self.send(&heartbeat(m::MavType::MAV_TYPE_ONBOARD_CONTROLLER));
        }
        self.collect();
    }

    /// Takes what the stub said and answers its TIMESYNC.
    pub(crate) fn collect(&mut self) {
        for (_, message) in self.stub.take_outgoing() {
            match message {
                MavMessage::TIMESYNC(data) if data.tc1 == 0 => {
                    let tc1 = self.now().nanos();
                    let answer =
                        m::TIMESYNC_DATA { tc1, ts1: data.ts1, ..m::TIMESYNC_DATA::DEFAULT };
                    self.send(&MavMessage::TIMESYNC(answer));
                }
                other => self.received.push(other),
            }
        }
        self.ground.extend(self.stub.to_ground_station());
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        let until = self.now().plus(Duration::from_secs_f64(seconds));
        while self.now() < until {
            self.step();
        }
    }

    /// Runs until `done`, at most `seconds`; says if it happened.
    pub(crate) fn run_until(&mut self, seconds: f64, done: impl Fn(&Self) -> bool) -> bool {
        let until = self.now().plus(Duration::from_secs_f64(seconds));
        while self.now() < until {
            if done(self) {
                return true;
            }
            self.step();
        }
        done(self)
    }

    pub(crate) fn send(&mut self, message: &MavMessage) {
        let now = self.now();
        self.stub.on_message(now, COMPANION, message);
    }

    fn odometry(&mut self) -> MavMessage {
        let pose = self.vehicle.hall_from_body();
        let noise = self.noise.normal3() * self.odometry_sigma_m;
        let p = pose.origin.coords + noise + nalgebra::Vector3::from(self.odometry_error_m);
        let q = pose.rotation.quaternion();
        let v = q.inverse() * self.vehicle.velocity_mps().coords;
        let unless_sent = if self.sends_velocity { 0.0 } else { f32::NAN };
        let mut velocity_covariance = [unless_sent; 21];
        for index in [0, 6, 11] {
            velocity_covariance[index] += 4e-4;
        }
        let mut pose_covariance = [f32::NAN; 21];
        for index in [0, 6, 11] {
            pose_covariance[index] = 4e-4;
        }
        for index in [15, 18, 20] {
            pose_covariance[index] = 1e-4;
        }
        MavMessage::ODOMETRY(m::ODOMETRY_DATA {
            time_usec: u64::try_from(self.now().nanos() / 1000).unwrap_or(0),
            x: single(p.x),
            y: single(-p.y),
            z: single(-p.z),
            q: [single(q.w), single(q.i), single(-q.j), single(-q.k)],
            vx: single(v.x) + unless_sent,
            vy: single(-v.y) + unless_sent,
            vz: single(-v.z) + unless_sent,
            rollspeed: f32::NAN,
            pitchspeed: f32::NAN,
            yawspeed: f32::NAN,
            pose_covariance,
            velocity_covariance,
            frame_id: self.odometry_frame,
            child_frame_id: m::MavFrame::MAV_FRAME_BODY_FRD,
            reset_counter: self.reset_counter,
            estimator_type: self.estimator,
            quality: 100,
        })
    }

    /// Sends a command as `COMMAND_LONG` and returns the results of its acknowledgements.
    pub(crate) fn command(&mut self, command: MavCmd, params: [f32; 3]) -> Vec<MavResult> {
        let message = command_long(command, params, 1);
        self.received.clear();
        self.send(&message);
        self.collect();
        self.acks(command)
    }

    pub(crate) fn acks(&self, command: MavCmd) -> Vec<MavResult> {
        let ack = |message: &MavMessage| match message {
            MavMessage::COMMAND_ACK(ack) if ack.command == command => {
                assert_eq!((ack.target_system, ack.target_component), (1, COMPANION_COMPONENT));
                Some(ack.result)
            }
            _ => None,
        };
        self.received.iter().filter_map(ack).collect()
    }

    pub(crate) fn arm(&mut self) -> Vec<MavResult> {
        self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0])
    }

    pub(crate) fn set_mode(&mut self, main: f32, sub: f32) -> Vec<MavResult> {
        self.command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, main, sub])
    }

    /// From the pad into a hover at this height, in OFFBOARD.
    pub(crate) fn take_off(&mut self, height_m: f64) {
        self.run(2.0);
        let pad = self.place();
        self.wish = Some(Wish::stay(pad));
        self.run(0.5);
        assert_eq!(self.set_mode(6.0, 0.0).last(), Some(&MavResult::MAV_RESULT_ACCEPTED));
        assert_eq!(self.arm(), [MavResult::MAV_RESULT_ACCEPTED]);
        self.wish = Some(Wish::stay([pad[0], pad[1], height_m]));
        let is_up = self.run_until(15.0, |l| (l.place()[2] - height_m).abs() < 0.1);
        assert!(is_up, "still at {:?}", self.place());
        self.run(3.0);
    }

    pub(crate) fn place(&self) -> [f64; 3] {
        self.vehicle.hall_from_body().origin.coords.into()
    }

    /// Texts that the ground station saw, chunks joined, tabs kept.
    pub(crate) fn texts(&self) -> Vec<String> {
        let mut texts: Vec<String> = Vec::new();
        for (_, message) in &self.ground {
            if let MavMessage::STATUSTEXT(data) = message {
                let part = data.text.to_str().unwrap_or("?");
                match texts.last_mut() {
                    Some(text) if data.chunk_seq > 0 => text.push_str(part),
                    _ => texts.push(part.to_owned()),
                }
            }
        }
        texts
    }

    pub(crate) fn heard_text(&self, text: &str) -> bool {
        self.texts().iter().any(|heard| heard == &format!("{text}\t"))
    }

    pub(crate) fn last_heartbeat(&self) -> Option<&m::HEARTBEAT_DATA> {
        self.received.iter().rev().find_map(|message| match message {
            MavMessage::HEARTBEAT(data) if data.autopilot == m::MavAutopilot::MAV_AUTOPILOT_PX4 => {
                Some(data)
            }
            _ => None,
        })
    }
}

pub(crate) fn command_long(command: MavCmd, params: [f32; 3], component: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(m::COMMAND_LONG_DATA {
        command,
        param1: params[0],
        param2: params[1],
        param3: params[2],
        target_system: 1,
        target_component: component,
        ..m::COMMAND_LONG_DATA::DEFAULT
    })
}

pub(crate) fn heartbeat(mavtype: m::MavType) -> MavMessage {
    MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype,
        autopilot: m::MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: m::MavModeFlag::from_bits_retain(0),
        system_status: m::MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

pub(crate) fn setpoint(wish: &Wish) -> MavMessage {
    let [x, y, z] = wish.position;
    let [vx, vy, vz] = wish.velocity;
    let [ax, ay, az] = wish.accel;
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(m::SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: 0,
        x: single(x),
        y: single(-y),
        z: single(-z),
        vx: single(vx),
        vy: single(-vy),
        vz: single(-vz),
        afx: single(ax),
        afy: single(-ay),
        afz: single(-az),
        yaw: single(-0.4),
        yaw_rate: 0.0,
        type_mask: m::PositionTargetTypemask::from_bits_retain(0x800),
        target_system: 1,
        target_component: 1,
        coordinate_frame: m::MavFrame::MAV_FRAME_LOCAL_NED,
    })
}

#[expect(clippy::cast_possible_truncation, reason = "the wire holds single precision")]
pub(crate) fn single(value: f64) -> f32 {
    value as f32
}

/// A global origin in Zurich at this altitude.
#[expect(deprecated, reason = "PX4 v1.16 speaks it")]
pub(crate) fn origin(altitude_mm: i32) -> MavMessage {
    MavMessage::SET_GPS_GLOBAL_ORIGIN(m::SET_GPS_GLOBAL_ORIGIN_DATA {
        latitude: 473_977_418,
        longitude: 85_455_939,
        altitude: altitude_mm,
        target_system: 1,
        time_usec: 0,
    })
}
