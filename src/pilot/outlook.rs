//! Where the flight stands and how far it still reaches, for displays.

use super::{OfferedGap, Pilot};
use crate::messages::{BatterySample, HitCounts, NavEstimate, StorageState, VehicleState};
use crate::mission::{Phase, PreflightCheck};
use crate::planning::free_space::FreeSpace;
use crate::time::{Mono, Stamp};
use std::sync::Arc;

/// What the brain knows of the flight beside its maps; nothing rests on it.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of one instant")]
pub struct Outlook {
    /// When it was looked at.
    pub at: Stamp<Mono>,
    /// Where the flight stands.
    pub phase: Phase,
    /// The list that is gone through before the motors turn, with what was measured.
    pub checks: Vec<PreflightCheck>,
    /// The own pose can be flown on.
    pub has_position: bool,
    /// Distance between where the autopilot and where the companion believes to be, m.
    pub disagreement_m: Option<f64>,
    /// Beams arrive.
    pub has_lidar: bool,
    /// The newest belief, whether it can be flown on or not.
    pub estimate: Option<NavEstimate>,
    /// The autopilot's last word.
    pub vehicle: Option<VehicleState>,
    /// The autopilot has been silent for too long.
    pub is_autopilot_lost: bool,
    /// The last word on the battery, however old.
    pub battery: Option<BatterySample>,
    /// Charge at which the vehicle turns home by itself, 0 to 1.
    pub turns_home_at_ratio: f64,
    /// Time until then at the consumption so far, s; `None` while that is not known.
    pub until_turn_home_s: Option<f64>,
    /// Charge for the way home and the landing, 0 to 1; `None` while that is not known.
    pub way_home_ratio: Option<f64>,
    /// Waypoints reached so far.
    pub steps_done: usize,
    /// The waypoints ahead, m; x, y, z.
    pub ahead_m: Vec<[f64; 3]>,
    /// Length of the commanded path so far, m.
    pub flown_m: f64,
    /// Where the beams went so far.
    pub hits: HitCounts,
    /// The last word on the disk with the log.
    pub storage: Option<StorageState>,
    /// What the last flight has left out, the largest share of the variance first; empty before its end.
    pub gaps: Arc<[OfferedGap]>,
    /// The present flight, or the last one, goes on with the survey before it.
    pub is_into_gaps: bool,
}

impl Pilot {
    /// Looks at where the flight stands. It changes nothing and costs some microseconds.
    #[must_use]
    pub fn outlook(&self) -> Outlook {
        let inputs = self.mission_inputs();
        let turns_home_at_ratio = self.mission.turns_home_at_ratio(&inputs);
        let ahead = self.route.plan.ahead();
        Outlook {
            at: self.now,
            phase: self.mission.phase(),
            checks: self.mission.preflight_checks(&inputs),
            has_position: inputs.has_position,
            disagreement_m: inputs.disagreement_m,
            has_lidar: inputs.has_lidar,
            estimate: self.localizer.estimate().filter(NavEstimate::is_finite),
            vehicle: self.vehicle,
            is_autopilot_lost: self.is_autopilot_lost,
            battery: self.battery,
            turns_home_at_ratio,
            until_turn_home_s: self.energy.seconds_until(turns_home_at_ratio),
            way_home_ratio: inputs.way_home_ratio,
            steps_done: self.route.plan.steps_done(),
            ahead_m: ahead.iter().map(|waypoint| waypoint.place.coords.into()).collect(),
            flown_m: self.flown.length_m,
            hits: self.mapper.counts(),
            storage: self.storage,
            gaps: self.gaps.gaps(),
            is_into_gaps: self.mission.is_into_gaps(),
        }
    }

    /// Where a fix is good enough and nothing stands in the way, as it was evaluated at the start.
    #[must_use]
    pub fn free_space(&self) -> Arc<FreeSpace> {
        self.route.plan.free_space()
    }
}
