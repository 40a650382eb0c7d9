//! Limits of the mission and the list of what must hold before the motors turn.

use super::decision::Inputs;
use crate::messages::{LandedState, Room, VehicleState};
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
    /// From samples that come late to [`Land`](super::Phase::Land): the autopilot gets no place that
    /// it can use, so waiting in the air drifts.
    pub land_after_late: Duration,
    /// A recovered pose or LiDAR must stay this long before the flight goes on.
    pub recovered_after: Duration,
    /// Without LiDAR for this long in a hold, it returns.
    pub return_after_lidar_lost: Duration,
    /// At the end of the way home without being over the pad for this long, it lands there.
    pub land_beside_pad_after: Duration,
    /// The autopilot's place may differ this much from the own one, m.
    pub max_disagreement_m: f64,
    /// No take-off with the autopilot's heading further than this from the own one, rad.
    pub max_heading_disagreement_rad: f64,
    /// In flight its heading may differ this much, rad: turned by more, what it does against an
    /// error soon makes it larger.
    pub land_heading_disagreement_rad: f64,
    /// A larger difference of either kind must last this long before it counts.
    pub disagrees_for: Duration,
    /// In flight it lands when the autopilot's place cannot be compared for so long.
    pub land_after_untold: Duration,
    /// Nearer than planned to something by more than this, m, it holds.
    pub max_intrusion_m: f64,
    /// Still too near after this long in a hold, it lands.
    pub land_after_intrusion: Duration,
    /// Further than this from where its trajectory has it, m, the vehicle does not follow.
    pub max_off_track_m: f64,
    /// It must not follow for this long before it holds.
    pub off_track_for: Duration,
    /// After so many holds of one flight it lands instead.
    pub most_off_track_holds: u32,
    /// An empty battery must be told for this long: PX4 speaks of it every two seconds.
    pub battery_empty_for: Duration,
    /// The way home is begun while the battery holds this many times what it takes, beside what
    /// must be left for a landing.
    pub way_home_factor: f64,
    /// No take-off with the heading further than this from the survey's, rad.
    pub max_heading_error_rad: f64,
    /// Somebody has said that the hall is no zone of explosive dust, or has released it.
    pub is_dust_cleared: bool,
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
            land_after_late: Duration::from_secs(1),
            recovered_after: Duration::from_secs(1),
            return_after_lidar_lost: Duration::from_secs(10),
            land_beside_pad_after: Duration::from_secs(10),
            max_disagreement_m: 0.5,
            max_heading_disagreement_rad: 10_f64.to_radians(),
            land_heading_disagreement_rad: 15_f64.to_radians(),
            disagrees_for: Duration::from_millis(500),
            land_after_untold: Duration::from_secs(3),
            max_intrusion_m: 0.15,
            land_after_intrusion: Duration::from_secs(3),
            max_off_track_m: 1.0,
            off_track_for: Duration::from_millis(300),
            most_off_track_holds: 2,
            battery_empty_for: Duration::from_millis(2_500),
            way_home_factor: 1.5,
            max_heading_error_rad: 0.4,
            is_dust_cleared: true,
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
    #[error("a second autopilot is on the link, or one comes by two ways of a router")]
    SecondAutopilot,
    /// The motors turn already.
    #[error("the vehicle is armed already")]
    ArmedAlready,
    /// It stands nowhere.
    #[error("the autopilot does not report to stand on the ground")]
    NotOnGround,
    /// Its samples cannot be dated, or do not come.
    #[error(
        "no inertial samples that can be dated: does the link take over 10 ms there and back, or \
         does the autopilot not send them?"
    )]
    NoSamples,
    /// The own place is not known well enough.
    #[error("no trusted position: are markers in view?")]
    NoPosition,
    /// No beams arrive that measure anything.
    #[error("the LiDAR measures nothing: is it plugged in, turning, its window free?")]
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
    /// It fuses something else, or nothing.
    #[error("the autopilot believes to be {metres:.1} m away: does it fuse the ODOMETRY?")]
    Disagreement {
        /// Its place against the own one, m.
        metres: f64,
    },
    /// It fuses the place of the ODOMETRY and takes its heading from elsewhere, and would fly away.
    #[error(
        "the autopilot's heading is {degrees:.0}° off: let it fuse the ODOMETRY's yaw (PX4 \
         EKF2_EV_CTRL 15, ArduPilot EK3_SRC1_YAW 6)"
    )]
    HeadingDisagreement {
        /// Its heading against the own one, deg.
        degrees: f64,
    },
    /// Its place cannot be compared.
    #[error(
        "the autopilot does not tell its position: does it fuse the ODOMETRY and send \
         LOCAL_POSITION_NED?"
    )]
    PositionUntold,
    /// Its heading cannot be compared.
    #[error("the autopilot does not tell its heading: does it send ATTITUDE_QUATERNION?")]
    HeadingUnknown,
    /// It would turn right after take-off.
    #[error("the heading is {degrees:.0}° off the survey's: turn the vehicle on its pad")]
    Heading {
        /// Heading against the survey's, deg.
        degrees: f64,
    },
    /// The log of this flight would not fit.
    #[error("{free_mb} MB free on the disk, a survey needs {needed_mb}")]
    NoRoom {
        /// Free, MB.
        free_mb: u64,
        /// Least, MB.
        needed_mb: u64,
    },
    /// The flight could not be computed again.
    #[error("the log has failed: mend the disk, then restart stockpilot")]
    NoLog,
    /// Dust may explode.
    #[error("nobody has said that this hall is no dust zone, or released it: hall.dust_zone")]
    DustZone,
    /// No waypoints.
    #[error("no feasible waypoint: check marker map, region and quality threshold")]
    NoPlan,
}

/// One line of the list that is gone through before the motors turn.
#[derive(Debug, Clone, PartialEq)]
pub struct PreflightCheck {
    /// What is looked at.
    pub subject: &'static str,
    /// What was found, with its unit.
    pub found: String,
    /// Why it forbids the take-off, if it does.
    pub fault: Option<PreflightFault>,
}

/// Everything that forbids a take-off, what to look at first in front.
pub(super) fn preflight_faults(inputs: &Inputs, settings: &Settings) -> Vec<PreflightFault> {
    preflight_checks(inputs, settings).into_iter().filter_map(|check| check.fault).collect()
}

/// The whole list with what was measured, what to look at first in front.
///
/// Without an autopilot it has one line: all others would repeat that nothing is known.
pub(super) fn preflight_checks(inputs: &Inputs, settings: &Settings) -> Vec<PreflightCheck> {
    let Some(vehicle) = inputs.vehicle else {
        return vec![check("autopilot", "silent".to_owned(), Some(PreflightFault::NoAutopilot))];
    };
    let off = |number: Option<f64>, unit: &str| {
        number.map_or_else(|| "unknown".to_owned(), |n| format!("{n:.0}{unit} off"))
    };
    let heading_deg = inputs.heading_error_rad.map(f64::to_degrees);
    let is_turned = heading_deg
        .is_some_and(|degrees| degrees.abs() > settings.max_heading_error_rad.to_degrees());
    let heading = PreflightFault::Heading { degrees: heading_deg.unwrap_or(0.0) };
    let sigma = inputs.position_sigma_m.map_or_else(
        || "unknown".to_owned(),
        |sigma_m| format!("1-sigma {:.1} cm", 100.0 * sigma_m),
    );
    use PreflightFault as Fault;
    let mut checks = vehicle_checks(inputs, &vehicle);
    checks.extend([
        either("inertial samples", inputs.has_samples, "dated", "none", Fault::NoSamples),
        check("position", sigma, (!inputs.has_position).then_some(Fault::NoPosition)),
        check(
            "autopilot's position",
            off(inputs.disagreement_m.map(|m| 100.0 * m), " cm"),
            place_fault(inputs, settings),
        ),
        heading_check(inputs, settings),
        check("heading", off(heading_deg.map(f64::abs), "°"), is_turned.then_some(heading)),
        either("LiDAR", inputs.has_lidar, "measuring", "measuring nothing", Fault::NoLidar),
        either("waypoints", inputs.has_plan, "found", "none", Fault::NoPlan),
        battery_check(inputs, settings),
        either(
            "dust zone",
            settings.is_dust_cleared,
            "none, or released",
            "not declared",
            Fault::DustZone,
        ),
        check("mode switch", mode_news(vehicle.is_mode_prompt).to_owned(), None),
    ]);
    checks.extend(storage_check(inputs));
    checks
}

/// What the autopilot says of itself.
fn vehicle_checks(inputs: &Inputs, vehicle: &VehicleState) -> Vec<PreflightCheck> {
    use PreflightFault as Fault;
    let is_standing = vehicle.landed == LandedState::OnGround;
    vec![
        either("autopilot", !inputs.is_autopilot_lost, "heard", "silent", Fault::NoAutopilot),
        either("autopilot's start-up", vehicle.is_ready, "done", "under way", Fault::NotReady),
        either(
            "other autopilots",
            !vehicle.is_contested,
            "none",
            "one heard",
            Fault::SecondAutopilot,
        ),
        either("failsafe", !vehicle.in_failsafe, "none", "active", Fault::InFailsafe),
        either("motors", !vehicle.is_armed, "disarmed", "armed", Fault::ArmedAlready),
        either("vehicle", is_standing, "on the ground", "not said", Fault::NotOnGround),
    ]
}

const fn check(
    subject: &'static str,
    found: String,
    fault: Option<PreflightFault>,
) -> PreflightCheck {
    PreflightCheck { subject, found, fault }
}

/// A line with two outcomes.
fn either(
    subject: &'static str,
    is_good: bool,
    good: &str,
    bad: &str,
    fault: PreflightFault,
) -> PreflightCheck {
    let found = if is_good { good } else { bad };
    check(subject, found.to_owned(), (!is_good).then_some(fault))
}

const fn mode_news(is_prompt: bool) -> &'static str {
    if is_prompt { "seen at once" } else { "seen up to 1 s late" }
}

/// A place that was not compared may be anywhere.
fn place_fault(inputs: &Inputs, settings: &Settings) -> Option<PreflightFault> {
    match inputs.disagreement_m {
        Some(metres) if metres > settings.max_disagreement_m => {
            Some(PreflightFault::Disagreement { metres })
        }
        Some(_) => None,
        None => Some(PreflightFault::PositionUntold),
    }
}

fn heading_check(inputs: &Inputs, settings: &Settings) -> PreflightCheck {
    let told = inputs.heading_disagreement_rad.map(|rad| rad.to_degrees().abs());
    PreflightCheck {
        subject: "autopilot's heading",
        found: told.map_or_else(|| "unknown".to_owned(), |degrees| format!("{degrees:.0}° off")),
        fault: heading_fault(inputs, settings),
    }
}

/// A place without a heading beside it was not compared as it must be.
fn heading_fault(inputs: &Inputs, settings: &Settings) -> Option<PreflightFault> {
    match inputs.heading_disagreement_rad {
        Some(turned_rad) if turned_rad.abs() > settings.max_heading_disagreement_rad => {
            Some(PreflightFault::HeadingDisagreement { degrees: turned_rad.to_degrees().abs() })
        }
        None if inputs.disagreement_m.is_some() => Some(PreflightFault::HeadingUnknown),
        _ => None,
    }
}

/// What is wrong with the autopilot's pose in flight, if something is.
pub(super) fn disagreement_text(inputs: &Inputs, settings: &Settings) -> Option<String> {
    let off_m = inputs.disagreement_m.filter(|off_m| *off_m > settings.max_disagreement_m);
    let turned_rad = inputs
        .heading_disagreement_rad
        .filter(|turned_rad| turned_rad.abs() > settings.land_heading_disagreement_rad);
    let place = off_m.map(|off_m| format!("autopilot's position is {off_m:.1} m off: landing"));
    place.or_else(|| {
        let degrees = turned_rad?.to_degrees().abs();
        Some(format!("autopilot's heading is {degrees:.0} deg off: landing"))
    })
}

/// Whether the flight can be recorded; nothing where nobody looks at the disk.
fn storage_check(inputs: &Inputs) -> Option<PreflightCheck> {
    let storage = inputs.storage?;
    let free_mb = storage.free_bytes.unwrap_or(0) / 1_000_000;
    let needed_mb = storage.survey_bytes / 1_000_000;
    let (found, fault) = if storage.has_log_failed {
        let found = format!("{} entries lost", storage.records_lost);
        (found, Some(PreflightFault::NoLog))
    } else {
        let is_full = storage.room == Room::TooLittle;
        let fault = is_full.then_some(PreflightFault::NoRoom { free_mb, needed_mb });
        (format!("{} free", storage.free_text()), fault)
    };
    Some(PreflightCheck { subject: "log", found, fault })
}

fn battery_check(inputs: &Inputs, settings: &Settings) -> PreflightCheck {
    let needed_percent = settings.min_take_off_battery_ratio * 100.0;
    let (found, fault) = match inputs.battery_ratio {
        None => ("unknown".to_owned(), Some(PreflightFault::BatteryUnknown)),
        Some(ratio) => {
            let percent = ratio * 100.0;
            let is_low = ratio < settings.min_take_off_battery_ratio;
            let fault = PreflightFault::BatteryLow { percent, needed_percent };
            (format!("{percent:.0} %"), is_low.then_some(fault))
        }
    };
    PreflightCheck { subject: "battery", found, fault }
}

/// What was measured before the start, for people.
pub(super) fn preflight_line(inputs: &Inputs) -> String {
    let or_unknown = |number: Option<String>| number.unwrap_or_else(|| "unknown".to_owned());
    let battery = or_unknown(inputs.battery_ratio.map(|r| format!("{:.0} %", r * 100.0)));
    let sigma = or_unknown(inputs.position_sigma_m.map(|s| format!("{:.0} cm", s * 100.0)));
    let off = or_unknown(inputs.disagreement_m.map(|d| format!("{:.0} cm", d * 100.0)));
    let degrees =
        |rad: Option<f64>| or_unknown(rad.map(|rad| format!("{:.0} deg", rad.to_degrees().abs())));
    let turned = degrees(inputs.heading_disagreement_rad);
    let heading = degrees(inputs.heading_error_rad);
    let is_late = inputs.vehicle.is_some_and(|vehicle| !vehicle.is_mode_prompt);
    let mode = if is_late { ", mode switch seen up to 1 s late" } else { "" };
    let lidar = if inputs.has_lidar { "on" } else { "silent" };
    format!(
        "preflight: battery {battery}, position sigma {sigma}, autopilot off by {off} \
         and {turned}, heading off by {heading}, LiDAR {lidar}{mode}"
    )
}
