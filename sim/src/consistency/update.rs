//! Which of the filter's updates flies.

use anyhow::Context;
use clap::ValueEnum;
use stockpilot::config::FilterSection;

/// How a frame of tags enters the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Update {
    /// One 6-dof pose a frame.
    Loose,
    /// Each corner by itself.
    Tight,
}

impl Update {
    /// The name in the configuration and in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Loose => "loose",
            Self::Tight => "tight",
        }
    }
}

/// The filter's settings with this update.
///
/// # Errors
/// A filter that has only the loose update cannot be told another.
pub fn with_update(filter: &FilterSection, update: Update) -> anyhow::Result<FilterSection> {
    let mut value = serde_json::to_value(filter)?;
    let has_choice = value.get("update").is_some();
    if !has_choice && update == Update::Loose {
        return Ok(filter.clone());
    }
    value["update"] = update.name().into();
    serde_json::from_value(value).context("the filter has no such update")
}
