//! The configuration file: TOML, every key with its unit, unknown keys refused.
//!
//! Layers, the later ones win: built-in defaults, the file, environment variables
//! (`STOCKPILOT__SECTION__KEY`), command-line flags (`--set section.key=value`). The result is
//! checked before anything starts, printed by `--print-config`, and kept in every log, so that a
//! replay finds it.

pub mod ascii_grid;

mod bays;
mod camera_info;
mod cameras;
mod convert;
mod edit;
mod error;
mod field_layout;
mod file;
mod filter;
mod foxglove;
mod images;
mod load;
mod markers;
mod mesh_file;
mod mission;
mod obstacles;
mod page;
mod planning;
mod published;
mod security;
mod storage;
mod surface;

pub use bays::{BaseSection, BaySection, ExclusionSection};
pub use cameras::{CameraSection, LensName};
pub use edit::{FoundMount, FoundRange, write_clock, write_markers, write_mount, write_range};
pub use error::ConfigError;
pub use file::{
    Config, DustZone, HallSection, LidarSection, LinkSection, LogSection, MountSection, RectSection,
};
pub use filter::{FilterSection, PadSection, UpdateName};
pub use foxglove::FoxgloveSection;
pub use images::{DetectorSection, ImagesSection, SourceName};
pub use load::load;
pub use markers::{MarkersSection, PointSection, TagSection};
pub use mesh_file::MeshContent;
pub use mission::MissionSection;
pub use obstacles::{FenceSection, ObstacleSection, SpaceSection};
pub use page::PageSection;
pub use planning::{ExternalSection, PlannerName, PlanningSection};
pub use security::SigningSection;
pub use surface::{
    FieldSection, SurfaceName, SurfaceSection, UncertaintySection, VarianceUpdateName,
    VolumeVarianceName,
};
