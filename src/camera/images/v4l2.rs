//! A video device of the kernel (V4L2).
//!
//! Only what needs the device is here; what its pictures and stamps mean is in [`super::luma`] and
//! [`super::stamp`].

mod offer;

pub(super) use offer::look;

use super::luma::{LumaLayout, choose_layout, known_names, name_of};
use super::source::{POLL, PictureSource};
use super::stamp::{StampPoint, monotonic};
use super::{PictureError, Settings};
use crate::camera::picture::StampedPicture;
use crate::time::{Mono, Stamp};
use moq_v4l::buffer::{Flags, Metadata, Type};
use moq_v4l::control::{Control, Value};
use moq_v4l::device::Device;
use moq_v4l::format::{Format, FourCC};
use moq_v4l::io::mmap::Stream;
use moq_v4l::io::traits::{CaptureStream, Stream as _};
use moq_v4l::sys::{V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CID_EXPOSURE_AUTO};
use moq_v4l::video::Capture;
use moq_v4l::video::capture::Parameters;
use offer::{offered_at, rate_hz};
use rustix::event::PollFlags;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::Duration;

/// Buffers asked for: one with us, one being filled, two against a late reader.
const N_BUFFERS: u32 = 4;
/// A device that sends nothing for so many polls has failed: 2 s.
const MOST_SILENT_POLLS: u32 = 40;
/// An exposure that the camera chooses itself is asked for again after so many pictures.
const EXPOSURE_EVERY: u32 = 32;
/// Whether uvcvideo stamps by the camera's own clock.
const UVC_HARDWARE_STAMPS: &str = "/sys/module/uvcvideo/parameters/hwtimestamps";

/// What is asked of a device beside what [`Settings`] say.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Wish {
    pub(super) device: PathBuf,
    pub(super) frames_per_s: u32,
    pub(super) exposure: Option<Duration>,
}

/// A device that streams.
pub(super) struct VideoDevice {
    device: Device,
    /// `None` only while it is dropped.
    stream: Option<Stream<'static>>,
    path: PathBuf,
    layout: LumaLayout,
    size_px: [u32; 2],
    row_bytes: u32,
    stamps_first_bytes: bool,
    exposure: Exposure,
    readout: Duration,
    stamp_delay: Option<Duration>,
    n_silent_polls: u32,
}

/// How long the rows are exposed, as far as it is known.
struct Exposure {
    /// The camera chooses it.
    is_automatic: bool,
    known: Option<Duration>,
    /// Pictures until it is asked for again.
    n_left: u32,
}

impl VideoDevice {
    /// Opens a device and has it stream.
    pub(super) fn open(wish: &Wish, settings: &Settings) -> Result<Self, PictureError> {
        guarded(|| Self::opened(wish, settings))?
    }

    fn opened(wish: &Wish, settings: &Settings) -> Result<Self, PictureError> {
        let size_px = settings.size_px;
        let device = Device::with_path(&wish.device)?;
        let capabilities = device.query_caps()?;
        let offered = offered_at(&device, size_px);
        let refuse = || PictureError::NoFormat {
            device: wish.device.clone(),
            offered: offered.iter().map(|format| name_of(format.code)).collect(),
            needed: known_names(),
            size_px,
        };
        let (code, layout) = choose_layout(&offered, wish.frames_per_s).ok_or_else(refuse)?;
        let [width, height] = size_px;
        // A driver answers with what it can do instead of refusing.
        let got = device.set_format(&Format::new(width, height, FourCC::new(&code)))?;
        if got.fourcc.repr != code {
            return Err(refuse());
        }
        if [got.width, got.height] != size_px {
            let got = [got.width, got.height];
            return Err(PictureError::OtherSize { got, expected: size_px });
        }
        set_rate(&device, wish);
        let exposure = Exposure::set(&device, wish.exposure);
        let stamps_first_bytes = capabilities.driver == "uvcvideo" && !uvc_stamps_by_hardware();
        Ok(Self {
            stream: Some(started(&device)?),
            device,
            path: wish.device.clone(),
            layout,
            size_px,
            row_bytes: got.stride,
            stamps_first_bytes,
            exposure,
            readout: settings.readout,
            stamp_delay: settings.stamp_delay,
            n_silent_polls: 0,
        })
    }

    /// True if a picture waits; an error if none has come for too long.
    fn is_ready(&mut self) -> Result<bool, PictureError> {
        let wait_ms = i32::try_from(POLL.as_millis()).unwrap_or(i32::MAX);
        let readable = i16::try_from(PollFlags::IN.bits()).unwrap_or(i16::MAX);
        let Some(stream) = &self.stream else { return Ok(false) };
        match stream.handle().poll(readable, wait_ms) {
            Ok(0) => {
                self.n_silent_polls += 1;
                if self.n_silent_polls < MOST_SILENT_POLLS {
                    return Ok(false);
                }
                let silent = format!("{} has sent no picture for 2 s", self.path.display());
                Err(io::Error::new(io::ErrorKind::TimedOut, silent).into())
            }
            Ok(_) => {
                self.n_silent_polls = 0;
                Ok(true)
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// The middle of a picture's exposure; `None` if only its arrival tells.
    fn captured_at(&self, buffer: &Metadata) -> Result<Option<Stamp<Mono>>, PictureError> {
        let flags = buffer.flags.bits();
        let Some(stamp) = monotonic(flags, buffer.timestamp.sec, buffer.timestamp.usec) else {
            let no_stamp = || PictureError::NoStamp { device: self.path.clone() };
            return self.stamp_delay.ok_or_else(no_stamp).map(|_| None);
        };
        let exposure = self.exposure.known.unwrap_or_default();
        let middle = StampPoint::of(flags, self.stamps_first_bytes).middle_of_exposure(
            stamp,
            exposure,
            self.readout,
        );
        Ok(Some(middle.minus(self.stamp_delay.unwrap_or_default())))
    }
}

impl Drop for VideoDevice {
    /// The library's own end panics twice, which ends the program, where a driver does not stop: such a stream is
    /// left as it is.
    fn drop(&mut self) {
        const NO_SUCH_DEVICE: i32 = 19;
        if let Some(mut stream) = self.stream.take()
            && let Err(error) = stream.stop()
            && error.raw_os_error() != Some(NO_SUCH_DEVICE)
        {
            tracing::warn!(%error, device = %self.path.display(), "the camera does not stop");
            std::mem::forget(stream);
        }
    }
}

impl PictureSource for VideoDevice {
    fn next(&mut self) -> Result<Option<StampedPicture>, PictureError> {
        if !self.is_ready()? {
            return Ok(None);
        }
        self.exposure.follow(&self.device);
        let (layout, size_px, row_bytes) = (self.layout, self.size_px, self.row_bytes);
        let Some(stream) = &mut self.stream else { return Ok(None) };
        let (bytes, buffer) = stream.next()?;
        if buffer.flags.contains(Flags::ERROR) {
            // A damaged picture is left out; the next one comes by itself.
            return Ok(None);
        }
        let n_used = (buffer.bytesused as usize).min(bytes.len());
        let (picture, buffer) = (layout.grey(size_px, row_bytes, &bytes[..n_used])?, *buffer);
        Ok(Some(StampedPicture { picture, captured_at: self.captured_at(&buffer)? }))
    }
}

impl Exposure {
    /// Fixes the exposure as far as the camera lets itself be told, and asks what became of it.
    fn set(device: &Device, wanted: Option<Duration>) -> Self {
        /// `V4L2_EXPOSURE_MANUAL` of the kernel's control.
        const MANUAL: i64 = 1;
        if let Some(wanted) = wanted {
            // The kernel counts in units of 100 µs.
            let units = i64::try_from(wanted.as_micros() / 100).unwrap_or(i64::MAX).max(1);
            for (id, value) in
                [(V4L2_CID_EXPOSURE_AUTO, MANUAL), (V4L2_CID_EXPOSURE_ABSOLUTE, units)]
            {
                if let Err(error) = device.set_control(Control { id, value: Value::Integer(value) })
                {
                    tracing::warn!(%error, "the camera does not take a fixed exposure");
                }
            }
        }
        let is_automatic = number(device, V4L2_CID_EXPOSURE_AUTO).is_none_or(|how| how != MANUAL);
        let known = Self::asked(device).or(wanted);
        if known.is_none() {
            tracing::warn!(
                "the camera does not tell its exposure: half of it is missing in the stamps"
            );
        }
        Self { is_automatic, known, n_left: EXPOSURE_EVERY }
    }

    fn asked(device: &Device) -> Option<Duration> {
        let units = u64::try_from(number(device, V4L2_CID_EXPOSURE_ABSOLUTE)?).ok()?;
        // More than a second is no exposure of a video.
        (1..=10_000).contains(&units).then(|| Duration::from_micros(100 * units))
    }

    /// One picture more: an exposure that changes by itself is asked for now and then.
    fn follow(&mut self, device: &Device) {
        if !self.is_automatic || self.known.is_none() {
            return;
        }
        self.n_left -= 1;
        if self.n_left == 0 {
            self.n_left = EXPOSURE_EVERY;
            self.known = Self::asked(device).or(self.known);
        }
    }
}

/// Runs what asks the device: the library panics where a driver answers what it does not know.
fn guarded<T>(ask: impl FnOnce() -> T) -> io::Result<T> {
    let died = |_| io::Error::other("the device answers what the V4L2 library does not understand");
    catch_unwind(AssertUnwindSafe(ask)).map_err(died)
}

fn number(device: &Device, id: u32) -> Option<i64> {
    match device.control(id).ok()?.value {
        Value::Integer(value) => Some(value),
        _ => None,
    }
}

fn uvc_stamps_by_hardware() -> bool {
    std::fs::read_to_string(UVC_HARDWARE_STAMPS).is_ok_and(|set| set.trim() == "1")
}

/// Asks for a rate and tells what became of it.
fn set_rate(device: &Device, wish: &Wish) {
    let path = wish.device.display();
    match device.set_params(&Parameters::with_fps(wish.frames_per_s)) {
        Err(error) => {
            tracing::warn!(%error, device = %path, "the camera keeps its own frame rate");
        }
        Ok(set) => match rate_hz(set.interval) {
            Some(hz) if (hz / f64::from(wish.frames_per_s) - 1.0).abs() < 0.05 => {
                tracing::info!(device = %path, hz, "frame rate");
            }
            set_hz => tracing::warn!(
                device = %path, ?set_hz, asked_hz = wish.frames_per_s,
                "the camera has another frame rate than was asked for"
            ),
        },
    }
}

/// A stream that runs, its buffers with the driver but for the first, which the first reading hands over.
fn started(device: &Device) -> io::Result<Stream<'static>> {
    let mut stream = Stream::with_buffers(device, Type::VideoCapture, N_BUFFERS)?;
    for index in 1..N_BUFFERS as usize {
        // A driver may have given fewer buffers than were asked for.
        match CaptureStream::queue(&mut stream, index) {
            Err(error) if index == 1 => return Err(error),
            Err(_) => break,
            Ok(()) => {}
        }
    }
    stream.start()?;
    Ok(stream)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::images::Source;
    use crate::camera::tag_finder;
    use crate::messages::CameraId;

    #[test]
    fn what_is_no_camera_is_told() {
        for path in ["/dev/null", "/nonexistent"] {
            let wish = Wish { device: path.into(), frames_per_s: 30, exposure: None };
            let settings = Settings {
                camera: CameraId(0),
                size_px: [640, 480],
                readout: Duration::ZERO,
                source: Source::V4l2 { device: path.into(), frames_per_s: 30, exposure: None },
                stamp_delay: None,
                detector: tag_finder::Settings::default(),
            };
            assert!(VideoDevice::open(&wish, &settings).is_err(), "{path}");
        }
    }

    #[test]
    fn a_panic_of_the_library_is_an_error_of_the_device() {
        let error = guarded(|| -> u8 { panic!("Invalid colorspace") }).unwrap_err();
        assert!(error.to_string().contains("V4L2"), "{error}");
    }
}
