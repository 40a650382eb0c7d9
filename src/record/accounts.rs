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
    /// They are the result after a landing, not of a flight under way.
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
            LogItem::Result { topic: Topic::Ended, .. } => is_final = newest.is_some(),
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

#[derive(Deserialize)]
struct SurfaceItem(#[serde(with = "SurfaceTwin")] HeightMap);

/// A surface as the log holds it.
pub(super) fn read_surface(json: &[u8]) -> serde_json::Result<HeightMap> {
    serde_json::from_slice::<SurfaceItem>(json).map(|item| item.0)
}
