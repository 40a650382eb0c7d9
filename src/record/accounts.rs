//! The volumes out of a log, as they were recorded.

use super::reader::{LogItem, LogReader};
use super::replay::ReplayError;
use super::topic::Topic;
use super::twin::{AccountsTwin, SurfaceTwin};
use crate::messages::{HeightMap, VolumeAccount};
use serde::Deserialize;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// The newest volumes of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggedAccounts {
    /// The effective configuration, TOML.
    pub config_toml: String,
    /// The whole region first, then its bays; empty if nothing was measured.
    pub accounts: Vec<VolumeAccount>,
    /// The newest surface.
    pub surface: Option<HeightMap>,
    /// They are the result after a landing, not of a flight under way, nor of one whose last solve failed.
    pub is_final: bool,
    /// The log has its proper end and no gap.
    pub is_complete: bool,
}

/// Reads the newest volumes of a log.
///
/// # Errors
/// The log cannot be opened, holds no configuration, or holds volumes that this build cannot read.
pub fn read_accounts(log: &Path) -> Result<LoggedAccounts, ReplayError> {
    let mut reader = LogReader::<BufReader<File>>::open(log)?;
    let Some(LogItem::Config { config_toml, .. }) = reader.next() else {
        return Err(ReplayError::NoConfig { damage: reader.damage().map(str::to_owned) });
    };
    let mut newest = None;
    let mut surface = None;
    let mut is_final = false;
    for item in reader.by_ref() {
        match item {
            LogItem::Result { topic: Topic::Accounts, json, .. } => {
                newest = Some(json);
                is_final = false;
            }
            LogItem::Result { topic: Topic::Surface, json, .. } => surface = Some(json),
            LogItem::Result { topic: Topic::Ended, json, .. } => {
                is_final = newest.is_some() && serde_json::from_slice::<Ended>(&json)?.is_final;
            }
            _ => {}
        }
    }
    let accounts = newest.map_or(Ok(Vec::new()), |json| {
        serde_json::from_slice::<AccountsTwin>(&json).map(AccountsTwin::into_accounts)
    })?;
    let surface = surface.map(|json| read_surface(&json)).transpose()?;
    let is_complete = reader.is_complete();
    Ok(LoggedAccounts { config_toml, accounts, surface, is_final, is_complete })
}

/// Of the end of a flight, whether its last solve has told these volumes; logs from before it was noted say
/// nothing, and count as if it had.
#[derive(Deserialize)]
struct Ended {
    #[serde(default = "yes")]
    is_final: bool,
}

const fn yes() -> bool {
    true
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
