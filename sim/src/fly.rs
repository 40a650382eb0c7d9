//! A flight of the real service: emulated LiDAR on a pseudo-terminal, stub autopilot on UDP,
//! detections on a socket, and the service between them, all in this process.
//!
//! The rig owns the clock: one step of the simulation moves it by 5 ms, no faster than the wished
//! speed and no faster than this machine simulates. The service only sees devices and that clock.

use crate::hall::{Devices, config};
use crate::judge::PoseJudge;
use crate::lidar::{LineFaults, Optics, SerialLidar};
use crate::load::LoadMeter;
use crate::operator::Operator;
use crate::picture_line::PictureLine;
use crate::report::{Measured, RunReport};
use crate::rig::Rig;
use crate::scenario::Scenario;
use anyhow::{Context, bail};
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader};
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::fs::OpenOptionsExt as _;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use stockpilot::config::{Config, FoxgloveSection, PageSection};
use stockpilot::pilot::FlightSummary;
use stockpilot::service::clock::{Clock, ClockDriver};
use stockpilot::service::onboard::{Onboard, Surroundings};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};
use tokio_util::sync::CancellationToken;

/// What the user asks of a flight, beside the scenario.
#[derive(Debug, Clone)]
pub struct FlyOptions {
    /// Flight seconds per second, at most.
    pub speed: f64,
    /// Where log and configuration go.
    pub directory: PathBuf,
    /// Show a line of progress.
    pub shows_progress: bool,
    /// Where a ground station may speak to the autopilot, instead of the operator within.
    pub ground: Option<String>,
    /// Serve the live log for Foxglove at this address.
    pub foxglove: Option<String>,
    /// Serve the live page.
    pub page: Option<PageOptions>,
}

/// How a flight is shown.
#[derive(Debug, Clone)]
pub struct PageOptions {
    /// Address and port; port 0 for a free one.
    pub listen: String,
    /// The log of an earlier survey: the page shows what has changed since.
    pub last_survey: Option<PathBuf>,
    /// Nobody starts the flight but the page, and the page stays until the program is ended.
    pub waits: bool,
}

/// A flight that has not ended by then will not end by itself.
const LONGEST_FLIGHT: Duration = Duration::from_secs(900);
/// A page that waits for somebody waits for a working day of flight time.
const LONGEST_WAIT: Duration = Duration::from_secs(8 * 3_600);
/// The rig moves by one inertial sample.
const STEP: Duration = Duration::from_millis(5);
/// The brain may be this much behind the simulation: two of its ticks.
const LARGEST_LAG: Duration = Duration::from_millis(34);
const POLL: Duration = Duration::from_micros(100);
/// A brain that does not tick for five seconds is not waited for any longer.
const LONGEST_WAIT_POLLS: u32 = 50_000;
/// A line of progress comes this often, by the wall's clock.
const PROGRESS_EVERY: Duration = Duration::from_millis(250);

/// Flies one scenario from start to landing.
///
/// # Errors
/// A device that cannot be had, a service that does not start, or a flight without an end.
pub fn run(scenario: &Scenario, options: &FlyOptions) -> anyhow::Result<RunReport> {
    let meter = LoadMeter::start();
    let runtime = tokio::runtime::Runtime::new().context("cannot start the runtime")?;
    let (clock, driver) = Clock::driven();
    let mut devices = EmulatedDevices::open(scenario)?;
    // A socket's name must be short, so it does not go beside the log.
    let sockets = tempfile::tempdir().context("no folder for sockets")?;
    devices.pictures = scenario.camera.pictures.map(|_| PictureLine::new(sockets.path()));
    let mut config = config(scenario, devices.addresses(&options.directory)?);
    config.filter.capture_sigma_s = CLOCKS_SIGMA_S;
    let token = options.page.as_ref().map(|page| open_page(page, &mut config)).transpose()?;
    if let Some(listen) = &options.foxglove {
        config.foxglove = FoxgloveSection { enabled: true, listen: listen.clone() };
    }
    let stop = CancellationToken::new();
    let around = Surroundings { clock, stop: stop.clone(), waits_for_disk: true };
    let onboard = runtime.block_on(Onboard::start(&config, around))?;
    if let Some(token) = token {
        announce_page(&onboard, &token)?;
    }
    runtime.spawn(end_by_signal(stop));
    if options.foxglove.is_some() {
        announce_foxglove(&onboard)?;
    }
    write_config(&config, onboard.log())?;
    devices.connect(&onboard)?;
    let log = onboard.log().to_owned();
    let operator = match &options.ground {
        Some(address) => announced(Operator::at_station(address)?),
        None if options.page.as_ref().is_some_and(|page| page.waits) => Operator::looking_on(),
        None => Operator::default(),
    };
    let mut rig = scenario.rig();
    let optics = rig.take_optics().context("the rig has no LiDAR")?;
    let mut flight = Flight {
        rig,
        optics,
        operator,
        poses: PoseJudge::default(),
        devices,
        driver,
        pace: Pace::new(options.speed),
    };
    let mut outcome = flight.fly(&onboard, options);
    if options.page.as_ref().is_some_and(|page| page.waits) {
        outcome = outcome.and_then(|summary| flight.stay(&onboard, summary));
    }
    let load = meter.read(flight.rig.now().since(Stamp::ZERO));
    let (beams_sent, beams_dropped) = flight.beams_sent_and_dropped(&onboard);
    onboard.stop();
    runtime.block_on(join_driven(onboard, &flight.driver))?;
    let summary = outcome?;
    let measured = Measured {
        flight: summary,
        poses: flight.poses,
        beams_sent,
        beams_dropped,
        wall_time: flight.pace.began.elapsed(),
        load: Some(load),
    };
    Ok(RunReport::new(scenario, &flight.rig, &measured, Some(log)))
}

/// Switches the page on, with a token of this flight's own beside the log; gives the token.
fn open_page(page: &PageOptions, config: &mut Config) -> anyhow::Result<String> {
    let directory = &config.log.directory;
    std::fs::create_dir_all(directory)
        .with_context(|| format!("cannot make {}", directory.display()))?;
    let mut secret = [0_u8; 16];
    std::fs::File::open("/dev/urandom").and_then(|mut source| source.read_exact(&mut secret))?;
    let token: String = secret.iter().map(|byte| format!("{byte:02x}")).collect();
    let path = directory.join("page.token");
    let open =
        std::fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&path);
    open.and_then(|mut file| file.write_all(token.as_bytes()))
        .with_context(|| format!("cannot write {}", path.display()))?;
    config.page = PageSection {
        enabled: true,
        listen: page.listen.clone(),
        token_file: Some(path),
        last_survey: page.last_survey.clone(),
        ..PageSection::default()
    };
    Ok(token)
}

/// Tells where the page is as the first line of the output, with the token of this simulation.
#[expect(clippy::print_stdout, reason = "the program's output")]
fn announce_page(onboard: &Onboard, token: &str) -> anyhow::Result<()> {
    let address = onboard.page_addr().context("the live page could not be served")?;
    println!("{{\"page\":\"http://{address}/\",\"token\":\"{token}\"}}");
    Ok(())
}

/// Tells where the live log is, as a line of JSON.
#[expect(clippy::print_stdout, reason = "the program's output")]
fn announce_foxglove(onboard: &Onboard) -> anyhow::Result<()> {
    let address = onboard.foxglove_addr().context("the live log could not be served")?;
    println!("{{\"foxglove\":\"ws://{address}\"}}");
    Ok(())
}

/// Has the vehicle land at the first SIGINT or SIGTERM, and ends the program at the second.
async fn end_by_signal(stop: CancellationToken) {
    use tokio::signal::unix::{SignalKind, signal};
    let Ok(mut terminate) = signal(SignalKind::terminate()) else { return };
    for n in 0..2 {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminate.recv() => {}
        }
        stop.cancel();
        if n == 0 {
            tracing::info!("landing first; once more ends at once");
        }
    }
    std::process::exit(1);
}

/// Tells the ground station's address as the first line of the output.
#[expect(clippy::print_stdout, reason = "the program's output")]
fn announced((operator, address): (Operator, SocketAddr)) -> Operator {
    println!("{{\"ground\":\"{address}\"}}");
    operator
}

/// Waits for the service to end while the clock goes on, since its tasks may wait for an instant.
async fn join_driven(onboard: Onboard, driver: &ClockDriver) -> anyhow::Result<()> {
    let mut ticker = tokio::time::interval(Duration::from_millis(1));
    let joined = onboard.join();
    tokio::pin!(joined);
    loop {
        tokio::select! {
            stats = &mut joined => return stats.map(|_| ()).map_err(Into::into),
            _ = ticker.tick() => driver.advance_to(driver.now().plus(STEP)),
        }
    }
}

/// What the comparison of clocks over sockets leaves, s: round trips wait for the scheduler.
pub(crate) const CLOCKS_SIGMA_S: f64 = 1e-3;

/// The configuration beside the log, for `stockpilot run` and for curious people.
fn write_config(config: &Config, log: &Path) -> anyhow::Result<()> {
    let path = log.with_extension("toml");
    std::fs::write(&path, config.to_toml()?)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// The far ends of the service's links.
struct EmulatedDevices {
    lidar: SerialLidar,
    /// The autopilot's socket.
    link: UdpSocket,
    link_peer: Option<SocketAddr>,
    /// The detector's socket.
    detector: UdpSocket,
    detections_peer: Option<SocketAddr>,
    pictures: Option<PictureLine>,
    sequence: u8,
}

impl EmulatedDevices {
    fn open(scenario: &Scenario) -> anyhow::Result<Self> {
        let seeds = SeedBook::new(scenario.seed);
        let model = scenario.lidar.model();
        let faults = LineFaults { checks_speed: true, ..LineFaults::default() };
        let socket = || -> std::io::Result<UdpSocket> {
            let socket = UdpSocket::bind("127.0.0.1:0")?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        };
        Ok(Self {
            lidar: SerialLidar::open(&model, faults, seeds, Stamp::ZERO, true)
                .context("no pseudo-terminal")?,
            link: socket().context("no socket for the autopilot")?,
            link_peer: None,
            detector: socket().context("no socket for the detector")?,
            detections_peer: None,
            pictures: None,
            sequence: 0,
        })
    }

    fn addresses(&self, directory: &Path) -> anyhow::Result<Devices> {
        let lidar_port = self.lidar.path().to_str().context("the port's name is not UTF-8")?;
        Ok(Devices {
            link: "udpin:127.0.0.1:0".to_owned(),
            lidar_port: lidar_port.to_owned(),
            detections: "udp:127.0.0.1:0".to_owned(),
            pictures: self.pictures.as_ref().map(|line| line.socket.clone()),
            log_directory: directory.to_owned(),
        })
    }

    fn connect(&mut self, onboard: &Onboard) -> anyhow::Result<()> {
        self.link_peer = Some(onboard.link_addr().context("the link has no address")?);
        self.detections_peer =
            Some(onboard.detections_addr().context("the detections have no address")?);
        if let Some(pictures) = &mut self.pictures {
            pictures.stream = Some(UnixStream::connect(&pictures.socket)?);
        }
        Ok(())
    }

    fn send_mavlink(&mut self, header: MavHeader, message: &MavMessage) -> anyhow::Result<()> {
        let Some(peer) = self.link_peer else { return Ok(()) };
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(MavHeader { sequence: self.sequence, ..header }, message);
        self.sequence = self.sequence.wrapping_add(1);
        self.link.send_to(raw.raw_bytes(), peer).context("cannot send MAVLink")?;
        Ok(())
    }

    /// All messages that the service has sent since the last call.
    fn receive_mavlink(&self) -> Vec<(MavHeader, MavMessage)> {
        let mut datagram = [0_u8; 2048];
        std::iter::from_fn(|| self.link.recv(&mut datagram).ok().map(|n| decode(&datagram[..n])))
            .flatten()
            .collect()
    }
}

fn decode(datagram: &[u8]) -> Vec<(MavHeader, MavMessage)> {
    let mut reader = MavlinkReader::new(datagram);
    std::iter::from_fn(|| reader.read_any_message().ok()).collect()
}

/// Keeps the simulation from running faster than wished.
struct Pace {
    began: Instant,
    speed: f64,
}

impl Pace {
    #[expect(clippy::disallowed_methods, reason = "the simulation owns the flight's clock")]
    fn new(speed: f64) -> Self {
        Self { began: Instant::now(), speed }
    }

    #[expect(clippy::disallowed_methods, reason = "paces the simulation against the wall's clock")]
    fn wait_for(&self, flight: Stamp<Mono>) {
        let due = Duration::from_secs_f64(flight.seconds() / self.speed);
        let elapsed = self.began.elapsed();
        if due > elapsed {
            std::thread::sleep(due.saturating_sub(elapsed));
        }
    }

    /// Lets a service that falls behind catch up, so that a wished speed above what this machine
    /// keeps up with slows the flight instead of losing ticks.
    #[expect(clippy::disallowed_methods, reason = "paces the simulation against the service")]
    fn wait_for_brain(&self, flight: Stamp<Mono>, onboard: &Onboard) {
        for _ in 0..LONGEST_WAIT_POLLS {
            if flight.since(onboard.last_tick()) <= LARGEST_LAG {
                return;
            }
            std::thread::sleep(POLL);
        }
    }
}

struct Flight {
    rig: Rig,
    optics: Optics,
    operator: Operator,
    poses: PoseJudge,
    devices: EmulatedDevices,
    driver: ClockDriver,
    pace: Pace,
}

impl Flight {
    fn fly(&mut self, onboard: &Onboard, options: &FlyOptions) -> anyhow::Result<FlightSummary> {
        // A person at the page may take their time.
        let waits = options.page.as_ref().is_some_and(|page| page.waits);
        let longest = if waits { LONGEST_WAIT } else { LONGEST_FLIGHT };
        let limit = Stamp::ZERO.plus(longest);
        let status = onboard.status();
        let mut next_progress = Stamp::ZERO;
        while self.rig.now() < limit {
            self.step()?;
            self.pace.wait_for_brain(self.rig.now(), onboard);
            if let Some(pictures) = &mut self.devices.pictures {
                pictures.wait_for_detector(self.rig.now(), onboard);
            }
            if let Some(summary) = status.borrow().flight.clone() {
                return Ok(summary);
            }
            anyhow::ensure!(!onboard.has_ended(), "ended before the landing");
            if options.shows_progress && self.rig.now() >= next_progress {
                next_progress = self.rig.now().plus(PROGRESS_EVERY.mul_f64(options.speed));
                show_progress(self.rig.now(), &status.borrow());
            }
        }
        bail!(
            "the flight has not ended after {} s; last words: {:?}",
            LONGEST_FLIGHT.as_secs(),
            self.operator.texts,
        )
    }

    /// Goes on after the landing, for more flights, until the program is ended; gives the last
    /// flight.
    fn stay(
        &mut self,
        onboard: &Onboard,
        mut last: FlightSummary,
    ) -> anyhow::Result<FlightSummary> {
        let status = onboard.status();
        while !onboard.has_ended() {
            self.step()?;
            self.pace.wait_for_brain(self.rig.now(), onboard);
            if let Some(summary) = status.borrow().flight.clone() {
                last = summary;
            }
        }
        Ok(last)
    }

    /// 5 ms of flight.
    fn step(&mut self) -> anyhow::Result<()> {
        let output = self.rig.step();
        let now = self.rig.now();
        self.pace.wait_for(now);
        self.driver.advance_to(now);
        for (header, message) in &output.to_companion {
            self.devices.send_mavlink(*header, message)?;
        }
        let rig = &self.rig;
        let mut view = self.optics.view(rig.world(), |at| rig.pose_at(at));
        self.devices.lidar.advance(now, &mut view).context("the LiDAR's line broke")?;
        for frame in &output.frames {
            if let Some(peer) = self.devices.detections_peer {
                let line = crate::camera::detections_line(frame)? + "\n";
                self.devices.detector.send_to(line.as_bytes(), peer)?;
            }
        }
        if let Some(line) = &mut self.devices.pictures {
            for picture in &output.pictures {
                line.send(picture, now)?;
            }
        }
        for (header, message) in self.devices.receive_mavlink() {
            let vehicle = self.rig.vehicle();
            self.poses.hear(&message, |at| vehicle.pose_at(at));
            self.rig.autopilot_mut().on_message(now, header, &message);
        }
        for (header, message) in self.rig.autopilot_mut().take_outgoing() {
            self.devices.send_mavlink(header, &message)?;
        }
        self.operator.step(now, self.rig.autopilot_mut());
        Ok(())
    }

    /// Samples that left the sensor, and those of them that are known to be lost on the way.
    ///
    /// To be asked before the service ends: a turn that comes after that has nowhere to go.
    fn beams_sent_and_dropped(&self, onboard: &Onboard) -> (u64, u64) {
        let line = self.devices.lidar.counts();
        let driver = onboard.lidar().borrow().stats;
        let dropped_on_line = line.samples_overrun + line.samples_corrupted;
        if dropped_on_line + driver.lost_beams > 0 {
            tracing::warn!(?line, ?driver, "beams were lost on the way");
        }
        (line.samples_sent + dropped_on_line, dropped_on_line + driver.lost_beams)
    }
}

#[expect(clippy::print_stderr, reason = "the program's output")]
fn show_progress(now: Stamp<Mono>, status: &stockpilot::service::ServiceStatus) {
    let phase = status.phase.map_or("idle", |phase| phase.name());
    let volume = status.volume.map_or_else(String::new, |report| {
        let battery = report
            .battery_ratio
            .map_or_else(String::new, |b| format!("  battery {:.0} %", 100.0 * b));
        format!(
            "  coverage {:.0} %  volume {:.1} ± {:.1} m³  step {}{battery}",
            100.0 * report.estimate.coverage_ratio,
            report.estimate.volume_m3,
            2.0 * report.estimate.sigma_m3,
            report.steps_done,
        )
    });
    eprintln!("{:6.1} s  {phase:<9}{volume}", now.seconds());
}
