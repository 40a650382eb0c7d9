//! `ArduCopter`'s flight modes and their numbers in HEARTBEAT.

/// A flight mode of `ArduCopter`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ApMode {
    /// Sticks steer the tilt, throttle the lift.
    Stabilize,
    /// Sticks steer the tilt, the height is held.
    AltHold,
    /// Flies a mission; this stub has none and holds its place.
    Auto,
    /// Follows the companion.
    Guided,
    /// Sticks steer velocity; centred, it holds its place.
    Loiter,
    /// Returns home and lands.
    Rtl,
    /// Lands where it is.
    Land,
    /// Stops and holds its place, sticks ignored.
    Brake,
}

const NUMBERS: [(ApMode, u32, &str); 8] = [
    (ApMode::Stabilize, 0, "STABILIZE"),
    (ApMode::AltHold, 2, "ALT_HOLD"),
    (ApMode::Auto, 3, "AUTO"),
    (ApMode::Guided, 4, "GUIDED"),
    (ApMode::Loiter, 5, "LOITER"),
    (ApMode::Rtl, 6, "RTL"),
    (ApMode::Land, 9, "LAND"),
    (ApMode::Brake, 17, "BRAKE"),
];

impl ApMode {
    /// `custom_mode` of HEARTBEAT.
    #[must_use]
    pub fn custom_mode(self) -> u32 {
        NUMBERS.iter().find(|(mode, ..)| *mode == self).map_or(0, |(_, number, _)| *number)
    }

    /// The mode with this number.
    pub(super) fn numbered(number: u32) -> Option<Self> {
        NUMBERS.iter().find(|(_, known, _)| *known == number).map(|(mode, ..)| *mode)
    }

    /// The name in the autopilot's texts.
    pub(super) fn name(self) -> &'static str {
        NUMBERS.iter().find(|(mode, ..)| *mode == self).map_or("?", |(.., name)| *name)
    }

    /// The mode cannot be entered in the air, nor armed in, without a position.
    pub(super) const fn needs_position(self) -> bool {
        matches!(self, Self::Auto | Self::Guided | Self::Loiter | Self::Rtl | Self::Brake)
    }

    /// The motors may be armed in this mode by a message.
    pub(super) const fn is_armable(self) -> bool {
        !matches!(self, Self::Rtl | Self::Land | Self::Brake)
    }

    /// The position controller flies: bit 0x08 of `base_mode`.
    pub(super) const fn is_guided_bit(self) -> bool {
        matches!(
            self,
            Self::Auto | Self::Guided | Self::Loiter | Self::Rtl | Self::Land | Self::Brake
        )
    }
}
