//! How the sensor and its line are doing.

use crate::time::{Mono, Stamp};

/// Counts since the driver started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LidarStats {
    /// Bytes read.
    pub bytes: u64,
    /// Good frames.
    pub frames: u64,
    /// Candidates that failed the CRC.
    pub crc_errors: u64,
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
}

/// What the driver sees of the sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LidarHealth {
    /// The port is open and nothing has been judged yet.
    Starting,
    /// Frames arrive.
    Streaming,
    /// Nothing has arrived for a second.
    Silent,
    /// Bytes arrive, but for a second no frame among them: the baud or the model is wrong.
    NoFrames {
        /// The line speed in use, bit/s.
        baud: u32,
    },
    /// The port is gone; it is tried again every second.
    Disconnected {
        /// Why, with the cure.
        reason: String,
    },
    /// The driver has ended.
    Stopped,
}

/// What the driver last knew.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LidarStatus {
    /// How the sensor does.
    pub health: LidarHealth,
    /// When the last good frame arrived. A read that hangs in the kernel shows here only.
    pub last_frame_at: Option<Stamp<Mono>>,
    /// Counts.
    pub stats: LidarStats,
}

impl Default for LidarStatus {
    fn default() -> Self {
        Self { health: LidarHealth::Starting, last_frame_at: None, stats: LidarStats::default() }
    }
}
