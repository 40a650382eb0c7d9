//! Judges from arrivals how the sensor does.

use super::{AssemblerStats, LidarHealth, Rates};
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// Silence, nonsense or a standing head this long is told.
const PATIENCE: Duration = Duration::from_secs(1);
/// Rates are counted over this long.
const WINDOW: Duration = Duration::from_secs(1);
/// A head below this is standing; no sensor works below 1 turn/s.
const LEAST_TURNS_HZ: f64 = 0.5;
/// Fewer samples tell nothing about the head.
const FEW_SAMPLES_HZ: f64 = 50.0;

/// Remembers the last byte, the last frame and what came in the last second.
#[derive(Debug, Clone, Copy)]
pub(super) struct Watchdog {
    baud: u32,
    last_byte_at: Stamp<Mono>,
    last_frame_at: Stamp<Mono>,
    has_frame: bool,
    window_from: Stamp<Mono>,
    counted: AssemblerStats,
    rates: Option<Rates>,
}

impl Watchdog {
    /// A watchdog over a port opened at `now`, after what was assembled until then.
    pub(super) const fn new(baud: u32, now: Stamp<Mono>, counted: AssemblerStats) -> Self {
        Self {
            baud,
            last_byte_at: now,
            last_frame_at: now,
            has_frame: false,
            window_from: now,
            counted,
            rates: None,
        }
    }

    pub(super) const fn note_bytes(&mut self, at: Stamp<Mono>) {
        self.last_byte_at = at;
    }

    pub(super) fn note_frame(&mut self, at: Stamp<Mono>) {
        if !self.has_frame {
            self.window_from = at;
        }
        self.last_frame_at = at;
        self.has_frame = true;
    }

    /// Counts samples and turns; the rates are renewed every second.
    #[expect(clippy::cast_precision_loss, reason = "counts of one second")]
    pub(super) fn note_counts(&mut self, now: Stamp<Mono>, stats: AssemblerStats) -> Rates {
        let elapsed = now.since(self.window_from);
        if elapsed >= WINDOW {
            let per_s = |after: u64, before: u64| (after - before) as f64 / elapsed.as_secs_f64();
            self.rates = Some(Rates {
                samples_hz: per_s(stats.beams, self.counted.beams),
                turns_hz: per_s(stats.turns, self.counted.turns),
            });
            (self.window_from, self.counted) = (now, stats);
        }
        self.rates.unwrap_or_default()
    }

    /// True if nothing that makes sense has come since the port was opened.
    pub(super) const fn has_frame(&self) -> bool {
        self.has_frame
    }

    pub(super) fn health(&self, now: Stamp<Mono>) -> LidarHealth {
        if now.since(self.last_byte_at) > PATIENCE {
            LidarHealth::Silent
        } else if now.since(self.last_frame_at) > PATIENCE {
            LidarHealth::NoFrames { baud: self.baud }
        } else if self.is_head_standing() {
            LidarHealth::Stalled
        } else if self.has_frame {
            LidarHealth::Streaming
        } else {
            LidarHealth::Starting
        }
    }

    fn is_head_standing(&self) -> bool {
        self.rates.is_some_and(|rates| {
            rates.samples_hz > FEW_SAMPLES_HZ && rates.turns_hz < LEAST_TURNS_HZ
        })
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
        let mut watchdog = Watchdog::new(230_400, at_ms(0), AssemblerStats::default());
        assert_eq!(watchdog.health(at_ms(900)), LidarHealth::Starting);
        assert_eq!(watchdog.health(at_ms(1001)), LidarHealth::Silent);
        watchdog.note_bytes(at_ms(1100));
        assert_eq!(watchdog.health(at_ms(1101)), LidarHealth::NoFrames { baud: 230_400 });
        watchdog.note_frame(at_ms(1100));
        assert_eq!(watchdog.health(at_ms(1101)), LidarHealth::Streaming);
        assert_eq!(watchdog.health(at_ms(2101)), LidarHealth::Silent);
    }

    #[test]
    fn a_head_that_stands_while_beams_come_is_stalled() {
        let mut watchdog = Watchdog::new(230_400, at_ms(0), AssemblerStats::default());
        let mut stats = AssemblerStats::default();
        for ms in (0..4000).step_by(10) {
            stats.beams += 45;
            // Ten turns a second for two seconds, then none.
            stats.turns += u64::from(ms % 100 == 0 && ms < 2000);
            watchdog.note_bytes(at_ms(ms));
            watchdog.note_frame(at_ms(ms));
            let rates = watchdog.note_counts(at_ms(ms), stats);
            if ms == 1990 {
                assert!((rates.samples_hz - 4500.0).abs() < 50.0, "{rates:?}");
                assert!((rates.turns_hz - 10.0).abs() < 1.1, "{rates:?}");
                assert_eq!(watchdog.health(at_ms(ms)), LidarHealth::Streaming);
            }
        }
        // Told within two seconds of the stop.
        assert_eq!(watchdog.health(at_ms(3990)), LidarHealth::Stalled);
    }
}
