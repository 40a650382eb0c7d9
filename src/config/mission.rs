//! Times and levels of the mission in the file.

use super::convert::{seconds, within};
use super::error::ConfigError;
use super::file::{Config, DustZone};
use crate::mission;
use serde::{Deserialize, Serialize};

/// Times and levels of the mission.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MissionSection {
    /// No take-off below this state of charge, %.
    pub min_take_off_battery_percent: f64,
    /// Below this the survey ends and the vehicle returns, %.
    pub return_battery_percent: f64,
    /// Below this it lands where it is, %.
    pub land_battery_percent: f64,
    /// Preflight gives up after this long, s.
    pub preflight_timeout_s: f64,
    /// Without a position for this long in a hold it lands, s.
    pub land_after_fix_lost_s: f64,
    /// Without LiDAR for this long in a hold it returns, s.
    pub return_after_lidar_lost_s: f64,
}

impl Default for MissionSection {
    fn default() -> Self {
        Self {
            min_take_off_battery_percent: 40.0,
            return_battery_percent: 25.0,
            land_battery_percent: 12.0,
            preflight_timeout_s: 60.0,
            land_after_fix_lost_s: 3.0,
            return_after_lidar_lost_s: 10.0,
        }
    }
}

impl Config {
    pub(super) fn mission_settings(&self) -> Result<mission::Settings, ConfigError> {
        let m = &self.mission;
        let ratio = |key, percent, high| {
            within(key, percent, (0.0, high), "%").map(|percent: f64| percent / 100.0)
        };
        let land = m.land_battery_percent;
        let back = m.return_battery_percent;
        Ok(mission::Settings {
            min_take_off_battery_ratio: ratio(
                "mission.min_take_off_battery_percent",
                m.min_take_off_battery_percent,
                100.0,
            )
            .and_then(|take_off| {
                let least = back / 100.0;
                within("mission.min_take_off_battery_percent", take_off, (least, 1.0), "")
            })?,
            return_battery_ratio: ratio("mission.return_battery_percent", back, 100.0)?,
            land_battery_ratio: ratio("mission.land_battery_percent", land, back)?,
            preflight_timeout: seconds(
                "mission.preflight_timeout_s",
                m.preflight_timeout_s,
                (5.0, 600.0),
            )?,
            land_after_fix_lost: seconds(
                "mission.land_after_fix_lost_s",
                m.land_after_fix_lost_s,
                (0.5, 60.0),
            )?,
            return_after_lidar_lost: seconds(
                "mission.return_after_lidar_lost_s",
                m.return_after_lidar_lost_s,
                (0.5, 600.0),
            )?,
            is_dust_cleared: self.is_dust_cleared()?,
            ..mission::Settings::default()
        })
    }

    /// A release names who gave it, and nothing else does.
    fn is_dust_cleared(&self) -> Result<bool, ConfigError> {
        let refuse = |message: &str| {
            let key = "hall.dust_released_by".to_owned();
            Err(ConfigError::Invalid { key, message: message.to_owned() })
        };
        let by = self.hall.dust_released_by.as_deref().map(str::trim);
        match (self.hall.dust_zone, by) {
            (DustZone::Released, None | Some("")) => refuse("name who has released the hall"),
            (DustZone::Undeclared | DustZone::None, Some(_)) => {
                refuse("goes with dust_zone = \"released\" only")
            }
            (zone, _) => Ok(zone != DustZone::Undeclared),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn is_cleared(hall: &str) -> Result<bool, ConfigError> {
        let example = include_str!("../../deploy/config.example.toml");
        let text = example.replace("dust_zone = \"undeclared\"\n", hall);
        Config::from_toml(&text, Path::new("dust"))?.mission_settings().map(|m| m.is_dust_cleared)
    }

    #[test]
    fn dust_is_cleared_by_a_word_or_by_somebody_with_a_name() {
        for hall in ["", "dust_zone = \"undeclared\"\n"] {
            assert!(!is_cleared(hall).unwrap());
        }
        assert!(is_cleared("dust_zone = \"none\"\n").unwrap());
        let by = "dust_released_by = \"A. Person, 2026-03-04\"\n";
        assert!(is_cleared(&format!("dust_zone = \"released\"\n{by}")).unwrap());
        // A release without a name is none, and a name without a release says nothing.
        let nobody = "dust_zone = \"released\"\ndust_released_by = \" \"\n";
        let doubtful = [
            "dust_zone = \"released\"\n".to_owned(),
            nobody.to_owned(),
            by.to_owned(),
            format!("dust_zone = \"none\"\n{by}"),
            "dust_zone = \"perhaps\"\n".to_owned(),
        ];
        for hall in doubtful {
            assert!(is_cleared(&hall).is_err(), "{hall}");
        }
    }
}
