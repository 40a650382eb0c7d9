//! A video device of the kernel (V4L2).
//!
//! Uncompressed formats only: a detector on a small computer has no time to decompress. The
//! library does not hand on the kernel's stamp of a buffer, so pictures are stamped when they
//! arrive, less the configured delay.

use super::PictureError;
use super::luma::{LumaLayout, choose_layout, known_names, name_of};
use super::source::{PictureSource, is_readable};
use crate::camera::picture::StampedPicture;
use linuxvideo::format::{FrameSizes, PixFormat, PixelFormat};
use linuxvideo::stream::ReadStream;
use linuxvideo::{BufType, Device, Fract};
use std::path::Path;
use std::time::Duration;

/// A device that streams.
pub(super) struct VideoDevice {
    stream: ReadStream,
    layout: LumaLayout,
    size_px: [u32; 2],
    row_bytes: u32,
}

impl VideoDevice {
    /// Opens a device and has it stream pictures of this size.
    pub(super) fn open(
        path: &Path,
        size_px: [u32; 2],
        frames_per_s: u32,
        exposure: Option<Duration>,
    ) -> Result<Self, PictureError> {
        let mut device = Device::open(path)?;
        let offered: Vec<[u8; 4]> = offered_at(&device, size_px);
        let refuse = || PictureError::NoFormat {
            device: path.to_owned(),
            offered: offered.iter().map(|code| name_of(*code)).collect(),
            needed: known_names(),
            size_px,
        };
        let (code, layout) = choose_layout(&offered).ok_or_else(refuse)?;
        if let Some(exposure) = exposure {
            fix_exposure(&mut device, exposure);
        }
        let [width_px, height_px] = size_px;
        let wanted = PixFormat::new(width_px, height_px, PixelFormat::from_fourcc(code));
        let capture = device.video_capture(wanted)?;
        // A driver answers with what it can do instead of refusing.
        let got = capture.format();
        let (got_px, row_bytes) = ([got.width(), got.height()], got.bytes_per_line());
        if got.pixel_format().as_fourcc() != code {
            return Err(refuse());
        }
        if got_px != size_px {
            return Err(PictureError::OtherSize { got: got_px, expected: size_px });
        }
        if let Err(error) = capture.set_frame_interval(Fract::new(1, frames_per_s)) {
            tracing::warn!(%error, device = %path.display(), "the camera keeps its own frame rate");
        }
        Ok(Self { stream: capture.into_stream()?, layout, size_px, row_bytes })
    }
}

/// The codes of the formats that come in this size.
fn offered_at(device: &Device, size_px: [u32; 2]) -> Vec<[u8; 4]> {
    let formats = device.formats(BufType::VIDEO_CAPTURE).filter_map(Result::ok);
    let codes = formats.map(|format| format.pixel_format());
    codes
        .filter(|code| device.frame_sizes(*code).is_ok_and(|sizes| has_size(&sizes, size_px)))
        .map(PixelFormat::as_fourcc)
        .collect()
}

fn has_size(sizes: &FrameSizes, [width_px, height_px]: [u32; 2]) -> bool {
    match sizes {
        FrameSizes::Discrete(sizes) => {
            sizes.iter().any(|size| size.width() == width_px && size.height() == height_px)
        }
        FrameSizes::Stepwise(sizes) | FrameSizes::Continuous(sizes) => {
            is_step(width_px, sizes.min_width(), sizes.max_width(), sizes.step_width())
                && is_step(height_px, sizes.min_height(), sizes.max_height(), sizes.step_height())
        }
    }
}

/// True for one of the values from `min` on in steps; a step of 0 counts as 1.
const fn is_step(value: u32, min: u32, max: u32, step: u32) -> bool {
    let step = if step == 0 { 1 } else { step };
    value >= min && value <= max && (value - min).is_multiple_of(step)
}

/// Fixes the exposure as far as the camera lets itself be told.
fn fix_exposure(device: &mut Device, exposure: Duration) {
    use linuxvideo::controls::Cid;
    /// `V4L2_EXPOSURE_MANUAL` of the kernel's control.
    const MANUAL: i32 = 1;
    // The kernel counts in units of 100 µs.
    let units = i32::try_from(exposure.as_micros() / 100).unwrap_or(i32::MAX).max(1);
    for (control, value) in [(Cid::EXPOSURE_AUTO, MANUAL), (Cid::EXPOSURE_ABSOLUTE, units)] {
        if let Err(error) = device.write_control_raw(control, value) {
            tracing::warn!(%error, "the camera does not take a fixed exposure");
        }
    }
}

impl PictureSource for VideoDevice {
    fn next(&mut self) -> Result<Option<StampedPicture>, PictureError> {
        if !is_readable(&self.stream)? {
            return Ok(None);
        }
        let (layout, size_px, row_bytes) = (self.layout, self.size_px, self.row_bytes);
        let read = self.stream.dequeue(|view| {
            // A damaged picture is left out; the next one comes by itself.
            Ok((!view.is_error()).then(|| layout.grey(size_px, row_bytes, &view)))
        })?;
        let picture = read.transpose()?;
        Ok(picture.map(|picture| StampedPicture { picture, captured_at: None }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_sizes_are_counted_from_the_smallest() {
        assert!(is_step(1280, 64, 1920, 32));
        assert!(!is_step(1280, 50, 1920, 32));
        assert!(is_step(1281, 64, 1920, 0));
        assert!(!is_step(1952, 64, 1920, 32));
    }

    #[test]
    fn what_is_no_camera_is_told() {
        for path in ["/dev/null", "/nonexistent"] {
            assert!(VideoDevice::open(Path::new(path), [640, 480], 30, None).is_err(), "{path}");
        }
    }
}
