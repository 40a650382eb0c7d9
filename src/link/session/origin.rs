//! The origin of the autopilot's map: set where it is needed, put level where it is dangerous.
//!
//! Nobody indoors knows where on the globe the hall stands, and nothing here depends on it: the
//! numbers of the local frame stay what they are. `ArduPilot` does not arm without an origin. PX4
//! needs none, but if somebody has set one at an altitude other than 0, its v1.16.1 takes that
//! altitude for a height in the hall when vision comes back after a gap, and climbs away.

#![expect(deprecated, reason = "both families still listen to SET_GPS_GLOBAL_ORIGIN")]

use crate::link::AUTOPILOT_COMPONENT;
use crate::link::dialect::Dialect;
use crate::time::{Mono, Stamp};
use mavlink::MessageData as _;
use mavlink::dialects::ardupilotmega::{
    COMMAND_LONG_DATA, GPS_GLOBAL_ORIGIN_DATA, MavCmd, MavMessage, SET_GPS_GLOBAL_ORIGIN_DATA,
};
use std::time::Duration;

/// Where the map is said to lie if nobody said otherwise: in Zürich, as PX4's simulator.
const LATITUDE_DEG_E7: i32 = 473_977_418;
const LONGITUDE_DEG_E7: i32 = 85_455_939;

/// Pause between requests while an origin is needed.
const NEEDED_EVERY: Duration = Duration::from_secs(2);
/// Pause between looks at an origin that somebody may change.
const WATCHED_EVERY: Duration = Duration::from_secs(5);

/// What is known of the origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Origin {
    is_known: bool,
    asked_at: Option<Stamp<Mono>>,
    n_asked: u32,
}

impl Origin {
    pub(super) const fn new() -> Self {
        Self { is_known: false, asked_at: None, n_asked: 0 }
    }

    /// Asks for the origin, and sets one where the question stays unanswered and it is needed.
    pub(super) fn on_time(
        &mut self,
        dialect: Dialect,
        target_system: u8,
        now: Stamp<Mono>,
        messages: &mut Vec<MavMessage>,
    ) {
        let needs_one = dialect.needs_origin() && !self.is_known;
        if !needs_one && !dialect.needs_level_origin() {
            return;
        }
        let every = if needs_one { NEEDED_EVERY } else { WATCHED_EVERY };
        if self.asked_at.is_some_and(|at| now.since(at) < every) {
            return;
        }
        if needs_one && self.n_asked > 0 {
            messages.push(set(target_system, LATITUDE_DEG_E7, LONGITUDE_DEG_E7));
        }
        messages.push(request(target_system));
        self.asked_at = Some(now);
        self.n_asked = self.n_asked.saturating_add(1);
    }

    /// Takes in an origin; the message that puts it level, where its altitude is a danger.
    pub(super) fn on_heard(
        &mut self,
        data: &GPS_GLOBAL_ORIGIN_DATA,
        dialect: Dialect,
        target_system: u8,
    ) -> Option<MavMessage> {
        self.is_known = true;
        let is_dangerous = dialect.needs_level_origin() && data.altitude != 0;
        is_dangerous.then(|| set(target_system, data.latitude, data.longitude))
    }
}

fn set(target_system: u8, latitude: i32, longitude: i32) -> MavMessage {
    MavMessage::SET_GPS_GLOBAL_ORIGIN(SET_GPS_GLOBAL_ORIGIN_DATA {
        latitude,
        longitude,
        altitude: 0,
        target_system,
        time_usec: 0,
    })
}

#[expect(clippy::cast_precision_loss, reason = "MAVLink carries a message's id as f32")]
fn request(target_system: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1: GPS_GLOBAL_ORIGIN_DATA::ID as f32,
        command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
        target_system,
        target_component: AUTOPILOT_COMPONENT,
        ..Default::default()
    })
}
