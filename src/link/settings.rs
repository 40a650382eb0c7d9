//! How to reach the autopilot.

use super::SecuritySettings;
use super::params::Published;
use std::fmt;
use std::str::FromStr;

/// What the link needs to know.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Where the autopilot is.
    pub address: Address,
    /// Inertial samples asked of the autopilot, Hz. PX4 integrates at 200 Hz.
    pub imu_rate_hz: f64,
    /// Positions asked of the autopilot, Hz.
    pub autopilot_pose_rate_hz: f64,
    /// Who may speak.
    pub security: SecuritySettings,
    /// What ground stations may see of the configuration.
    pub published: Vec<Published>,
}

impl Settings {
    /// 200 Hz inertial samples and 10 Hz positions from the autopilot at `address`.
    #[must_use]
    pub const fn new(address: Address) -> Self {
        let security = SecuritySettings { peers: Vec::new(), signing: None };
        Self {
            address,
            imu_rate_hz: 200.0,
            autopilot_pose_rate_hz: 10.0,
            security,
            published: Vec::new(),
        }
    }
}

/// Where the autopilot is.
///
/// ```
/// use stockpilot::link::Address;
/// let address: Address = "udpin:0.0.0.0:14540".parse()?;
/// assert_eq!(address.to_string(), "udpin:0.0.0.0:14540");
/// assert!("udpin:14540".parse::<Address>().is_err());
/// # Ok::<(), stockpilot::link::AddressError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// Datagrams. With a `peer` the link speaks first (`udpout`), without one it waits to be
    /// spoken to (`udpin`).
    Udp {
        /// Own `HOST:PORT`; port 0 takes a free one.
        bind: String,
        /// The autopilot's `HOST:PORT`, if it has to be spoken to first.
        peer: Option<String>,
    },
    /// A stream to a server at `HOST:PORT`.
    Tcp {
        /// The server's `HOST:PORT`.
        host: String,
    },
    /// A serial port.
    Serial {
        /// Device file, best below `/dev/serial/by-id`.
        path: String,
        /// Symbols per second.
        baud: u32,
    },
}

impl Address {
    /// True if the other side hears of us only by our own messages.
    #[must_use]
    pub const fn speaks_first(&self) -> bool {
        matches!(self, Self::Udp { peer: Some(_), .. })
    }
}

/// Why an address was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// The part before the first colon names no transport.
    #[error("`{0}` begins with none of udpin:, udpout:, tcpout:, serial:")]
    Transport(String),
    /// Host or port is missing or not a number.
    #[error("`{0}` is not HOST:PORT with a port from {1} to 65535")]
    HostPort(String, u16),
    /// Device or speed is missing or not a number.
    #[error("`{0}` is not PATH:BAUD with a baud rate from 1200 to 4000000")]
    PathBaud(String),
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let unknown = || AddressError::Transport(text.to_owned());
        let (transport, rest) = text.split_once(':').ok_or_else(unknown)?;
        match transport {
            "udpin" => Ok(Self::Udp { bind: checked_host_port(rest, 0)?, peer: None }),
            "udpout" => {
                let peer = checked_host_port(rest, 1)?;
                Ok(Self::Udp { bind: "0.0.0.0:0".to_owned(), peer: Some(peer) })
            }
            "tcpout" => Ok(Self::Tcp { host: checked_host_port(rest, 1)? }),
            "serial" => {
                let (path, baud) = path_baud(rest)?;
                Ok(Self::Serial { path, baud })
            }
            _ => Err(unknown()),
        }
    }
}

fn checked_host_port(text: &str, lowest: u16) -> Result<String, AddressError> {
    let wrong = || AddressError::HostPort(text.to_owned(), lowest);
    let (host, port) = text.rsplit_once(':').ok_or_else(wrong)?;
    let port: u16 = port.parse().map_err(|_| wrong())?;
    if host.is_empty() || port < lowest {
        return Err(wrong());
    }
    Ok(text.to_owned())
}

fn path_baud(text: &str) -> Result<(String, u32), AddressError> {
    let wrong = || AddressError::PathBaud(text.to_owned());
    let (path, baud) = text.rsplit_once(':').ok_or_else(wrong)?;
    let baud: u32 = baud.parse().map_err(|_| wrong())?;
    if path.is_empty() || !(1200..=4_000_000).contains(&baud) {
        return Err(wrong());
    }
    Ok((path.to_owned(), baud))
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp { bind, peer: None } => write!(f, "udpin:{bind}"),
            Self::Udp { peer: Some(peer), .. } => write!(f, "udpout:{peer}"),
            Self::Tcp { host } => write!(f, "tcpout:{host}"),
            Self::Serial { path, baud } => write!(f, "serial:{path}:{baud}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_each_transport() {
        let peer = Some("10.0.0.7:14550".to_owned());
        assert_eq!(
            "udpout:10.0.0.7:14550".parse(),
            Ok(Address::Udp { bind: "0.0.0.0:0".to_owned(), peer })
        );
        assert_eq!("tcpout:[::1]:5760".parse(), Ok(Address::Tcp { host: "[::1]:5760".to_owned() }));
        // A by-id path holds colons of its own; only the last one separates the speed.
        assert_eq!(
            "serial:/dev/serial/by-path/usb-0:1:921600".parse(),
            Ok(Address::Serial { path: "/dev/serial/by-path/usb-0:1".to_owned(), baud: 921_600 })
        );
    }

    #[test]
    fn says_what_is_wrong() {
        for text in ["", "udp:1.2.3.4:5", "14540", "udpin:1.2.3.4", "udpin:1.2.3.4:70000"] {
            assert!(text.parse::<Address>().is_err(), "{text}");
        }
        for text in ["udpout:1.2.3.4:0", "udpin::14540", "serial:/dev/ttyS0", "serial:/dev/x:9"] {
            assert!(text.parse::<Address>().is_err(), "{text}");
        }
        let error = "serial:/dev/ttyS0:fast".parse::<Address>().unwrap_err();
        assert!(error.to_string().contains("/dev/ttyS0:fast"), "{error}");
    }
}
