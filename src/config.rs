//! The configuration file: TOML, every key with its unit, unknown keys refused.
//!
//! Layers, the later ones win: built-in defaults, the file, environment variables
//! (`STOCKPILOT__SECTION__KEY`), command-line flags (`--set section.key=value`). The result is
//! checked before anything starts, printed by `--print-config`, and kept in every log, so that a
//! replay finds it.

pub mod ascii_grid;

mod bays;
mod convert;
mod error;
mod file;
mod load;

pub use bays::{BaseSection, BaySection, ExclusionSection};
pub use error::ConfigError;
pub use file::{
    CameraSection, Config, FieldSection, FilterSection, HallSection, LidarSection, LinkSection,
    LogSection, MissionSection, MountSection, PlannerName, PlanningSection, RectSection,
    SurfaceName, SurfaceSection, TagSection, UncertaintySection, VarianceUpdateName,
    VolumeVarianceName,
};
pub use load::load;
