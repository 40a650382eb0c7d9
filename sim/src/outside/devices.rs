//! The devices that the service opens.

use crate::camera::detections_line;
use crate::fly::CLOCKS_SIGMA_S;
use crate::hall::{self, config};
use crate::lidar::{LineFaults, Optics, SerialLidar};
use crate::rig::Rig;
use crate::scenario::Scenario;
use anyhow::Context as _;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use stockpilot::config::PageSection;
use stockpilot::messages::TagDetections;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// The far ends of the service's links.
pub(super) struct Devices {
    lidar: SerialLidar,
    optics: Optics,
    link: UdpSocket,
    /// Where the service speaks from, once it has.
    service: Option<SocketAddr>,
    detector: UnixDatagram,
    detections: PathBuf,
    sequence: u8,
}

impl Devices {
    pub(super) fn open(
        scenario: &Scenario,
        optics: Optics,
        folder: &Path,
        now: Stamp<Mono>,
    ) -> anyhow::Result<Self> {
        let faults = LineFaults { checks_speed: true, ..LineFaults::default() };
        let seeds = SeedBook::new(scenario.seed);
        let lidar = SerialLidar::open(&scenario.lidar.model(), faults, seeds, now, true)
            .context("no pseudo-terminal")?;
        let link = UdpSocket::bind("127.0.0.1:0").context("no socket for the autopilot")?;
        link.set_nonblocking(true)?;
        let detector = UnixDatagram::unbound().context("no socket for the detector")?;
        detector.set_nonblocking(true)?;
        let detections = folder.join("tags.sock");
        Ok(Self { lidar, optics, link, service: None, detector, detections, sequence: 0 })
    }

    /// Writes the configuration for the service; the page takes any free port.
    pub(super) fn write_config(
        &self,
        scenario: &Scenario,
        folder: &Path,
        log_directory: PathBuf,
    ) -> anyhow::Result<PathBuf> {
        let lidar_port = self.lidar.path().to_str().context("the port's name is not UTF-8")?;
        let devices = hall::Devices {
            link: format!("udpout:{}", self.link.local_addr()?),
            lidar_port: lidar_port.to_owned(),
            detections: format!("unix:{}", self.detections.display()),
            pictures: None,
            log_directory,
        };
        let mut config = config(scenario, devices);
        config.filter.capture_sigma_s = CLOCKS_SIGMA_S;
        config.page = PageSection { listen: "127.0.0.1:0".to_owned(), ..PageSection::default() };
        let path = folder.join("hall.toml");
        std::fs::write(&path, config.to_toml()?)
            .with_context(|| format!("cannot write {}", path.display()))?;
        Ok(path)
    }

    /// Lets the LiDAR turn on; the rig's time was zero at `began`.
    pub(super) fn scan(&mut self, rig: &Rig, began: Stamp<Mono>) -> anyhow::Result<()> {
        let to_rig = |at: Stamp<Mono>| Stamp::ZERO.plus(at.since(began));
        let mut view = self.optics.view(rig.world(), |at| rig.pose_at(to_rig(at)));
        let now = began.plus(rig.now().since(Stamp::ZERO));
        self.lidar.advance(now, &mut view).context("the LiDAR's line broke")
    }

    /// Hands a frame to the service, if it listens yet.
    pub(super) fn show(&self, mut frame: TagDetections, began: Stamp<Mono>) -> anyhow::Result<()> {
        frame.captured_at = began.plus(frame.captured_at.since(Stamp::ZERO));
        let line = detections_line(&frame)? + "\n";
        match self.detector.send_to(line.as_bytes(), &self.detections) {
            Err(error) if !is_deaf(&error) => Err(error).context("the detector's socket"),
            _ => Ok(()),
        }
    }

    /// Sends a message to the service; what it does not hear is lost, as on any link.
    pub(super) fn send(&mut self, header: MavHeader, message: &MavMessage) {
        let Some(service) = self.service else { return };
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(MavHeader { sequence: self.sequence, ..header }, message);
        self.sequence = self.sequence.wrapping_add(1);
        if let Err(error) = self.link.send_to(raw.raw_bytes(), service) {
            tracing::debug!(%error, "the service missed a message");
        }
    }

    /// Everything that the service has sent since the last call.
    pub(super) fn receive(&mut self) -> Vec<(MavHeader, MavMessage)> {
        let mut heard = Vec::new();
        let mut datagram = [0_u8; 2_048];
        while let Ok((length, from)) = self.link.recv_from(&mut datagram) {
            self.service = Some(from);
            let mut reader = MavlinkReader::new(&datagram[..length]);
            heard.extend(std::iter::from_fn(|| reader.read_any_message().ok()));
        }
        heard
    }
}

/// Nobody listens yet or any more, or not fast enough.
fn is_deaf(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionRefused, NotFound, WouldBlock};
    matches!(error.kind(), ConnectionRefused | NotFound | WouldBlock)
}
