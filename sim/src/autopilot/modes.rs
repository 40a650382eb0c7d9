//! Flight modes and their numbers in HEARTBEAT.

/// A flight mode of PX4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Px4Mode {
    /// Sticks steer the attitude rates through a mixer.
    Manual,
    /// Sticks steer tilt and climb.
    Altitude,
    /// Sticks steer velocity.
    Position,
    /// Climbs to the take-off altitude.
    TakeOff,
    /// Holds its place.
    Loiter,
    /// Flies a mission; this stub has none and holds its place.
    Mission,
    /// Returns home and lands.
    Return,
    /// Lands where it is.
    Land,
    /// Sticks steer the rates.
    Acro,
    /// Follows the setpoints of the companion.
    Offboard,
    /// Sticks steer the tilt.
    Stabilized,
    /// Motors stop for good.
    Termination,
}

/// Every mode with its main and sub number.
const NUMBERS: [(Px4Mode, u8, u8); 12] = [
    (Px4Mode::Manual, 1, 0),
    (Px4Mode::Altitude, 2, 0),
    (Px4Mode::Position, 3, 0),
    (Px4Mode::TakeOff, 4, 2),
    (Px4Mode::Loiter, 4, 3),
    (Px4Mode::Mission, 4, 4),
    (Px4Mode::Return, 4, 5),
    (Px4Mode::Land, 4, 6),
    (Px4Mode::Acro, 5, 0),
    (Px4Mode::Offboard, 6, 0),
    (Px4Mode::Stabilized, 7, 0),
    (Px4Mode::Termination, 10, 0),
];

/// What a pair of mode numbers asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ModeRequest {
    Known(Px4Mode),
    /// A sub-mode of AUTO that does not exist.
    UnknownAuto,
    /// A main mode that does not exist; PX4 says yes and ignores it.
    UnknownMain,
}

impl Px4Mode {
    /// `custom_mode` of HEARTBEAT: main « 16 | sub « 24.
    #[must_use]
    pub fn custom_mode(self) -> u32 {
        NUMBERS
            .iter()
            .find(|(mode, _, _)| *mode == self)
            .map_or(0, |(_, main, sub)| (u32::from(*main) << 16) | (u32::from(*sub) << 24))
    }

    pub(super) fn requested(main: u8, sub: u8) -> ModeRequest {
        let found = NUMBERS.iter().find(|(_, m, s)| *m == main && (main != 4 || *s == sub));
        match found {
            Some((mode, _, _)) => ModeRequest::Known(*mode),
            None if main == 4 => ModeRequest::UnknownAuto,
            None => ModeRequest::UnknownMain,
        }
    }

    /// The name in PX4's texts.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Manual => "Manual",
            Self::Altitude => "Altitude",
            Self::Position => "Position",
            Self::TakeOff => "Takeoff",
            Self::Loiter => "Hold",
            Self::Mission => "Mission",
            Self::Return => "Return",
            Self::Land => "Land",
            Self::Acro => "Acro",
            Self::Offboard => "Offboard",
            Self::Stabilized => "Stabilized",
            Self::Termination => "Termination",
        }
    }

    /// One of the AUTO modes.
    pub(super) const fn is_auto(self) -> bool {
        matches!(self, Self::TakeOff | Self::Loiter | Self::Mission | Self::Return | Self::Land)
    }

    /// The mode cannot run without a global position.
    pub(super) const fn needs_global_position(self) -> bool {
        matches!(self, Self::Loiter | Self::Mission | Self::Return)
    }

    /// The mode cannot run without a local position.
    pub(super) const fn needs_local_position(self) -> bool {
        matches!(self, Self::Position | Self::TakeOff | Self::Land | Self::Offboard)
            || self.needs_global_position()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_seen_on_px4() {
        assert_eq!(Px4Mode::Position.custom_mode(), 0x0003_0000);
        assert_eq!(Px4Mode::TakeOff.custom_mode(), 0x0204_0000);
        assert_eq!(Px4Mode::Loiter.custom_mode(), 0x0304_0000);
        assert_eq!(Px4Mode::Return.custom_mode(), 0x0504_0000);
        assert_eq!(Px4Mode::Land.custom_mode(), 0x0604_0000);
        assert_eq!(Px4Mode::Offboard.custom_mode(), 0x0006_0000);
        assert_eq!(Px4Mode::requested(4, 99), ModeRequest::UnknownAuto);
        assert_eq!(Px4Mode::requested(77, 0), ModeRequest::UnknownMain);
        assert_eq!(Px4Mode::requested(6, 0), ModeRequest::Known(Px4Mode::Offboard));
    }
}
