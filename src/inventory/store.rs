//! The database.

use super::known::{self, accounts};
use super::new::NewSurvey;
use super::{InventoryError, tables};
use crate::config::Config;
use crate::export::sha256_of_file;
use crate::record::{Decision, SurveyPlace, read_accounts_of, read_decision};
use crate::survey::{Origin, Survey};
use rusqlite::{Connection, TransactionBehavior};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Another program that writes is waited for so long.
const PATIENCE: Duration = Duration::from_secs(10);

/// The open books.
#[derive(Debug)]
pub struct Inventory {
    database: Connection,
}

/// What the log of a survey does not say.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct AddOptions {
    /// Which survey of the log; the last if none is named.
    pub number: Option<usize>,
    /// It is added even if a person has rejected it.
    pub although_rejected: bool,
    /// Errors that it does not share with earlier surveys although the configurations are equal.
    pub independent: Vec<Origin>,
}

/// What became of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Added {
    /// It was added.
    New {
        /// The survey's id.
        id: String,
        /// Which survey of its log it is.
        place: SurveyPlace,
    },
    /// It was there already; nothing was changed.
    Known {
        /// The survey's id.
        id: String,
        /// Which survey of its log it is.
        place: SurveyPlace,
    },
    /// It was there as it stood before more was flown of it: what it came to since has taken that one's place, which
    /// the table `replaced` keeps.
    Updated {
        /// The survey's id.
        id: String,
        /// Which survey of its log it is.
        place: SurveyPlace,
    },
}

/// A survey as it stands in the books.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredSurvey {
    /// Its id.
    pub id: String,
    /// Its hall.
    pub hall: String,
    /// The hall's id.
    pub hall_id: String,
    /// SHA-256 of its log, as it was when it was read.
    pub log_sha256: String,
    /// Sums of the log when less was flown of the survey, in the order in which it was added.
    pub replaced_sha256: Vec<String>,
    /// Which survey of the log it is, from 1; not known of some that an earlier program added.
    pub number: Option<usize>,
    /// Errors that it does not share with earlier surveys although the configurations are equal.
    pub independent: Vec<Origin>,
    /// What a person had decided of it when its log was last added: `accepted by Kim, 2026-…: remark`.
    pub decision: Option<String>,
    /// When it began, RFC 3339 in UTC, if that was noted.
    pub started_utc: Option<String>,
    /// Build that flew.
    pub build: String,
    /// Its volumes, and what to compare them by.
    pub survey: Survey,
}

impl Inventory {
    /// Opens the books, or begins new ones.
    ///
    /// # Errors
    /// A file that is no database, or is of a newer program.
    pub fn open(path: &Path) -> Result<Self, InventoryError> {
        let mut database = Connection::open(path)?;
        database.busy_timeout(PATIENCE)?;
        // A commit is on the disk when it is told.
        database.pragma_update(None, "synchronous", "FULL")?;
        tables::bring_up(&mut database)?;
        Ok(Self { database })
    }

    /// Adds a survey of a log to a hall. One that is there already is left as it is, or brought up to what the log
    /// says of it by now, whichever hall it stands under.
    ///
    /// # Errors
    /// A log without a result after a landing, a survey that a person has rejected, books that cannot be
    /// written, or books of an earlier program that leave open whether they hold it.
    pub fn add(
        &mut self,
        hall: &str,
        log: &Path,
        options: &AddOptions,
    ) -> Result<Added, InventoryError> {
        let sum = sha256_of_file(log)
            .map_err(|source| InventoryError::File { path: log.to_owned(), source })?;
        let read = read_accounts_of(log, options.number)?;
        if !read.is_final || read.accounts.is_empty() {
            return Err(InventoryError::NotFinal { path: log.to_owned() });
        }
        let decision = read_decision(log, &read.place)?;
        let is_rejected = decision.as_ref().is_some_and(Decision::is_rejection);
        let decision = decision.map(|decision| decision.said());
        if let Some(said) = decision.clone().filter(|_| is_rejected && !options.although_rejected) {
            return Err(InventoryError::Rejected { path: log.to_owned(), said });
        }
        let change = self.database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let (read, independent) = (&read, options.independent.as_slice());
        let new = NewSurvey { log, sha256: &sum, read, independent, decision };
        let added = match known::find(&change, &new)? {
            None => new.insert(&change, hall)?,
            Some(known) => known.bring_up(&change, &new)?,
        };
        change.commit()?;
        Ok(added)
    }

    /// All surveys, of one hall if it is named, the earliest first; those without a time come last, in
    /// the order in which they were added.
    ///
    /// # Errors
    /// Books that cannot be read.
    pub fn surveys(&self, hall: Option<&str>) -> Result<Vec<StoredSurvey>, InventoryError> {
        let mut found = Vec::new();
        let mut query = self.database.prepare(
            "SELECT survey.id, hall.name, hall.id, log_sha256, log_path, started_utc, build, config_toml,
                 number, independent, decision
             FROM survey JOIN hall ON hall.id = survey.hall_id
             WHERE ?1 IS NULL OR hall.name = ?1
             ORDER BY hall.name, started_utc IS NULL, started_utc, survey.rowid",
        )?;
        let mut rows = query.query([hall])?;
        while let Some(row) = rows.next()? {
            let path = PathBuf::from(row.get::<_, String>(4)?);
            let id: String = row.get(0)?;
            let toml: String = row.get(7)?;
            let config = Config::from_log(&toml, &path)
                .map_err(|error| InventoryError::Survey(error.into()))?;
            let accounts = accounts(&self.database, &id)?;
            let number = row.get::<_, Option<i64>>(8)?.and_then(|n| usize::try_from(n).ok());
            let place = SurveyPlace { number: number.unwrap_or(0), ..SurveyPlace::default() };
            let replaced_sha256 = self.replaced(&id)?;
            found.push(StoredSurvey {
                survey: Survey { path, config, place, accounts, surface: None, is_final: true },
                id,
                hall: row.get(1)?,
                hall_id: row.get(2)?,
                log_sha256: row.get(3)?,
                started_utc: row.get(5)?,
                build: row.get(6)?,
                number,
                replaced_sha256,
                independent: origins(&row.get::<_, String>(9)?),
                decision: row.get(10)?,
            });
        }
        Ok(found)
    }

    fn replaced(&self, survey_id: &str) -> Result<Vec<String>, InventoryError> {
        let mut query = self
            .database
            .prepare("SELECT log_sha256 FROM replaced WHERE survey_id = ?1 ORDER BY rowid")?;
        let sums = query.query_map([survey_id], |row| row.get(0))?.collect::<Result<_, _>>()?;
        Ok(sums)
    }

    /// What SQLite finds wrong with the file; `ok` if nothing is.
    ///
    /// # Errors
    /// Books that cannot be read.
    pub fn check(&self) -> Result<String, InventoryError> {
        Ok(self.database.query_row("PRAGMA integrity_check", [], |row| row.get(0))?)
    }
}

/// The origins in a list of their names.
fn origins(names: &str) -> Vec<Origin> {
    let is_named = |origin: &Origin| names.split(',').any(|name| name == origin.name());
    Origin::ALL.into_iter().filter(is_named).collect()
}
