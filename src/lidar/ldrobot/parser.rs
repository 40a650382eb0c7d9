//! Finds frames in a stream of bytes.

use super::{FRAME_BYTES, FRAME_HEAD, Frame};

/// What a parser met so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ParserStats {
    /// Bytes fed.
    pub bytes: u64,
    /// Frames delivered.
    pub frames: u64,
    /// Candidates that began like a frame but failed the CRC.
    pub crc_errors: u64,
    /// Candidates with a good CRC but impossible angles or time.
    pub implausible: u64,
    /// Bytes that belong to no delivered frame.
    pub skipped_bytes: u64,
}

/// Finds frames in bytes that arrive in chunks of any size.
///
/// After a failed candidate the search goes on one byte behind its first byte, so a damaged frame
/// never takes its good successor along. How the bytes are cut into chunks makes no difference.
#[derive(Debug, Clone, Default)]
pub struct Parser {
    pending: Vec<u8>,
    stats: ParserStats,
}

impl Parser {
    /// A parser that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes in `bytes` and hands each good frame to `on_frame`, in order, together with the number
    /// of bytes that followed the frame in this chunk.
    pub fn feed(&mut self, bytes: &[u8], mut on_frame: impl FnMut(Frame, usize)) {
        self.stats.bytes += bytes.len() as u64;
        self.pending.extend_from_slice(bytes);
        let mut at = 0;
        while let Some(step) = self.examine(at) {
            if let Step::Found(frame) = step {
                at += FRAME_BYTES;
                on_frame(frame, self.pending.len() - at);
            } else {
                at += 1;
            }
        }
        self.pending.drain(..at);
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> ParserStats {
        self.stats
    }

    /// Forgets the unfinished frame, as after a reopened port; the counts stay.
    pub fn reset(&mut self) {
        self.stats.skipped_bytes += self.pending.len() as u64;
        self.pending.clear();
    }

    /// Judges the place `at`; `None` if more bytes are needed.
    fn examine(&mut self, at: usize) -> Option<Step> {
        let rest = self.pending.get(at..).unwrap_or_default();
        let n_head = rest.len().min(FRAME_HEAD.len());
        if n_head == 0 {
            return None;
        }
        if rest[..n_head] != FRAME_HEAD[..n_head] {
            self.stats.skipped_bytes += 1;
            return Some(Step::Skip);
        }
        let candidate = rest.first_chunk::<FRAME_BYTES>()?;
        match Frame::from_bytes(candidate) {
            Some(frame) if frame.is_plausible() => {
                self.stats.frames += 1;
                return Some(Step::Found(frame));
            }
            Some(_) => self.stats.implausible += 1,
            None => self.stats.crc_errors += 1,
        }
        self.stats.skipped_bytes += 1;
        Some(Step::Skip)
    }
}

/// What stands at one place of the stream.
enum Step {
    Found(Frame),
    Skip,
}
