//! Ways to scan, as the sensor lists them.

use super::Answer;
use std::time::Duration;

/// One way to scan. Numbers and names are whatever the firmware says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mode {
    /// The number that starts it.
    pub id: u16,
    /// What the firmware calls it.
    pub name: String,
    /// Time between two samples.
    pub sample_period: Duration,
    /// Largest distance, m.
    pub max_distance_m: f64,
    /// The format of its samples; `None` for one that is not known here.
    pub answer: Option<Answer>,
}
