//! Finds frames in bytes that arrive in chunks of any size.

/// What stands at the beginning of the bytes that are left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// Perhaps a frame; more bytes are needed.
    Wait,
    /// No frame begins here, nor at the next places up to this many bytes on.
    Skip(usize),
    /// A frame of this many bytes.
    Take(usize),
}

/// Bytes that have not been judged yet.
///
/// After a failed candidate the search goes on one byte behind its first byte, so a damaged frame
/// never takes its good successor along. How the bytes are cut into chunks makes no difference.
#[derive(Debug, Clone, Default)]
pub(super) struct Scanner {
    pending: Vec<u8>,
    /// Bytes that were judged.
    n_judged: u64,
}

impl Scanner {
    /// Takes in `bytes` and shows `look` all that is left and how many bytes of the stream lie
    /// before it, again and again, until it waits.
    ///
    /// A chunk that begins where nothing is pending is looked at in place.
    pub(super) fn feed(&mut self, bytes: &[u8], mut look: impl FnMut(&[u8], u64) -> Look) {
        if self.pending.is_empty() {
            let done = advance(bytes, self.n_judged, &mut look);
            self.n_judged += done as u64;
            self.pending.extend_from_slice(&bytes[done..]);
            return;
        }
        self.pending.extend_from_slice(bytes);
        let done = advance(&self.pending, self.n_judged, &mut look);
        self.n_judged += done as u64;
        self.pending.drain(..done);
    }

    /// Forgets what is pending; says how many bytes that was.
    pub(super) fn clear(&mut self) -> usize {
        let n_bytes = self.pending.len();
        self.pending.clear();
        self.n_judged += n_bytes as u64;
        n_bytes
    }
}

fn advance(bytes: &[u8], n_before: u64, look: &mut impl FnMut(&[u8], u64) -> Look) -> usize {
    let mut at = 0;
    while at < bytes.len() {
        match look(&bytes[at..], n_before + at as u64) {
            Look::Wait => break,
            Look::Skip(n_bytes) | Look::Take(n_bytes) => {
                at = (at + n_bytes.max(1)).min(bytes.len())
            }
        }
    }
    at
}
