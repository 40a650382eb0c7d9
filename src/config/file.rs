//! The twin of the configuration file.

use super::bays::{BaseSection, BaySection, ExclusionSection, default_base_sigma_m};
use super::cameras::CameraSection;
use super::filter::FilterSection;
use super::foxglove::FoxgloveSection;
use super::images::DetectorSection;
use super::markers::{MarkersSection, PointSection, TagSection};
use super::mission::MissionSection;
use super::obstacles::{FenceSection, ObstacleSection};
use super::page::PageSection;
use super::planning::PlanningSection;
use super::security::SigningSection;
use super::surface::SurfaceSection;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// What is measured.
    pub hall: HallSection,
    /// The way to the autopilot.
    #[serde(default)]
    pub link: LinkSection,
    /// The 2D LiDAR.
    pub lidar: LidarSection,
    /// The filter.
    #[serde(default)]
    pub filter: FilterSection,
    /// The surface.
    #[serde(default)]
    pub surface: SurfaceSection,
    /// Waypoints and trajectory.
    #[serde(default)]
    pub planning: PlanningSection,
    /// Times and levels of the mission.
    #[serde(default)]
    pub mission: MissionSection,
    /// The flight log.
    #[serde(default)]
    pub log: LogSection,
    /// The live log for Foxglove.
    #[serde(default)]
    pub foxglove: FoxgloveSection,
    /// The live page.
    #[serde(default)]
    pub page: PageSection,
    /// Address where marker detections come in: `udp:HOST:PORT`, `unix:PATH` or
    /// `unix-stream:PATH`.
    #[serde(default = "default_detections")]
    pub detections: String,
    /// The own tag detector, for cameras that name the source of their pictures.
    #[serde(default)]
    pub detector: DetectorSection,
    /// The cameras, numbered from 0.
    pub cameras: Vec<CameraSection>,
    /// Files with tags and points; empty in the effective configuration.
    #[serde(default)]
    pub markers: MarkersSection,
    /// Where the tags hang.
    #[serde(default)]
    pub tags: Vec<TagSection>,
    /// Where other points lie that the detector knows.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<PointSection>,
    /// What is measured for itself; if empty, the whole region is one bay.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bays: Vec<BaySection>,
    /// What stands in the region, beside the rectangles of the hall.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exclusions: Vec<ExclusionSection>,
    /// What the vehicle must not touch.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<ObstacleSection>,
    /// Where the vehicle may be at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fence: Option<FenceSection>,
}

fn default_detections() -> String {
    "udp:127.0.0.1:5600".to_owned()
}

/// A rectangle along the hall's axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RectSection {
    /// Smallest x, m.
    pub x_min_m: f64,
    /// Smallest y, m.
    pub y_min_m: f64,
    /// Largest x, m.
    pub x_max_m: f64,
    /// Largest y, m.
    pub y_max_m: f64,
}

/// What is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HallSection {
    /// The region of interest.
    pub region: RectSection,
    /// Height of the floor under the material, m.
    #[serde(default)]
    pub base_height_m: f64,
    /// Its standard deviation, m.
    #[serde(default = "default_base_sigma_m")]
    pub base_sigma_m: f64,
    /// Another kind of base than a level, for all bays that have none of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<BaseSection>,
    /// Bulk density of all material, t/m³, for a hall without bays; without it there are no tonnes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_t_per_m3: Option<f64>,
    /// Its standard deviation, t/m³; exact if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_sigma_t_per_m3: Option<f64>,
    /// No pile is higher than this, m.
    pub max_pile_height_m: f64,
    /// Inner faces of the walls as corners x and y, in either direction, m; the vehicle keeps away
    /// from them and sees no tag through them. Without them only the waypoints' bounds hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walls_m: Option<Vec<[f64; 2]>>,
    /// Lower face of the ceiling over the hall's zero, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ceiling_m: Option<f64>,
    /// Footprints of walls and machines, not measured.
    #[serde(default)]
    pub exclusions: Vec<RectSection>,
    /// Hits this close to an exclusion are left out, m.
    #[serde(default = "default_exclusion_margin_m")]
    pub exclusion_margin_m: f64,
    /// Whether dust in this hall may explode.
    #[serde(default)]
    pub dust_zone: DustZone,
    /// Who has released a dust zone for flying.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dust_released_by: Option<String>,
}

/// What is said of explosive dust.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DustZone {
    /// Nobody has said anything: no take-off.
    #[default]
    Undeclared,
    /// The hall is no zone 20, 21 or 22.
    None,
    /// It is one, and a named person has released it for this vehicle.
    Released,
}

const fn default_exclusion_margin_m() -> f64 {
    0.12
}

/// The way to the autopilot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LinkSection {
    /// `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcpout:HOST:PORT` or `serial:PATH:BAUD`.
    pub address: String,
    /// Inertial samples asked of the autopilot, Hz.
    pub imu_rate_hz: f64,
    /// Positions asked of the autopilot, Hz.
    pub autopilot_pose_rate_hz: f64,
    /// Addresses and networks whose datagrams are taken; all of them if empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub peers: Vec<String>,
    /// Signing; without it frames are unsigned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub signing: Option<SigningSection>,
}

impl Default for LinkSection {
    fn default() -> Self {
        Self {
            address: "udpin:0.0.0.0:14540".to_owned(),
            imu_rate_hz: 200.0,
            autopilot_pose_rate_hz: 10.0,
            peers: Vec::new(),
            signing: None,
        }
    }
}

/// Where a sensor is bolted to the body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountSection {
    /// Its origin, forward, left, up of the IMU, m.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw, applied as yaw, then pitch, then roll, deg.
    pub rotation_deg: [f64; 3],
}

/// The 2D LiDAR.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LidarSection {
    /// `ld19` or `stl27l`.
    pub model: String,
    /// The serial port; a link under `/dev/serial/by-id` survives unplugging.
    pub port: String,
    /// Line speed, baud; the model's own if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Where it is bolted; at 0, 90, 0 degrees its zero beam looks straight down.
    pub mount: MountSection,
    /// Standard deviation of a range, m.
    #[serde(default = "default_range_sigma_m")]
    pub range_sigma_m: f64,
    /// Standard deviation of a beam's direction, deg.
    #[serde(default = "default_angle_sigma_deg")]
    pub angle_sigma_deg: f64,
    /// Shorter returns are not trusted, m.
    #[serde(default = "default_min_range_m")]
    pub min_range_m: f64,
    /// Longer returns are not trusted, m.
    pub max_range_m: f64,
    /// Ranges come out longer by this, m: what a calibration has found.
    #[serde(default)]
    pub range_bias_m: f64,
    /// Ranges come out longer by this times the distance.
    #[serde(default)]
    pub range_scale: f64,
    /// Stamps come out later by this, ms.
    #[serde(default)]
    pub clock_offset_ms: f64,
    /// Sectors [from, to] of the beam angle that the own body hides, deg, −180 to 180.
    #[serde(default)]
    pub blind_sectors_deg: Vec<[f64; 2]>,
}

const fn default_range_sigma_m() -> f64 {
    0.012
}

const fn default_angle_sigma_deg() -> f64 {
    0.1
}

const fn default_min_range_m() -> f64 {
    0.15
}

/// The flight log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LogSection {
    /// Where logs are written.
    pub directory: PathBuf,
    /// What one survey may need, MB; with less free none is begun.
    pub survey_mb: u64,
    /// With less free the people are told, and logs that may go are deleted, MB.
    pub low_mb: u64,
}

impl Default for LogSection {
    fn default() -> Self {
        Self { directory: PathBuf::from("logs"), survey_mb: 200, low_mb: 2_000 }
    }
}
