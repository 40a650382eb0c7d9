//! The decision on a flight, kept beside its log.

use super::verdict::Verdict;
use atomic_write_file::AtomicWriteFile;
use serde::Serialize;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// What is kept.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Decision {
    /// End of the flight on the log's clock, ns.
    pub(super) flight_ended_at_ns: i64,
    /// The decision.
    pub(super) verdict: Verdict,
    /// What the person said to it.
    pub(super) remark: String,
    /// What spoke against accepting it.
    pub(super) remarks: Vec<String>,
    /// When it was decided, UTC.
    pub(super) decided_utc: String,
    /// Who decided, if that was said.
    pub(super) decided_by: Option<String>,
}

/// The file with the decisions on the flights of one log, one JSON object a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ReviewFile {
    path: PathBuf,
}

impl ReviewFile {
    /// `flight.mcap` has `flight.review.jsonl`.
    pub(super) fn beside(log: &Path) -> Self {
        Self { path: log.with_extension("review.jsonl") }
    }

    /// Appends a decision: all or nothing of it survives a power cut.
    ///
    /// # Errors
    /// What the disk says; the earlier decisions are kept then.
    pub(super) fn append(&self, decision: &Decision) -> io::Result<()> {
        let earlier = match std::fs::read(&self.path) {
            Ok(earlier) => earlier,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(error),
        };
        let mut file = AtomicWriteFile::open(&self.path)?;
        file.write_all(&earlier)?;
        serde_json::to_writer(&mut file, decision)?;
        file.write_all(b"\n")?;
        file.commit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decisions_follow_each_other_and_a_full_disk_keeps_the_earlier_ones() {
        let folder = tempfile::tempdir().unwrap();
        let file = ReviewFile::beside(&folder.path().join("flight-1.mcap"));
        let decision = |verdict| Decision {
            flight_ended_at_ns: 7,
            verdict,
            remark: "dust \"at\" bay B".to_owned(),
            remarks: Vec::new(),
            decided_by: None,
            decided_utc: "2026-01-01T00:00:00Z".to_owned(),
        };
        file.append(&decision(Verdict::Rejected)).unwrap();
        file.append(&decision(Verdict::Accepted)).unwrap();
        let read = || std::fs::read_to_string(folder.path().join("flight-1.review.jsonl")).unwrap();
        let verdicts: Vec<String> = read()
            .lines()
            .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
            .map(|line| line["verdict"].as_str().unwrap().to_owned())
            .collect();
        assert_eq!(verdicts, ["rejected", "accepted"]);
        // With the longest name a file can have no other one fits beside it, so nothing can be written.
        let long = folder.path().join(format!("{}.mcap", "f".repeat(255 - ".review.jsonl".len())));
        let (file, kept) = (ReviewFile::beside(&long), long.with_extension("review.jsonl"));
        std::fs::write(&kept, read()).unwrap();
        assert!(file.append(&decision(Verdict::Accepted)).is_err());
        assert_eq!(std::fs::read_to_string(&kept).unwrap(), read());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
