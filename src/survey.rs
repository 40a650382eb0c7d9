//! After the flight: maps of several logs as one, the change between two surveys, and what people
//! read of both.
//!
//! ```text
//! LOG LOG … ─ events ─▶ turns ─▶ mapping::merge ─▶ one solve ─▶ volumes ─▶ table, JSON, new log
//!                                    └▶ the likeliest prior ─▶ configuration
//! LOG ─ flown again ─▶ Flight: volumes, surface, hits, path ─▶ report, exports
//! LOG ─ events ─▶ scans with their poses ─▶ calibration ─▶ mounting of the LiDAR
//! EARLIER, LATER ─ recorded volumes ─▶ mapping::change ─▶ Δ ± U, verdict
//! ```
//!
//! Not done here: the mathematics (`mapping`, `calibration`), and reading files (`record`, `config`).

mod calibrate;
mod compare;
mod flight;
mod floor;
pub mod ids;
mod learn;
mod merge;
mod table;

pub use calibrate::{CalibrateError, LidarCalibration, MountOptions, calibrate_mount};
pub use compare::{BayChange, ChangeReport, Origin, Survey, SurveyError, compare};
pub use flight::{FixStatistics, Flight, Reproduction};
pub use floor::{Floor, FloorError, FloorMemory, Learned, Level, survey_floor};
pub use learn::{FieldNumbers, LearnedPrior, learn_prior};
pub use merge::{MergeLogsError, MergeOptions, MergedLog, MergedSurvey, merge_logs};
pub use table::{AccountLine, accounts_table};
