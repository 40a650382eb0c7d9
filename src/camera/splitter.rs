//! Cuts a stream of bytes into lines.

/// A longer line is refused, bytes.
pub const MAX_LINE_BYTES: usize = 64 * 1024;

/// Collects bytes of one connection until a line is whole.
///
/// A line that grows beyond [`MAX_LINE_BYTES`] is handed on cut at one byte more, so that the reader
/// refuses it, and the rest up to its end is dropped.
#[derive(Debug, Clone, Default)]
pub struct LineSplitter {
    pending: Vec<u8>,
    is_skipping: bool,
}

impl LineSplitter {
    /// A splitter at the beginning of a line.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes in bytes and hands on each line that they complete, without its line break; empty
    /// lines are left out.
    pub fn feed(&mut self, bytes: &[u8], mut on_line: impl FnMut(&[u8])) {
        let mut pieces = bytes.split(|byte| *byte == b'\n').peekable();
        while let Some(piece) = pieces.next() {
            self.grow(piece, &mut on_line);
            if pieces.peek().is_some() {
                self.finish(&mut on_line);
            }
        }
    }

    /// Hands on the last line of a datagram or connection, which needs no line break.
    pub fn finish(&mut self, mut on_line: impl FnMut(&[u8])) {
        if !self.is_skipping && !self.pending.trim_ascii().is_empty() {
            on_line(&self.pending);
        }
        self.pending.clear();
        self.is_skipping = false;
    }

    fn grow(&mut self, piece: &[u8], on_line: &mut impl FnMut(&[u8])) {
        if self.is_skipping {
            return;
        }
        let room = MAX_LINE_BYTES + 1 - self.pending.len();
        self.pending.extend_from_slice(&piece[..piece.len().min(room)]);
        if self.pending.len() > MAX_LINE_BYTES {
            on_line(&self.pending);
            self.pending.clear();
            self.is_skipping = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines_of(chunks: &[&[u8]]) -> Vec<Vec<u8>> {
        let mut splitter = LineSplitter::new();
        let mut lines = Vec::new();
        chunks.iter().for_each(|chunk| splitter.feed(chunk, |line| lines.push(line.to_vec())));
        splitter.finish(|line| lines.push(line.to_vec()));
        lines
    }

    #[test]
    fn cuts_do_not_matter() {
        let whole = b"one\n\ntwo\r\nthree";
        let expected = lines_of(&[whole]);
        assert_eq!(expected, [b"one".to_vec(), b"two\r".to_vec(), b"three".to_vec()]);
        for cut in 0..whole.len() {
            assert_eq!(lines_of(&[&whole[..cut], &whole[cut..]]), expected);
        }
    }

    #[test]
    fn a_giant_line_is_told_once_and_the_next_is_unharmed() {
        let giant = vec![b'x'; 3 * MAX_LINE_BYTES];
        let lines = lines_of(&[&giant, &giant, b"\ngood\n"]);
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[0].len(), MAX_LINE_BYTES + 1);
        assert_eq!(lines[1], b"good");
    }
}
