//! The log: an MCAP file that holds every event, every result and the configuration.
//!
//! ```text
//! brain ─ event, result ─▶ Recorder ─ bounded channel ─▶ thread ─▶ file.mcap
//!                              └─ the same bytes ─▶ LiveView ─▶ viewers
//! file.mcap ─▶ LogReader ─ events, results ─▶ replay ─▶ ReplayReport
//!                  └─ events ─▶ read_flights ─▶ turns;  results ─▶ read_accounts ─▶ volumes
//!                  └─ read_surveys ─▶ which surveys it holds, one after the other
//!                  └─ both ─▶ fly_again ─▶ what a watcher sees, and whether it came out as recorded
//! ```
//! | topics | encoding | role |
//! | --- | --- | --- |
//! | `/event/*` | JSON with a JSON schema | what the brain was told, without loss, in its order |
//! | `/result/*` | JSON with a JSON schema | what the brain gave out, between its events |
//! | `/config` | JSON | versions and the effective configuration; first message |
//! | `/record/lost` | JSON | how many entries are missing at this place |
//! | `/view/*`, `/tf` | Foxglove schemas, protobuf | derived for viewers; no replay looks at them |
//!
//! All times in the file are nanoseconds on the service's monotonic clock. Jobs are recorded by
//! number only: they are pure functions of what the brain gave them, so a replay runs them again
//! and hands the output over at the recorded place.

mod accounts;
mod again;
mod build;
mod entry;
mod flights;
mod live;
mod reader;
mod recorder;
mod refly;
pub mod replay;
mod review;
mod scans;
mod shelf;
mod surveys;
mod topic;
mod twin;
mod view;
mod writer;

pub use accounts::{
    LogTimes, LoggedAccounts, accounts_from_json, accounts_to_json, read_accounts,
    read_accounts_of, read_times,
};
pub use again::{FlownAgain, LoggedVolumes, Watcher, fly_again};
pub use build::{COMMIT_NOT_STAMPED, build_commit, build_identity};
pub use entry::RecordedEvent;
pub use flights::{LoggedFlights, read_flights};
pub use live::{LiveView, RunningLive};
pub use reader::{LogItem, LogReader};
pub use recorder::{LogNotes, RecordError, Recorder, RecorderHealth, RecorderStats};
pub use review::{Decided, Decision, read_decision, review_file};
pub use scans::read_scans;
pub use shelf::{
    Seen, Shelf, ShelfSettings, ShelvedLog, Standing, mark_reported, shelved_logs, standing_within,
};
pub use surveys::{LogContents, LoggedSurvey, SurveyPlace, read_surveys};
pub use topic::Topic;
pub use writer::LogHeader;
