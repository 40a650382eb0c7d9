//! What can be wrong with a configuration.

use crate::localization::marker_map::MarkerMapError;
use std::path::PathBuf;

/// Why a configuration is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read {path}: {source}", path = path.display())]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not TOML, holds an unknown key, or a value of the wrong type.
    #[error("{path}: {message}", path = path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// What, with line and column.
        message: String,
    },
    /// An environment variable or a flag names an unknown key or has the wrong type.
    #[error("environment or flags: {0}")]
    Override(String),
    /// A number outside its range.
    #[error("{key} = {value} {unit} is outside {low} to {high} {unit}")]
    OutOfRange {
        /// The key, with its section.
        key: String,
        /// The refused value.
        value: f64,
        /// Unit of all three numbers.
        unit: &'static str,
        /// Smallest allowed.
        low: f64,
        /// Largest allowed.
        high: f64,
    },
    /// A value that does not fit the others, or that nothing understands.
    #[error("{key}: {message}")]
    Invalid {
        /// The key, with its section.
        key: String,
        /// What is wrong and what would be right.
        message: String,
    },
    /// The marker map is wrong.
    #[error("markers: {0}")]
    Markers(#[from] MarkerMapError),
    /// The effective configuration cannot be written as TOML.
    #[error("cannot print the configuration: {0}")]
    Print(#[from] toml::ser::Error),
}
