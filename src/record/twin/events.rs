//! The recorded form of events; both ways, without loss.

use super::enums::{
    CameraIdTwin, FlightModeTwin, LandedStateTwin, OperatorRequestTwin, OperatorVerbTwin,
    TagFamilyTwin, TakeOffTwin, VehicleCommandTwin,
};
use super::scalars::{Nanos, OptionalWxyz, Xyz};
use crate::geometry::{Body, Direction, Hall, Point, Rotation};
use crate::messages::{
    AutopilotPose, BatterySample, Beam, CameraId, CommandOutcome, Declaration, FlightMode,
    ImuSample, LandedState, OperatorCommand, OperatorRequest, OperatorVerb, PointDetection, Room,
    Scan, StorageState, TagDetection, TagDetections, TagFamily, TakeOff, VehicleCommand,
    VehicleState,
};
use crate::time::{Mono, Stamp};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An event that is nothing but its instant.
#[derive(Serialize, Deserialize, JsonSchema)]
pub(in crate::record) struct InstantTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    pub(in crate::record) at: Stamp<Mono>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "ImuSample")]
pub(in crate::record) struct ImuTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "Xyz")]
    accel_mps2: Vector3<f64>,
    #[serde(with = "Xyz")]
    gyro_radps: Vector3<f64>,
}

/// A scan in columns of equal length.
#[derive(Serialize, Deserialize, JsonSchema)]
pub(in crate::record) struct ScanTwin {
    #[serde(rename = "start_ns", with = "Nanos")]
    start: Stamp<Mono>,
    offset_ns: Vec<u32>,
    angle_rad: Vec<f32>,
    range_m: Vec<f32>,
    intensity: Vec<u8>,
}

impl From<&Scan> for ScanTwin {
    fn from(scan: &Scan) -> Self {
        Self {
            start: scan.start,
            offset_ns: scan.beams.iter().map(|beam| beam.offset_ns).collect(),
            angle_rad: scan.beams.iter().map(|beam| beam.angle_rad).collect(),
            range_m: scan.beams.iter().map(|beam| beam.range_m).collect(),
            intensity: scan.beams.iter().map(|beam| beam.intensity).collect(),
        }
    }
}

impl ScanTwin {
    /// The scan; `None` if the columns differ in length.
    pub(in crate::record) fn into_scan(self) -> Option<Scan> {
        let n_beams = self.offset_ns.len();
        let lengths = [self.angle_rad.len(), self.range_m.len(), self.intensity.len()];
        let beam = |i: usize| Beam {
            offset_ns: self.offset_ns[i],
            angle_rad: self.angle_rad[i],
            range_m: self.range_m[i],
            intensity: self.intensity[i],
        };
        lengths
            .iter()
            .all(|length| *length == n_beams)
            .then(|| Scan { start: self.start, beams: (0..n_beams).map(beam).collect() })
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "TagDetection")]
struct TagTwin {
    id: u32,
    #[serde(with = "TagFamilyTwin")]
    family: TagFamily,
    corners_px: [[f64; 2]; 4],
    decision_margin: f64,
}

#[derive(Serialize, Deserialize, JsonSchema)]
struct TagItem(#[serde(with = "TagTwin")] TagDetection);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "PointDetection")]
struct PointTwin {
    id: u32,
    pixel_px: [f64; 2],
}

#[derive(Serialize, Deserialize, JsonSchema)]
struct PointItem(#[serde(with = "PointTwin")] PointDetection);

#[derive(Serialize, Deserialize, JsonSchema)]
pub(in crate::record) struct TagsTwin {
    #[serde(rename = "captured_at_ns", with = "Nanos")]
    captured_at: Stamp<Mono>,
    #[serde(rename = "received_at_ns", with = "Nanos")]
    received_at: Stamp<Mono>,
    #[serde(with = "CameraIdTwin")]
    camera: CameraId,
    tags: Vec<TagItem>,
    /// Absent in logs of earlier versions.
    #[serde(default)]
    points: Vec<PointItem>,
}

impl From<&TagDetections> for TagsTwin {
    fn from(seen: &TagDetections) -> Self {
        Self {
            captured_at: seen.captured_at,
            received_at: seen.received_at,
            camera: seen.camera,
            tags: seen.tags.iter().map(|tag| TagItem(*tag)).collect(),
            points: seen.points.iter().map(|point| PointItem(*point)).collect(),
        }
    }
}

impl From<TagsTwin> for TagDetections {
    fn from(twin: TagsTwin) -> Self {
        Self {
            captured_at: twin.captured_at,
            received_at: twin.received_at,
            camera: twin.camera,
            tags: twin.tags.into_iter().map(|item| item.0).collect(),
            points: twin.points.into_iter().map(|item| item.0).collect(),
        }
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "VehicleState")]
#[expect(clippy::struct_excessive_bools, reason = "the twin of independent facts")]
pub(in crate::record) struct VehicleTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    is_armed: bool,
    #[serde(with = "FlightModeTwin")]
    mode: FlightMode,
    #[serde(with = "LandedStateTwin")]
    landed: LandedState,
    in_failsafe: bool,
    #[serde(default = "yes")]
    is_ready: bool,
    #[serde(default)]
    is_contested: bool,
    /// Logs from before it was asked for have the mode from heartbeats at 30 Hz.
    #[serde(default = "yes")]
    is_mode_prompt: bool,
    #[serde(with = "TakeOffTwin", default = "by_setpoints")]
    takes_off: TakeOff,
}

const fn yes() -> bool {
    true
}

const fn by_setpoints() -> TakeOff {
    TakeOff::BySetpoints
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "BatterySample")]
pub(in crate::record) struct BatteryTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    voltage_v: f64,
    current_a: f64,
    remaining_ratio: f64,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "Room", rename_all = "kebab-case")]
enum RoomTwin {
    Enough,
    Low,
    TooLittle,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "StorageState")]
pub(in crate::record) struct StorageTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "RoomTwin")]
    room: Room,
    free_bytes: Option<u64>,
    survey_bytes: u64,
    records_lost: u64,
    has_log_failed: bool,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "AutopilotPose")]
pub(in crate::record) struct AutopilotPoseTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(rename = "position_m", with = "Xyz")]
    position: Point<Hall>,
    #[serde(with = "Xyz")]
    velocity_mps: Direction<Hall>,
    #[serde(rename = "hall_from_body_wxyz", with = "OptionalWxyz")]
    hall_from_body_rot: Option<Rotation<Hall, Body>>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "CommandOutcome")]
pub(in crate::record) struct CommandOutcomeTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "VehicleCommandTwin")]
    command: VehicleCommand,
    is_accepted: bool,
}

/// What a named person said before a start from the page; all of it, or there was no start.
#[derive(Serialize, Deserialize, JsonSchema)]
#[expect(clippy::struct_excessive_bools, reason = "four things that are said one by one")]
pub(in crate::record) struct DeclaredTwin {
    /// When it was said, ns.
    at_ns: i64,
    /// The start that it was said for.
    #[serde(with = "OperatorVerbTwin")]
    verb: OperatorVerb,
    /// Who said it, as typed.
    by: String,
    /// Nobody is in the hall, and nobody can walk in.
    nobody_inside: bool,
    /// The remote control is in the person's hand, its mode and kill switches are tried.
    remote_in_hand: bool,
    /// Machines stand, doors and fans are as in the last survey.
    hall_as_before: bool,
    /// The hall is no dust zone, or a named person has released it.
    no_dust_zone: bool,
}

impl DeclaredTwin {
    pub(in crate::record) fn new(at: Stamp<Mono>, said: &Declaration) -> Self {
        Self {
            at_ns: at.nanos(),
            verb: said.verb,
            by: said.by.clone(),
            nobody_inside: true,
            remote_in_hand: true,
            hall_as_before: true,
            no_dust_zone: true,
        }
    }

    /// When it was said, and by whom.
    pub(in crate::record) fn said(self) -> (Stamp<Mono>, Declaration) {
        (Stamp::from_nanos(self.at_ns), Declaration { verb: self.verb, by: self.by })
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "OperatorCommand")]
pub(in crate::record) struct OperatorTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "OperatorVerbTwin")]
    verb: OperatorVerb,
    #[serde(with = "OperatorRequestTwin")]
    from: OperatorRequest,
}
