//! The recorded form of everything the brain takes in and gives out.
//!
//! The twins describe the inner types field by field (`serde(remote)`), so a change of an inner type
//! stops the build here instead of changing the log in silence. Units are in the keys.

mod budget;
mod enums;
mod events;
mod jobs;
mod results;
mod scalars;

pub(super) use events::{
    AutopilotPoseTwin, BatteryTwin, CommandOutcomeTwin, DeclaredTwin, ImuTwin, InstantTwin,
    OperatorTwin, ScanTwin, StorageTwin, TagsTwin, VehicleTwin,
};
pub(super) use jobs::{FinishedTwin, PlanTwin};
pub(super) use results::{
    AccountsTwin, AnswerTwin, CommandTwin, EndedTwin, FixTwin, OdometryTwin, PhaseTwin,
    SetpointTwin, StartedTwin, SurfaceTwin, TextTwin, VolumeReportTwin,
};
