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
}

impl Scanner {
    /// Takes in `bytes` and shows `look` all that is left, again and again, until it waits.
    ///
    /// A chunk that begins where nothing is pending is looked at in place.
    pub(super) fn feed(&mut self, bytes: &[u8], mut look: impl FnMut(&[u8]) -> Look) {
        if self.pending.is_empty() {
            let done = advance(bytes, &mut look);
            self.pending.extend_from_slice(&bytes[done..]);
            return;
        }
        self.pending.extend_from_slice(bytes);
        let done = advance(&self.pending, &mut look);
        self.pending.drain(..done);
    }

    /// Forgets what is pending; says how many bytes that was.
    pub(super) fn clear(&mut self) -> usize {
        let n_bytes = self.pending.len();
        self.pending.clear();
        n_bytes
    }
}

fn advance(bytes: &[u8], look: &mut impl FnMut(&[u8]) -> Look) -> usize {
    let mut at = 0;
    while at < bytes.len() {
        match look(&bytes[at..]) {
            Look::Wait => break,
            Look::Skip(n_bytes) | Look::Take(n_bytes) => {
                at = (at + n_bytes.max(1)).min(bytes.len())
            }
        }
    }
    at
}
