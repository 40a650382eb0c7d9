//! How the sensor and its line are doing.

use super::Identity;
use crate::time::{Mono, Stamp};

/// Counts since the driver started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LidarStats {
    /// Bytes read.
    pub bytes: u64,
    /// Good frames.
    pub frames: u64,
    /// Frames refused for their checksum or for impossible numbers.
    pub checksum_errors: u64,
    /// Bytes that belong to no good frame.
    pub skipped_bytes: u64,
    /// Samples that the sensor took but that never came.
    pub missing_samples: u64,
    /// Scans handed to the brain.
    pub scans: u64,
    /// Beams handed to the brain.
    pub beams: u64,
    /// Beams lost because the brain's channel was full.
    pub lost_beams: u64,
    /// Times that the port was opened again after it was gone.
    pub reconnects: u64,
    /// Times that the conversation with the sensor was begun anew.
    pub restarts: u64,
    /// Times that the estimate of the sensor's clock was begun anew: after a pause, or because
    /// arrivals had moved away from it.
    pub clock_restarts: u64,
}

/// What the driver sees of the sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LidarHealth {
    /// The port is open and nothing has been judged yet.
    Starting,
    /// Frames arrive.
    Streaming,
    /// Nothing has arrived for a second; so it is too at a wrong baud with a sensor that must be asked.
    Silent,
    /// Bytes arrive, but for a second no frame among them: the baud or the model is wrong, or the
    /// line damages whatever it carries.
    NoFrames {
        /// The line speed in use, bit/s.
        baud: u32,
    },
    /// A sensor has told its name, but it is none that can be chosen by itself.
    Unknown {
        /// Maker and number.
        name: String,
        /// The line speed at which it answered, bit/s.
        baud: u32,
    },
    /// Beams arrive, but the head stands still: its motor is blocked, unplugged or without power.
    Stalled,
    /// The sensor itself complains.
    Faulty {
        /// Of what, with the cure.
        reason: String,
    },
    /// The port is gone; it is tried again every second.
    Disconnected {
        /// Why, with the cure.
        reason: String,
    },
    /// The driver has ended.
    Stopped,
}

/// How fast it measures.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rates {
    /// Samples, 1/s.
    pub samples_hz: f64,
    /// Turns of the head, 1/s.
    pub turns_hz: f64,
}

/// What the driver last knew.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarStatus {
    /// How the sensor does.
    pub health: LidarHealth,
    /// Who the sensor is, once that is known.
    pub identity: Option<Identity>,
    /// The line speed in use, bit/s.
    pub baud: u32,
    /// Samples and turns of the head in the last second, 1/s.
    pub rates: Rates,
    /// When the last good frame arrived. A read that hangs in the kernel shows here only.
    pub last_frame_at: Option<Stamp<Mono>>,
    /// Counts.
    pub stats: LidarStats,
}

impl Default for LidarStatus {
    fn default() -> Self {
        Self {
            health: LidarHealth::Starting,
            identity: None,
            baud: 0,
            rates: Rates::default(),
            last_frame_at: None,
            stats: LidarStats::default(),
        }
    }
}
