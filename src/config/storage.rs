//! How much room the log needs: the check of its section.

use super::convert::invalid;
use super::error::ConfigError;
use super::file::{Config, LogSection};
use crate::record::ShelfSettings;

const LARGEST_DISK_MB: u64 = 100_000_000;

impl Config {
    /// How the disk with the log is looked after.
    ///
    /// # Errors
    /// Room for less than one survey that counts as enough, or absurd sizes.
    pub fn storage_settings(&self) -> Result<ShelfSettings, ConfigError> {
        let LogSection { directory, survey_mb, low_mb } = &self.log;
        let bytes = |key: &'static str, megabytes: u64| {
            if (1..=LARGEST_DISK_MB).contains(&megabytes) {
                Ok(megabytes * 1_000_000)
            } else {
                Err(invalid(key, format!("{megabytes} is not 1 to {LARGEST_DISK_MB} MB")))
            }
        };
        let settings = ShelfSettings {
            folder: directory.clone(),
            survey_bytes: bytes("log.survey_mb", *survey_mb)?,
            low_bytes: bytes("log.low_mb", *low_mb)?,
        };
        if settings.low_bytes < settings.survey_bytes {
            return Err(invalid("log.low_mb", "is less than log.survey_mb"));
        }
        Ok(settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const EXAMPLE: &str = include_str!("../../deploy/config.example.toml");

    fn settings(text: &str) -> Result<ShelfSettings, String> {
        let toml = EXAMPLE.replace("survey_mb = 200\nlow_mb = 2000\n", text);
        let config = Config::from_toml(&toml, Path::new("t")).map_err(|error| error.to_string())?;
        config.storage_settings().map_err(|error| error.to_string())
    }

    #[test]
    fn megabytes_become_bytes() {
        let settings = settings("survey_mb = 300\n").unwrap();
        assert_eq!((settings.survey_bytes, settings.low_bytes), (300_000_000, 2_000_000_000));
    }

    #[test]
    fn what_cannot_be_meant_is_refused() {
        for (text, word) in [
            ("survey_mb = 0\n", "log.survey_mb"),
            ("survey_mb = 2001\nlow_mb = 2000\n", "log.low_mb"),
            ("low_mb = 200000000\n", "log.low_mb"),
            ("low_gb = 2\n", "unknown field"),
        ] {
            let error = settings(text).unwrap_err();
            assert!(error.contains(word), "{text:?}: {error}");
        }
    }
}
