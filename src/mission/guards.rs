//! Limits of the mission and the list of what must hold before the motors turn.

use super::machine::Inputs;
use crate::messages::LandedState;
use std::time::Duration;

/// Times and levels at which the mission reacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// No take-off below this state of charge, 0 to 1.
    pub min_take_off_battery_ratio: f64,
    /// Below this the survey ends and the vehicle returns, 0 to 1.
    pub return_battery_ratio: f64,
    /// Below this it lands where it is, 0 to 1.
    pub land_battery_ratio: f64,
    /// Preflight gives up after this long.
    pub preflight_timeout: Duration,
    /// Setpoints stream this long before the mode is asked for.
    pub stream_before_mode: Duration,
    /// Commands are repeated at this pace while their effect is missing.
    pub command_retry: Duration,
    /// Take-off gives up and lands after this long.
    pub take_off_timeout: Duration,
    /// Without a pose for this long in a hold, it lands.
    pub land_after_fix_lost: Duration,
    /// A recovered pose or LiDAR must stay this long before the flight goes on.
    pub recovered_after: Duration,
    /// Without LiDAR for this long in a hold, it returns.
    pub return_after_lidar_lost: Duration,
    /// At the end of the way home without being over the pad for this long, it lands there.
    pub land_beside_pad_after: Duration,
    /// No take-off with the heading further than this from the survey's, rad.
    pub max_heading_error_rad: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            min_take_off_battery_ratio: 0.4,
            return_battery_ratio: 0.25,
            land_battery_ratio: 0.12,
            preflight_timeout: Duration::from_secs(60),
            stream_before_mode: Duration::from_millis(1_500),
            command_retry: Duration::from_secs(2),
            take_off_timeout: Duration::from_secs(30),
            land_after_fix_lost: Duration::from_secs(3),
            recovered_after: Duration::from_secs(1),
            return_after_lidar_lost: Duration::from_secs(10),
            land_beside_pad_after: Duration::from_secs(10),
            max_heading_error_rad: 0.4,
        }
    }
}

/// Why the motors may not turn yet; each says its measured value.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PreflightFault {
    /// The autopilot is silent.
    #[error("no heartbeat of the autopilot")]
    NoAutopilot,
    /// It has not finished its start.
    #[error("the autopilot is still starting up")]
    NotReady,
    /// Somebody else might obey.
    #[error("a second autopilot is on the link")]
    SecondAutopilot,
    /// The motors turn already.
    #[error("the vehicle is armed already")]
    ArmedAlready,
    /// It stands nowhere.
    #[error("the autopilot does not report to stand on the ground")]
    NotOnGround,
    /// The own place is not known well enough.
    #[error("no trusted position: are markers in view?")]
    NoPosition,
    /// No beams arrive.
    #[error("the LiDAR is silent")]
    NoLidar,
    /// No battery message yet.
    #[error("the battery is unknown")]
    BatteryUnknown,
    /// Too little charge.
    #[error("battery at {percent:.0} %, take-off needs {needed_percent:.0} %")]
    BatteryLow {
        /// State of charge, %.
        percent: f64,
        /// Least state of charge, %.
        needed_percent: f64,
    },
    /// The autopilot is in a failsafe.
    #[error("the autopilot reports a failsafe")]
    InFailsafe,
    /// It would turn right after take-off.
    #[error("the heading is {degrees:.0}° off the survey's: turn the vehicle on its pad")]
    Heading {
        /// Heading against the survey's, deg.
        degrees: f64,
    },
    /// No waypoints.
    #[error("no feasible waypoint: check marker map, region and quality threshold")]
    NoPlan,
}

/// The first thing that forbids a take-off, if any.
pub(super) fn preflight_fault(inputs: &Inputs, settings: &Settings) -> Option<PreflightFault> {
    let Some(vehicle) = inputs.vehicle else { return Some(PreflightFault::NoAutopilot) };
    let needed_percent = settings.min_take_off_battery_ratio * 100.0;
    let battery = match inputs.battery_ratio {
        None => Some(PreflightFault::BatteryUnknown),
        Some(ratio) if ratio < settings.min_take_off_battery_ratio => {
            Some(PreflightFault::BatteryLow { percent: ratio * 100.0, needed_percent })
        }
        Some(_) => None,
    };
    let heading_error_rad = inputs.heading_error_rad.unwrap_or(0.0);
    let heading = PreflightFault::Heading { degrees: heading_error_rad.to_degrees() };
    let checks = [
        (inputs.is_autopilot_lost, PreflightFault::NoAutopilot),
        (!vehicle.is_ready, PreflightFault::NotReady),
        (vehicle.is_contested, PreflightFault::SecondAutopilot),
        (vehicle.in_failsafe, PreflightFault::InFailsafe),
        (vehicle.is_armed, PreflightFault::ArmedAlready),
        (vehicle.landed != LandedState::OnGround, PreflightFault::NotOnGround),
        (!inputs.has_position, PreflightFault::NoPosition),
        (heading_error_rad.abs() > settings.max_heading_error_rad, heading),
        (!inputs.has_lidar, PreflightFault::NoLidar),
        (!inputs.has_plan, PreflightFault::NoPlan),
    ];
    checks.into_iter().find(|(fails, _)| *fails).map(|(_, fault)| fault).or(battery)
}
