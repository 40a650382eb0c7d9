//! The books of a hall: its surveys in one SQLite file, what was in each bay and what has changed.
//!
//! | table | one row for each |
//! | --- | --- |
//! | `hall` | hall, by its name |
//! | `bay` | bay of a hall, and the hall as a whole |
//! | `survey` | survey of a log: what it is known by, the log's SHA-256, its configuration, when it measured, which errors it does not share, what a person decided of it |
//! | `volume` | bay of a survey: volume, σ, mass, and the whole account |
//! | `replaced` | survey as it stood before more was flown of it |
//!
//! Ids are stable: they are made from names and from what a survey is known by
//! ([`crate::record::LoggedSurvey::identity`]), so the same survey has the same id in every file, also when its log
//! has grown since. A survey is added in one transaction; one that is there already is not added again, also
//! under another name of its log. Where gaps were flown since, what the survey came to takes the place of what it had
//! come to, which is kept in `replaced`. A survey that a person has rejected is not added, unless that is asked for.
//! Nothing is ever taken out.
//!
//! Earlier programs did not note what surveys are known by, the first one not even which survey of its log it added.
//! Theirs are known by their volumes when the log comes again, and are numbered then.
//!
//! The rows hold what a log recorded; whether it can be computed again, `report` and `audit` say.

mod history;
mod known;
mod new;
mod store;
mod table;
mod tables;

pub use history::{HistoryLine, history};
pub use store::{AddOptions, Added, Inventory, StoredSurvey};
pub use table::history_table;

use crate::record::replay::ReplayError;
use crate::survey::SurveyError;
use std::path::PathBuf;

/// Why the books cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum InventoryError {
    /// From the database.
    #[error("the books: {0}")]
    Database(#[from] rusqlite::Error),
    /// The file is of a newer program.
    #[error("the books have version {found}, this program knows {known}")]
    Version {
        /// What the file has.
        found: i64,
        /// What the program knows.
        known: i64,
    },
    /// A log cannot be read or compared.
    #[error(transparent)]
    Survey(#[from] SurveyError),
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] ReplayError),
    /// A file cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// An account cannot be written or read.
    #[error("an account in the books: {0}")]
    Account(#[from] serde_json::Error),
    /// A person has rejected the survey.
    #[error("{}: the survey was {said}; --although-rejected adds it all the same", path.display())]
    Rejected {
        /// Which log.
        path: PathBuf,
        /// By whom, when and why.
        said: String,
    },
    /// It cannot be told whether the survey is in the books.
    #[error(
        "{}: the books have {id} of this log, which an earlier program added; its volumes are none of those that the \
         log holds now, so nobody can tell which survey it is: add the logs to new books", path.display()
    )]
    Unclear {
        /// Which log.
        path: PathBuf,
        /// The survey in the books.
        id: String,
    },
    /// The log is of a flight under way.
    #[error(
        "{} holds no result after a landing; if it is cut, `stockpilot merge` makes one", path.display()
    )]
    NotFinal {
        /// Which.
        path: PathBuf,
    },
}

#[cfg(test)]
mod tests;
