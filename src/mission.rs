//! Phases of a flight and what leads from one to the next.

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
    /// Keeping the place; a person decides what next.
    Hold,
    /// The companion has let go: pilot, autopilot failsafe or an unrecoverable fault.
    Abort,
}
