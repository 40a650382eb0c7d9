//! The serial ports of this computer.

use super::{Check, Verdict};
use crate::lidar::{GOOD_LATENCY_MS, latency_timer_ms};
use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Where USB adapters have names that do not change.
const BY_ID: &str = "/dev/serial/by-id";
/// Beginnings of names of serial devices: USB adapters, USB devices, UARTs of a Pi and a Jetson.
const NAMES: [&str; 4] = ["ttyUSB", "ttyACM", "ttyAMA", "ttyTHS"];

/// A serial port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SerialPort {
    /// The best name to write into a configuration.
    pub path: PathBuf,
    /// The device behind it.
    pub device: PathBuf,
    /// This user may open it.
    pub is_permitted: bool,
    /// How long its adapter may hold bytes back, ms; `None` if it has no such timer.
    pub latency_ms: Option<u32>,
}

impl SerialPort {
    /// What is to be said of it.
    #[must_use]
    pub fn check(&self) -> Check {
        let subject = format!("port {}", self.path.display());
        let device = self.device.display();
        if !self.is_permitted {
            let cure = format!(
                "`sudo usermod -aG $(stat -c %G {device}) $USER`, then log in again; or install \
                 deploy/99-stockpilot.rules"
            );
            return Check::with_cure(subject, Verdict::Bad, "no permission to open it", cure);
        }
        match self.latency_ms {
            Some(ms) if ms > GOOD_LATENCY_MS => {
                let name = file_name(&self.device);
                let cure = format!(
                    "`echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer`; for good: \
                     deploy/99-stockpilot.rules"
                );
                let found = format!("{device}, its FTDI adapter holds bytes back for {ms} ms");
                Check::with_cure(subject, Verdict::Warn, found, cure)
            }
            _ => Check::good(subject, device.to_string()),
        }
    }
}

/// All serial ports that may have a sensor behind them.
#[must_use]
pub fn serial_ports() -> Vec<SerialPort> {
    let named: Vec<PathBuf> = entries(Path::new(BY_ID));
    let mut ports: Vec<SerialPort> = named.into_iter().filter_map(port).collect();
    let plain = entries(Path::new("/dev")).into_iter().filter(|path| {
        let name = file_name(path);
        NAMES.iter().any(|beginning| name.starts_with(beginning))
    });
    for port in plain.filter_map(port) {
        if !ports.iter().any(|known| known.device == port.device) {
            ports.push(port);
        }
    }
    ports
}

/// The port of this name; `None` if there is no such device.
pub(super) fn port(path: PathBuf) -> Option<SerialPort> {
    let device = fs::canonicalize(&path).ok()?;
    let latency_ms = latency_timer_ms(&device);
    let is_permitted = is_permitted(&device);
    Some(SerialPort { path, device, is_permitted, latency_ms })
}

/// Opening says it best: groups, modes and containers all have their say.
fn is_permitted(device: &Path) -> bool {
    let opened = OpenOptions::new().read(true).write(true).open(device);
    !opened.is_err_and(|error| error.kind() == ErrorKind::PermissionDenied)
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let found = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = found.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usb(is_permitted: bool, latency_ms: Option<u32>) -> Check {
        let path = PathBuf::from("/dev/serial/by-id/usb-FTDI");
        SerialPort { path, device: "/dev/ttyUSB3".into(), is_permitted, latency_ms }.check()
    }

    #[test]
    fn permission_and_latency_have_their_cures() {
        assert_eq!(usb(true, None).verdict, Verdict::Good);
        assert_eq!(usb(true, Some(1)).verdict, Verdict::Good);
        let slow = usb(true, Some(16));
        assert_eq!(slow.verdict, Verdict::Warn);
        assert!(slow.found.contains("16 ms"));
        assert!(slow.cure.unwrap().contains("devices/ttyUSB3/latency_timer"));
        let closed = usb(false, Some(16));
        assert_eq!(closed.verdict, Verdict::Bad);
        assert!(closed.cure.unwrap().contains("usermod"));
    }
}
