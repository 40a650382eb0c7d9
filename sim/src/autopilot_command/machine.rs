//! The vehicle with the stub in it, on an open floor: x north, y west, z up.

use super::home::Home;
use crate::autopilot::{Flavour, Sensors, StubAutopilot};
use crate::vehicle::{MotorCommands, Surroundings, Vehicle, VehicleSettings};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::time::Duration;
use stockpilot::geometry::{Point, Rotation, Transform};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// Height of the body over the floor when the vehicle stands, m.
const STANDING_M: f64 = 0.15;
const VISION_EVERY: Duration = Duration::from_millis(33);
/// 1σ that the built-in tracking claims: 1 cm and 0.6°.
const POSITION_VAR_M2: f32 = 1e-4;
const ANGLE_VAR_RAD2: f32 = 1e-4;
/// A tracking computer, `MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY`.
const TRACKER: MavHeader = MavHeader { system_id: 1, component_id: 197, sequence: 0 };

/// Vehicle and autopilot.
pub(super) struct Machine {
    vehicle: Vehicle,
    pub(super) autopilot: StubAutopilot,
    motors: MotorCommands,
    /// When the built-in tracking speaks next, if there is one.
    vision_due: Option<Stamp<Mono>>,
    home: Home,
}

impl Machine {
    pub(super) fn new(autopilot: StubAutopilot, is_tracked: bool, home: Home, seed: u64) -> Self {
        let heading = Rotation::from_euler_rad(0.0, 0.0, home.yaw_rad());
        let pad = Transform::new(heading, Point::new(0.0, 0.0, STANDING_M));
        let seeds = SeedBook::new(seed);
        Self {
            vehicle: Vehicle::new(VehicleSettings::default(), &pad, Stamp::ZERO, seeds),
            autopilot,
            motors: MotorCommands::default(),
            vision_due: is_tracked.then_some(Stamp::ZERO),
            home,
        }
    }

    pub(super) const fn now(&self) -> Stamp<Mono> {
        self.vehicle.now()
    }

    /// Moves on to the next inertial sample, 5 ms later.
    pub(super) fn step(&mut self) {
        let floor = Surroundings::open_floor();
        let imu = loop {
            if let Some(imu) = self.vehicle.step(&self.motors, &floor) {
                break imu;
            }
        };
        let sensors = Sensors::read(&mut self.vehicle, imu);
        self.autopilot.is_told_the_truth(self.truth());
        self.motors = self.autopilot.step(&sensors);
        let now = self.now();
        if let Some(due) = self.vision_due.filter(|due| *due <= now) {
            self.vision_due = Some(due.plus(VISION_EVERY));
            let odometry = self.tracked();
            self.autopilot.on_message(now, TRACKER, &odometry);
        }
    }

    /// Where the vehicle truly is, as the family's simulator says it.
    pub(super) fn truth(&self) -> MavMessage {
        self.home.truth(self.autopilot.flavour(), &self.vehicle)
    }

    /// What a motion capture system would send: the true pose in the frames that this autopilot
    /// takes, velocity in body FRD.
    fn tracked(&self) -> MavMessage {
        let pose = self.vehicle.hall_from_body();
        let p = pose.origin.coords;
        let q = pose.rotation.quaternion();
        let v = q.inverse() * self.vehicle.velocity_mps().coords;
        let mut pose_covariance = [0.0; 21];
        for (indices, var) in [([0, 6, 11], POSITION_VAR_M2), ([15, 18, 20], ANGLE_VAR_RAD2)] {
            for index in indices {
                pose_covariance[index] = var;
            }
        }
        let mut velocity_covariance = [0.0; 21];
        for index in [0, 6, 11] {
            velocity_covariance[index] = 4.0 * POSITION_VAR_M2;
        }
        MavMessage::ODOMETRY(m::ODOMETRY_DATA {
            time_usec: u64::try_from(self.now().nanos() / 1_000).unwrap_or(0),
            x: single(p.x),
            y: single(-p.y),
            z: single(-p.z),
            q: [single(q.w), single(q.i), single(-q.j), single(-q.k)],
            vx: single(v.x),
            vy: single(-v.y),
            vz: single(-v.z),
            rollspeed: f32::NAN,
            pitchspeed: f32::NAN,
            yawspeed: f32::NAN,
            pose_covariance,
            velocity_covariance,
            frame_id: match self.autopilot.flavour() {
                Flavour::Px4 => m::MavFrame::MAV_FRAME_LOCAL_NED,
                // Here the heading of the hall is taken for north, so the numbers are the same.
                Flavour::ArduPilot => m::MavFrame::MAV_FRAME_LOCAL_FRD,
            },
            child_frame_id: m::MavFrame::MAV_FRAME_BODY_FRD,
            reset_counter: 0,
            estimator_type: m::MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
            quality: 100,
        })
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the wire holds single precision")]
const fn single(value: f64) -> f32 {
    value as f32
}
