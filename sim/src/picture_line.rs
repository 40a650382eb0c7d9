//! The way of rendered pictures to the service.

use crate::camera::Picture;
use std::collections::VecDeque;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;
use stockpilot::service::onboard::Onboard;
use stockpilot::time::{Mono, Stamp};

/// A detector on a small computer is done with a picture by then; the flight waits for it.
const PATIENCE: Duration = Duration::from_millis(50);
const POLL: Duration = Duration::from_micros(200);
/// A detector that finds nothing for five seconds is not waited for any longer.
const LONGEST_WAIT_POLLS: u32 = 25_000;

/// The far end of the service's socket for pictures.
#[derive(Debug)]
pub(crate) struct PictureLine {
    pub(crate) socket: PathBuf,
    pub(crate) stream: Option<UnixStream>,
    n_done: u64,
    /// When each picture was sent that the detector has not done with.
    under_way: VecDeque<Stamp<Mono>>,
}

impl PictureLine {
    /// A line to a socket in this folder, not yet connected.
    pub(crate) fn new(folder: &Path) -> Self {
        Self {
            socket: folder.join("pictures"),
            stream: None,
            n_done: 0,
            under_way: VecDeque::new(),
        }
    }

    /// Sends a picture.
    pub(crate) fn send(&mut self, picture: &Picture, now: Stamp<Mono>) -> std::io::Result<()> {
        let Some(stream) = &mut self.stream else { return Ok(()) };
        self.under_way.push_back(now);
        picture.write_pgm(&mut std::io::BufWriter::new(stream))
    }

    /// Holds the flight until no picture has been under way for longer than [`PATIENCE`].
    #[expect(clippy::disallowed_methods, reason = "paces the simulation against the service")]
    pub(crate) fn wait_for_detector(&mut self, now: Stamp<Mono>, onboard: &Onboard) {
        for _ in 0..LONGEST_WAIT_POLLS {
            self.note_done(onboard);
            if self.under_way.front().is_none_or(|sent_at| now.since(*sent_at) < PATIENCE) {
                return;
            }
            std::thread::sleep(POLL);
        }
    }

    fn note_done(&mut self, onboard: &Onboard) {
        let Some(stats) = onboard.images().into_iter().next() else { return };
        let stats = stats.borrow();
        let n_done = stats.frames + stats.lost + stats.skipped + stats.refused;
        while self.n_done < n_done {
            self.under_way.pop_front();
            self.n_done += 1;
        }
    }
}
