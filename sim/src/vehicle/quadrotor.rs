//! One vehicle: everything that moves, stepped together.

use super::battery::{Battery, BatterySettings};
use super::collision::{Collision, Surroundings};
use super::history::History;
use super::imu::{ImuSettings, InertialSensor};
use super::rigid_body::{Load, MotionState, RigidBodySettings, Step, advance};
use super::rotors::{MotorCommands, RotorSettings, Rotors};
use super::wind::{Wind, WindSettings};
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Point, Transform};
use stockpilot::messages::ImuSample;
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

/// The fixed step of the simulation.
pub const STEP: Duration = Duration::from_millis(1);
const STEP_S: f64 = 1e-3;
/// Steps per inertial sample: 200 Hz.
const STEPS_PER_IMU: u64 = 5;
/// Steps between looks at wind, battery and walls: 50 Hz.
const STEPS_PER_SLOW: u64 = 20;
const IMU_INTERVAL_S: f64 = 5e-3;
const SLOW_INTERVAL_S: f64 = 0.02;
/// A landing faster than this breaks the gear, m/s.
const HARD_LANDING_MPS: f64 = 2.0;

/// Everything that tells one vehicle from another.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VehicleSettings {
    /// Mass, inertia, drag, gear.
    pub body: RigidBodySettings,
    /// Rotors.
    pub rotors: RotorSettings,
    /// Battery.
    pub battery: BatterySettings,
    /// Air.
    pub wind: WindSettings,
    /// Inertial sensors.
    pub imu: ImuSettings,
}

/// A quadrotor in its surroundings.
#[derive(Debug, Clone)]
pub struct Vehicle {
    settings: VehicleSettings,
    now: Stamp<Mono>,
    n_steps: u64,
    state: MotionState,
    rotors: Rotors,
    battery: Battery,
    wind: Wind,
    imu: InertialSensor,
    barometer: Noise,
    history: History,
    is_on_ground: bool,
    collision: Option<Collision>,
}

impl Vehicle {
    /// A vehicle at rest at `hall_from_body` at the time `now`.
    #[must_use]
    pub fn new(
        settings: VehicleSettings,
        hall_from_body: &Transform<Hall, Body>,
        now: Stamp<Mono>,
        seeds: SeedBook,
    ) -> Self {
        let state = MotionState::at_rest(hall_from_body);
        let mut history = History::new();
        history.push(now, state);
        Self {
            settings,
            now,
            n_steps: 0,
            state,
            rotors: Rotors::new(settings.rotors, STEP_S),
            battery: Battery::new(settings.battery),
            wind: Wind::new(settings.wind, seeds, SLOW_INTERVAL_S),
            imu: InertialSensor::new(settings.imu, seeds),
            barometer: seeds.stream("barometer"),
            history,
            is_on_ground: false,
            collision: None,
        }
    }

    /// Moves everything by [`STEP`]; every fifth call returns an inertial sample.
    pub fn step(
        &mut self,
        commands: &MotorCommands,
        surroundings: &Surroundings<'_>,
    ) -> Option<ImuSample> {
        self.now = self.now.plus(STEP);
        self.n_steps += 1;
        let step = self.advance(commands, surroundings);
        self.imu.accumulate(&step.specific_force_mps2, &self.state.rate_radps);
        self.is_on_ground = step.is_on_ground;
        if step.impact_mps.is_some_and(|speed| speed > HARD_LANDING_MPS) {
            self.collide(Point::from_coords(self.state.position_m), step.impact_mps);
        }
        if self.n_steps.is_multiple_of(STEPS_PER_SLOW) {
            self.step_slow(surroundings);
        }
        self.n_steps.is_multiple_of(STEPS_PER_IMU).then(|| {
            self.history.push(self.now, self.state);
            self.imu.sample(self.now, IMU_INTERVAL_S)
        })
    }

    fn advance(&mut self, commands: &MotorCommands, surroundings: &Surroundings<'_>) -> Step {
        self.rotors.step(commands);
        let (thrust_n, torque_nm) = self.rotors.wrench();
        let p = self.state.position_m;
        let load = Load {
            thrust_n,
            torque_nm,
            wind_mps: self.wind.velocity_mps(),
            ground_height_m: (surroundings.ground_height_m)(p.x, p.y),
        };
        advance(&self.settings.body, &mut self.state, &load, STEP_S)
    }

    fn step_slow(&mut self, surroundings: &Surroundings<'_>) {
        self.wind.step();
        self.battery.step(self.rotors.power_w(), SLOW_INTERVAL_S);
        let hit = self.hull().into_iter().find(|point| (surroundings.is_solid)(point));
        if let Some(point) = hit {
            self.collide(point, None);
        }
    }

    /// The points of the hull that can hit something: body origin and the tips of the rotors.
    fn hull(&self) -> [Point<Hall>; 5] {
        let pose = self.hall_from_body();
        // A 10 inch rotor reaches 0.127 m past its hub along the diagonal.
        let reach = self.settings.rotors.arm_m + 0.09;
        [(0.0, 0.0), (reach, reach), (reach, -reach), (-reach, reach), (-reach, -reach)]
            .map(|(x, y)| pose * Point::new(x, y, 0.0))
    }

    fn collide(&mut self, place: Point<Hall>, impact_mps: Option<f64>) {
        let speed_mps = impact_mps.unwrap_or_else(|| self.state.velocity_mps.norm());
        self.collision.get_or_insert(Collision { at: self.now, place, speed_mps });
    }

    /// The present time of the simulation.
    #[must_use]
    pub const fn now(&self) -> Stamp<Mono> {
        self.now
    }

    /// True pose.
    #[must_use]
    pub fn hall_from_body(&self) -> Transform<Hall, Body> {
        self.state.hall_from_body()
    }

    /// True velocity in hall axes, m/s.
    #[must_use]
    pub fn velocity_mps(&self) -> Direction<Hall> {
        Direction::from_coords(self.state.velocity_mps)
    }

    /// True angular velocity in body axes, rad/s.
    #[must_use]
    pub const fn rate_radps(&self) -> &Vector3<f64> {
        &self.state.rate_radps
    }

    /// True motion at an instant of the last 0.6 s, interpolated; `None` outside.
    #[must_use]
    pub fn motion_at(&self, at: Stamp<Mono>) -> Option<MotionState> {
        self.history.at(at, (self.now, &self.state))
    }

    /// True pose at an instant of the last 0.6 s, interpolated; `None` outside.
    #[must_use]
    pub fn pose_at(&self, at: Stamp<Mono>) -> Option<Transform<Hall, Body>> {
        self.motion_at(at).map(|state| state.hall_from_body())
    }

    /// Height by air pressure over the hall floor, m, with a noise of 0.1 m.
    pub fn barometer_height_m(&mut self) -> f64 {
        self.state.position_m.z + 0.1 * self.barometer.normal()
    }

    /// The battery.
    #[must_use]
    pub const fn battery(&self) -> &Battery {
        &self.battery
    }

    /// The battery, to change its charge.
    pub const fn battery_mut(&mut self) -> &mut Battery {
        &mut self.battery
    }

    /// The inertial sensors with their true biases.
    #[must_use]
    pub const fn imu(&self) -> &InertialSensor {
        &self.imu
    }

    /// From now on the air moves by this in addition, m/s in hall axes.
    pub const fn blast(&mut self, velocity_mps: Vector3<f64>) {
        self.wind.blast(velocity_mps);
    }

    /// The air at the vehicle, m/s in hall axes.
    #[must_use]
    pub fn wind_mps(&self) -> Vector3<f64> {
        self.wind.velocity_mps()
    }

    /// True while the ground carries the vehicle.
    #[must_use]
    pub const fn is_on_ground(&self) -> bool {
        self.is_on_ground
    }

    /// The first collision, if there was one.
    #[must_use]
    pub const fn collision(&self) -> Option<&Collision> {
        self.collision.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stockpilot::geometry::Rotation;
    use stockpilot::units::GRAVITY_MPS2;

    fn calm() -> VehicleSettings {
        VehicleSettings {
            wind: WindSettings::still(),
            imu: ImuSettings::perfect(),
            ..VehicleSettings::default()
        }
    }

    fn vehicle_at(settings: VehicleSettings, z_m: f64) -> Vehicle {
        let pose =
            Transform::new(Rotation::from_euler_rad(0.0, 0.0, 0.8), Point::new(2.0, 3.0, z_m));
        Vehicle::new(settings, &pose, Stamp::from_nanos(1_000), SeedBook::new(11))
    }

    /// The command at which four rotors carry the weight: `√(m g / 4 T_max)`.
    fn hover_command() -> f64 {
        (1.5 * GRAVITY_MPS2 / 32.0).sqrt()
    }

    #[test]
    fn hover_thrust_equals_the_weight() {
        let mut vehicle = vehicle_at(calm(), 50.0);
        vehicle.rotors = Rotors::new(RotorSettings { lag_s: 1e-9, ..calm().rotors }, STEP_S);
        let mut sample = None;
        for _ in 0..2000 {
            sample = vehicle.step(&[hover_command(); 4], &Surroundings::open_floor()).or(sample);
        }
        assert!((vehicle.hall_from_body().origin.coords.z - 50.0).abs() < 1e-9);
        let accel = sample.map(|s| s.accel_mps2).unwrap();
        assert!((accel - Vector3::new(0.0, 0.0, GRAVITY_MPS2)).norm() < 1e-9);
    }

    #[test]
    fn hover_lasts_fifteen_to_twenty_minutes() {
        let mut vehicle = vehicle_at(calm(), 50.0);
        let mut minutes = 0.0;
        while vehicle.battery().charge_ratio() > 0.1 {
            vehicle.rotors.step(&[hover_command(); 4]);
            let power_w = vehicle.rotors.power_w();
            vehicle.battery.step(power_w, 1.0);
            minutes += 1.0 / 60.0;
        }
        assert!((15.0..20.0).contains(&minutes), "{minutes} min");
    }

    #[test]
    fn past_poses_are_interpolated_and_bounded() {
        let mut vehicle = vehicle_at(calm(), 50.0);
        for _ in 0..1000 {
            vehicle.step(&[0.0; 4], &Surroundings::open_floor());
        }
        // Free fall is h(t) = 50 − ½ g t²; drag at 9.8 m/s takes less than 0.4 m off.
        let half_second_ago = vehicle.now().minus(Duration::from_micros(302_300));
        let past = vehicle.pose_at(half_second_ago).unwrap().origin.coords.z;
        let fallen = 0.5 * GRAVITY_MPS2 * 0.6977_f64.powi(2);
        assert!((50.0 - past - fallen).abs() < 0.15, "{past}");
        assert!(vehicle.pose_at(vehicle.now().plus(STEP)).is_none());
        assert!(vehicle.pose_at(vehicle.now().minus(Duration::from_secs(1))).is_none());
        assert_eq!(vehicle.pose_at(vehicle.now()), Some(vehicle.hall_from_body()));
    }

    #[test]
    fn walls_and_hard_landings_are_reported() {
        let wall = Surroundings { ground_height_m: &|_, _| 0.0, is_solid: &|p| p.coords.x > 2.2 };
        let mut vehicle = vehicle_at(calm(), 5.0);
        for _ in 0..STEPS_PER_SLOW {
            vehicle.step(&[hover_command(); 4], &wall);
        }
        assert!(vehicle.collision().is_some(), "a rotor tip reaches past x = 2.2 m");

        let mut falling = vehicle_at(calm(), 5.0);
        for _ in 0..1500 {
            falling.step(&[0.0; 4], &Surroundings::open_floor());
        }
        // With k = 0.35/1.5 s⁻¹, 4.85 m of fall take 1.035 s: (g/k)(1 − e^(−k t)) = 9.01 m/s.
        let speed = falling.collision().unwrap().speed_mps;
        assert!((speed - 9.01).abs() < 0.02, "{speed}");
    }

    #[test]
    fn same_seed_same_bits() {
        let fly = || {
            let mut vehicle = vehicle_at(VehicleSettings::default(), 20.0);
            let samples: Vec<_> = (0..500)
                .filter_map(|_| vehicle.step(&[0.6; 4], &Surroundings::open_floor()))
                .collect();
            (samples, vehicle.hall_from_body())
        };
        assert_eq!(fly(), fly());
    }
}
