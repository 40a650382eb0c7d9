//! `stockpilot doctor`: what is connected, whether it works, and what to do where it does not.
//!
//! ```text
//! serial ports · video devices · LiDAR · detector · autopilot · clocks · log ─ listened to for some seconds ─▶ Report
//! ```
//! The examination runs the service's own drivers and link beside each other, as in flight, but
//! records nothing and commands nothing. Judging is pure: [`judge`] is told what was seen.

mod cameras;
mod examination;
pub mod judge;
mod parameters;
mod ports;
mod video;

pub use examination::{Examination, Patience};
pub use ports::{SerialPort, serial_ports};
pub use video::video_checks;

use serde::Serialize;
use std::fmt;

/// How it stands with one thing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// As it should be.
    Good,
    /// It works, but not as well as it could.
    Warn,
    /// It does not work; a flight needs it.
    Bad,
}

/// One line of the table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Check {
    /// What was looked at.
    pub subject: String,
    /// How it stands.
    pub verdict: Verdict,
    /// What was found.
    pub found: String,
    /// What to do; there is one for every line that is not good.
    pub cure: Option<String>,
}

impl Check {
    /// A good line.
    #[must_use]
    pub fn good(subject: impl Into<String>, found: impl Into<String>) -> Self {
        let (subject, found) = (subject.into(), found.into());
        Self { subject, verdict: Verdict::Good, found, cure: None }
    }

    /// A line that needs something done.
    #[must_use]
    pub fn with_cure(
        subject: impl Into<String>,
        verdict: Verdict,
        found: impl Into<String>,
        cure: impl Into<String>,
    ) -> Self {
        let (subject, found) = (subject.into(), found.into());
        Self { subject, verdict, found, cure: Some(cure.into()) }
    }
}

/// The whole examination.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Report {
    /// The lines, in the order of looking.
    pub checks: Vec<Check>,
}

impl Report {
    /// The worst verdict; good if nothing was looked at.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        self.checks.iter().map(|check| check.verdict).max().unwrap_or(Verdict::Good)
    }

    /// For the shell: 0 if everything works, 1 if something does not. Warnings count as working.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        u8::from(self.verdict() == Verdict::Bad)
    }
}

impl fmt::Display for Report {
    /// A table with each cure below its line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.checks.iter().map(|check| check.subject.chars().count()).max();
        let width = width.unwrap_or(0);
        for check in &self.checks {
            let mark = match check.verdict {
                Verdict::Good => "good",
                Verdict::Warn => "WARN",
                Verdict::Bad => "BAD ",
            };
            writeln!(f, "{mark}  {:width$}  {}", check.subject, check.found)?;
            if let Some(cure) = &check.cure {
                writeln!(f, "      {:width$}  → {cure}", "")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_line_decides_and_every_cure_stands_below_its_line() {
        let warn = Check::with_cure("clock", Verdict::Warn, "not set", "let it set itself");
        let mut report = Report { checks: vec![Check::good("lidar", "LD19"), warn] };
        assert_eq!((report.verdict(), report.exit_code()), (Verdict::Warn, 0));
        report.checks.push(Check::with_cure("autopilot", Verdict::Bad, "silent", "plug it in"));
        assert_eq!(report.exit_code(), 1);
        let table = report.to_string();
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "good  lidar      LD19");
        assert_eq!(lines[2], "                 → let it set itself");
        assert!(lines[3].starts_with("BAD   autopilot  silent"));
        assert_eq!(lines.len(), 5);
    }
}
