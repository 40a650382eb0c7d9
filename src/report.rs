//! What a survey came to, for people and their programs: PDF, HTML, JSON and CSV of one set of facts.
//!
//! ```text
//! LOG ─▶ survey::Flight ─┬─▶ Facts ─▶ content ─▶ pages (PDF), HTML
//! earlier LOG, books ────┘     └────▶ data (JSON, CSV)
//! ```
//! The numbers are those that the log recorded; the flight is flown again, and the report says
//! whether this build computes them again to the last bit. Every volume stands with its expanded
//! uncertainty (k = 2), and nothing is called certified, accurate to a percentage, or in keeping
//! with a standard that excludes surface models.
//!
//! Not done here: the mathematics (`mapping`, `survey`), and maps and point clouds (`export`).

mod books;
mod compose;
mod content;
mod data;
mod declared;
mod facts;
mod files;
mod html;
mod method;
mod pages;
mod pictures;
mod verdict;
mod words;

pub use books::{Amount, BookDifference, BookEntry, BookError, read_books};
pub use data::{ReportData, SCHEMA};
pub use facts::{BayFacts, Facts, Wishes};
pub use files::{ReportFile, SUMS, report_files, write_files};
pub(crate) use files::{sync_folder, write_to_disk};
pub use verdict::{Target, Verdict};

use crate::export::ExportError;
use crate::figure::FigureError;
use crate::mapping::statement::StatementError;
use crate::pdf::PdfError;
use crate::survey::SurveyError;
use std::path::PathBuf;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The surveys cannot be compared.
    #[error(transparent)]
    Survey(#[from] SurveyError),
    /// The books do not fit.
    #[error(transparent)]
    Book(#[from] BookError),
    /// A number cannot be stated.
    #[error(transparent)]
    Statement(#[from] StatementError),
    /// A picture cannot be drawn.
    #[error(transparent)]
    Figure(#[from] FigureError),
    /// A map or a point cloud cannot be made.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The PDF cannot be made.
    #[error(transparent)]
    Pdf(#[from] PdfError),
    /// The JSON form cannot be made.
    #[error("the report cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// The CSV form cannot be made.
    #[error("the report cannot be written as CSV: {0}")]
    Csv(#[from] csv::Error),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// A report in all its forms.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The pages.
    pub pdf: Vec<u8>,
    /// The same as one HTML file.
    pub html: String,
    /// Everything that is stated, as JSON.
    pub json: String,
    /// One row for each volume.
    pub csv: Vec<u8>,
}

impl Report {
    /// Makes a report of facts; `log_sha256` names the log.
    ///
    /// # Errors
    /// What cannot be stated, drawn or set.
    pub fn new(facts: &Facts, log_sha256: &str) -> Result<Self, ReportError> {
        let content = compose::content(facts, log_sha256)?;
        let mut json = serde_json::to_string_pretty(&ReportData::new(facts, log_sha256))?;
        json.push('\n');
        Ok(Self {
            pdf: pages::pdf(&content, facts.flight.started)?,
            html: html::html(&content),
            json,
            csv: data::csv(facts, log_sha256)?,
        })
    }

    /// Its forms as files.
    #[must_use]
    pub fn into_files(self) -> Vec<ReportFile> {
        vec![
            ReportFile { name: "report.pdf", bytes: self.pdf },
            ReportFile { name: "report.html", bytes: self.html.into_bytes() },
            ReportFile { name: "report.json", bytes: self.json.into_bytes() },
            ReportFile { name: "report.csv", bytes: self.csv },
        ]
    }
}
