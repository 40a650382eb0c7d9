//! The sensor's transmitter: bytes leave one after the other, at the line's speed.

use super::Frame;
use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::time::{Mono, Stamp};

/// A serial line sends a start bit, eight data bits and a stop bit for each byte.
const BITS_PER_BYTE: u64 = 10;
/// A sensor that produces more than its line carries loses whole frames beyond this many bytes.
const BUFFER_BYTES: usize = 8192;

/// Frames on their way out.
#[derive(Debug)]
pub(super) struct Uart {
    byte_time: Duration,
    queue: VecDeque<Frame>,
    n_queued: usize,
    free_at: Stamp<Mono>,
}

impl Uart {
    pub(super) fn new(baud: u32) -> Self {
        let nanos = BITS_PER_BYTE * 1_000_000_000 / u64::from(baud.max(1));
        Self {
            byte_time: Duration::from_nanos(nanos),
            queue: VecDeque::new(),
            n_queued: 0,
            free_at: Stamp::ZERO,
        }
    }

    /// Puts a frame behind the others; what does not fit is lost, and its samples are given back.
    pub(super) fn push(&mut self, frame: Frame) -> u64 {
        if self.n_queued + frame.bytes.len() > BUFFER_BYTES {
            return frame.n_samples;
        }
        self.n_queued += frame.bytes.len();
        self.queue.push_back(frame);
        0
    }

    /// The next frame whose last bit has left by `now`.
    pub(super) fn pop(&mut self, now: Stamp<Mono>) -> Option<Frame> {
        let frame = self.queue.front()?;
        let n_bytes = u32::try_from(frame.bytes.len()).unwrap_or(u32::MAX);
        let sent_at = frame.ready_at.max(self.free_at).plus(self.byte_time * n_bytes);
        if sent_at > now {
            return None;
        }
        self.free_at = sent_at;
        self.n_queued -= frame.bytes.len();
        self.queue.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_take_their_time() {
        let at_us = |us: u64| Stamp::ZERO.plus(Duration::from_micros(us));
        let mut uart = Uart::new(100_000);
        let frame = |us| Frame { bytes: vec![0; 10], n_samples: 1, ready_at: at_us(us) };
        // 10 bytes take 1 ms: the second frame waits for the first, the third for itself.
        for us in [0, 100, 5000] {
            uart.push(frame(us));
        }
        assert!(uart.pop(at_us(999)).is_none());
        assert!(uart.pop(at_us(1000)).is_some());
        assert!(uart.pop(at_us(1999)).is_none());
        assert!(uart.pop(at_us(2000)).is_some());
        assert!(uart.pop(at_us(5999)).is_none());
        assert!(uart.pop(at_us(6000)).is_some());
    }
}
