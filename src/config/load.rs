//! Reading the file and laying environment and flags over it.

use super::error::ConfigError;
use super::file::{Config, DustZone};
use super::markers::MarkersSection;
use std::path::Path;

/// Prefix of the environment variables that override the file.
const ENVIRONMENT_PREFIX: &str = "STOCKPILOT";

impl Config {
    /// Parses a file's text strictly: unknown keys and wrong types are errors with their place.
    ///
    /// # Errors
    /// [`ConfigError::File`] names `path`, line and column.
    pub fn from_toml(text: &str, path: &Path) -> Result<Self, ConfigError> {
        toml::from_str(text).map_err(|error| ConfigError::File {
            path: path.to_owned(),
            message: error.to_string(),
        })
    }

    /// The configuration that a flight has recorded. What was not asked for a start yet when it flew is taken
    /// for given: it did start.
    ///
    /// # Errors
    /// As [`Self::from_toml`].
    pub fn from_log(text: &str, log: &Path) -> Result<Self, ConfigError> {
        let mut config = Self::from_toml(text, log)?;
        let table: toml::Table = toml::from_str(text).unwrap_or_default();
        let says = |key: &str| table.get("hall").is_some_and(|hall| hall.get(key).is_some());
        if !says("dust_zone") {
            config.hall.dust_zone = DustZone::None;
        }
        Ok(config)
    }
}

/// Reads a file, lays the environment and `section.key=value` overrides over it, and takes in what
/// stands in the files that it names (relative to its own folder).
///
/// # Errors
/// An unreadable file, anything [`Config::from_toml`] refuses, an override of an unknown key, a
/// calibration, marker map or field layout with a fault.
pub fn load(path: &Path, overrides: &[String]) -> Result<Config, ConfigError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| ConfigError::Unreadable { path: path.to_owned(), source })?;
    // The layering below converts silently ("115200" and 1.7 become integers), so the file is
    // judged strictly first.
    Config::from_toml(&text, path)?;
    let mut config = layered(&text, config::Environment::default(), overrides)?;
    let directory = path.parent().unwrap_or(Path::new(""));
    config.read_files(directory)?;
    config.with_files_read(directory)
}

impl Config {
    /// The same configuration with the contents of the calibrations and marker files that it names
    /// in place of their names, so that it stands for itself in the log.
    pub(super) fn with_files_read(mut self, directory: &Path) -> Result<Self, ConfigError> {
        let cameras = self.cameras.into_iter().enumerate();
        let cameras = cameras.map(|(k, camera)| camera.with_file_read(k, directory));
        self.cameras = cameras.collect::<Result<_, _>>()?;
        let (file, layout) =
            (self.markers.read_file(directory)?, self.markers.read_layout(directory)?);
        self.tags.extend(file.tags.into_iter().chain(layout));
        self.points.extend(file.points);
        self.markers = MarkersSection::default();
        Ok(self)
    }
}

fn layered(
    text: &str,
    environment: config::Environment,
    overrides: &[String],
) -> Result<Config, ConfigError> {
    let refuse = |error: config::ConfigError| ConfigError::Override(error.to_string());
    let environment = environment_named(environment);
    let mut builder = config::Config::builder()
        .add_source(config::File::from_str(text, config::FileFormat::Toml))
        .add_source(environment);
    for assignment in overrides {
        let (key, value) = assignment.split_once('=').ok_or_else(|| {
            ConfigError::Override(format!("{assignment:?} is not of the form section.key=value"))
        })?;
        builder = builder.set_override(key.trim(), value.trim()).map_err(refuse)?;
    }
    builder.build().and_then(config::Config::try_deserialize).map_err(refuse)
}

fn environment_named(environment: config::Environment) -> config::Environment {
    environment.prefix(ENVIRONMENT_PREFIX).prefix_separator("__").separator("__").try_parsing(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::PlannerName;
    use std::collections::BTreeMap;

    const EXAMPLE: &str = include_str!("../../deploy/config.example.toml");

    fn with_environment(pairs: &[(&str, &str)], overrides: &[&str]) -> Result<Config, ConfigError> {
        let source: BTreeMap<String, String> =
            pairs.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
        let source = source.into_iter().collect();
        layered(EXAMPLE, config::Environment::default().source(Some(source)), &overrides)
    }

    #[test]
    fn flags_override_the_environment_and_that_the_file() {
        let from_env =
            with_environment(&[("STOCKPILOT__PLANNING__N_STEPS", "40")], &[]).expect("valid");
        assert_eq!(from_env.planning.n_steps, 40);
        let from_flag = with_environment(
            &[("STOCKPILOT__PLANNING__N_STEPS", "40")],
            &["planning.n_steps=30", "planning.planner=square-wave"],
        )
        .expect("valid");
        assert_eq!(from_flag.planning.n_steps, 30);
        assert_eq!(from_flag.planning.planner, Some(PlannerName::SquareWave));
    }

    #[test]
    fn horizon_flies_to_a_target_unless_another_planner_is_named() {
        let chosen = |flags: &[&str]| {
            let config = with_environment(&[], flags).expect("valid");
            config.planning.chosen_planner()
        };
        assert_eq!(chosen(&[]), PlannerName::SquareWave);
        assert_eq!(chosen(&["planning.target_percent=1"]), PlannerName::Horizon);
        let named = &["planning.target_percent=1", "planning.planner=greedy"];
        assert_eq!(chosen(named), PlannerName::Greedy);
    }

    #[test]
    fn unknown_keys_are_refused_in_every_layer() {
        let file = EXAMPLE.replace("[planning]", "[planning]\nspeed = 3.0");
        let error = Config::from_toml(&file, Path::new("hall.toml")).unwrap_err().to_string();
        assert!(error.contains("speed") && error.contains("line"), "{error}");
        let error = with_environment(&[("STOCKPILOT__PLANNING__SPEED", "3")], &[]).unwrap_err();
        assert!(error.to_string().contains("speed"), "{error}");
        let error = with_environment(&[], &["planning.speed=3"]).unwrap_err();
        assert!(error.to_string().contains("speed"), "{error}");
        assert!(with_environment(&[], &["planning.n_steps"]).is_err());
    }

    #[test]
    fn what_was_not_asked_when_a_flight_was_recorded_does_not_forbid_to_fly_it_again() {
        let silent = EXAMPLE.replace("\ndust_zone = \"undeclared\"\n", "\n");
        assert_ne!(EXAMPLE, silent, "the example speaks of it");
        let is_cleared = |config: Result<Config, ConfigError>| {
            config.unwrap().mission_settings().unwrap().is_dust_cleared
        };
        let path = Path::new("log");
        assert!(!is_cleared(Config::from_toml(&silent, path)));
        assert!(is_cleared(Config::from_log(&silent, path)));
        assert!(!is_cleared(Config::from_log(EXAMPLE, path)), "what it says counts");
    }

    #[test]
    fn values_out_of_range_name_key_value_and_range() {
        let config = with_environment(&[], &["surface.cell_m=0.001"]).expect("parses");
        let error = config.pilot_settings().unwrap_err().to_string();
        assert_eq!(error, "surface.cell_m = 0.001 m is outside 0.05 to 5 m");
        let config = with_environment(&[], &["surface.cell_m=nan"]).expect("parses");
        assert!(config.pilot_settings().is_err(), "NaN passes no range");
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = load(Path::new("no/such/hall.toml"), &[]).unwrap_err().to_string();
        assert!(error.contains("no/such/hall.toml"), "{error}");
    }

    #[test]
    fn the_example_is_valid_and_its_printed_form_means_the_same() {
        let example = Config::from_toml(EXAMPLE, Path::new("example")).expect("valid");
        example.pilot_settings().expect("in range");
        example.link_settings().expect("valid");
        example.lidar_settings().expect("valid");
        example.camera_settings().expect("valid");
        let printed = example.to_toml().expect("printable");
        let again = Config::from_toml(&printed, Path::new("printed")).expect("valid");
        assert_eq!(again, example);
    }
}
