//! A survey that the books have already, though its log may have grown since.

use super::new::NewSurvey;
use super::{Added, InventoryError};
use crate::messages::VolumeAccount;
use crate::record::{accounts_from_json, accounts_to_json, read_accounts_of};
use rusqlite::{Connection, OptionalExtension as _, Row, Transaction, params};

/// A survey in the books.
pub(super) struct KnownSurvey {
    id: String,
    hall_id: String,
    log_sha256: String,
    build: String,
    config_toml: String,
    independent: String,
    /// When it last took off or gave a result; earlier programs did not note it.
    newest_at_ns: Option<i64>,
}

const COLUMNS: &str = "id, hall_id, log_sha256, build, config_toml, independent, newest_at_ns";

impl KnownSurvey {
    fn from_row(row: &Row<'_>) -> rusqlite::Result<Self> {
        Ok(Self {
            id: row.get(0)?,
            hall_id: row.get(1)?,
            log_sha256: row.get(2)?,
            build: row.get(3)?,
            config_toml: row.get(4)?,
            independent: row.get(5)?,
            newest_at_ns: row.get(6)?,
        })
    }
}

/// The survey in the books that this one is.
///
/// # Errors
/// An earlier program has added a survey of this log, or of what the log was then, and it cannot be told which.
pub(super) fn find(
    change: &Transaction<'_>,
    new: &NewSurvey<'_>,
) -> Result<Option<KnownSurvey>, InventoryError> {
    let sql = format!("SELECT {COLUMNS} FROM survey WHERE identity = ?1");
    let known = change.query_row(&sql, [&new.read.identity], KnownSurvey::from_row).optional()?;
    if known.is_some() {
        return Ok(known);
    }
    // All of them are compared before any is found unclear: a log that had grown may be there twice.
    let mut unclear = Vec::new();
    for unnamed in unnamed(change, new)? {
        let held = accounts(change, &unnamed.id)?;
        if are_same(&held, &new.read.accounts) {
            return Ok(Some(unnamed));
        }
        unclear.push((unnamed.id, held));
    }
    for (id, held) in unclear {
        if !is_another(&held, new)? {
            return Err(InventoryError::Unclear { path: new.log.to_owned(), id });
        }
    }
    Ok(None)
}

/// Surveys of the same log from programs that did not keep what a survey is known by: those of its sum, and those
/// that began when this one or its log did.
fn unnamed(
    change: &Transaction<'_>,
    new: &NewSurvey<'_>,
) -> Result<Vec<KnownSurvey>, InventoryError> {
    let mut query = change.prepare(&format!(
        "SELECT {COLUMNS} FROM survey
         WHERE identity IS NULL AND (log_sha256 = ?1 OR started_utc IN (?2, ?3))
         ORDER BY number IS NULL, rowid"
    ))?;
    let times = params![new.sha256, new.read.started_utc, new.read.log_started_utc];
    Ok(query.query_map(times, KnownSurvey::from_row)?.collect::<Result<_, _>>()?)
}

/// True if these are the volumes of another survey of the log, to the last bit.
fn is_another(held: &[VolumeAccount], new: &NewSurvey<'_>) -> Result<bool, InventoryError> {
    for number in 1..=new.read.place.n_in_log {
        if are_same(held, &read_accounts_of(new.log, Some(number))?.accounts) {
            return Ok(true);
        }
    }
    Ok(false)
}

impl KnownSurvey {
    /// Leaves it as it is, or lets what the log says by now take its place. An older copy of the log changes nothing.
    pub(super) fn bring_up(
        &self,
        change: &Transaction<'_>,
        new: &NewSurvey<'_>,
    ) -> Result<Added, InventoryError> {
        let (id, place) = (self.id.clone(), new.read.place.clone());
        let held = accounts(change, &id)?;
        let newest_at_ns = new.read.newest_at.nanos();
        // A copy without the file beside it knows of no decision, which takes none back.
        change.execute(
            "UPDATE survey SET decision = COALESCE(?2, decision) WHERE id = ?1",
            params![id, new.decision],
        )?;
        let is_grown = self.newest_at_ns.is_none_or(|known_ns| known_ns < newest_at_ns);
        if is_grown && !are_same(&held, &new.read.accounts) {
            self.replace(change, &held, new)?;
            return Ok(Added::Updated { id, place });
        }
        if is_grown {
            change.execute(
                "UPDATE survey SET identity = ?2, number = ?3, newest_at_ns = ?4, started_utc = ?5 WHERE id = ?1",
                params![id, new.read.identity, new.number(), newest_at_ns, new.read.started_utc],
            )?;
        }
        Ok(Added::Known { id, place })
    }

    fn replace(
        &self,
        change: &Transaction<'_>,
        held: &[VolumeAccount],
        new: &NewSurvey<'_>,
    ) -> Result<(), InventoryError> {
        change.execute(
            "INSERT INTO replaced (survey_id, log_sha256, build, config_toml, accounts_json)
             VALUES (?1, ?2, ?3, ?4, ?5)",
            params![
                self.id,
                self.log_sha256,
                self.build,
                self.config_toml,
                accounts_to_json(held)?
            ],
        )?;
        change.execute("DELETE FROM volume WHERE survey_id = ?1", [&self.id])?;
        // What was said when it was added holds until something else is said.
        let said = new.origins();
        let independent = if said.is_empty() { &self.independent } else { &said };
        change.execute(
            "UPDATE survey SET identity = ?2, log_sha256 = ?3, number = ?4, log_path = ?5, newest_at_ns = ?6,
                 version = ?7, build = ?8, config_toml = ?9, independent = ?10
             WHERE id = ?1",
            params![
                self.id,
                new.read.identity,
                new.sha256,
                new.number(),
                new.log.display().to_string(),
                new.read.newest_at.nanos(),
                new.read.version,
                new.read.build,
                new.read.config_toml,
                independent
            ],
        )?;
        new.insert_volumes(change, (&self.id, &self.hall_id))
    }
}

/// The volumes of a survey in the books.
pub(super) fn accounts(
    database: &Connection,
    survey_id: &str,
) -> Result<Vec<VolumeAccount>, InventoryError> {
    let mut query = database
        .prepare("SELECT account_json FROM volume WHERE survey_id = ?1 ORDER BY position")?;
    let mut accounts = Vec::new();
    let mut rows = query.query([survey_id])?;
    while let Some(row) = rows.next()? {
        accounts.extend(accounts_from_json(&row.get::<_, String>(0)?)?);
    }
    Ok(accounts)
}

/// True if both have the same bays, volumes and standard deviations, to the last bit.
fn are_same(held: &[VolumeAccount], logged: &[VolumeAccount]) -> bool {
    let bits = |account: &VolumeAccount| {
        (account.estimate.volume_m3.to_bits(), account.estimate.sigma_m3.to_bits())
    };
    held.len() == logged.len()
        && std::iter::zip(held, logged).all(|(a, b)| a.name == b.name && bits(a) == bits(b))
}
