//! What the page is told, five times a second. Lengths m, times s, angles rad unless a name says
//! otherwise; every uncertainty that people see is expanded (k = 2).

use serde::Serialize;
use utoipa::ToSchema;

/// How something does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Level {
    /// As it should be.
    Good,
    /// Worth a look.
    Degraded,
    /// The flight is affected.
    Bad,
    /// Nothing is known.
    Unknown,
}

/// The whole picture.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of one instant")]
pub(super) struct State {
    /// Counts the states; to be sent back with a wish to start or to go on.
    pub(super) seq: u64,
    /// The flight's clock, s.
    pub(super) at_s: f64,
    /// Version of the program.
    pub(super) version: &'static str,
    /// The brain has spoken within the last second.
    pub(super) is_brain_alive: bool,
    /// The mission's phase.
    pub(super) phase: &'static str,
    /// The flight goes on with the survey before it, into its gaps.
    pub(super) is_into_gaps: bool,
    /// Why the mission came to it.
    pub(super) phase_reason: String,
    /// Time since take-off, s; of the last flight once it is over.
    pub(super) flight_s: Option<f64>,
    /// The whole region, if it has more than one bay, and every bay.
    pub(super) volumes: Vec<Volume>,
    /// The volumes are those after landing.
    pub(super) is_final: bool,
    /// What is aimed at.
    pub(super) target: Target,
    /// Waypoints reached, and those known ahead.
    pub(super) steps: [usize; 2],
    /// Where the vehicle is.
    pub(super) pose: Option<Pose>,
    /// The waypoints ahead: x, y, z, m.
    pub(super) ahead_m: Vec<[f64; 3]>,
    /// The own position.
    pub(super) fix: Fix,
    /// The LiDAR.
    pub(super) lidar: Lidar,
    /// The cameras' detector.
    pub(super) camera: Camera,
    /// The flight battery.
    pub(super) battery: Battery,
    /// The autopilot and the way to it.
    pub(super) link: Link,
    /// The computer: clock, brain, log.
    pub(super) computer: Computer,
    /// What must hold before the motors turn.
    pub(super) preflight: Vec<Check>,
    /// What is wrong, and what to do; the worst first.
    pub(super) warnings: Vec<Warning>,
    /// The newest lines for people, the newest last.
    pub(super) lines: Vec<Line>,
    /// What people decided of the last flight.
    pub(super) review: Review,
    /// Versions of the maps, 0 without one: fetch a map again when its number changes.
    pub(super) maps: MapVersions,
    /// Points of the curve of the volume over time so far.
    pub(super) n_points: usize,
    /// Commands are taken from who has the token.
    pub(super) has_token: bool,
    /// Who looks.
    pub(super) viewers: Viewers,
}

/// One volume.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Volume {
    /// What is measured.
    pub(super) name: String,
    /// Volume, m³.
    pub(super) volume_m3: f64,
    /// U of it, k = 2, m³.
    pub(super) expanded_m3: f64,
    /// Both rounded as the GUM wants it: y and U.
    pub(super) stated_m3: [String; 2],
    /// U as a share of the volume, %; left out where there is nearly none.
    pub(super) expanded_percent: Option<f64>,
    /// Mass and its U, k = 2, as stated, t; where the density is known.
    pub(super) stated_t: Option<[String; 2]>,
    /// Shares of the volume that were measured, interpolated, not seen, disturbed; 0 to 1.
    pub(super) shares: [f64; 4],
    /// U falls (−1), stays (0) or rises (1).
    pub(super) trend: i8,
    /// What makes the most of the variance, with its share, 0 to 1, the largest first.
    pub(super) sources: Vec<Source>,
}

/// A source of uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Source {
    /// Its name.
    pub(super) name: &'static str,
    /// Share of the variance of the volume, 0 to 1.
    pub(super) share: f64,
}

/// What is aimed at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub(super) struct Target {
    /// The wished-for U (k = 2) of the whole volume, %.
    pub(super) percent: f64,
    /// U now, %.
    pub(super) now_percent: Option<f64>,
    /// The survey ends when it is reached.
    pub(super) ends_survey: bool,
    /// About how long the way ahead takes until the end of the survey, s; left out where the planner looks less far.
    pub(super) left_s: Option<f64>,
    /// About what U is at its end, % of the whole volume; left out where the planner does not know.
    pub(super) end_percent: Option<f64>,
}

/// Where the vehicle is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub(super) struct Pose {
    /// Place of the body, m.
    pub(super) place_m: [f64; 3],
    /// Heading, rad.
    pub(super) yaw_rad: f64,
    /// Horizontal speed, m/s.
    pub(super) speed_mps: f64,
    /// It can be flown on.
    pub(super) is_trusted: bool,
}

/// The own position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub(super) struct Fix {
    /// How it does.
    pub(super) level: Level,
    /// Markers in the newest frame, and those of them that were used.
    pub(super) markers: [usize; 2],
    /// Root mean square of the newest fix's residuals, px.
    pub(super) residual_px: Option<f64>,
    /// Larger horizontal 1-σ, m.
    pub(super) sigma_xy_m: Option<f64>,
    /// Vertical 1-σ, m.
    pub(super) sigma_z_m: Option<f64>,
    /// Age of the last frame that was used, s.
    pub(super) age_s: Option<f64>,
    /// Share of the frames of the last seconds that were used, 0 to 1.
    pub(super) used_ratio: Option<f64>,
}

/// The LiDAR.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Lidar {
    /// How it does.
    pub(super) level: Level,
    /// In words.
    pub(super) health: String,
    /// Turns of the head, 1/s.
    pub(super) turns_hz: f64,
    /// Samples, 1/s.
    pub(super) samples_hz: f64,
    /// Beams with a return in the trusted range, lately, 0 to 1.
    pub(super) return_ratio: Option<f64>,
    /// Mapped beams that turned out to be dust, edges or machines, 0 to 1.
    pub(super) dust_ratio: Option<f64>,
    /// Beams lost at a full channel.
    pub(super) lost_beams: u64,
}

/// The cameras' detector.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub(super) struct Camera {
    /// How it does.
    pub(super) level: Level,
    /// Frames lately, 1/s.
    pub(super) frames_hz: f64,
    /// Age of a frame when it arrives, s.
    pub(super) latency_s: Option<f64>,
    /// Lines refused.
    pub(super) refused: u64,
}

/// The flight battery.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub(super) struct Battery {
    /// How it does.
    pub(super) level: Level,
    /// State of charge, %.
    pub(super) percent: Option<f64>,
    /// Voltage, V.
    pub(super) voltage_v: Option<f64>,
    /// Time until the vehicle turns home by itself, s; way home and reserve are taken off.
    pub(super) left_s: Option<f64>,
    /// Charge at which it turns home by itself, %.
    pub(super) turns_home_at_percent: f64,
}

/// The autopilot and the way to it.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Link {
    /// How it does.
    pub(super) level: Level,
    /// Who steers, in words.
    pub(super) mode: String,
    /// Motors may turn.
    pub(super) is_armed: bool,
    /// Frames lost on the way, 0 to 1.
    pub(super) missed_ratio: f64,
    /// Distance between its place and the own one, m.
    pub(super) disagreement_m: Option<f64>,
    /// Frames refused before they were read.
    pub(super) refused_frames: u64,
}

/// The computer.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Computer {
    /// How it does.
    pub(super) level: Level,
    /// The autopilot's clock is known.
    pub(super) is_clock_known: bool,
    /// Ticks that the brain left out.
    pub(super) ticks_skipped: u64,
    /// Log entries that were lost.
    pub(super) records_lost: u64,
    /// Everything else that was lost: messages, jobs, news for this page.
    pub(super) other_lost: u64,
    /// Free room where the log is written, bytes; left out if it cannot be told.
    pub(super) free_bytes: Option<u64>,
    /// Room should be made there; what counts as short is in the configuration.
    pub(super) is_disk_short: bool,
    /// Name of the log.
    pub(super) log: String,
}

/// One line of the preflight list.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Check {
    /// What is looked at.
    pub(super) subject: &'static str,
    /// What was found.
    pub(super) found: String,
    /// Why it forbids the take-off, if it does.
    pub(super) fault: Option<String>,
}

/// Something is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub(super) struct Warning {
    /// How bad.
    pub(super) level: Level,
    /// What is wrong.
    pub(super) what: String,
    /// What to do.
    pub(super) todo: String,
}

/// A line for people.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Line {
    /// When, s.
    pub(super) at_s: f64,
    /// How urgent.
    pub(super) level: Level,
    /// The text.
    pub(super) text: String,
}

/// What people decided of the last flight.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Review {
    /// A flight has ended and nobody has decided.
    pub(super) is_due: bool,
    /// The decision.
    pub(super) verdict: Option<super::verdict::Verdict>,
    /// The survey ran to its end.
    pub(super) is_complete: bool,
    /// What speaks against accepting it.
    pub(super) remarks: Vec<String>,
    /// What it has left out, the largest share of the uncertainty first.
    pub(super) gaps: Vec<Gap>,
}

/// Ground that a flight has left out.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Gap {
    /// Its middle, x and y, m.
    pub(super) centre_m: [f64; 2],
    /// Its area, m².
    pub(super) area_m2: f64,
    /// Share of the surface's variance of the volume that goes through it, 0 to 1.
    pub(super) share: f64,
    /// The bay it lies in, if bays have names.
    pub(super) bay: Option<String>,
    /// Another flight could look into it.
    pub(super) is_in_reach: bool,
}

/// Versions of the maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, ToSchema)]
pub(super) struct MapVersions {
    pub(super) height: u64,
    pub(super) sigma: u64,
    pub(super) coverage: u64,
    pub(super) fix_quality: u64,
    pub(super) change: u64,
}

/// Who looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, ToSchema)]
pub(super) struct Viewers {
    /// Now.
    pub(super) now: usize,
    /// Dropped since the start because they did not keep up.
    pub(super) dropped: u64,
}
