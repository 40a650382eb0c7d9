//! What people decided of a log's flights: the file that the live page keeps beside it.

use super::replay::ReplayError;
use super::surveys::SurveyPlace;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

/// A decision on a flight, as the page appended it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Decision {
    /// End of the flight on the log's clock, ns.
    pub flight_ended_at_ns: i64,
    /// What was decided.
    pub verdict: Decided,
    /// What the person said to it.
    #[serde(default)]
    pub remark: String,
    /// When, RFC 3339 in UTC.
    pub decided_utc: String,
    /// Who, if that was said.
    #[serde(default)]
    pub decided_by: Option<String>,
}

/// What a person decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Decided {
    /// The flight counts.
    Accepted,
    /// It does not.
    Rejected,
}

impl Decision {
    /// `rejected by Kim Doe, 2026-03-01T06:20:00Z: dust at bay B`
    #[must_use]
    pub fn said(&self) -> String {
        let what = match self.verdict {
            Decided::Accepted => "accepted",
            Decided::Rejected => "rejected",
        };
        let by = self.decided_by.as_deref().unwrap_or("a person who gave no name");
        let remark = self.remark.trim();
        let remark = if remark.is_empty() { String::new() } else { format!(": {remark}") };
        format!("{what} by {by}, {}{remark}", self.decided_utc)
    }

    /// The survey does not count.
    #[must_use]
    pub const fn is_rejection(&self) -> bool {
        matches!(self.verdict, Decided::Rejected)
    }
}

/// `flight.mcap` has `flight.review.jsonl`.
#[must_use]
pub fn review_file(log: &Path) -> PathBuf {
    log.with_extension("review.jsonl")
}

/// The newest decision on any flight of a survey. One on the survey holds for the flights into its gaps until
/// somebody decides again.
///
/// # Errors
/// A file beside the log that cannot be read: nobody knows what was decided.
pub fn read_decision(log: &Path, on: &SurveyPlace) -> Result<Option<Decision>, ReplayError> {
    let path = review_file(log);
    let bad = |cause: String| ReplayError::Review { path: path.clone(), cause };
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(bad(error.to_string())),
    };
    let mut newest = None;
    for (number, line) in (1..).zip(text.lines()) {
        let decision: Decision =
            serde_json::from_str(line).map_err(|error| bad(format!("line {number}: {error}")))?;
        if on.ended_at.iter().any(|ended_at| ended_at.nanos() == decision.flight_ended_at_ns) {
            newest = Some(decision);
        }
    }
    Ok(newest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Stamp;

    #[test]
    fn the_newest_decision_on_a_flight_of_the_survey_holds() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("flight-1.mcap");
        let ended_at = [7_i64, 9].map(Stamp::from_nanos).to_vec();
        let place = SurveyPlace { ended_at, ..SurveyPlace::default() };
        assert_eq!(read_decision(&log, &place).unwrap(), None);
        // As the page writes it, with fields that are not needed here.
        let line = |ns: i64, verdict: &str, remark: &str| {
            format!(
                "{{\"flight_ended_at_ns\":{ns},\"verdict\":\"{verdict}\",\"remark\":\"{remark}\",\
                 \"remarks\":[\"a\"],\"decided_utc\":\"2026-03-01T06:20:00Z\"}}\n"
            )
        };
        let write = |text: String| std::fs::write(review_file(&log), text).unwrap();
        write(line(7, "accepted", "") + &line(9, "rejected", "dust") + &line(11, "accepted", ""));
        let decision = read_decision(&log, &place).unwrap().unwrap();
        assert!(decision.is_rejection());
        assert_eq!(
            decision.said(),
            "rejected by a person who gave no name, 2026-03-01T06:20:00Z: dust"
        );
        write(line(9, "rejected", "dust") + &line(9, "accepted", "cleaned"));
        assert!(!read_decision(&log, &place).unwrap().unwrap().is_rejection());
        write(line(9, "postponed", ""));
        assert!(matches!(read_decision(&log, &place), Err(ReplayError::Review { .. })));
    }
}
