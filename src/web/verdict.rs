//! What people decide of a flight before anybody leaves.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Verdict {
    /// It counts.
    Accepted,
    /// It does not.
    Rejected,
}
