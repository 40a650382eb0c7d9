//! The volumes out of a log, as they were recorded.

use super::reader::{LogItem, LogReader};
use super::replay::ReplayError;
use super::topic::Topic;
use super::twin::AccountsTwin;
use crate::messages::VolumeAccount;
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
    let mut is_final = false;
    for item in reader.by_ref() {
        match item {
            LogItem::Result { topic: Topic::Accounts, json, .. } => {
                newest = Some(json);
                is_final = false;
            }
            LogItem::Result { topic: Topic::Ended, .. } => is_final = newest.is_some(),
            _ => {}
        }
    }
    let accounts = newest.map_or(Ok(Vec::new()), |json| {
        serde_json::from_slice::<AccountsTwin>(&json).map(AccountsTwin::into_accounts)
    })?;
    Ok(LoggedAccounts { config_toml, accounts, is_final, is_complete: reader.is_complete() })
}
