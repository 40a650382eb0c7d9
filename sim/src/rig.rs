//! The true hall with the flying vehicle in it: everything that is not stockpilot.

use crate::autopilot::{Flavour, Sensors, StubAutopilot};
use crate::camera::{CameraModel, CameraSimulator, Picture, PictureCamera};
use crate::lidar::{LidarModel, LidarSimulator, Optics, Packet, PoseTrack};
use crate::machine::Machine;
use crate::vehicle::{MotorCommands, Surroundings, Vehicle, VehicleSettings};
use crate::world::World;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::messages::TagDetections;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// The autopilot was switched on this long before the companion.
const BOOT_LEAD: Duration = Duration::from_millis(12_345);

/// Vehicle, autopilot and sensors in their world.
#[derive(Debug, Clone)]
pub struct Rig {
    world: World,
    vehicle: Vehicle,
    autopilot: StubAutopilot,
    motors: MotorCommands,
    track: PoseTrack,
    lidar: Option<LidarSimulator>,
    camera: CameraSimulator,
    /// Takes the camera's place if it hands over pictures.
    pictures: Option<PictureCamera>,
    machine: Option<Machine>,
    flown_m: f64,
}

/// What left the sensors and the autopilot during one step.
#[derive(Debug, Default)]
pub struct RigOutput {
    /// Packets of the LiDAR.
    pub packets: Vec<Packet>,
    /// Camera frames that arrived.
    pub frames: Vec<TagDetections>,
    /// Camera pictures that arrived, instead of frames.
    pub pictures: Vec<Picture>,
    /// MAVLink messages for the companion.
    pub to_companion: Vec<(MavHeader, MavMessage)>,
}

impl Rig {
    /// A vehicle on the pad.
    #[must_use]
    pub fn new(world: World, lidar: LidarModel, camera: CameraModel, seed: u64) -> Self {
        let seeds = SeedBook::new(seed);
        let start = Stamp::ZERO;
        let pad = world.pad;
        let pose = Transform::new(Rotation::from_euler_rad(0.0, 0.0, pad.yaw_rad), pad.position);
        Self {
            vehicle: Vehicle::new(VehicleSettings::default(), &pose, start, seeds),
            autopilot: StubAutopilot::indoor(Flavour::Px4, BOOT_LEAD),
            motors: MotorCommands::default(),
            track: PoseTrack::default(),
            lidar: Some(LidarSimulator::new(lidar, seeds, start)),
            pictures: camera
                .pictures
                .map(|pictures| PictureCamera::new(camera.clone(), pictures, seeds, start)),
            camera: CameraSimulator::new(camera, seeds, start),
            world,
            machine: None,
            flown_m: 0.0,
        }
    }

    /// The same rig under an autopilot of this family.
    #[must_use]
    pub fn with_autopilot(mut self, flavour: Flavour) -> Self {
        self.autopilot = StubAutopilot::indoor(flavour, BOOT_LEAD);
        self
    }

    /// The same rig in a hall where a machine drives about.
    #[must_use]
    pub fn with_machine(mut self, machine: Machine) -> Self {
        self.world.guests = machine.solids_at(self.now()).to_vec();
        self.machine = Some(machine);
        self
    }

    /// Moves on to the next inertial sample, 5 ms later.
    pub fn step(&mut self) -> RigOutput {
        let before = self.vehicle.hall_from_body().origin;
        if let Some(machine) = &self.machine {
            self.world.guests = machine.solids_at(self.vehicle.now()).to_vec();
        }
        let world = &self.world;
        let surroundings = Surroundings {
            ground_height_m: &|x, y| world.height_at(x, y),
            is_solid: &|p| is_solid(world, p),
        };
        let imu = loop {
            if let Some(imu) = self.vehicle.step(&self.motors, &surroundings) {
                break imu;
            }
        };
        let sensors = Sensors::read(&mut self.vehicle, imu);
        self.motors = self.autopilot.step(&sensors);
        let now = self.vehicle.now();
        let pose = self.vehicle.hall_from_body();
        self.flown_m += (pose.origin - before).coords.norm();
        self.track.push(now, pose);
        let pose_at = |at| self.track.at(at).unwrap_or(pose);
        RigOutput {
            packets: self
                .lidar
                .as_mut()
                .map_or_else(Vec::new, |lidar| lidar.advance(&self.world, now, pose_at)),
            frames: if self.pictures.is_some() {
                Vec::new()
            } else {
                self.camera.advance(&self.world, now, pose_at)
            },
            pictures: self
                .pictures
                .as_mut()
                .map_or_else(Vec::new, |pictures| pictures.advance(&self.world, now, pose_at)),
            to_companion: self.autopilot.take_outgoing(),
        }
    }

    /// Takes the LiDAR's optics off, for an emulated sensor that measures with them; no packets
    /// come from the rig any more. `None` the second time.
    pub fn take_optics(&mut self) -> Option<Optics> {
        self.lidar.take().map(LidarSimulator::into_optics)
    }

    /// The true pose of the body at an instant of the last steps.
    #[must_use]
    pub fn pose_at(&self, at: Stamp<Mono>) -> Transform<Hall, Body> {
        self.track.at(at).unwrap_or_else(|| self.vehicle.hall_from_body())
    }

    /// The instant of the last step.
    #[must_use]
    pub const fn now(&self) -> Stamp<Mono> {
        self.vehicle.now()
    }

    /// The hall.
    #[must_use]
    pub const fn world(&self) -> &World {
        &self.world
    }

    /// The vehicle.
    #[must_use]
    pub const fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// The vehicle, to change its battery.
    pub const fn vehicle_mut(&mut self) -> &mut Vehicle {
        &mut self.vehicle
    }

    /// Moves a marker of the hall by a vector in hall axes, m; false if there is none with this
    /// number. What anybody has written down of it stays as it was.
    pub fn move_tag(&mut self, id: u32, by_m: &Vector3<f64>) -> bool {
        let Some(tag) = self.world.tags.iter_mut().find(|tag| tag.id == id) else { return false };
        for corner in &mut tag.corners {
            *corner = Point::from_coords(corner.coords + by_m);
        }
        true
    }

    /// Moves every marker of the hall by a vector in hall axes, m: as if the vehicle stood there.
    pub fn move_all_tags(&mut self, by_m: &Vector3<f64>) {
        for corner in self.world.tags.iter_mut().flat_map(|tag| &mut tag.corners) {
            *corner = Point::from_coords(corner.coords + by_m);
        }
    }

    /// The camera.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        self.camera.model()
    }

    /// The autopilot, to talk to and to torment.
    pub const fn autopilot_mut(&mut self) -> &mut StubAutopilot {
        &mut self.autopilot
    }

    /// The autopilot.
    #[must_use]
    pub const fn autopilot(&self) -> &StubAutopilot {
        &self.autopilot
    }

    /// Length of the true path, m.
    #[must_use]
    pub const fn flown_m(&self) -> f64 {
        self.flown_m
    }
}

/// The skin of solids that does not count as touched, m: the body rests on the floor.
const SKIN_M: f64 = 0.03;

/// True if a point lies inside anything of the hall, or outside of it.
pub(crate) fn is_solid(world: &World, p: &Point<Hall>) -> bool {
    let (x, y, z) = (p.coords.x, p.coords.y, p.coords.z);
    let hall = &world.hall;
    let is_outside = !hall.footprint().contains(x, y) || z > crate::world::CEILING_M;
    is_outside
        || z < world.height_at(x, y) - SKIN_M
        || world
            .walls_inside
            .iter()
            .chain(&world.obstacles)
            .chain(&world.guests)
            .any(|wall| wall.depth_m(&p.coords) > SKIN_M)
}
