//! What the computer says of its disk.

use crate::time::{Mono, Stamp};

/// How much the disk takes in still.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Room {
    /// Several surveys.
    Enough,
    /// A survey, but space should be made.
    Low,
    /// Less than a survey.
    TooLittle,
}

/// The disk with the log, as it was looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StorageState {
    /// When.
    pub at: Stamp<Mono>,
    /// How much fits.
    pub room: Room,
    /// Free bytes for this program; `None` if the disk does not say.
    pub free_bytes: Option<u64>,
    /// What one survey needs, bytes.
    pub survey_bytes: u64,
    /// Entries of the log that are lost so far.
    pub records_lost: u64,
    /// Nothing is written any more, until the program starts anew.
    pub has_log_failed: bool,
}

impl StorageState {
    /// The free bytes for people: `1.2 GB`, `310 MB`.
    #[must_use]
    pub fn free_text(&self) -> String {
        match self.free_bytes {
            None => "unknown".to_owned(),
            Some(bytes) if bytes < 1_000_000_000 => format!("{} MB", bytes / 1_000_000),
            Some(bytes) => format!("{}.{} GB", bytes / 1_000_000_000, bytes / 100_000_000 % 10),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_space_reads_well() {
        let of = |free_bytes| {
            let state = StorageState {
                at: Stamp::ZERO,
                room: Room::Enough,
                free_bytes,
                survey_bytes: 0,
                records_lost: 0,
                has_log_failed: false,
            };
            state.free_text()
        };
        assert_eq!(of(Some(310_400_000)), "310 MB");
        assert_eq!(of(Some(1_290_000_000)), "1.2 GB");
        assert_eq!(of(None), "unknown");
    }
}
