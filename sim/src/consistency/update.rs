//! Which of the filter's updates flies.

use clap::ValueEnum;
use stockpilot::config::{FilterSection, UpdateName};

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
#[must_use]
pub fn with_update(filter: &FilterSection, update: Update) -> FilterSection {
    let update = match update {
        Update::Loose => UpdateName::Loose,
        Update::Tight => UpdateName::Tight,
    };
    FilterSection { update, ..filter.clone() }
}
