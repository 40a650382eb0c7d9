//! What a device offers: formats, sizes, rates.

use super::guarded;
use crate::camera::images::devices::{Mode, Offer, OfferedModes};
use crate::camera::images::luma::OfferedFormat;
use moq_v4l::capability;
use moq_v4l::device::Device;
use moq_v4l::format::FourCC;
use moq_v4l::fraction::Fraction;
use moq_v4l::frameinterval::FrameIntervalEnum;
use moq_v4l::framesize::FrameSizeEnum;
use moq_v4l::video::Capture;
use std::io;
use std::path::Path;

/// Opens a device only to see what it offers; `None` if it takes no pictures, as the second device of a webcam, which
/// carries metadata, and codecs.
pub(in crate::camera::images) fn look(path: &Path) -> io::Result<Option<Offer>> {
    guarded(|| {
        let device = Device::with_path(path)?;
        let capabilities = device.query_caps()?;
        let can = |flags| capabilities.capabilities.intersects(flags);
        if can(capability::Flags::VIDEO_M2M | capability::Flags::VIDEO_M2M_MPLANE) {
            return Ok(None);
        }
        let is_multi_planar = can(capability::Flags::VIDEO_CAPTURE_MPLANE);
        if !can(capability::Flags::VIDEO_CAPTURE) && !is_multi_planar {
            return Ok(None);
        }
        let formats = device.enum_formats().unwrap_or_default();
        let formats = formats.iter().map(|format| modes(&device, format.fourcc)).collect();
        Ok(Some(Offer { card: capabilities.card, is_multi_planar, formats }))
    })?
}

fn modes(device: &Device, code: FourCC) -> OfferedModes {
    let sizes = device.enum_framesizes(code).unwrap_or_default();
    let modes = sizes.iter().map(|offered| {
        let (smallest_px, size_px) = match &offered.size {
            FrameSizeEnum::Discrete(size) => (None, [size.width, size.height]),
            FrameSizeEnum::Stepwise(steps) => {
                (Some([steps.min_width, steps.min_height]), [steps.max_width, steps.max_height])
            }
        };
        Mode { size_px, smallest_px, fastest_hz: fastest_hz(device, code, size_px) }
    });
    OfferedModes { code: code.repr, modes: modes.collect() }
}

/// The formats that come in this size.
pub(super) fn offered_at(device: &Device, size_px: [u32; 2]) -> Vec<OfferedFormat> {
    let [width, height] = size_px;
    let formats = device.enum_formats().unwrap_or_default().into_iter().map(|format| format.fourcc);
    formats
        .filter(|code| {
            let sizes = device.enum_framesizes(*code).unwrap_or_default();
            // A driver that names no sizes leaves them to the trying.
            sizes.is_empty() || sizes.iter().any(|offered| has_size(&offered.size, size_px))
        })
        .map(|code| OfferedFormat {
            code: code.repr,
            fastest_hz: fastest_hz(device, code, [width, height]),
        })
        .collect()
}

/// The most pictures of this kind in a second, if the driver tells.
fn fastest_hz(device: &Device, code: FourCC, [width, height]: [u32; 2]) -> Option<f64> {
    let intervals = device.enum_frameintervals(code, width, height).ok()?;
    let rates = intervals.into_iter().filter_map(|offered| match offered.interval {
        FrameIntervalEnum::Discrete(interval) => rate_hz(interval),
        FrameIntervalEnum::Stepwise(steps) => rate_hz(steps.min),
    });
    rates.max_by(f64::total_cmp)
}

/// Pictures in a second at this interval; `None` for one that cannot be.
pub(super) fn rate_hz(interval: Fraction) -> Option<f64> {
    let is_possible = interval.numerator > 0 && interval.denominator > 0;
    is_possible.then(|| f64::from(interval.denominator) / f64::from(interval.numerator))
}

fn has_size(sizes: &FrameSizeEnum, [width, height]: [u32; 2]) -> bool {
    match sizes {
        FrameSizeEnum::Discrete(size) => [size.width, size.height] == [width, height],
        FrameSizeEnum::Stepwise(steps) => {
            is_step(width, steps.min_width, steps.max_width, steps.step_width)
                && is_step(height, steps.min_height, steps.max_height, steps.step_height)
        }
    }
}

/// True for one of the values from `min` on in steps; a step of 0 counts as 1.
const fn is_step(value: u32, min: u32, max: u32, step: u32) -> bool {
    let step = if step == 0 { 1 } else { step };
    value >= min && value <= max && (value - min).is_multiple_of(step)
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
    fn rates_are_the_other_way_round_and_nothing_by_nothing_is_none() {
        assert_eq!(rate_hz(Fraction::new(1, 30)), Some(30.0));
        assert_eq!(rate_hz(Fraction::new(1001, 30_000)).map(f64::round), Some(30.0));
        assert_eq!(rate_hz(Fraction::new(0, 30)), None);
        assert_eq!(rate_hz(Fraction::new(1, 0)), None);
    }

    #[test]
    fn what_is_no_video_device_is_an_error_and_no_panic() {
        assert!(look(Path::new("/dev/null")).is_err());
    }
}
