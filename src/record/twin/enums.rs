//! The recorded names of the closed lists.

use crate::messages::{
    CameraId, FixSource, FlightMode, LandedState, OperatorRequest, OperatorVerb, Severity,
    TagFamily, TakeOff, VehicleCommand, Verdict,
};
use crate::mission::Phase;
use crate::pilot::JobId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "CameraId")]
pub(super) struct CameraIdTwin(u8);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "JobId")]
pub(super) struct JobIdTwin(u64);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "TagFamily")]
pub(super) enum TagFamilyTwin {
    #[serde(rename = "36h11")]
    Tag36h11,
    #[serde(rename = "25h9")]
    Tag25h9,
    #[serde(rename = "16h5")]
    Tag16h5,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "FlightMode", rename_all = "snake_case")]
pub(super) enum FlightModeTwin {
    Companion,
    Hold,
    Land,
    TakeOff,
    Return,
    Pilot,
    Other(u32),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "LandedState", rename_all = "snake_case")]
pub(super) enum LandedStateTwin {
    Unknown,
    OnGround,
    TakingOff,
    InAir,
    Landing,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "VehicleCommand", rename_all = "snake_case")]
pub(super) enum VehicleCommandTwin {
    Arm,
    Disarm,
    EnterCompanionMode,
    EnterHold,
    EnterLand,
    TakeOff,
}

/// Logs from before two families were spoken are PX4's.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "TakeOff", rename_all = "snake_case")]
pub(super) enum TakeOffTwin {
    BySetpoints,
    ByCommand,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "OperatorVerb", rename_all = "snake_case")]
pub(super) enum OperatorVerbTwin {
    Start,
    FlyGaps,
    Hold,
    Resume,
    Return,
    Land,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "OperatorRequest")]
pub(super) struct OperatorRequestTwin {
    system: u8,
    component: u8,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "Severity", rename_all = "snake_case")]
pub(super) enum SeverityTwin {
    Critical,
    Error,
    Warning,
    Notice,
    Info,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "Phase", rename_all = "snake_case")]
pub(super) enum PhaseNameTwin {
    Idle,
    Preflight,
    TakeOff,
    Survey,
    Return,
    Land,
    Hold,
    Abort,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "Verdict", rename_all = "snake_case")]
pub(super) enum VerdictTwin {
    Fused,
    Initialized,
    Gated,
    TooOld,
    FromTheFuture,
    NotObservable,
    NoKnownTag,
    NotInitialized,
    BadResidual,
    Frozen,
    AgainstGravity,
}

#[derive(Serialize, JsonSchema)]
#[serde(remote = "FixSource", rename_all = "snake_case")]
pub(super) enum FixSourceTwin {
    Loose,
    Tight,
    Standstill,
}
