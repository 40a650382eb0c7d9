//! The volumes out of a log, as they were recorded.

use super::reader::{LogItem, LogReader};
use super::replay::ReplayError;
use super::surveys::{SurveyPlace, read_surveys};
use super::twin::{AccountsTwin, SurfaceTwin};
use crate::messages::{HeightMap, VolumeAccount};
use crate::time::{Mono, Stamp};
use serde::Deserialize;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// The newest volumes of a survey.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggedAccounts {
    /// The effective configuration, TOML.
    pub config_toml: String,
    /// Which survey of the log it is.
    pub place: SurveyPlace,
    /// What it is known by, however the log goes on; empty in a log without volumes.
    pub identity: String,
    /// When it last took off or gave a result.
    pub newest_at: Stamp<Mono>,
    /// When it began, RFC 3339 in UTC, if that was noted.
    pub started_utc: Option<String>,
    /// When the log began, likewise.
    pub log_started_utc: Option<String>,
    /// Version of the program that flew.
    pub version: String,
    /// Build of that program.
    pub build: String,
    /// The whole region first, then its bays; empty if nothing was measured.
    pub accounts: Vec<VolumeAccount>,
    /// The newest surface.
    pub surface: Option<HeightMap>,
    /// They are the result after a landing, not of a flight under way, nor of one whose last solve failed.
    pub is_final: bool,
    /// The log has its proper end and no gap.
    pub is_complete: bool,
}

/// Reads the volumes of the last survey of a log that has some.
///
/// # Errors
/// As [`read_accounts_of`].
pub fn read_accounts(log: &Path) -> Result<LoggedAccounts, ReplayError> {
    read_accounts_of(log, None)
}

/// Reads the newest volumes of the survey with this number in the log, or of the last one.
///
/// # Errors
/// The log cannot be opened, holds no configuration, has no survey of this number, or holds volumes that
/// this build cannot read.
pub fn read_accounts_of(log: &Path, number: Option<usize>) -> Result<LoggedAccounts, ReplayError> {
    let contents = read_surveys(log)?;
    let survey = contents.survey(number)?.cloned().unwrap_or_default();
    let accounts = survey.accounts.as_deref().map_or(Ok(Vec::new()), |json| {
        serde_json::from_slice::<AccountsTwin>(json).map(AccountsTwin::into_accounts)
    })?;
    let surface = survey.surface.as_deref().map(read_surface).transpose()?;
    Ok(LoggedAccounts {
        started_utc: contents.started_utc(&survey.place),
        log_started_utc: contents.notes.get("started_utc").cloned(),
        identity: survey.identity,
        newest_at: survey.newest_at,
        place: survey.place,
        version: contents.version,
        build: contents.build,
        config_toml: contents.config_toml,
        accounts,
        surface,
        is_final: survey.is_final,
        is_complete: contents.is_complete,
    })
}

#[derive(Deserialize)]
struct SurfaceItem(#[serde(with = "SurfaceTwin")] HeightMap);

/// A surface as the log holds it.
pub(super) fn read_surface(json: &[u8]) -> serde_json::Result<HeightMap> {
    serde_json::from_slice::<SurfaceItem>(json).map(|item| item.0)
}

/// What the head of a log says of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogTimes {
    /// When it began, RFC 3339 in UTC, if that was noted.
    pub started_utc: Option<String>,
    /// Version of the program that wrote it.
    pub version: String,
    /// Build of that program.
    pub build: String,
}

/// Reads the head of a log.
///
/// # Errors
/// The log cannot be opened or holds no configuration.
pub fn read_times(log: &Path) -> Result<LogTimes, ReplayError> {
    let mut reader = LogReader::<BufReader<File>>::open(log)?;
    let Some(LogItem::Config { version, build, .. }) = reader.next() else {
        return Err(ReplayError::NoConfig { damage: reader.damage().map(str::to_owned) });
    };
    Ok(LogTimes { started_utc: reader.notes().get("started_utc").cloned(), version, build })
}

/// Accounts in the form of the log's channel `/result/accounts`; numbers come back to the last bit.
///
/// # Errors
/// None but by a defect.
pub fn accounts_to_json(accounts: &[VolumeAccount]) -> serde_json::Result<String> {
    serde_json::to_string(&AccountsTwin::from(accounts))
}

/// Reads what [`accounts_to_json`] has written.
///
/// # Errors
/// A text that is no such accounts.
pub fn accounts_from_json(json: &str) -> serde_json::Result<Vec<VolumeAccount>> {
    serde_json::from_str::<AccountsTwin>(json).map(AccountsTwin::into_accounts)
}
