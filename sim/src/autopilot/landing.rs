//! Tells ground from air.

use stockpilot::time::{Boot, Stamp};

/// Time that all signs of the ground must last, s.
const LANDED_AFTER_S: f64 = 0.9;
/// Time that the lift must last to count as flight, s.
const AIRBORNE_AFTER_S: f64 = 0.2;

/// The signs that are looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signs {
    pub(super) is_armed: bool,
    /// Collective thrust over that of hovering.
    pub(super) thrust_ratio: f64,
    /// Wanted velocity downwards, m/s.
    pub(super) sink_wanted_mps: f64,
    /// Believed velocity downwards, m/s.
    pub(super) sink_mps: f64,
}

/// The land detector.
#[derive(Debug, Clone, Copy)]
pub(super) struct LandDetector {
    is_landed: bool,
    since: Option<Stamp<Boot>>,
    became_at: Stamp<Boot>,
}

/// A change of the land detector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LandEvent {
    TookOff,
    Landed,
}

impl LandDetector {
    pub(super) const fn new() -> Self {
        Self { is_landed: true, since: None, became_at: Stamp::ZERO }
    }

    pub(super) const fn is_landed(&self) -> bool {
        self.is_landed
    }

    /// When the state last changed.
    pub(super) const fn became_at(&self) -> Stamp<Boot> {
        self.became_at
    }

    /// Looks at the signs; says if the state changed.
    pub(super) fn step(&mut self, now: Stamp<Boot>, signs: &Signs) -> Option<LandEvent> {
        let (shows_change, after_s) = if self.is_landed {
            (signs.is_armed && signs.thrust_ratio > 0.9, AIRBORNE_AFTER_S)
        } else {
            let stands = signs.sink_wanted_mps > 0.25 && signs.sink_mps.abs() < 0.15;
            (!signs.is_armed || (stands && signs.thrust_ratio < 0.95), LANDED_AFTER_S)
        };
        if !shows_change {
            self.since = None;
            return None;
        }
        let since = *self.since.get_or_insert(now);
        if now.seconds_since(since) < after_s {
            return None;
        }
        self.since = None;
        self.is_landed = !self.is_landed;
        self.became_at = now;
        Some(if self.is_landed { LandEvent::Landed } else { LandEvent::TookOff })
    }
}
