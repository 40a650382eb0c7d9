//! Plain data that modules exchange. No behaviour beyond constructors and checks of finiteness.

mod budget;
mod camera;
mod imu;
mod map;
mod nav;
mod operator;
mod scan;
mod setpoint;
mod storage;
mod tag_pattern;
mod vehicle;

pub use budget::{BudgetRow, BudgetSource, SharedSensitivity, VolumeBudget};
pub use camera::{CameraId, PointDetection, TagDetection, TagDetections, TagFamily};
pub use imu::ImuSample;
pub use map::{
    CellCoverage, DisturbedArea, GridGeometry, HeightMap, HitCounts, Mass, VolumeAccount,
    VolumeEstimate, VolumeShares,
};
pub use nav::{
    FixOutcome, FixRecord, FixSource, NavEstimate, PoseError, TagSensitivity, Verdict, state,
};
pub use operator::{
    Declaration, OperatorAnswer, OperatorCommand, OperatorRequest, OperatorVerb, Severity,
    StatusText,
};
pub use scan::{Beam, Scan, ScanCorrection};
pub use setpoint::Setpoint;
pub use storage::{Room, StorageState};
pub use tag_pattern::TagPattern;
pub use vehicle::{
    AutopilotPose, BatterySample, CommandOutcome, FlightMode, LandedState, TAKE_OFF_HEIGHT_M,
    TakeOff, VehicleCommand, VehicleState,
};
