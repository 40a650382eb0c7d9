//! Which video devices this computer has, and what they offer.

use super::v4l2;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Where video devices have names that tell the plug and do not change.
const BY_PATH: &str = "/dev/v4l/by-path";
const DEV: &str = "/dev";

/// A size of pictures, or a range of them, in one format.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Width and height, px; of a range the largest.
    pub size_px: [u32; 2],
    /// The smallest of a range, px.
    pub smallest_px: Option<[u32; 2]>,
    /// The most pictures in a second at [`Self::size_px`]; `None` if the driver does not tell.
    pub fastest_hz: Option<f64>,
}

/// The sizes that a pixel format comes in.
#[derive(Debug, Clone, PartialEq)]
pub struct OfferedModes {
    /// Its four characters.
    pub code: [u8; 4],
    /// The sizes, in the driver's order.
    pub modes: Vec<Mode>,
}

/// What a device that takes pictures offers.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// Its name.
    pub card: String,
    /// It delivers planes in buffers of their own, as many CSI receivers do: that is not read here.
    pub is_multi_planar: bool,
    /// Its formats, in the driver's order.
    pub formats: Vec<OfferedModes>,
}

/// A device, and what it said when it was opened.
#[derive(Debug)]
pub struct FoundDevice {
    /// The best name to write into a configuration.
    pub path: PathBuf,
    /// The device behind it.
    pub device: PathBuf,
    /// Its offer, or why it told none.
    pub offer: io::Result<Offer>,
}

/// All devices that take pictures, and those that do not let themselves be opened.
#[must_use]
pub fn video_devices() -> Vec<FoundDevice> {
    let looked = named_devices(Path::new(BY_PATH), Path::new(DEV)).into_iter();
    looked
        .filter_map(|(path, device)| {
            let offer = v4l2::look(&device).transpose()?;
            Some(FoundDevice { path, device, offer })
        })
        .collect()
}

/// Every video device once, with its best name.
fn named_devices(by_path: &Path, dev: &Path) -> Vec<(PathBuf, PathBuf)> {
    let is_video = |path: &PathBuf| {
        let number = path.file_name().and_then(|name| name.to_str()?.strip_prefix("video"));
        number.is_some_and(|digits| {
            !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
        })
    };
    let plain = entries(dev).into_iter().filter(is_video);
    let mut devices: Vec<(PathBuf, PathBuf)> = Vec::new();
    for path in entries(by_path).into_iter().chain(plain) {
        let Ok(device) = fs::canonicalize(&path) else { continue };
        if !devices.iter().any(|(_, known)| *known == device) {
            devices.push((path, device));
        }
    }
    devices
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let found = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = found.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn every_device_is_named_once_by_its_plug_if_it_has_one() {
        let folder = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(folder.path()).unwrap();
        let (dev, by_path) = (root.join("dev"), root.join("by-path"));
        fs::create_dir(&dev).unwrap();
        fs::create_dir(&by_path).unwrap();
        for name in ["video0", "video1", "video10", "video", "video-codec", "ttyUSB0"] {
            fs::write(dev.join(name), "").unwrap();
        }
        // As udev makes them: two names of one plug.
        for name in
            ["platform-xhci-usb-0:1:1.0-video-index0", "platform-xhci-usbv2-0:1:1.0-video-index0"]
        {
            symlink(dev.join("video1"), by_path.join(name)).unwrap();
        }
        symlink(dev.join("gone"), by_path.join("stale")).unwrap();
        let found = named_devices(&by_path, &dev);
        let expected = [
            (by_path.join("platform-xhci-usb-0:1:1.0-video-index0"), dev.join("video1")),
            (dev.join("video0"), dev.join("video0")),
            (dev.join("video10"), dev.join("video10")),
        ];
        assert_eq!(found, expected);
        assert!(named_devices(&root.join("none"), &root.join("none")).is_empty());
    }
}
