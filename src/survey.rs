//! After the flight: maps of several logs as one, the change between two surveys, and what people
//! read of both.
//!
//! ```text
//! LOG LOG … ─ events ─▶ turns ─▶ mapping::merge ─▶ one solve ─▶ volumes ─▶ table, JSON, new log
//!                                    └▶ the likeliest prior ─▶ configuration
//! LOG ─ flown again ─▶ Flight: volumes, surface, hits, path ─▶ report, exports
//! EARLIER, LATER ─ recorded volumes ─▶ mapping::change ─▶ Δ ± U, verdict
//! ```
//!
//! Not done here: the mathematics (`mapping`), and reading files (`record`, `config`).

mod compare;
mod flight;
mod learn;
mod merge;
mod table;

pub use compare::{BayChange, ChangeReport, Origin, Survey, SurveyError, compare};
pub use flight::{FixStatistics, Flight, Reproduction};
pub use learn::{FieldNumbers, LearnedPrior, learn_prior};
pub use merge::{MergeLogsError, MergeOptions, MergedLog, MergedSurvey, merge_logs};
pub use table::{AccountLine, accounts_table};
