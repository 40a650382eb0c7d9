//! From the kernel's stamp of a picture to the middle of its exposure.
//!
//! ```text
//! middle of the middle row's exposure =
//!     stamp + e/2 + r/2      the exposure of the first row begins at the stamp
//!     stamp − e/2 + r/2      the first row is read out at the stamp
//!     stamp − e/2 − r/2      the last row has arrived at the stamp
//! ```
//! - `e`: exposure; `r`: time from the readout of the first row to that of the last, 0 for a global shutter
//!
//! Source: `struct v4l2_buffer` of the kernel's user space API, "Buffer Flags" (`V4L2_BUF_FLAG_TIMESTAMP_MASK`,
//! `V4L2_BUF_FLAG_TSTAMP_SRC_MASK`).

use crate::time::{Mono, Stamp};
use std::time::Duration;

/// `V4L2_BUF_FLAG_TIMESTAMP_MASK`, and the value that means `CLOCK_MONOTONIC`.
const CLOCK_MASK: u32 = 0xe000;
const CLOCK_MONOTONIC: u32 = 0x2000;
/// `V4L2_BUF_FLAG_TSTAMP_SRC_MASK`, and the value that means the start of the exposure.
const POINT_MASK: u32 = 0x0007_0000;
const POINT_START_OF_EXPOSURE: u32 = 0x0001_0000;

/// What a driver stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StampPoint {
    /// The first row begins to be exposed.
    StartOfExposure,
    /// The first bytes of the picture arrive: its first row has been read out just before.
    FirstBytes,
    /// The last row has arrived.
    EndOfFrame,
}

impl StampPoint {
    /// What the flags of a buffer say.
    ///
    /// `stamps_first_bytes` is for a driver whose flags promise the start of the exposure while it stamps the first
    /// packet: uvcvideo, unless its parameter `hwtimestamps` is set.
    pub(super) const fn of(flags: u32, stamps_first_bytes: bool) -> Self {
        match flags & POINT_MASK {
            POINT_START_OF_EXPOSURE if stamps_first_bytes => Self::FirstBytes,
            POINT_START_OF_EXPOSURE => Self::StartOfExposure,
            _ => Self::EndOfFrame,
        }
    }

    /// The middle of the exposure of the middle row.
    pub(super) fn middle_of_exposure(
        self,
        stamp: Stamp<Mono>,
        exposure: Duration,
        readout: Duration,
    ) -> Stamp<Mono> {
        let (exposure, readout) = (exposure / 2, readout / 2);
        match self {
            Self::StartOfExposure => stamp.plus(exposure).plus(readout),
            Self::FirstBytes => stamp.plus(readout).minus(exposure),
            Self::EndOfFrame => stamp.minus(readout).minus(exposure),
        }
    }
}

/// The stamp of a buffer, if its flags say that the service's own clock made it.
pub(super) fn monotonic(flags: u32, seconds: i64, micros: i64) -> Option<Stamp<Mono>> {
    let nanos = seconds.checked_mul(1_000_000_000)?.checked_add(micros.checked_mul(1000)?)?;
    (flags & CLOCK_MASK == CLOCK_MONOTONIC && nanos > 0).then(|| Stamp::from_nanos(nanos))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Written out by hand from the kernel's table.
    const UVC: u32 = 0x0001_2001;
    const CSI: u32 = 0x0000_2005;

    #[test]
    fn only_the_monotonic_clock_is_believed() {
        assert_eq!(monotonic(CSI, 12, 345_678), Some(Stamp::from_nanos(12_345_678_000)));
        assert_eq!(monotonic(UVC, 12, 0), Some(Stamp::from_nanos(12_000_000_000)));
        assert_eq!(monotonic(0x0000_0005, 12, 0), None, "unknown clock");
        assert_eq!(monotonic(0x0000_4005, 12, 0), None, "copied from elsewhere");
        assert_eq!(monotonic(CSI, 0, 0), None, "not stamped");
        assert_eq!(monotonic(CSI, i64::MAX, 0), None);
    }

    /// A shutter that opens at 100 ms for 4 ms per row, its rows 10 ms apart from first to last: the middle
    /// row is exposed from 105 to 109 ms, the first read out at 104 ms and the last at 114 ms.
    #[test]
    fn every_point_leads_to_the_same_middle() {
        let at = |ms: i64| Stamp::from_nanos(ms * 1_000_000);
        let (exposure, readout) = (Duration::from_millis(4), Duration::from_millis(10));
        for (flags, is_uvc, stamped_ms) in
            [(UVC, false, 100), (UVC, true, 104), (CSI, false, 114), (CSI, true, 114)]
        {
            let point = StampPoint::of(flags, is_uvc);
            let middle = point.middle_of_exposure(at(stamped_ms), exposure, readout);
            assert_eq!(middle, at(107), "{point:?}");
        }
    }
}
