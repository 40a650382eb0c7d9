//! Pictures of an own camera, and the tags that are found in them.
//!
//! ```text
//! source ─ StampedPicture ─▶ slot of one ─▶ TagFinder ─ Event::TagsSeen ─▶ brain
//! thread images-N            newest wins     thread tags-N
//! ```
//!
//! A detector that is slower than the camera leaves pictures out, the older ones, and counts them.
//! A folder waits instead. A source that fails is opened again every second.

pub mod devices;
mod driver;
mod folder;
mod luma;
mod slot;
mod source;
mod stamp;
mod stream;
mod v4l2;

pub use driver::ImageDriver;
pub use luma::{LumaLayout, OfferedFormat, choose_layout};
pub(crate) use luma::{is_known, known_names, name_of};

use super::line::Refusal;
use super::tag_finder::{self, TagFinderError};
use crate::messages::CameraId;
use crate::time::{Mono, Stamp};
use std::path::PathBuf;
use std::time::Duration;

/// Where pictures come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A video device of the kernel.
    V4l2 {
        /// Such as `/dev/video0`, or better its link in `/dev/v4l/by-path`.
        device: PathBuf,
        /// Frames asked for per second.
        frames_per_s: u32,
        /// Fixed exposure; the camera decides for itself without it.
        exposure: Option<Duration>,
    },
    /// PNG and PGM files that are moved into a folder after the start, in order of their names.
    Folder {
        /// The folder.
        path: PathBuf,
    },
    /// PGM pictures, one after the other, from whoever connects to a Unix stream socket.
    PgmStream {
        /// The socket.
        path: PathBuf,
    },
}

/// One camera whose tags stockpilot finds itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Its number in the configuration.
    pub camera: CameraId,
    /// Width and height of its pictures, px; others are refused.
    pub size_px: [u32; 2],
    /// Where its pictures come from.
    pub source: Source,
    /// Time from the readout of the first row to that of the last; zero for a global shutter.
    pub readout: Duration,
    /// For pictures that carry no stamp: from the middle of the exposure to their arrival here. Where the kernel stamps
    /// them: how much later still its stamps are than they say.
    pub stamp_delay: Option<Duration>,
    /// The detector.
    pub detector: tag_finder::Settings,
}

/// What is wrong with a picture or its source.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The source failed.
    #[error("cannot read pictures: {0}")]
    Io(#[from] std::io::Error),
    /// The number of pixels is not that of the size, or the size is absurd.
    #[error("{n_pixels} pixels are no picture of {width_px} × {height_px} px")]
    Size {
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// Pixels that are there.
        n_pixels: usize,
    },
    /// Not the format that is read here.
    #[error("picture begins with {found:?}, only P5 (binary PGM) and PNG are read")]
    NotPgm {
        /// The first word.
        found: String,
    },
    /// A PGM with other than 8 bits, or too large.
    #[error(
        "PGM of {width_px} × {height_px} px up to {brightest}: only 8 bits (255) and 8192 px are read"
    )]
    Unsupported {
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// The number for white.
        brightest: u32,
    },
    /// The header makes no sense or never ends.
    #[error("the picture's header is damaged")]
    Header,
    /// The PNG decoder refuses.
    #[error("PNG is damaged: {0}")]
    Png(#[from] png::DecodingError),
    /// The picture is not of the configured camera.
    #[error("picture is {got:?} px, the camera's are {expected:?} px")]
    OtherSize {
        /// Width and height, px.
        got: [u32; 2],
        /// Those configured, px.
        expected: [u32; 2],
    },
    /// The stamp cannot be.
    #[error(transparent)]
    Stamp(#[from] Refusal),
    /// A JPEG that cannot be read.
    #[error("JPEG is damaged: {cause}")]
    Jpeg {
        /// What the decoder says.
        cause: String,
    },
    /// Nobody knows when this device's pictures were taken.
    #[error(
        "the driver of {} does not stamp by the monotonic clock: stamp_delay_ms must say how late its \
         pictures arrive", device.display()
    )]
    NoStamp {
        /// The device.
        device: PathBuf,
    },
    /// The camera offers nothing that is understood here.
    #[error("{device} offers {offered:?} at {size_px:?} px; needed is one of {needed:?}")]
    NoFormat {
        /// The device.
        device: PathBuf,
        /// Its pixel formats of that size.
        offered: Vec<String>,
        /// What would do.
        needed: Vec<String>,
        /// Width and height, px.
        size_px: [u32; 2],
    },
    /// The detector refuses.
    #[error(transparent)]
    Detector(#[from] TagFinderError),
}

/// Counts since the start.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ImageStats {
    /// Pictures that came.
    pub pictures: u64,
    /// Of them, left out because the detector was busy and a newer one came.
    pub skipped: u64,
    /// Of them, refused for their size or stamp.
    pub refused: u64,
    /// Why the last was refused, or the source failed.
    pub last_error: Option<String>,
    /// How often the source failed and was opened again.
    pub reopened: u64,
    /// Frames handed to the brain.
    pub frames: u64,
    /// Frames lost because the brain's channel was full.
    pub lost: u64,
    /// Tags in the frames handed over.
    pub tags: u64,
    /// Detections left out as doubtful or double.
    pub left_out: u64,
    /// How long the last picture took from its arrival to its tags, by the service's clock.
    pub last_delay: Duration,
    /// When the last frame was handed over.
    pub last_frame_at: Option<Stamp<Mono>>,
}
