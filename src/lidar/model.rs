//! What the supported sensors are like.

use std::ops::RangeInclusive;
use std::time::Duration;

/// A supported sensor.
///
/// | model | samples/s | baud | trusted range |
/// | --- | --- | --- | --- |
/// | `Ld19` | 4,500 | 230,400 | 0.02–12 m |
/// | `Stl27l` | 21,600 | 921,600 | 0.03–25 m |
///
/// Sources: LDROBOT `ldlidar_stl_sdk` 3.0.3 (`lipkg.cpp`, launch files) for rates and baud; the
/// LD19 data sheet for its range and σ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Model {
    /// LDROBOT LD06 and LD19.
    Ld19,
    /// LDROBOT STL-27L.
    Stl27l,
}

impl Model {
    /// Every supported model.
    pub const ALL: [Self; 2] = [Self::Ld19, Self::Stl27l];

    /// The name in configuration files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ld19 => "ld19",
            Self::Stl27l => "stl27l",
        }
    }

    /// The model with this name, in any case and with or without hyphens; `ld06` is an `ld19`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name.to_ascii_lowercase().replace('-', "").as_str() {
            "ld06" | "ld19" => Some(Self::Ld19),
            "stl27l" => Some(Self::Stl27l),
            _ => None,
        }
    }

    /// Range measurements per second, with or without a return.
    #[must_use]
    pub const fn samples_per_s(self) -> u32 {
        match self {
            Self::Ld19 => 4_500,
            Self::Stl27l => 21_600,
        }
    }

    /// Time between two samples.
    #[must_use]
    pub fn sample_period(self) -> Duration {
        Duration::from_secs(1) / self.samples_per_s()
    }

    /// The line speed that the sensor talks at, bit/s.
    #[must_use]
    pub const fn default_baud(self) -> u32 {
        match self {
            Self::Ld19 => 230_400,
            Self::Stl27l => 921_600,
        }
    }

    /// Distances that the maker vouches for, m.
    #[must_use]
    pub const fn trusted_range_m(self) -> RangeInclusive<f64> {
        match self {
            Self::Ld19 => 0.02..=12.0,
            Self::Stl27l => 0.03..=25.0,
        }
    }

    /// Standard deviation of one distance, m (LD19 data sheet; taken for the STL-27L too).
    #[must_use]
    pub const fn range_sigma_m(self) -> f64 {
        0.010
    }

    /// Step of the transmitted distance, m; its uniform error has σ = step/√12.
    #[must_use]
    pub const fn range_step_m(self) -> f64 {
        0.001
    }

    /// Step of the transmitted angles at both ends of a frame, rad; those between are interpolated.
    #[must_use]
    pub fn angle_step_rad(self) -> f64 {
        0.01_f64.to_radians()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_the_model() {
        for model in Model::ALL {
            assert_eq!(Model::from_name(model.name()), Some(model));
        }
        assert_eq!(Model::from_name("STL-27L"), Some(Model::Stl27l));
        assert_eq!(Model::from_name("LD06"), Some(Model::Ld19));
        assert_eq!(Model::from_name("a1"), None);
    }
}
