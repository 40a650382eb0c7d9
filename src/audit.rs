//! The audit pack: everything that somebody else needs to compute the same volumes again, signed.
//!
//! ```text
//! pack/
//!   LOG.mcap              the log, every byte
//!   config.toml           the configuration that it was flown with
//!   LOG.review.jsonl      what people decided of its flights, if they did
//!   volumes.json          the volumes to the last bit, and the builds
//!   wishes.json           what the report was asked for: site, target, books, which survey of the log
//!   earlier.mcap          the log of the earlier survey, if the report compares with one
//!   report.pdf …          the report with its maps and point clouds
//!   RECOMPUTE.txt         the commands
//!   stockpilot.pub        the public key; who it belongs to, the auditor must know from elsewhere
//!   SHA256SUMS            the sum of every file above
//!   SHA256SUMS.minisig    the signature of that list
//! ```
//! The signature is minisign's, so the list can be checked without this program: `minisign -V` for the
//! signature, `sha256sum -c` for the files. [`verify`] does both, computes the volumes again and makes every
//! file of the pack anew from the logs, the wishes and the decisions: each must come out byte by byte, the PDF
//! too.
//!
//! What a signature says: the holder of the key has packed these bytes. Not: when, or that the configuration,
//! the books or the decisions are right. Those, and the earlier log, stand on the signature alone.
//!
//! Another build than the pack's may come to other last digits or word the report otherwise. Then [`Judgement`] says
//! what can be judged all the same, and what only the pack's build can.

mod key;
mod pack;
mod verify;
mod wishes;

pub use key::{AuditKey, make_key, read_public_key};
pub use pack::{Pack, PackedVolumes, pack};
pub use verify::{Finding, Judgement, Verification, verify};

use crate::report::ReportError;
use crate::survey::SurveyError;
use std::path::{Path, PathBuf};

/// The list of sums.
pub const SUMS: &str = crate::report::SUMS;
/// Its signature.
pub const SIGNATURE: &str = "SHA256SUMS.minisig";
/// The public key in a pack.
pub const PUBLIC_KEY: &str = "stockpilot.pub";
/// The volumes in a pack.
pub const VOLUMES: &str = "volumes.json";
/// The configuration in a pack.
pub const CONFIG: &str = "config.toml";
/// What the report was asked for.
pub const WISHES: &str = "wishes.json";
/// The log of the earlier survey.
pub const EARLIER: &str = "earlier.mcap";
/// The commands in a pack.
pub const RECOMPUTE: &str = "RECOMPUTE.txt";

/// Why a pack cannot be made or read.
#[derive(Debug, thiserror::Error)]
pub enum AuditError {
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The secret key may be read by others.
    #[error("the key {} has mode {mode:03o}: take it from others with `chmod 600`", path.display())]
    SharedKey {
        /// Which file.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// A key or a signature is none, or signing fails.
    #[error("{what}: {cause}")]
    Minisign {
        /// What was done.
        what: String,
        /// Why it failed.
        cause: String,
    },
    /// The log cannot be read.
    #[error(transparent)]
    Survey(#[from] SurveyError),
    /// The report cannot be made.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// Volumes or wishes are no JSON.
    #[error("{VOLUMES}, {WISHES}: {0}")]
    Json(#[from] serde_json::Error),
    /// The log has a name that the pack needs for something else.
    #[error("the log cannot be packed as {name:?}: give it another name")]
    Name {
        /// Which.
        name: String,
    },
    /// This build does not compute the volumes that the log records.
    #[error(
        "this build does not compute the recorded volumes again to the last bit, so nobody could check \
         the pack: use the build that flew ({flown_with})"
    )]
    NotReproduced {
        /// The build in the log.
        flown_with: String,
    },
    /// The log is not what the report was made of.
    #[error("{} is being written: pack it when the service has ended", path.display())]
    Growing {
        /// Which.
        path: PathBuf,
    },
    /// A merged survey has no events to compute from.
    #[error("the survey was merged from other logs: pack each of them")]
    Merged,
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> AuditError + '_ {
    |source| AuditError::File { path: path.to_owned(), source }
}

fn minisign_error(what: impl Into<String>) -> impl FnOnce(minisign::PError) -> AuditError {
    let what = what.into();
    |cause| AuditError::Minisign { what, cause: cause.to_string() }
}

#[cfg(test)]
mod tests;
