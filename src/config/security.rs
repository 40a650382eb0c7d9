//! Who may speak on the link: the file's twin and its check.

use super::convert::{invalid, within};
use super::error::ConfigError;
use super::file::LinkSection;
use crate::link::signing::SigningSettings;
use crate::link::{Network, NetworkError, SecuritySettings};
use mavlink::Message as _;
use mavlink::dialects::ardupilotmega::MavMessage;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Duration;

/// How far ahead a stamp may be at most, s: a year, for a computer without any clock.
const LONGEST_AHEAD_S: f64 = 31_536_000.0;

/// MAVLink 2 signing. The key itself never stands in a configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SigningSection {
    /// The file with the key: 64 hexadecimal digits, readable by its owner only.
    pub key_file: PathBuf,
    /// Where used-up timestamps are remembered; relative to the working directory.
    #[serde(default = "default_stamp_file")]
    pub stamp_file: PathBuf,
    /// Number of this link among those of the same sender.
    #[serde(default)]
    pub link_id: u8,
    /// Frames with a stamp further ahead of this computer's clock are refused, s.
    #[serde(default = "default_max_ahead_s")]
    pub max_ahead_s: f64,
    /// Messages that may come unsigned, by name, until their sender has signed once.
    #[serde(default = "default_accept_unsigned")]
    pub accept_unsigned: Vec<String>,
}

fn default_stamp_file() -> PathBuf {
    PathBuf::from("mavlink-signing.stamp")
}

const fn default_max_ahead_s() -> f64 {
    60.0
}

fn default_accept_unsigned() -> Vec<String> {
    ["HEARTBEAT", "RADIO_STATUS"].map(str::to_owned).to_vec()
}

impl LinkSection {
    /// The guard's settings.
    pub(super) fn security(&self) -> Result<SecuritySettings, ConfigError> {
        let network = |text: &String| {
            text.parse::<Network>()
                .map_err(|error: NetworkError| invalid("link.peers", error.to_string()))
        };
        Ok(SecuritySettings {
            peers: self.peers.iter().map(network).collect::<Result<_, _>>()?,
            signing: self.signing.as_ref().map(SigningSection::settings).transpose()?,
        })
    }
}

impl SigningSection {
    fn settings(&self) -> Result<SigningSettings, ConfigError> {
        if self.key_file == self.stamp_file {
            return Err(invalid("link.signing.stamp_file", "is the key file"));
        }
        let id = |name: &String| {
            MavMessage::message_id_from_name(name).ok_or_else(|| {
                let message = format!("{name:?} is no MAVLink message");
                invalid("link.signing.accept_unsigned", message)
            })
        };
        let max_ahead_s =
            within("link.signing.max_ahead_s", self.max_ahead_s, (1.0, LONGEST_AHEAD_S), "s")?;
        Ok(SigningSettings {
            key_file: self.key_file.clone(),
            stamp_file: self.stamp_file.clone(),
            link_id: self.link_id,
            max_ahead: Duration::from_secs_f64(max_ahead_s),
            accept_unsigned: self.accept_unsigned.iter().map(id).collect::<Result<_, _>>()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(signing: &str) -> Result<SecuritySettings, String> {
        let text = format!("peers = [\"10.1.0.0/16\"]\n[signing]\n{signing}");
        let link: LinkSection = toml::from_str(&text).map_err(|error| error.to_string())?;
        link.security().map_err(|error| error.to_string())
    }

    #[test]
    fn only_the_key_file_must_be_given() {
        let security = section("key_file = \"/etc/key\"").unwrap();
        assert_eq!(security.peers.len(), 1);
        let signing = security.signing.unwrap();
        assert_eq!(signing.max_ahead, Duration::from_secs(60));
        // HEARTBEAT is 0 and RADIO_STATUS 109 in MAVLink's common set.
        assert!(signing.accept_unsigned.into_iter().eq([0, 109]));
    }

    #[test]
    fn what_cannot_be_meant_is_refused() {
        for (signing, word) in [
            ("", "key_file"),
            ("key_file = \"k\"\nkey = \"00\"", "unknown field"),
            ("key_file = \"k\"\naccept_unsigned = [\"HART_BEAT\"]", "HART_BEAT"),
            ("key_file = \"k\"\nmax_ahead_s = 0.0", "max_ahead_s"),
            ("key_file = \"k\"\nlink_id = 256", "link_id"),
            ("key_file = \"k\"\nstamp_file = \"k\"", "stamp_file"),
        ] {
            let error = section(signing).unwrap_err();
            assert!(error.contains(word), "{signing:?}: {error}");
        }
    }
}
