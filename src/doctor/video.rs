//! Video devices: whether stockpilot can find tags in what they offer.

use super::{Check, Verdict};
use crate::camera::images::devices::{FoundDevice, Mode, Offer, OfferedModes};
use crate::camera::images::{is_known, known_names, name_of};
use std::io;

/// Smaller pictures show tags from too near only, px.
const LEAST_WIDTH_PX: u32 = 640;
const LEAST_HEIGHT_PX: u32 = 400;
/// A position needs so many pictures in a second.
const LEAST_HZ: f64 = 5.0;
/// Sizes of a format that are told, the largest ones.
const MOST_SIZES: usize = 4;

/// What is to be said of each device, or that there is none.
#[must_use]
pub fn video_checks(devices: &[FoundDevice]) -> Vec<Check> {
    if devices.is_empty() {
        let cure = "plug it in (`dmesg -w` shows whether the system sees it); with an external detector none is \
                    needed";
        return vec![Check::with_cure("camera", Verdict::Warn, "no video device", cure)];
    }
    devices.iter().map(video_check).collect()
}

fn video_check(found: &FoundDevice) -> Check {
    let subject = format!("camera {}", found.path.display());
    let device = found.device.display();
    match &found.offer {
        Ok(offer) => offer_check(subject, offer),
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => {
            let cure =
                format!("`sudo usermod -aG $(stat -c %G {device}) $USER`, then log in again");
            Check::with_cure(subject, Verdict::Bad, "no permission to open it", cure)
        }
        Err(error) => {
            let cure =
                format!("see what else uses it: `fuser -v {device}`; otherwise plug it in anew");
            Check::with_cure(subject, Verdict::Bad, error.to_string(), cure)
        }
    }
}

fn offer_check(subject: String, offer: &Offer) -> Check {
    let found = format!("{}: {}", offer.card, told(&offer.formats));
    let modes = || {
        let known = offer.formats.iter().filter(|format| is_known(format.code));
        known.flat_map(|format| &format.modes)
    };
    // A driver that names no sizes leaves them to the trying.
    let is_understood = offer.formats.iter().any(|format| is_known(format.code));
    if !is_understood {
        let found = if offer.is_multi_planar {
            format!("{}: its planes come in buffers of their own", offer.card)
        } else {
            found
        };
        let cure = format!(
            "it is not read here, {} are; a camera on the CSI plug is read by libcamera: let a program of its \
             write pictures into a folder or the PGM stream of [cameras.images], or use a USB camera",
            known_names().join(", ")
        );
        return Check::with_cure(subject, Verdict::Bad, found, cure);
    }
    let is_large =
        |mode: &&Mode| mode.size_px[0] >= LEAST_WIDTH_PX && mode.size_px[1] >= LEAST_HEIGHT_PX;
    let is_fast = |mode: &Mode| mode.fastest_hz.is_none_or(|hz| hz >= LEAST_HZ);
    if modes().next().is_some() && !modes().filter(is_large).any(is_fast) {
        let cure = format!(
            "at least {LEAST_WIDTH_PX} × {LEAST_HEIGHT_PX} px and {LEAST_HZ:.0} pictures/s are needed: a plug for \
             USB 3, or another camera"
        );
        return Check::with_cure(subject, Verdict::Warn, found, cure);
    }
    Check::good(subject, found)
}

/// `YUYV 1280×800 to 10/s, 640×480 to 30/s; MJPG …`
fn told(formats: &[OfferedModes]) -> String {
    if formats.is_empty() {
        return "no format".to_owned();
    }
    let format = |format: &OfferedModes| {
        let mut modes = format.modes.clone();
        modes.sort_by_key(|mode| std::cmp::Reverse(mode.size_px));
        modes.dedup();
        let more = if modes.len() > MOST_SIZES { " …" } else { "" };
        let sizes: Vec<String> = modes.iter().take(MOST_SIZES).map(mode_told).collect();
        let unknown = if is_known(format.code) { "" } else { " (not read)" };
        format!("{}{unknown} {}{more}", name_of(format.code), sizes.join(", "))
            .trim_end()
            .to_owned()
    };
    formats.iter().map(format).collect::<Vec<_>>().join("; ")
}

fn mode_told(mode: &Mode) -> String {
    let from = mode.smallest_px.map_or_else(String::new, |[w, h]| format!("{w}×{h} to "));
    let [width, height] = mode.size_px;
    let rate = mode.fastest_hz.map_or_else(String::new, |hz| format!(" to {hz:.0}/s"));
    format!("{from}{width}×{height}{rate}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(size_px: [u32; 2], fastest_hz: f64) -> Mode {
        Mode { size_px, smallest_px: None, fastest_hz: Some(fastest_hz) }
    }

    fn check(formats: &[(&[u8; 4], Vec<Mode>)], is_multi_planar: bool) -> Check {
        let formats = formats
            .iter()
            .map(|(code, modes)| OfferedModes { code: **code, modes: modes.clone() })
            .collect();
        let offer = Offer { card: "Webcam".into(), is_multi_planar, formats };
        device(Ok(offer))
    }

    fn device(offer: io::Result<Offer>) -> Check {
        let path = "/dev/v4l/by-path/usb-video-index0".into();
        video_check(&FoundDevice { path, device: "/dev/video2".into(), offer })
    }

    #[test]
    fn a_webcam_is_told_with_its_sizes_and_rates() {
        let yuyv = vec![mode([640, 480], 30.0), mode([1280, 800], 10.0)];
        let webcam = check(&[(b"YUYV", yuyv), (b"H264", vec![mode([1920, 1080], 30.0)])], false);
        assert_eq!(webcam.verdict, Verdict::Good);
        assert_eq!(webcam.subject, "camera /dev/v4l/by-path/usb-video-index0");
        assert_eq!(
            webcam.found,
            "Webcam: YUYV 1280×800 to 10/s, 640×480 to 30/s; H264 (not read) 1920×1080 to 30/s"
        );
        // A virtual device names a range.
        let any = Mode { smallest_px: Some([48, 48]), ..mode([3840, 2160], 60.0) };
        let virtual_one = check(&[(b"GREY", vec![any])], false);
        assert_eq!(virtual_one.verdict, Verdict::Good);
        assert!(virtual_one.found.ends_with("GREY 48×48 to 3840×2160 to 60/s"), "{virtual_one:?}");
        assert_eq!(check(&[(b"MJPG", vec![])], false).verdict, Verdict::Good);
    }

    #[test]
    fn what_cannot_be_used_has_its_cure() {
        let bayer = check(&[(b"BA81", vec![mode([1280, 800], 60.0)])], false);
        assert_eq!(bayer.verdict, Verdict::Bad);
        assert!(bayer.cure.unwrap().contains("libcamera"));
        assert_eq!(check(&[], true).verdict, Verdict::Bad);
        let slow = vec![mode([320, 240], 60.0), mode([1280, 800], 3.0)];
        let slow = check(&[(b"YUYV", slow)], false);
        assert!(slow.verdict == Verdict::Warn && slow.cure.unwrap().contains("640 × 400"));
        let closed = device(Err(io::ErrorKind::PermissionDenied.into()));
        assert_eq!(closed.verdict, Verdict::Bad);
        assert!(closed.cure.unwrap().contains("usermod -aG $(stat -c %G /dev/video2)"));
        let gone = device(Err(io::Error::other("Device or resource busy")));
        assert!(gone.cure.unwrap().contains("fuser -v /dev/video2"));
        let none = video_checks(&[]);
        assert!(none.len() == 1 && none[0].verdict == Verdict::Warn);
    }
}
