//! What ground stations may see of the configuration, as MAVLink parameters.

use super::file::Config;
use crate::link::params::Published;

impl Config {
    /// Fifteen numbers that a person asks for on the field; they only change with a restart.
    pub(super) fn published(&self) -> Vec<Published> {
        let (planning, mission) = (&self.planning, &self.mission);
        let region = &self.hall.region;
        [
            ("SP_BAT_LAND", mission.land_battery_percent),
            ("SP_BAT_RETURN", mission.return_battery_percent),
            ("SP_BAT_START", mission.min_take_off_battery_percent),
            ("SP_CELL_M", self.surface.cell_m),
            ("SP_FIX_LOST_S", mission.land_after_fix_lost_s),
            ("SP_FIX_MIN_Q", planning.min_fix_quality),
            ("SP_HEIGHT_M", planning.height_m),
            ("SP_LIDAR_LOST_S", mission.return_after_lidar_lost_s),
            ("SP_PILE_MAX_M", self.hall.max_pile_height_m),
            ("SP_REGION_X_M", region.x_max_m - region.x_min_m),
            ("SP_REGION_Y_M", region.y_max_m - region.y_min_m),
            ("SP_SPEED_MPS", planning.max_speed_mps),
            ("SP_STEPS", n(planning.n_steps)),
            // 0: the survey has no target.
            ("SP_TARGET_PCT", planning.target_percent.unwrap_or(0.0)),
            ("SP_VERSION", version()),
        ]
        .map(|(name, value)| Published { name, value: single(value) })
        .to_vec()
    }
}

/// 10203 for version 1.2.3.
fn version() -> f64 {
    let part = |text: &str| text.parse().unwrap_or(0.0);
    part(env!("CARGO_PKG_VERSION_MAJOR")) * 1e4
        + part(env!("CARGO_PKG_VERSION_MINOR")) * 1e2
        + part(env!("CARGO_PKG_VERSION_PATCH"))
}

#[expect(clippy::cast_precision_loss, reason = "small numbers")]
const fn n(count: usize) -> f64 {
    count as f64
}

#[expect(clippy::cast_possible_truncation, reason = "the protocol has single precision")]
const fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn names_fit_the_protocol_and_values_are_those_of_the_file() {
        let text = include_str!("../../deploy/config.example.toml");
        let config = Config::from_toml(text, Path::new("example")).expect("valid");
        let published = config.published();
        assert!(published.iter().all(|param| param.name.len() <= 16 && param.value.is_finite()));
        assert!(published.is_sorted_by(|a, b| a.name < b.name), "each name once, in order");
        let value = |name| published.iter().find(|param| param.name == name).expect(name).value;
        assert_eq!((value("SP_HEIGHT_M"), value("SP_STEPS")), (7.0, 50.0));
        assert_eq!((value("SP_BAT_RETURN"), value("SP_TARGET_PCT")), (25.0, 0.0));
    }
}
