//! Phases of a flight and what leads from one to the next: a pure transition machine.
//!
//! ```text
//!        start, fly gaps      armed          at height         plan done       over the pad
//!   Idle ──▶ Preflight ──▶ TakeOff ──▶ Survey ──────▶ Return ──────▶ Land ──▶ Idle
//!                             │          ▲ │             │             ▲
//!                             └─────▶ Hold ◀┴────────────┘  fix lost ──┘
//!   any phase in the air, mode or arming changed by somebody else ──▶ Abort ──▶ Idle
//! ```
//!
//! Not done here: setpoints (the pilot derives them from the phase), measuring, planning.

mod decision;
mod energy;
mod guards;
mod machine;

pub use decision::{Effect, Inputs};
pub use energy::EnergyGauge;
pub use guards::{PreflightCheck, PreflightFault, Settings};
pub use machine::Mission;

/// Where a flight stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// On the ground, nothing asked for.
    Idle,
    /// On the ground, checking and arming.
    Preflight,
    /// Climbing over the pad.
    TakeOff,
    /// Measuring.
    Survey,
    /// Flying back to the pad.
    Return,
    /// Descending onto the pad or where it is.
    Land,
    /// Keeping the place; a person or a recovered sensor decides what next.
    Hold,
    /// The companion has let go: pilot, autopilot failsafe or an unrecoverable fault.
    Abort,
}

impl Phase {
    /// A short word for people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Preflight => "preflight",
            Self::TakeOff => "take-off",
            Self::Survey => "survey",
            Self::Return => "return",
            Self::Land => "land",
            Self::Hold => "hold",
            Self::Abort => "abort",
        }
    }

    /// True while the companion's setpoints move the vehicle, or are about to.
    #[must_use]
    pub const fn is_steering(self) -> bool {
        matches!(self, Self::Preflight | Self::TakeOff | Self::Survey | Self::Return | Self::Hold)
    }
}
