//! Where the sensor is and what it is.

use super::Model;
use std::ops::RangeInclusive;

/// Which sensor hangs on which port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Path of the serial device, such as `/dev/ttyUSB0` or a `/dev/serial/by-path/…` link.
    pub port: String,
    /// The sensor; `None` to find out.
    pub model: Option<Model>,
    /// Line speed, bit/s; `None` for the model's own, or to find out.
    pub baud: Option<u32>,
}

/// A setting that cannot work.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SettingsError {
    /// No device is named.
    #[error("lidar port is empty, name a serial device such as /dev/ttyUSB0")]
    NoPort,
    /// The line speed is outside what serial bridges do.
    #[error("lidar baud is {got}, allowed are {lo} to {hi} bit/s")]
    Baud {
        /// The refused value.
        got: u32,
        /// Smallest allowed.
        lo: u32,
        /// Largest allowed.
        hi: u32,
    },
}

impl Settings {
    /// Line speeds that are accepted, bit/s.
    pub const BAUD_RANGE: RangeInclusive<u32> = 9_600..=1_000_000;

    /// The line speed that is known before the sensor is asked, bit/s.
    #[must_use]
    pub fn known_baud(&self) -> Option<u32> {
        self.baud.or_else(|| self.model.map(Model::default_baud))
    }

    /// Checks every field.
    ///
    /// # Errors
    /// The first field that cannot work.
    pub fn validated(self) -> Result<Self, SettingsError> {
        if self.port.trim().is_empty() {
            return Err(SettingsError::NoPort);
        }
        if let Some(got) = self.baud.filter(|baud| !Self::BAUD_RANGE.contains(baud)) {
            let (lo, hi) = (*Self::BAUD_RANGE.start(), *Self::BAUD_RANGE.end());
            return Err(SettingsError::Baud { got, lo, hi });
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_knows_its_baud_and_nonsense_is_refused() {
        let good = Settings { port: "/dev/ttyUSB0".into(), model: Some(Model::Stl27l), baud: None };
        assert_eq!(good.known_baud(), Some(921_600));
        assert!(good.clone().validated().is_ok());
        let fast = Settings { baud: Some(2_000_000), ..good.clone() };
        assert!(matches!(fast.validated(), Err(SettingsError::Baud { got: 2_000_000, .. })));
        let nowhere = Settings { port: "  ".into(), ..good };
        assert_eq!(nowhere.validated(), Err(SettingsError::NoPort));
    }
}
