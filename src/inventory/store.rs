//! The database.

use super::{InventoryError, tables};
use crate::config::Config;
use crate::export::sha256_of_file;
use crate::messages::VolumeAccount;
use crate::record::{
    Decision, SurveyPlace, accounts_from_json, accounts_to_json, read_accounts_of, read_decision,
};
use crate::survey::{Origin, Survey, ids};
use rusqlite::{Connection, OptionalExtension as _, Transaction, TransactionBehavior, params};
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
    /// SHA-256 of its log.
    pub log_sha256: String,
    /// Which survey of the log it is, from 1.
    pub number: usize,
    /// Errors that it does not share with earlier surveys although the configurations are equal.
    pub independent: Vec<Origin>,
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

    /// Adds a survey of a log to a hall, unless it is there already.
    ///
    /// # Errors
    /// A log without a result after a landing, a survey that a person has rejected, or books that cannot be
    /// written.
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
        let decision = read_decision(log, &read.place)?.filter(Decision::is_rejection);
        if let Some(decision) = decision.filter(|_| !options.although_rejected) {
            let (path, said) = (log.to_owned(), decision.said());
            return Err(InventoryError::Rejected { path, said });
        }
        let place = read.place.clone();
        let id = ids::of_survey(&sum, place.number);
        let number = i64::try_from(place.number).unwrap_or(i64::MAX);
        let change = self.database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let known: Option<String> = change
            .query_row(
                "SELECT id FROM survey WHERE log_sha256 = ?1 AND number = ?2",
                params![sum, number],
                |row| row.get(0),
            )
            .optional()?;
        if let Some(id) = known {
            return Ok(Added::Known { id, place });
        }
        let hall_id = ids::of_hall(hall);
        change.execute(
            "INSERT OR IGNORE INTO hall (id, name) VALUES (?1, ?2)",
            params![hall_id, hall],
        )?;
        let independent: Vec<&str> =
            options.independent.iter().map(|origin| origin.name()).collect();
        change.execute(
            "INSERT INTO survey (id, hall_id, log_sha256, number, log_path, started_utc, version, build,
                 config_toml, independent)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)",
            params![
                id,
                hall_id,
                sum,
                number,
                log.display().to_string(),
                read.started_utc,
                read.version,
                read.build,
                read.config_toml,
                independent.join(",")
            ],
        )?;
        for (position, account) in (0_i64..).zip(&read.accounts) {
            add_volume(&change, (&id, &hall_id), position, account)?;
        }
        change.commit()?;
        Ok(Added::New { id, place })
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
                 number, independent
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
            let accounts = self.accounts(&id)?;
            found.push(StoredSurvey {
                survey: Survey { path, config, accounts, surface: None, is_final: true },
                id,
                hall: row.get(1)?,
                hall_id: row.get(2)?,
                log_sha256: row.get(3)?,
                started_utc: row.get(5)?,
                build: row.get(6)?,
                number: usize::try_from(row.get::<_, i64>(8)?).unwrap_or(0),
                independent: origins(&row.get::<_, String>(9)?),
            });
        }
        Ok(found)
    }

    fn accounts(&self, survey_id: &str) -> Result<Vec<VolumeAccount>, InventoryError> {
        let mut query = self
            .database
            .prepare("SELECT account_json FROM volume WHERE survey_id = ?1 ORDER BY position")?;
        let mut accounts = Vec::new();
        let mut rows = query.query([survey_id])?;
        while let Some(row) = rows.next()? {
            accounts.extend(accounts_from_json(&row.get::<_, String>(0)?)?);
        }
        Ok(accounts)
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

fn add_volume(
    change: &Transaction<'_>,
    (survey_id, hall_id): (&str, &str),
    position: i64,
    account: &VolumeAccount,
) -> Result<(), InventoryError> {
    let bay_id = ids::of_bay(hall_id, &account.name);
    change.execute(
        "INSERT OR IGNORE INTO bay (id, hall_id, name) VALUES (?1, ?2, ?3)",
        params![bay_id, hall_id, account.name],
    )?;
    change.execute(
        "INSERT INTO volume (survey_id, bay_id, position, volume_m3, sigma_m3, mass_t, mass_sigma_t, account_json)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
        params![
            survey_id,
            bay_id,
            position,
            account.estimate.volume_m3,
            account.estimate.sigma_m3,
            account.mass.map(|mass| mass.mass_t),
            account.mass.map(|mass| mass.sigma_t),
            accounts_to_json(std::slice::from_ref(account))?
        ],
    )?;
    Ok(())
}
