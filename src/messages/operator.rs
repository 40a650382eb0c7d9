//! Talk with the people at the ground station.

use crate::time::{Mono, Stamp};

/// What a person may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum OperatorVerb {
    /// Begin a survey from the ground.
    Start,
    /// Begin another flight of the same survey from the ground, into its gaps: the map is kept.
    FlyGaps,
    /// Stop and keep the place.
    Hold,
    /// Go on after a hold.
    Resume,
    /// Fly back to the pad and land.
    Return,
    /// Land here.
    Land,
}

impl OperatorVerb {
    /// Motors begin to turn.
    #[must_use]
    pub const fn is_start(self) -> bool {
        matches!(self, Self::Start | Self::FlyGaps)
    }
}

/// Who asked, so that the answer finds its way back. MAVLink system and component id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct OperatorRequest {
    /// MAVLink system id of the requester.
    pub system: u8,
    /// MAVLink component id of the requester.
    pub component: u8,
}

/// A person's wish, as it arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OperatorCommand {
    /// When it arrived.
    pub at: Stamp<Mono>,
    /// What is wanted.
    pub verb: OperatorVerb,
    /// Who wants it.
    pub from: OperatorRequest,
}

/// What became of a person's wish.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OperatorAnswer {
    /// What was wanted.
    pub verb: OperatorVerb,
    /// Who wanted it.
    pub to: OperatorRequest,
    /// True if it is done or under way already; false if it makes no sense now.
    pub is_accepted: bool,
}

/// What a named person says before the motors turn: that nobody is in the hall, that the remote control is at hand
/// and tried, that machines, doors and fans are as in the last survey, and that the hall is no dust zone or released.
/// Whoever does not say all four of them does not start from the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Declaration {
    /// The start that it was said for.
    pub verb: OperatorVerb,
    /// Who says so, as typed.
    pub by: String,
}

/// How urgent a text is, as in syslog.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The flight is affected.
    Critical,
    /// Something failed.
    Error,
    /// Degraded but flying.
    Warning,
    /// Worth knowing.
    Notice,
    /// Progress.
    Info,
}

/// One line for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatusText {
    /// How urgent.
    pub severity: Severity,
    /// The line, without a line break.
    pub text: String,
}
