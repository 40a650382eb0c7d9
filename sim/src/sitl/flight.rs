//! The real service between a foreign autopilot and emulated sensors, in real time.

use super::answers::judge;
use super::earth::Earth;
use super::ground::Ground;
use super::source::{Arrived, Listener, TruthAddress, listen};
use super::tap::{self, Far};
use super::track::TruthTrack;
use crate::autopilot::Flavour;
use crate::camera::CameraSimulator;
use crate::gate::{GateAddress, signing_key};
use crate::hall::{Devices, config};
use crate::lidar::{LineFaults, Optics, SerialLidar};
use crate::machine::Machine;
use crate::report::{Flown, Measured, RunReport};
use crate::rig::is_solid;
use crate::scenario::Scenario;
use crate::vehicle::VehicleSettings;
use crate::world::World;
use anyhow::{Context as _, bail};
use nalgebra::Vector3;
use serde::Serialize;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::time::Duration;
use stockpilot::config::{Config, FilterSection, SigningSection};
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::link::Address;
use stockpilot::pilot::FlightSummary;
use stockpilot::service::clock::Clock;
use stockpilot::service::onboard::{Onboard, Surroundings};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// How the foreign autopilot is reached.
#[derive(Debug, Clone)]
pub struct SitlOptions {
    /// The service's link to it.
    pub link: Address,
    /// Where it tells the truth.
    pub truth: TruthAddress,
    /// Its link for a ground station, from which this program says start; without it the user does.
    pub ground: Option<GateAddress>,
    /// The file with the key, if the link is signed.
    pub signing_key: Option<PathBuf>,
    /// Where log, configuration and the stamps of signing go.
    pub directory: PathBuf,
}

/// The sensors go on by this much at a time.
const STEP: Duration = Duration::from_millis(5);
/// A flight that has not ended by then will not end by itself.
const LONGEST_FLIGHT: Duration = Duration::from_secs(1_800);
/// What the comparison of clocks and the truth's way to here leave, s.
const CLOCKS_SIGMA_S: f64 = 3e-3;
/// Inertial noise of PX4's simulated vehicle: 1.7 m/s² and 0.14 rad/s in each sample at 250 Hz.
const ACCEL_DENSITY_MPS2_RTHZ: f64 = 0.11;
const GYRO_DENSITY_RADPS_RTHZ: f64 = 9e-3;
/// Half the vehicle's width, m.
const ARM_M: f64 = 0.25;
/// Lower than this over its pad it may touch the ground, m.
const LANDING_M: f64 = 0.3;
/// Number of the ground station's link among those that sign.
const GROUND_LINK: u8 = 7;
const TELL_EVERY: Duration = Duration::from_secs(5);

/// The first line of the output: the addresses that were taken.
#[derive(Debug, Serialize)]
struct Opened {
    autopilot_link: Option<String>,
    truth: Option<String>,
    ground: Option<String>,
}

/// Flies one scenario from start to landing on somebody else's autopilot.
///
/// # Errors
/// An address or a device that cannot be had, a service that does not start, or a flight without
/// an end.
pub fn run(scenario: &Scenario, options: &SitlOptions) -> anyhow::Result<RunReport> {
    tokio::runtime::Runtime::new().context("no runtime")?.block_on(fly(scenario, options))
}

async fn fly(scenario: &Scenario, options: &SitlOptions) -> anyhow::Result<RunReport> {
    let (clock, stop) = (Clock::real(), CancellationToken::new());
    let sensors = Sensors::new(scenario, clock.now())?;
    let config = configured(scenario, options, &sensors)?;
    let around = Surroundings { clock: clock.clone(), stop: stop.clone(), waits_for_disk: false };
    let onboard = Box::pin(Onboard::start(&config, around)).await?;
    let log = onboard.log().to_owned();
    std::fs::write(log.with_extension("toml"), config.to_toml()?).context("the configuration")?;
    let (listener, truths) = Listener::new(clock.clone());
    let (link, truth) = match &options.truth {
        TruthAddress::At(address) => {
            let truth =
                listen(address, listener, stop.clone()).await.context("the truth's link")?;
            (onboard.link_addr(), truth)
        }
        TruthAddress::Link => {
            let far = Far::open(&options.link).await.context("the autopilot's link")?;
            let local = far.local();
            let service = onboard.link_addr().context("the service's link has no address")?;
            let tap = tap::run(far, service, listener);
            tokio::spawn(stop.clone().run_until_cancelled_owned(tap));
            (local, None)
        }
    };
    let key = options.signing_key.as_deref();
    let signing = key.map(|key| signing_key(key, GROUND_LINK)).transpose()?;
    let ground = Ground::open(options.ground.as_ref(), signing, stop.clone())
        .await
        .context("the ground station's link")?;
    let text = |address: Option<std::net::SocketAddr>| address.map(|address| address.to_string());
    let opened =
        Opened { autopilot_link: text(link), truth: text(truth), ground: text(ground.local()) };
    tell(&opened)?;
    let began = clock.now();
    let mut flight = Flight {
        track: TruthTrack::new(on_pad(&scenario.world)),
        machine: scenario.machine(),
        world: scenario.world.clone(),
        sensors,
        ground,
        truths,
        clock,
        began,
        has_collided: false,
    };
    let outcome = flight.fly(&onboard).await;
    let time_s = flight.clock.now().seconds_since(began);
    let counts = flight.sensors.lidar.counts();
    let dropped = counts.samples_overrun + counts.samples_corrupted;
    let (beams_sent, lost) =
        (counts.samples_sent + dropped, onboard.lidar().borrow().stats.lost_beams);
    onboard.stop();
    onboard.join().await?;
    let measured = Measured {
        flight: outcome?,
        poses: judge(&log, &flight.track)?,
        beams_sent,
        beams_dropped: dropped + lost,
        wall_time: Duration::from_secs_f64(time_s),
        load: None,
    };
    // The service has found out by itself who flies; the report names them by the truth they told.
    let autopilot = match flight.track.earth() {
        Some(Earth::ArduPilot) => Flavour::ArduPilot,
        Some(Earth::Wgs84) | None => Flavour::Px4,
    };
    let scenario = Scenario { autopilot, ..scenario.clone() };
    let path_length_m = flight.track.flown_m();
    let flown = Flown { path_length_m, time_s, has_collided: flight.has_collided };
    Ok(RunReport::of(&scenario, &flown, &measured, Some(log)))
}

/// The pose of the body of a vehicle that stands on its pad.
fn on_pad(world: &World) -> Transform<Hall, Body> {
    let gear_m = Vector3::z() * VehicleSettings::default().body.gear_height_m;
    let origin = Point::from_coords(world.pad.position.coords + gear_m);
    Transform::new(Rotation::from_euler_rad(0.0, 0.0, world.pad.yaw_rad), origin)
}

/// The service's configuration: that of the hall, with room for what is not the simulator's own.
fn configured(
    scenario: &Scenario,
    options: &SitlOptions,
    sensors: &Sensors,
) -> anyhow::Result<Config> {
    let is_tapped = options.truth == TruthAddress::Link;
    let link = if is_tapped { "udpin:127.0.0.1:0".to_owned() } else { options.link.to_string() };
    let lidar_port = sensors.lidar.path().to_str().context("the port's name is not UTF-8")?;
    let devices = Devices {
        link,
        lidar_port: lidar_port.to_owned(),
        detections: "udp:127.0.0.1:0".to_owned(),
        log_directory: options.directory.clone(),
        pictures: None,
    };
    let mut config = config(scenario, devices);
    let corner_sigma_px = config.filter.corner_sigma_px;
    config.filter = FilterSection {
        corner_sigma_px,
        capture_sigma_s: CLOCKS_SIGMA_S,
        accel_density_mps2_rthz: ACCEL_DENSITY_MPS2_RTHZ,
        gyro_density_radps_rthz: GYRO_DENSITY_RADPS_RTHZ,
        ..FilterSection::default()
    };
    config.link.signing = options.signing_key.as_deref().map(|key| signing(key, options));
    Ok(config)
}

fn signing(key_file: &Path, options: &SitlOptions) -> SigningSection {
    SigningSection {
        key_file: key_file.to_owned(),
        stamp_file: options.directory.join("signing.stamp"),
        link_id: 1,
        max_ahead_s: 60.0,
        accept_unsigned: Vec::new(),
    }
}

/// The emulated devices.
struct Sensors {
    lidar: SerialLidar,
    optics: Optics,
    camera: CameraSimulator,
    /// The detector's socket.
    detector: UdpSocket,
}

impl Sensors {
    fn new(scenario: &Scenario, now: Stamp<Mono>) -> anyhow::Result<Self> {
        let seeds = SeedBook::new(scenario.seed);
        let faults = LineFaults { checks_speed: true, ..LineFaults::default() };
        let detector = UdpSocket::bind("127.0.0.1:0").context("no socket for the detector")?;
        detector.set_nonblocking(true)?;
        Ok(Self {
            lidar: SerialLidar::open(&scenario.lidar.model(), faults, seeds, now, true)
                .context("no pseudo-terminal")?,
            optics: Optics::new(scenario.true_lidar(), seeds),
            camera: CameraSimulator::new(scenario.camera.clone(), seeds, now),
            detector,
        })
    }

    /// Goes on to `now` in the hall, as seen from the true track.
    fn step(
        &mut self,
        world: &World,
        track: &TruthTrack,
        now: Stamp<Mono>,
        onboard: &Onboard,
    ) -> anyhow::Result<()> {
        let Some(newest) = track.at(now) else { return Ok(()) };
        let pose_at = |at: Stamp<Mono>| track.at(at).unwrap_or(newest);
        let mut view = self.optics.view(world, pose_at);
        self.lidar.advance(now, &mut view).context("the LiDAR's line broke")?;
        let peer = onboard.detections_addr().context("the detections have no address")?;
        for frame in self.camera.advance(world, now, pose_at) {
            let line = crate::camera::detections_line(&frame)? + "\n";
            self.detector.send_to(line.as_bytes(), peer)?;
        }
        Ok(())
    }
}

struct Flight {
    world: World,
    machine: Option<Machine>,
    track: TruthTrack,
    sensors: Sensors,
    ground: Ground,
    truths: mpsc::Receiver<Arrived>,
    clock: Clock,
    began: Stamp<Mono>,
    has_collided: bool,
}

impl Flight {
    async fn fly(&mut self, onboard: &Onboard) -> anyhow::Result<FlightSummary> {
        let status = onboard.status();
        let mut due = self.began;
        let mut next_word = self.began.plus(TELL_EVERY);
        while self.clock.now().since(self.began) < LONGEST_FLIGHT {
            due = due.plus(STEP).max(self.clock.now().minus(STEP));
            self.clock.sleep_until(due).await;
            let now = self.clock.now();
            while let Ok((at, truth)) = self.truths.try_recv() {
                self.track.push(at, &truth);
            }
            if let Some(machine) = &self.machine {
                let since = Stamp::ZERO.plus(now.since(self.began));
                self.world.guests = machine.solids_at(since).to_vec();
            }
            self.sensors.step(&self.world, &self.track, now, onboard)?;
            self.watch(now);
            self.ground.step(Stamp::ZERO.plus(now.since(self.began)));
            if let Some(summary) = status.borrow().flight.clone() {
                return Ok(summary);
            }
            if now >= next_word {
                next_word = now.plus(TELL_EVERY);
                self.show(now, &status.borrow());
            }
        }
        bail!(
            "the flight has not ended after {} s; last words: {:?}",
            LONGEST_FLIGHT.as_secs(),
            self.ground.texts(),
        )
    }

    /// The simulator's own world has no walls: whether these were touched is seen here.
    fn watch(&mut self, now: Stamp<Mono>) {
        let Some(pose) = self.track.at(now) else { return };
        let is_landing = pose.origin.coords.z < self.world.pad.position.coords.z + LANDING_M;
        let arms = [(ARM_M, 0.0), (-ARM_M, 0.0), (0.0, ARM_M), (0.0, -ARM_M), (0.0, 0.0)];
        let touches = arms.iter().any(|(x, y)| {
            let arm = pose.origin.coords + Vector3::new(*x, *y, 0.0);
            is_solid(&self.world, &Point::from_coords(arm))
        });
        self.has_collided |= touches && !is_landing;
    }

    #[expect(clippy::print_stderr, reason = "the program's output")]
    fn show(&self, now: Stamp<Mono>, status: &stockpilot::service::ServiceStatus) {
        let phase = status.phase.map_or("idle", |phase| phase.name());
        let heard = match (&status.vehicle, self.track.n_messages()) {
            (None, _) => "no autopilot is heard",
            (Some(_), 0) => "no truth is heard",
            (Some(_), _) => "",
        };
        let last = self.ground.texts().last().map_or("", String::as_str);
        eprintln!("{:6.1} s  {phase:<9} {heard} {last}", now.seconds_since(self.began));
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn tell(opened: &Opened) -> anyhow::Result<()> {
    println!("{}", serde_json::to_string(opened)?);
    Ok(())
}
