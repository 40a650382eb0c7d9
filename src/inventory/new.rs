//! A survey on its way from its log into the books.

use super::{Added, InventoryError};
use crate::messages::VolumeAccount;
use crate::record::{LoggedAccounts, accounts_to_json};
use crate::survey::{Origin, ids};
use rusqlite::{Transaction, params};
use std::path::Path;

/// What a log says of a survey.
pub(super) struct NewSurvey<'a> {
    pub(super) log: &'a Path,
    /// The log's sum.
    pub(super) sha256: &'a str,
    pub(super) read: &'a LoggedAccounts,
    /// Errors that it does not share with earlier surveys.
    pub(super) independent: &'a [Origin],
    /// What a person has decided of it.
    pub(super) decision: Option<String>,
}

impl NewSurvey<'_> {
    /// Its number in the log.
    pub(super) fn number(&self) -> i64 {
        i64::try_from(self.read.place.number).unwrap_or(i64::MAX)
    }

    /// The names of the independent errors, as the table has them.
    pub(super) fn origins(&self) -> String {
        let names: Vec<&str> = self.independent.iter().map(|origin| origin.name()).collect();
        names.join(",")
    }

    /// Adds it to a hall.
    pub(super) fn insert(
        &self,
        change: &Transaction<'_>,
        hall: &str,
    ) -> Result<Added, InventoryError> {
        let (id, hall_id) = (ids::of_survey(&self.read.identity), ids::of_hall(hall));
        change.execute(
            "INSERT OR IGNORE INTO hall (id, name) VALUES (?1, ?2)",
            params![hall_id, hall],
        )?;
        change.execute(
            "INSERT INTO survey (id, hall_id, identity, log_sha256, number, log_path, started_utc, newest_at_ns,
                 version, build, config_toml, independent, decision)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13)",
            params![
                id,
                hall_id,
                self.read.identity,
                self.sha256,
                self.number(),
                self.log.display().to_string(),
                self.read.started_utc,
                self.read.newest_at.nanos(),
                self.read.version,
                self.read.build,
                self.read.config_toml,
                self.origins(),
                self.decision
            ],
        )?;
        self.insert_volumes(change, (&id, &hall_id))?;
        Ok(Added::New { id, place: self.read.place.clone() })
    }

    /// Adds its volumes, and bays that the hall did not have.
    pub(super) fn insert_volumes(
        &self,
        change: &Transaction<'_>,
        ids: (&str, &str),
    ) -> Result<(), InventoryError> {
        let mut accounts = (0_i64..).zip(&self.read.accounts);
        accounts.try_for_each(|(position, account)| insert_volume(change, ids, position, account))
    }
}

fn insert_volume(
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
