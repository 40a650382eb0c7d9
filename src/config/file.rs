//! The twin of the configuration file.

use super::bays::{BaseSection, BaySection, ExclusionSection, default_base_sigma_m};
use super::cameras::CameraSection;
use super::foxglove::FoxgloveSection;
use super::images::DetectorSection;
use super::markers::{MarkersSection, PointSection, TagSection};
use super::obstacles::{FenceSection, ObstacleSection, SpaceSection};
use super::page::PageSection;
use super::security::SigningSection;
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

/// How a frame meets the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpdateName {
    /// As one pose.
    Loose,
    /// Corner by corner.
    Tight,
}

/// Where the vehicle stands before a flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PadSection {
    /// Origin of the body in the hall, m.
    pub position_m: [f64; 3],
    /// Yaw of the body in the hall, degrees.
    pub yaw_deg: f64,
    /// Standard deviation of each coordinate, m.
    pub position_sigma_m: f64,
    /// Standard deviation of the yaw, degrees.
    pub yaw_sigma_deg: f64,
}

/// The filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilterSection {
    /// How a frame meets the filter.
    pub update: UpdateName,
    /// Standard deviation of a detected corner, px.
    pub corner_sigma_px: f64,
    /// Standard deviation of a frame's capture time, s.
    pub capture_sigma_s: f64,
    /// A single fix less certain than this is not observable, m.
    pub max_fix_sigma_m: f64,
    /// Accelerometer noise with vibration, m/s²/√Hz.
    pub accel_density_mps2_rthz: f64,
    /// Gyroscope noise with vibration, rad/s/√Hz.
    pub gyro_density_radps_rthz: f64,
    /// Accelerometer bias walk, m/s²/√s.
    pub accel_walk_mps2_rts: f64,
    /// Gyroscope bias walk, rad/s/√s.
    pub gyro_walk_radps_rts: f64,
    /// Late frames are taken in this far back, s.
    pub ring_span_s: f64,
    /// Without a fix for this long the position counts as lost, s.
    pub lost_after_s: f64,
    /// A position less certain than this counts as lost, m.
    pub lost_sigma_m: f64,
    /// Where the vehicle stands before a flight, if it should know without a tag in view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pad: Option<PadSection>,
}

impl Default for FilterSection {
    fn default() -> Self {
        Self {
            update: UpdateName::Tight,
            corner_sigma_px: 0.4,
            capture_sigma_s: 0.002,
            max_fix_sigma_m: 0.5,
            accel_density_mps2_rthz: 0.01,
            gyro_density_radps_rthz: 5e-4,
            accel_walk_mps2_rts: 5e-4,
            gyro_walk_radps_rts: 2e-5,
            ring_span_s: 1.0,
            lost_after_s: 1.5,
            lost_sigma_m: 0.25,
            pad: None,
        }
    }
}

/// Which surface is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SurfaceName {
    /// The paper's height grid.
    KalmanGrid,
    /// A Gauss–Markov field with the budget of all error sources.
    MaternField,
}

/// Which law shrinks a cell's uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VarianceUpdateName {
    /// σ ← (1 − K) σ.
    Printed,
    /// σ² ← (1 − K) σ².
    Kalman,
}

/// How the cells' variances become the volume's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VolumeVarianceName {
    /// Marginals added.
    Printed,
    /// The variance of the sum.
    Full,
}

/// The surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceSection {
    /// Which surface.
    pub method: SurfaceName,
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Length scale l, m.
    pub length_scale_m: f64,
    /// Reach γ in length scales.
    pub reach: f64,
    /// Standard deviation `σ_t` of the terrain's slope, no unit.
    pub slope_sigma: f64,
    /// Height expected before anything is seen, m; what planners assume.
    pub prior_height_m: f64,
    /// Ground that nothing saw counts as the mean of the measured, instead of `prior_height_m`.
    pub estimates_prior_height: bool,
    /// Standard deviation `σ_f` of that expectation, m.
    pub prior_sigma_m: f64,
    /// Smoothness ν of the field between the cells, no unit.
    pub smoothness_nu: f64,
    /// The kernel is cut at its reach as printed, without the taper that keeps it valid.
    pub has_literal_cut: bool,
    /// Which law shrinks a cell's uncertainty.
    pub variance_update: VarianceUpdateName,
    /// How the cells' variances become the volume's.
    pub volume_variance: VolumeVarianceName,
    /// Beams are not used while the position is less certain than this, m.
    pub max_position_sigma_m: f64,
    /// The surface is solved this often in flight, s.
    pub solve_interval_s: f64,
    /// The volume is reported this often, s.
    pub report_interval_s: f64,
    /// What the field assumes of the material.
    pub field: FieldSection,
    /// Errors that last a whole flight.
    pub uncertainty: UncertaintySection,
}

/// What the field of `matern-field` assumes of the material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FieldSection {
    /// Practical range of the heights: so far apart they are nearly independent, m.
    pub range_m: f64,
    /// Standard deviation of the heights about their mean level, m.
    pub sigma_m: f64,
    /// Roughness below the cell size, m.
    pub nugget_m: f64,
}

impl Default for FieldSection {
    fn default() -> Self {
        Self { range_m: 5.0, sigma_m: 1.0, nugget_m: 0.007 }
    }
}

/// Standard deviations of errors that last a whole flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UncertaintySection {
    /// Every range is off by the same distance, m.
    pub range_bias_sigma_m: f64,
    /// Every range is off by the same share of itself.
    pub range_scale_sigma: f64,
    /// Place of the LiDAR on the body, per axis, m.
    pub mount_position_sigma_m: f64,
    /// Rotation of the LiDAR on the body, per axis, deg.
    pub mount_rotation_sigma_deg: f64,
    /// Clock of the LiDAR against the clock of the pose, ms.
    pub clock_offset_sigma_ms: f64,
    /// Place of each tag in the marker map, per axis, m.
    pub marker_sigma_m: f64,
}

impl Default for UncertaintySection {
    fn default() -> Self {
        Self {
            range_bias_sigma_m: 0.01,
            range_scale_sigma: 0.001,
            mount_position_sigma_m: 0.005,
            mount_rotation_sigma_deg: 0.2,
            clock_offset_sigma_ms: 2.0,
            marker_sigma_m: 0.005,
        }
    }
}

impl Default for SurfaceSection {
    fn default() -> Self {
        Self {
            method: SurfaceName::MaternField,
            cell_m: 0.25,
            length_scale_m: 0.5,
            reach: 1.5,
            slope_sigma: 0.6,
            prior_height_m: 1.5,
            estimates_prior_height: true,
            prior_sigma_m: 1.5,
            smoothness_nu: 1.5,
            has_literal_cut: false,
            variance_update: VarianceUpdateName::Kalman,
            volume_variance: VolumeVarianceName::Full,
            max_position_sigma_m: 0.15,
            solve_interval_s: 5.0,
            report_interval_s: 1.0,
            field: FieldSection::default(),
            uncertainty: UncertaintySection::default(),
        }
    }
}

/// Who chooses the waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlannerName {
    /// Parallel legs at equal distance.
    SquareWave,
    /// The paper's one-step planner.
    Greedy,
    /// Whole paths, scored by the σ^V that they leave.
    Horizon,
    /// The program of `[planning.external]`.
    External,
}

/// A program that plans.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExternalSection {
    /// The program and its arguments; no shell stands between.
    pub command: Vec<String>,
    /// It is ended if it has not answered by then, s.
    pub time_limit_s: f64,
}

impl Default for ExternalSection {
    fn default() -> Self {
        Self { command: Vec::new(), time_limit_s: 5.0 }
    }
}

/// Waypoints and trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanningSection {
    /// Who chooses the waypoints.
    pub planner: PlannerName,
    /// Waypoints of a survey.
    pub n_steps: usize,
    /// Height of the flight over the hall floor, m.
    pub height_m: f64,
    /// Heading during the survey, deg, from x towards y.
    pub yaw_deg: f64,
    /// Waypoints keep this distance inside the region's border, m; negative flies beyond it.
    pub inset_m: f64,
    /// The survey ends once σ^V is this share of V, %; left out, it flies all its waypoints.
    pub target_percent: Option<f64>,
    /// Distance of neighbouring legs of the square wave, m; left out, 5 m, or with a target the best.
    pub leg_spacing_m: Option<f64>,
    /// How far the greedy planner looks, R, m.
    pub step_radius_m: f64,
    /// Distance of neighbouring candidate waypoints, m.
    pub candidate_spacing_m: f64,
    /// Predicted beams reach this far from straight down, deg.
    pub swath_half_angle_deg: f64,
    /// Waypoints need a quality of fix above τ, 1/√(m² + rad²).
    pub min_fix_quality: f64,
    /// Predictions know that high ground hides what is behind it; otherwise they see a flat surface.
    /// Left out, `horizon` does and the others, to the paper's letter, do not.
    pub shadows: Option<bool>,
    /// Seed of the search for paths.
    pub seed: u64,
    /// Largest speed, m/s.
    pub max_speed_mps: f64,
    /// Largest acceleration, m/s².
    pub max_accel_mps2: f64,
    /// Largest jerk, m/s³.
    pub max_jerk_mps3: f64,
    /// Largest snap, m/s⁴.
    pub max_snap_mps4: f64,
    /// Largest rate of the heading, deg/s.
    pub max_yaw_rate_degps: f64,
    /// Largest acceleration of the heading, deg/s².
    pub max_yaw_accel_degps2: f64,
    /// The program that plans with `planner = "external"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub external: Option<ExternalSection>,
    /// The grid of the free space and the room around the vehicle.
    pub space: SpaceSection,
}

impl Default for PlanningSection {
    fn default() -> Self {
        Self {
            planner: PlannerName::SquareWave,
            n_steps: 50,
            height_m: 7.0,
            yaw_deg: 0.0,
            inset_m: 0.0,
            target_percent: None,
            leg_spacing_m: None,
            step_radius_m: 2.0,
            candidate_spacing_m: 1.0,
            swath_half_angle_deg: 50.0,
            min_fix_quality: 8.0,
            shadows: None,
            seed: 0,
            max_speed_mps: 2.0,
            max_accel_mps2: 2.0,
            max_jerk_mps3: 12.0,
            max_snap_mps4: 150.0,
            max_yaw_rate_degps: 45.0,
            max_yaw_accel_degps2: 90.0,
            external: None,
            space: SpaceSection::default(),
        }
    }
}

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
