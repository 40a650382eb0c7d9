//! `stockpilot prior`: what flights say about the numbers of the field.

use super::merge::{MergeLogsError, MergeOptions, join};
use crate::mapping::{SolveError, SolveSurface};
use std::path::PathBuf;

/// The numbers of the field's prior, as `[surface.field]` names them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldNumbers {
    /// Practical range of the heights, m.
    pub range_m: f64,
    /// Standard deviation of the heights about their level, m.
    pub sigma_m: f64,
    /// Standard deviation of the roughness below the cell size, m.
    pub nugget_m: f64,
}

/// What was configured beside what is likeliest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedPrior {
    /// As the flights were flown with.
    pub configured: FieldNumbers,
    /// Under which their heights are most likely.
    pub found: FieldNumbers,
}

/// The likeliest prior for the flights of these logs; `None` if their surface was no field.
///
/// # Errors
/// As [`merge_logs`](super::merge_logs).
pub fn learn_prior(
    logs: &[PathBuf],
    options: MergeOptions,
) -> Result<Option<LearnedPrior>, MergeLogsError> {
    let mut joined = join(logs, options)?;
    let solved = joined.mapper.snapshot(joined.at, true).run()?;
    joined.mapper.absorb(&solved);
    let SolveSurface::MaternField(field) = joined.mapper.snapshot(joined.at, true) else {
        return Ok(None);
    };
    let found = field.learn_prior().map_err(SolveError::from)?;
    let configured = &joined.mapper.settings().field;
    Ok(Some(LearnedPrior {
        configured: FieldNumbers {
            range_m: configured.range_m,
            sigma_m: configured.sigma_m,
            nugget_m: configured.nugget_m,
        },
        found: FieldNumbers {
            range_m: found.range_m,
            sigma_m: found.sigma_m,
            nugget_m: found.nugget_m,
        },
    }))
}
