//! The database.

use super::{InventoryError, ids};
use crate::config::Config;
use crate::export::sha256_of_file;
use crate::messages::VolumeAccount;
use crate::record::{accounts_from_json, accounts_to_json, read_accounts, read_times};
use crate::survey::Survey;
use rusqlite::{Connection, OptionalExtension as _, Transaction, TransactionBehavior, params};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The form of the tables, kept in the file's `user_version`.
const VERSION: i64 = 1;
/// Another program that writes is waited for so long.
const PATIENCE: Duration = Duration::from_secs(10);

const TABLES: &str = "
    CREATE TABLE hall (
        id TEXT PRIMARY KEY,
        name TEXT NOT NULL UNIQUE
    ) STRICT;
    CREATE TABLE bay (
        id TEXT PRIMARY KEY,
        hall_id TEXT NOT NULL REFERENCES hall(id),
        name TEXT NOT NULL,
        UNIQUE (hall_id, name)
    ) STRICT;
    CREATE TABLE survey (
        id TEXT PRIMARY KEY,
        hall_id TEXT NOT NULL REFERENCES hall(id),
        log_sha256 TEXT NOT NULL UNIQUE,
        log_path TEXT NOT NULL,
        started_utc TEXT,
        version TEXT NOT NULL,
        build TEXT NOT NULL,
        config_toml TEXT NOT NULL
    ) STRICT;
    CREATE TABLE volume (
        survey_id TEXT NOT NULL REFERENCES survey(id),
        bay_id TEXT NOT NULL REFERENCES bay(id),
        position INTEGER NOT NULL,
        volume_m3 REAL NOT NULL,
        sigma_m3 REAL NOT NULL,
        mass_t REAL,
        mass_sigma_t REAL,
        account_json TEXT NOT NULL,
        PRIMARY KEY (survey_id, bay_id)
    ) STRICT;
";

/// The open books.
#[derive(Debug)]
pub struct Inventory {
    database: Connection,
}

/// What became of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Added {
    /// It was added.
    New {
        /// The survey's id.
        id: String,
    },
    /// It was there already; nothing was changed.
    Known {
        /// The survey's id.
        id: String,
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
    /// When its log began, RFC 3339 in UTC, if that was noted.
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
        database.pragma_update(None, "foreign_keys", true)?;
        let begun = database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let found: i64 = begun.pragma_query_value(None, "user_version", |row| row.get(0))?;
        match found {
            0 => {
                begun.execute_batch(TABLES)?;
                begun.pragma_update(None, "user_version", VERSION)?;
                begun.commit()?;
            }
            VERSION => drop(begun),
            _ => return Err(InventoryError::Version { found, known: VERSION }),
        }
        Ok(Self { database })
    }

    /// Adds a log's survey to a hall, unless it is there already.
    ///
    /// # Errors
    /// A log without a result after a landing, or books that cannot be written.
    pub fn add(&mut self, hall: &str, log: &Path) -> Result<Added, InventoryError> {
        let sum = sha256_of_file(log)
            .map_err(|source| InventoryError::File { path: log.to_owned(), source })?;
        let id = ids::of_survey(&sum);
        let read = read_accounts(log)?;
        if !read.is_final || read.accounts.is_empty() {
            return Err(InventoryError::NotFinal { path: log.to_owned() });
        }
        let times = read_times(log)?;
        let change = self.database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let known: Option<String> = change
            .query_row("SELECT id FROM survey WHERE log_sha256 = ?1", [&sum], |row| row.get(0))
            .optional()?;
        if let Some(id) = known {
            return Ok(Added::Known { id });
        }
        let hall_id = ids::of_hall(hall);
        change.execute(
            "INSERT OR IGNORE INTO hall (id, name) VALUES (?1, ?2)",
            params![hall_id, hall],
        )?;
        change.execute(
            "INSERT INTO survey (id, hall_id, log_sha256, log_path, started_utc, version, build, config_toml)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
            params![
                id,
                hall_id,
                sum,
                log.display().to_string(),
                times.started_utc,
                times.version,
                times.build,
                read.config_toml
            ],
        )?;
        for (position, account) in (0_i64..).zip(&read.accounts) {
            add_volume(&change, (&id, &hall_id), position, account)?;
        }
        change.commit()?;
        Ok(Added::New { id })
    }

    /// All surveys, of one hall if it is named, the earliest first; those without a time come last, in
    /// the order in which they were added.
    ///
    /// # Errors
    /// Books that cannot be read.
    pub fn surveys(&self, hall: Option<&str>) -> Result<Vec<StoredSurvey>, InventoryError> {
        let mut found = Vec::new();
        let mut query = self.database.prepare(
            "SELECT survey.id, hall.name, hall.id, log_sha256, log_path, started_utc, build, config_toml
             FROM survey JOIN hall ON hall.id = survey.hall_id
             WHERE ?1 IS NULL OR hall.name = ?1
             ORDER BY hall.name, started_utc IS NULL, started_utc, survey.rowid",
        )?;
        let mut rows = query.query([hall])?;
        while let Some(row) = rows.next()? {
            let path = PathBuf::from(row.get::<_, String>(4)?);
            let id: String = row.get(0)?;
            let toml: String = row.get(7)?;
            let config = Config::from_toml(&toml, &path)
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
