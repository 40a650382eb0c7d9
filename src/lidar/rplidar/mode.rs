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

/// Sample period of the plain scans that every firmware knows, for a sensor that does not tell it: an A1
/// (508 and 254 µs), a C1 (200) and an S1 (244) do. `None` for the other formats, which come with a mode.
pub(super) const fn usual_period(answer: Answer, series: u8) -> Option<Duration> {
    match (answer, series) {
        (Answer::Standard, 1) => Some(Duration::from_micros(508)),
        (Answer::Legacy, 1) => Some(Duration::from_micros(254)),
        (Answer::Standard, 4) => Some(Duration::from_micros(200)),
        (Answer::Standard, _) => Some(Duration::from_micros(244)),
        _ => None,
    }
}
