//! The recorded form of plans and finished jobs. Of a job a number, for a replay runs the job again, and the whole answer
//! where a program outside was asked.

use super::super::entry::RecordedEvent;
use super::enums::JobIdTwin;
use super::scalars::Nanos;
use crate::geometry::Point;
use crate::pilot::{JobId, PlanChoice};
use crate::planning::Waypoint;
use crate::planning::planner::{Plan, PlanEnd};
use crate::time::{Mono, Stamp};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A finished job.
#[derive(Serialize, Deserialize, JsonSchema)]
pub(in crate::record) struct FinishedTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    #[serde(with = "JobIdTwin")]
    id: JobId,
    /// What a program outside planned, or why nothing of it is flown; absent for all other jobs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    outside: Option<OutsideTwin>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum OutsideTwin {
    Plan { waypoints: Vec<WaypointItem>, is_complete: bool },
    Failed { reason: String },
}

#[derive(Serialize, Deserialize, JsonSchema)]
struct WaypointItem {
    x_m: f64,
    y_m: f64,
    z_m: f64,
    yaw_rad: f64,
}

/// A plan that was taken in.
#[derive(Serialize, JsonSchema)]
pub(in crate::record) struct PlanTwin {
    #[serde(rename = "at_ns", with = "Nanos")]
    at: Stamp<Mono>,
    ahead: Vec<WaypointItem>,
    end: &'static str,
    prediction: Option<PredictionItem>,
}

#[derive(Serialize, JsonSchema)]
struct PredictionItem {
    sigma_now_m3: f64,
    sigma_end_m3: f64,
    length_m: f64,
}

impl From<&PlanChoice> for PlanTwin {
    fn from(choice: &PlanChoice) -> Self {
        Self {
            at: choice.at,
            ahead: choice.ahead.iter().map(WaypointItem::from).collect(),
            end: choice.end.name(),
            prediction: choice.prediction.map(|it| PredictionItem {
                sigma_now_m3: it.sigma_now_m3,
                sigma_end_m3: it.sigma_end_m3,
                length_m: it.length_m,
            }),
        }
    }
}

impl FinishedTwin {
    pub(in crate::record) fn new(
        at: Stamp<Mono>,
        id: JobId,
        outside: Option<&Result<Plan, String>>,
    ) -> Self {
        let outside = outside.map(|found| match found {
            Ok(plan) => OutsideTwin::Plan {
                waypoints: plan.waypoints.iter().map(WaypointItem::from).collect(),
                is_complete: plan.end == PlanEnd::Complete,
            },
            Err(reason) => OutsideTwin::Failed { reason: reason.clone() },
        });
        Self { at, id, outside }
    }
}

impl From<FinishedTwin> for RecordedEvent {
    fn from(twin: FinishedTwin) -> Self {
        let outside = twin.outside.map(|outside| match outside {
            OutsideTwin::Plan { waypoints, is_complete } => Ok(Plan {
                waypoints: waypoints.iter().map(Waypoint::from).collect(),
                end: if is_complete { PlanEnd::Complete } else { PlanEnd::Open },
                prediction: None,
            }),
            OutsideTwin::Failed { reason } => Err(reason),
        });
        Self::Finished { at: twin.at, id: twin.id, outside }
    }
}

impl From<&Waypoint> for WaypointItem {
    fn from(waypoint: &Waypoint) -> Self {
        let p = waypoint.place.coords;
        Self { x_m: p.x, y_m: p.y, z_m: p.z, yaw_rad: waypoint.yaw_rad }
    }
}

impl From<&WaypointItem> for Waypoint {
    fn from(item: &WaypointItem) -> Self {
        Self { place: Point::new(item.x_m, item.y_m, item.z_m), yaw_rad: item.yaw_rad }
    }
}
