//! How the page is served.

use std::net::SocketAddr;
use std::path::PathBuf;

/// How the page is served.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Where it listens; port 0 for a free one.
    pub listen: SocketAddr,
    /// The file with the token; without it nothing can be asked for.
    pub token_file: Option<PathBuf>,
    /// Names, beside numeric addresses and `localhost`, by which browsers may call it.
    pub host_names: Vec<String>,
    /// The log of the last survey, to show what has changed since.
    pub last_survey: Option<PathBuf>,
    /// The wished-for expanded uncertainty (k = 2) of each volume, % of it.
    pub target_percent: f64,
}
