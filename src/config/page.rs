//! The live page: the file's twin and its check.

use super::convert::{invalid, within};
use super::error::ConfigError;
use crate::web;
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::path::PathBuf;

/// The live page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PageSection {
    /// It is served at all.
    pub enabled: bool,
    /// Address and port; port 0 takes a free one.
    pub listen: String,
    /// The file with the token, readable by its owner only; without it the page can be looked at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub token_file: Option<PathBuf>,
    /// Names by which browsers may call it, beside numeric addresses and `localhost`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub host_names: Vec<String>,
    /// The log of the last survey: the page shows what has changed since.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub last_survey: Option<PathBuf>,
    /// Wished-for U (k = 2) of each volume, % of it; where the survey has a target, that counts.
    pub target_u_percent: f64,
}

impl Default for PageSection {
    fn default() -> Self {
        Self {
            enabled: true,
            listen: "127.0.0.1:8080".to_owned(),
            token_file: None,
            host_names: Vec::new(),
            last_survey: None,
            target_u_percent: 2.0,
        }
    }
}

impl PageSection {
    /// How the page is served; `None` if it is not.
    pub(super) fn settings(&self) -> Result<Option<web::Settings>, ConfigError> {
        let listen: SocketAddr = self.listen.parse().map_err(|_| {
            invalid("page.listen", format!("{:?} is not of the form ADDRESS:PORT", self.listen))
        })?;
        let percent = within("page.target_u_percent", self.target_u_percent, (0.01, 100.0), "%")?;
        let bad_name = self.host_names.iter().find(|name| {
            name.is_empty()
                || !name.bytes().all(|c| c.is_ascii_alphanumeric() || b"-.".contains(&c))
        });
        if let Some(name) = bad_name {
            return Err(invalid("page.host_names", format!("{name:?} is no name of a computer")));
        }
        Ok(self.enabled.then(|| web::Settings {
            listen,
            token_file: self.token_file.clone(),
            host_names: self.host_names.clone(),
            last_survey: self.last_survey.clone(),
            target_percent: percent,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(text: &str) -> Result<Option<web::Settings>, String> {
        let section: PageSection = toml::from_str(text).map_err(|error| error.to_string())?;
        section.settings().map_err(|error| error.to_string())
    }

    #[test]
    fn the_page_is_on_for_this_computer_only_and_without_controls() {
        let page = settings("").unwrap().unwrap();
        assert!(page.listen.ip().is_loopback() && page.token_file.is_none());
        assert_eq!(settings("enabled = false").unwrap(), None);
    }

    #[test]
    fn what_cannot_be_meant_is_refused() {
        for (text, word) in [
            ("listen = \"8080\"", "ADDRESS:PORT"),
            ("listen = \"hall.local:80\"", "ADDRESS:PORT"),
            ("host_names = [\"http://hall\"]", "host_names"),
            ("target_u_percent = 0.0", "target_u_percent"),
            ("token = \"0123456789abcdef\"", "unknown field"),
        ] {
            let error = settings(text).unwrap_err();
            assert!(error.contains(word), "{text:?}: {error}");
        }
    }
}
