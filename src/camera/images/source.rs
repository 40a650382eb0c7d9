//! What all sources of pictures have in common.

use super::folder::Folder;
use super::stream::PgmStream;
use super::v4l2::{VideoDevice, Wish};
use super::{PictureError, Settings, Source};
use crate::camera::picture::StampedPicture;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::os::fd::AsFd;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// A source looks this often whether it is to end.
pub(super) const POLL: Duration = Duration::from_millis(50);

/// Where one picture after the other comes from.
pub(super) trait PictureSource {
    /// The next picture; `None` if none came within [`POLL`] or so.
    fn next(&mut self) -> Result<Option<StampedPicture>, PictureError>;

    /// True if the source can wait for the detector, so that no picture needs to be left out.
    fn can_wait(&self) -> bool {
        false
    }
}

/// Opens a source.
pub(super) fn open(
    settings: &Settings,
    cancel: &CancellationToken,
) -> Result<Box<dyn PictureSource>, PictureError> {
    Ok(match &settings.source {
        Source::V4l2 { device, frames_per_s, exposure } => {
            let (device, frames_per_s, exposure) = (device.clone(), *frames_per_s, *exposure);
            Box::new(VideoDevice::open(&Wish { device, frames_per_s, exposure }, settings)?)
        }
        Source::Folder { path } => Box::new(Folder::open(path)?),
        Source::PgmStream { path } => Box::new(PgmStream::bind(path, cancel.clone())?),
    })
}

/// Waits until something can be read, at most [`POLL`]; true if it can.
pub(super) fn is_readable(file: &impl AsFd) -> Result<bool, PictureError> {
    let mut fds = [PollFd::new(file, PollFlags::IN)];
    match poll(&mut fds, Some(&timespec(POLL))) {
        Ok(n_ready) => Ok(n_ready > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(error) => Err(PictureError::Io(error.into())),
    }
}

/// Waits for [`POLL`].
pub(super) fn pause() {
    // A signal only shortens the pause.
    if let Err(error) = poll(&mut [], Some(&timespec(POLL))) {
        tracing::trace!(%error, "a pause was cut short");
    }
}

fn timespec(span: Duration) -> Timespec {
    Timespec { tv_sec: 0, tv_nsec: span.subsec_nanos().into() }
}
