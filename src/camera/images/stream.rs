//! Pictures through a Unix socket.

use super::PictureError;
use super::source::{POLL, PictureSource, is_readable};
use crate::camera::listener::remove_stale_socket;
use crate::camera::picture::{StampedPicture, read_pgm};
use std::io::{self, BufReader, ErrorKind, Read};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use tokio_util::sync::CancellationToken;

/// A socket that one program at a time may connect to.
#[derive(Debug)]
pub(super) struct PgmStream {
    listener: UnixListener,
    peer: Option<BufReader<Patient>>,
    cancel: CancellationToken,
}

impl PgmStream {
    pub(super) fn bind(path: &Path, cancel: CancellationToken) -> io::Result<Self> {
        remove_stale_socket(path)?;
        Ok(Self { listener: UnixListener::bind(path)?, peer: None, cancel })
    }
}

impl PictureSource for PgmStream {
    fn next(&mut self) -> Result<Option<StampedPicture>, PictureError> {
        let Some(peer) = &mut self.peer else {
            if is_readable(&self.listener)? {
                let (stream, _) = self.listener.accept()?;
                stream.set_read_timeout(Some(POLL))?;
                self.peer = Some(BufReader::new(Patient { stream, cancel: self.cancel.clone() }));
            }
            return Ok(None);
        };
        match read_pgm(peer) {
            Ok(Some(picture)) => Ok(Some(picture)),
            Ok(None) => {
                self.peer = None;
                Ok(None)
            }
            Err(error) => {
                // Nobody knows where the next picture would begin.
                self.peer = None;
                if self.cancel.is_cancelled() { Ok(None) } else { Err(error) }
            }
        }
    }
}

/// A stream that waits for its next byte until it is cancelled.
#[derive(Debug)]
struct Patient {
    stream: UnixStream,
    cancel: CancellationToken,
}

impl Read for Patient {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            match self.stream.read(buffer) {
                Err(error)
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
                {
                    if self.cancel.is_cancelled() {
                        return Err(ErrorKind::ConnectionAborted.into());
                    }
                }
                other => return other,
            }
        }
    }
}
