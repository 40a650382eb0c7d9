//! Waypoints from a program outside: what it is asked with, and what is believed of its answer.
//!
//! The program itself is started by the shell; here is what does no I/O. An answer is taken as a whole or
//! not at all: places are finite and in free space, the legs between them as well, each no longer than a
//! step when it is flown, no more waypoints than were asked for, and the battery lasts for all of them and
//! the way home. What stands between two waypoints is led around, as for every other planner.

use super::Waypoint;
use super::planner::{Plan, PlanEnd, PlanRequest};
use super::way::way;
use crate::units::wrapped_rad;
use std::time::Duration;

/// How the program is asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExternalSettings {
    /// The program and its arguments; no shell stands between.
    pub command: Vec<String>,
    /// It is ended if it has not answered by then.
    pub time_limit: Duration,
}

/// What the program answered.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Where to go behind the pending waypoints, in order.
    pub waypoints: Vec<Waypoint>,
    /// Nothing more is wished for behind these; otherwise the program is asked again.
    pub is_complete: bool,
}

/// Why an answer is not flown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// It asks for nothing and does not say that this is all.
    #[error("no waypoint, and not complete")]
    Nothing,
    /// More waypoints than were asked for, ways between them included.
    #[error("{got} waypoints, at most {most} were asked for")]
    TooMany {
        /// Waypoints of the answer in steps.
        got: usize,
        /// What was asked for.
        most: usize,
    },
    /// A number is infinite or none.
    #[error("waypoint {index} is no place")]
    NotFinite {
        /// Counted from 0.
        index: usize,
    },
    /// The vehicle may not be there, or would not know where it is.
    #[error("waypoint {index} is not in free space")]
    NotFree {
        /// Counted from 0.
        index: usize,
    },
    /// There is no free way from the waypoint before.
    #[error("no free way to waypoint {index}")]
    NoWay {
        /// Counted from 0.
        index: usize,
    },
    /// The battery does not last for it and the way home.
    #[error("{needed_m:.1} m with the way home, the battery lasts for {longest_m:.1} m")]
    TooLong {
        /// Metres of the plan and the way home.
        needed_m: f64,
        /// Metres that may be flown.
        longest_m: f64,
    },
}

/// The plan of an answer, in steps as they are flown.
///
/// # Errors
/// The first reason not to fly it.
pub fn admitted(request: &PlanRequest, proposal: &Proposal) -> Result<Plan, Refusal> {
    let most = request.n_waypoints;
    let n_proposed = proposal.waypoints.len();
    if n_proposed > most {
        return Err(Refusal::TooMany { got: n_proposed, most });
    }
    if n_proposed == 0 && !proposal.is_complete {
        return Err(Refusal::Nothing);
    }
    let Some(start) = request.pending.last() else { return Err(Refusal::NoWay { index: 0 }) };
    let (mut from, mut length_m) = (*start, 0.0);
    let mut waypoints: Vec<Waypoint> = Vec::new();
    for (index, to) in proposal.waypoints.iter().enumerate() {
        if !is_finite(to) {
            return Err(Refusal::NotFinite { index });
        }
        let to = &Waypoint { yaw_rad: wrapped_rad(to.yaw_rad), ..*to };
        if !request.free_space.is_free(to) {
            return Err(Refusal::NotFree { index });
        }
        let corners = way(&request.free_space, &from, to).ok_or(Refusal::NoWay { index })?;
        for corner in &corners {
            length_m += from.distance_m(corner);
            waypoints.extend(from.steps_to(corner, request.settings.step_radius_m));
            from = *corner;
        }
        if waypoints.len() > most {
            return Err(Refusal::TooMany { got: waypoints.len(), most });
        }
    }
    let home_m = request.over_home.map_or(0.0, |home| (home - from.place).coords.norm());
    let needed_m = length_m + home_m;
    match request.longest_m {
        Some(longest_m) if needed_m > longest_m && !waypoints.is_empty() => {
            Err(Refusal::TooLong { needed_m, longest_m })
        }
        _ => {
            let end = if proposal.is_complete { PlanEnd::Complete } else { PlanEnd::Open };
            Ok(Plan { waypoints, end, prediction: None })
        }
    }
}

fn is_finite(waypoint: &Waypoint) -> bool {
    waypoint.place.coords.iter().all(|x| x.is_finite()) && waypoint.yaw_rad.is_finite()
}

#[cfg(test)]
mod tests;
