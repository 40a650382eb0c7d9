//! Judges from arrivals how the sensor does.

use super::LidarHealth;
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// Silence or nonsense this long is told.
const PATIENCE: Duration = Duration::from_secs(1);

/// Remembers the last byte and the last frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Watchdog {
    baud: u32,
    last_byte_at: Stamp<Mono>,
    last_frame_at: Stamp<Mono>,
    has_frame: bool,
}

impl Watchdog {
    /// A watchdog over a port opened at `now`.
    pub(super) const fn new(baud: u32, now: Stamp<Mono>) -> Self {
        Self { baud, last_byte_at: now, last_frame_at: now, has_frame: false }
    }

    pub(super) const fn note_bytes(&mut self, at: Stamp<Mono>) {
        self.last_byte_at = at;
    }

    pub(super) const fn note_frame(&mut self, at: Stamp<Mono>) {
        self.last_frame_at = at;
        self.has_frame = true;
    }

    pub(super) fn health(&self, now: Stamp<Mono>) -> LidarHealth {
        if now.since(self.last_byte_at) > PATIENCE {
            LidarHealth::Silent
        } else if now.since(self.last_frame_at) > PATIENCE {
            LidarHealth::NoFrames { baud: self.baud }
        } else if self.has_frame {
            LidarHealth::Streaming
        } else {
            LidarHealth::Starting
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_ms(ms: i64) -> Stamp<Mono> {
        Stamp::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn tells_silence_from_nonsense() {
        let mut watchdog = Watchdog::new(230_400, at_ms(0));
        assert_eq!(watchdog.health(at_ms(900)), LidarHealth::Starting);
        assert_eq!(watchdog.health(at_ms(1001)), LidarHealth::Silent);
        watchdog.note_bytes(at_ms(1100));
        assert_eq!(watchdog.health(at_ms(1101)), LidarHealth::NoFrames { baud: 230_400 });
        watchdog.note_frame(at_ms(1100));
        assert_eq!(watchdog.health(at_ms(1101)), LidarHealth::Streaming);
        assert_eq!(watchdog.health(at_ms(2101)), LidarHealth::Silent);
    }
}
