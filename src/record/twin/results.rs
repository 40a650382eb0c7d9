//! The recorded form of actions; one way, but for the volumes, which later surveys are compared with.

use super::budget::BudgetTwin;
use super::enums::{
    FixSourceTwin, JobIdTwin, OperatorRequestTwin, OperatorVerbTwin, PhaseNameTwin, SeverityTwin,
    VehicleCommandTwin, VerdictTwin,
};
use super::scalars::{Nanos, PoseTwin, Rows, Xyz};
use crate::geometry::{Body, Direction, Hall, Point, Transform};
use crate::messages::{
    FixOutcome, FixRecord, FixSource, GridGeometry, HeightMap, HitCounts, Mass, NavEstimate,
    OperatorAnswer, OperatorRequest, OperatorVerb, Setpoint, Severity, StatusText, VehicleCommand,
    Verdict, VolumeAccount, VolumeBudget, VolumeEstimate, VolumeShares,
};
use crate::mission::Phase;
use crate::pilot::{FlightSummary, JobId, PhaseChange, VolumeReport};
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, SMatrix, Vector3};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;

#[derive(Serialize, JsonSchema)]
#[serde(remote = "Setpoint")]
pub(in crate::record) struct SetpointTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(rename = "position_m", with = "Xyz")]
    position: Point<Hall>,
    #[serde(with = "Xyz")]
    velocity_mps: Direction<Hall>,
    #[serde(with = "Xyz")]
    accel_mps2: Direction<Hall>,
    yaw_rad: f64,
    yaw_rate_radps: f64,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "NavEstimate")]
pub(in crate::record) struct OdometryTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "PoseTwin")]
    hall_from_body: Transform<Hall, Body>,
    #[serde(with = "Xyz")]
    velocity_mps: Direction<Hall>,
    #[serde(with = "Xyz")]
    gyro_radps: Vector3<f64>,
    #[serde(with = "Xyz")]
    gyro_bias_radps: Vector3<f64>,
    #[serde(with = "Xyz")]
    accel_bias_mps2: Vector3<f64>,
    #[serde(with = "Rows")]
    error_cov: SMatrix<f64, 15, 15>,
    reset_counter: u8,
}

#[derive(Serialize, JsonSchema)]
pub(in crate::record) struct CommandTwin {
    #[serde(with = "VehicleCommandTwin")]
    pub(in crate::record) command: VehicleCommand,
}

/// A job that began: its number only, for a replay starts it again.
#[derive(Serialize, JsonSchema)]
pub(in crate::record) struct StartedTwin {
    #[serde(with = "JobIdTwin")]
    pub(in crate::record) id: JobId,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "VolumeEstimate")]
struct VolumeTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    volume_m3: f64,
    sigma_m3: f64,
    coverage_ratio: f64,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "VolumeShares")]
struct SharesTwin {
    measured_ratio: f64,
    interpolated_ratio: f64,
    unseen_ratio: f64,
    /// Logs of earlier builds do not know it.
    #[serde(default)]
    disturbed_ratio: f64,
}

#[derive(Serialize, Deserialize, JsonSchema)]
struct MassItem {
    mass_t: f64,
    sigma_t: f64,
}

/// A mass, if there is one.
struct OptionalMass;

impl OptionalMass {
    fn serialize<S: Serializer>(mass: &Option<Mass>, to: S) -> Result<S::Ok, S::Error> {
        mass.map(|Mass { mass_t, sigma_t }| MassItem { mass_t, sigma_t }).serialize(to)
    }

    fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Mass>, D::Error> {
        let item = Option::<MassItem>::deserialize(from)?;
        Ok(item.map(|MassItem { mass_t, sigma_t }| Mass { mass_t, sigma_t }))
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "VolumeAccount")]
struct AccountTwin {
    name: String,
    #[serde(with = "VolumeTwin")]
    estimate: VolumeEstimate,
    #[serde(with = "OptionalMass")]
    #[schemars(with = "Option<MassItem>")]
    mass: Option<Mass>,
    #[serde(with = "BudgetTwin")]
    budget: VolumeBudget,
    #[serde(with = "SharesTwin")]
    shares: VolumeShares,
}

#[derive(Serialize, Deserialize, JsonSchema)]
struct AccountItem(#[serde(with = "AccountTwin")] VolumeAccount);

/// The whole region's account first, then those of the bays.
#[derive(Serialize, Deserialize, JsonSchema)]
pub(in crate::record) struct AccountsTwin {
    accounts: Vec<AccountItem>,
}

impl AccountsTwin {
    pub(in crate::record) fn into_accounts(self) -> Vec<VolumeAccount> {
        self.accounts.into_iter().map(|item| item.0).collect()
    }
}

impl From<&[VolumeAccount]> for AccountsTwin {
    fn from(accounts: &[VolumeAccount]) -> Self {
        Self { accounts: accounts.iter().cloned().map(AccountItem).collect() }
    }
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "HitCounts")]
struct HitCountsTwin {
    received: u64,
    used: u64,
    no_return: u64,
    own_body: u64,
    outside: u64,
    no_pose: u64,
    poor_pose: u64,
    on_ground: u64,
    refused: u64,
    forgotten: u64,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "VolumeReport")]
pub(in crate::record) struct VolumeReportTwin {
    #[serde(with = "VolumeTwin")]
    estimate: VolumeEstimate,
    #[serde(with = "HitCountsTwin")]
    hits: HitCounts,
    #[serde(with = "PhaseNameTwin")]
    phase: Phase,
    steps_done: usize,
    battery_ratio: Option<f64>,
    position_sigma_m: Option<f64>,
    is_final: bool,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "StatusText")]
pub(in crate::record) struct TextTwin {
    #[serde(with = "SeverityTwin")]
    severity: Severity,
    text: String,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "OperatorAnswer")]
pub(in crate::record) struct AnswerTwin {
    #[serde(with = "OperatorVerbTwin")]
    verb: OperatorVerb,
    #[serde(with = "OperatorRequestTwin")]
    to: OperatorRequest,
    is_accepted: bool,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "PhaseChange")]
pub(in crate::record) struct PhaseTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "PhaseNameTwin")]
    from: Phase,
    #[serde(with = "PhaseNameTwin")]
    to: Phase,
    reason: String,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "FixOutcome")]
struct FixOutcomeTwin {
    #[serde(with = "PoseTwin")]
    hall_from_body: Transform<Hall, Body>,
    #[serde(with = "Rows")]
    pose_cov: Matrix6<f64>,
    residual_rms_px: f64,
    n_points: usize,
    q_pos: f64,
    q_position: f64,
}

#[derive(Serialize, JsonSchema)]
struct FixItem(#[serde(with = "FixOutcomeTwin")] FixOutcome);

/// A fix, if there is one.
struct OptionalFix;

impl OptionalFix {
    fn serialize<S: Serializer>(fix: &Option<FixOutcome>, to: S) -> Result<S::Ok, S::Error> {
        fix.clone().map(FixItem).serialize(to)
    }
}

impl JsonSchema for OptionalFix {
    fn schema_name() -> Cow<'static, str> {
        "OptionalFix".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        Option::<FixItem>::json_schema(generator)
    }
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "FixRecord")]
pub(in crate::record) struct FixTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    age_s: f64,
    #[serde(with = "FixSourceTwin")]
    source: FixSource,
    n_tags: usize,
    n_tags_used: usize,
    n_points: usize,
    n_points_used: usize,
    #[serde(with = "OptionalFix")]
    fix: Option<FixOutcome>,
    innovation: Option<[f64; 6]>,
    innovation_cov: Option<[[f64; 6]; 6]>,
    nis: Option<f64>,
    nis_gate: f64,
    #[serde(with = "VerdictTwin")]
    verdict: Verdict,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "GridGeometry")]
struct GridTwin {
    x_min_m: f64,
    y_min_m: f64,
    cell_m: f64,
    n_cols: usize,
    n_rows: usize,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "HeightMap")]
pub(in crate::record) struct SurfaceTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "GridTwin")]
    grid: GridGeometry,
    mean_m: Vec<f64>,
    sigma_m: Vec<f64>,
    disturbed_cells: Vec<usize>,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "FlightSummary")]
pub(in crate::record) struct EndedTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "VolumeTwin")]
    volume: VolumeEstimate,
    #[serde(serialize_with = "accounts")]
    #[schemars(with = "Vec<AccountItem>")]
    accounts: Vec<VolumeAccount>,
    #[serde(with = "HitCountsTwin")]
    hits: HitCounts,
    steps_done: usize,
    path_length_m: f64,
    is_complete: bool,
    is_final: bool,
}

fn accounts<S: Serializer>(accounts: &[VolumeAccount], to: S) -> Result<S::Ok, S::Error> {
    AccountsTwin::from(accounts).accounts.serialize(to)
}
