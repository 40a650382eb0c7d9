//! The live log for Foxglove: the file's twin and its check.

use super::convert::invalid;
use super::error::ConfigError;
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;

/// The channels of the log, live, by Foxglove's WebSocket protocol.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FoxgloveSection {
    /// They are served at all.
    pub enabled: bool,
    /// Address and port; port 0 takes a free one.
    pub listen: String,
}

impl Default for FoxgloveSection {
    fn default() -> Self {
        Self { enabled: false, listen: "127.0.0.1:8765".to_owned() }
    }
}

impl FoxgloveSection {
    /// Where they are served; `None` if they are not.
    pub(super) fn address(&self) -> Result<Option<SocketAddr>, ConfigError> {
        let listen: SocketAddr = self.listen.parse().map_err(|_| {
            invalid("foxglove.listen", format!("{:?} is not of the form ADDRESS:PORT", self.listen))
        })?;
        Ok(self.enabled.then_some(listen))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_off_and_for_this_computer_only() {
        let section = FoxgloveSection::default();
        assert_eq!(section.address().unwrap(), None);
        let on = FoxgloveSection { enabled: true, ..section };
        assert!(on.address().unwrap().unwrap().ip().is_loopback());
        let nowhere = FoxgloveSection { listen: "8765".to_owned(), ..on };
        assert!(nowhere.address().unwrap_err().to_string().contains("foxglove.listen"));
    }
}
