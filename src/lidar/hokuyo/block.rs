//! Finds replies, which end with an empty line, and checks them.

use super::text::{checked, key_and_value, number};

/// No reply is longer: 1,440 distances with strengths of three characters and their lines.
const LONGEST: usize = 10_000;
/// Characters of a data line before its sum.
const LINE_CHARS: usize = 64;
/// Characters of a distance.
const DISTANCE_CHARS: usize = 3;
/// Characters of a time stamp.
const TIME_CHARS: usize = 4;

/// A reply with right sums.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Block {
    /// State of a command and what it says, as name and value.
    Answer {
        /// The command.
        echo: String,
        /// Two characters.
        state: [u8; 2],
        /// Names and values; none for most commands.
        values: Vec<(String, String)>,
    },
    /// One scan; its distances are in [`BlockReader::distances_mm`].
    Scan {
        /// The sensor's clock, ms, 24 bit.
        time_ms: u32,
        /// Bytes of the reply.
        n_bytes: usize,
    },
}

/// Finds replies in bytes that arrive in chunks of any size.
#[derive(Debug, Clone, Default)]
pub struct BlockReader {
    pending: Vec<u8>,
    /// Bytes of `pending` that hold no end of a reply.
    searched: usize,
    payload: Vec<u8>,
    distances_mm: Vec<u32>,
    n_expected: usize,
    scans: u64,
    refused: u64,
    refused_in_a_row: u32,
    skipped_bytes: u64,
}

impl BlockReader {
    /// A reader of scans with so many distances.
    #[must_use]
    pub fn new(n_expected: usize) -> Self {
        Self { n_expected, ..Self::default() }
    }

    /// From now on scans have so many distances.
    pub const fn expect(&mut self, n_distances: usize) {
        self.n_expected = n_distances;
    }

    /// Distances of the last scan in the order of the steps, mm.
    #[must_use]
    pub fn distances_mm(&self) -> &[u32] {
        &self.distances_mm
    }

    /// Scans delivered.
    #[must_use]
    pub const fn scans(&self) -> u64 {
        self.scans
    }

    /// Replies refused for a sum, a length or a number.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.refused
    }

    /// The same since the last good one.
    #[must_use]
    pub const fn refused_in_a_row(&self) -> u32 {
        self.refused_in_a_row
    }

    /// Bytes that belong to no good reply.
    #[must_use]
    pub const fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes
    }

    /// Forgets the unfinished reply; the counts stay.
    pub fn reset(&mut self) {
        self.skipped_bytes += self.pending.len() as u64;
        self.pending.clear();
        self.searched = 0;
        self.refused_in_a_row = 0;
    }

    /// Takes in bytes and shows `on_block` each good reply together with the reader's distances
    /// and the number of bytes behind the reply.
    pub fn feed(&mut self, bytes: &[u8], mut on_block: impl FnMut(Block, &[u32], usize)) {
        self.pending.extend_from_slice(bytes);
        let pending = std::mem::take(&mut self.pending);
        let mut at = 0;
        while let Some(n_bytes) = self.reply_bytes(&pending[at..]) {
            let reply = &pending[at..at + n_bytes];
            at += n_bytes;
            self.searched = 0;
            match self.read(reply) {
                Some(block) => {
                    self.refused_in_a_row = 0;
                    on_block(block, &self.distances_mm, pending.len() - at);
                }
                None => self.refuse(reply),
            }
        }
        self.pending = pending;
        self.pending.drain(..at);
    }

    /// Bytes up to the end of the first reply; too many without an end are one, a bad one.
    fn reply_bytes(&mut self, bytes: &[u8]) -> Option<usize> {
        let from = self.searched.saturating_sub(1).min(bytes.len());
        let end = end_of_reply(&bytes[from..]).map(|end| from + end);
        self.searched = bytes.len();
        end.filter(|end| *end <= LONGEST).or_else(|| (bytes.len() > LONGEST).then_some(LONGEST))
    }

    fn refuse(&mut self, reply: &[u8]) {
        self.skipped_bytes += reply.len() as u64;
        // An empty line alone is the end of what was refused before.
        if reply.len() > 2 {
            self.refused += 1;
            self.refused_in_a_row += 1;
        }
    }

    fn read(&mut self, reply: &[u8]) -> Option<Block> {
        let mut lines = reply.strip_suffix(b"\n\n")?.split(|byte| *byte == b'\n');
        let echo = std::str::from_utf8(lines.next()?).ok()?;
        let state: [u8; 2] = checked(lines.next()?)?.try_into().ok()?;
        if state == *b"99" && (echo.starts_with("MD") || echo.starts_with("GD")) {
            let time_ms = number(checked(lines.next()?).filter(|t| t.len() == TIME_CHARS)?)?;
            self.read_distances(lines)?;
            self.scans += 1;
            return Some(Block::Scan { time_ms, n_bytes: reply.len() });
        }
        let values = lines.map(key_and_value).collect::<Option<Vec<_>>>()?;
        Some(Block::Answer { echo: echo.to_owned(), state, values })
    }

    fn read_distances<'a>(&mut self, lines: impl Iterator<Item = &'a [u8]>) -> Option<()> {
        self.payload.clear();
        let n_chars = self.n_expected * DISTANCE_CHARS;
        for line in lines {
            let text = checked(line)?;
            let is_last = self.payload.len() + text.len() == n_chars;
            if text.len() != LINE_CHARS && !is_last {
                return None;
            }
            self.payload.extend_from_slice(text);
        }
        if self.payload.len() != n_chars {
            return None;
        }
        self.distances_mm.clear();
        let mut is_number = true;
        self.distances_mm.extend(self.payload.as_chunks::<DISTANCE_CHARS>().0.iter().map(
            |three| {
                let six = three.map(|byte| u32::from(byte.wrapping_sub(0x30)));
                is_number &= six.iter().all(|six| *six < 64);
                six[0] << 12 | six[1] << 6 | six[2]
            },
        ));
        is_number.then_some(())
    }
}

/// Where an empty line ends.
fn end_of_reply(bytes: &[u8]) -> Option<usize> {
    let mut at = 0;
    while let Some(found) = bytes[at..].iter().position(|byte| *byte == b'\n') {
        at += found + 1;
        if bytes.get(at)? == &b'\n' {
            return Some(at + 1);
        }
    }
    None
}
