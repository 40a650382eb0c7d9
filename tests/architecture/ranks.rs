//! The table of ranks.

use std::ops::RangeInclusive;

/// Modules of `stockpilot` with their ranks; a module names lower ranks only.
const RANKS: [(&str, u8); 27] = [
    ("units", 0),
    ("time", 0),
    ("geometry", 1),
    ("stats", 1),
    ("messages", 2),
    ("localization", 3),
    ("mapping", 3),
    ("planning", 4),
    ("calibration", 4),
    ("mission", 5),
    ("pilot", 6),
    ("link", 7),
    ("lidar", 7),
    ("camera", 7),
    ("record", 7),
    ("figure", 7),
    ("pdf", 7),
    ("export", 7),
    // It shows what the edges of rank 7 say of themselves.
    ("web", 8),
    // The file twins of the settings of the ranks below are converted there.
    ("config", 9),
    ("service", 10),
    ("survey", 10),
    ("doctor", 11),
    ("report", 11),
    ("inventory", 11),
    ("markers", 11),
    ("audit", 12),
];

/// Ranks that do no I/O.
pub(crate) const CORE_RANKS: RangeInclusive<u8> = 0..=6;

/// What ranks without I/O never name.
pub(crate) const FORBIDDEN_IN_CORE: [&str; 9] = [
    "tokio",
    "serde",
    "tracing",
    "std::fs",
    "std::net",
    "std::thread",
    "std::env",
    "std::time::Instant",
    "std::time::SystemTime",
];

/// Modules of the simulator that make the truth.
pub(crate) const TRUTH_MODULES: [&str; 9] =
    ["world", "raycast", "vehicle", "autopilot", "lidar", "camera", "rig", "judge", "machine"];

pub(crate) fn rank_of(module: &str) -> Option<u8> {
    RANKS.iter().find(|(name, _)| *name == module).map(|(_, rank)| *rank)
}
