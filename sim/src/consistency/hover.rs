//! The whole chain for a long time: one flight that hovers, with a battery that does not drain.

use super::flight::{FlightPlan, FlownFlight, Look, direct_flight, look_at};
use super::summary::SettingReport;
use crate::campaign::DirectFlight;
use crate::scenario::Scenario;
use anyhow::bail;
use mavlink::dialects::ardupilotmega::MavCmd;
use serde::Serialize;
use std::fmt;
use std::time::Duration;
use stockpilot::mission::Phase;
use stockpilot::time::Stamp;

/// Memory is compared with that of this much of flight, when all buffers have their size.
const SETTLED_AFTER: Duration = Duration::from_secs(300);
/// Longest time from the start to the survey.
const LONGEST_START: Duration = Duration::from_secs(60);
/// The hold begins this long after the survey's start.
const SURVEY_FOR: Duration = Duration::from_secs(3);
/// The belief is looked at this often, and the battery filled.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// The end of the flight that is judged by itself.
const LAST_MINUTES: f64 = 300.0;

/// What a long hover showed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HoverReport {
    /// Time flown, s.
    pub flown_s: f64,
    /// Still in the hold at the end.
    pub is_holding: bool,
    /// Mean NEES of position, attitude, velocity over the whole hover.
    pub nees_mean: [f64; 3],
    /// The same over the last five minutes.
    pub nees_mean_at_end: [f64; 3],
    /// Root mean square of the position error, m.
    pub position_rms_m: f64,
    /// The largest position error, m.
    pub position_max_m: f64,
    /// Memory of the process after five minutes of flight, kB; 0 where the system does not tell.
    pub resident_settled_kb: u64,
    /// Memory of the process at the end, kB.
    pub resident_end_kb: u64,
}

impl fmt::Display for HoverReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [p, a, v] = self.nees_mean;
        let [pe, ae, ve] = self.nees_mean_at_end;
        writeln!(f, "hovered {:.0} s, holding at the end: {}", self.flown_s, self.is_holding)?;
        writeln!(f, "NEES position {p:.2}, attitude {a:.2}, velocity {v:.2}")?;
        writeln!(f, "in the last 300 s    {pe:.2}          {ae:.2}          {ve:.2}")?;
        writeln!(
            f,
            "position rms {:.1} mm, largest {:.1} mm",
            1000.0 * self.position_rms_m,
            1000.0 * self.position_max_m
        )?;
        write!(
            f,
            "memory {} kB after 300 s, {} kB at the end",
            self.resident_settled_kb, self.resident_end_kb
        )
    }
}

/// Takes off, holds until `span` has passed since the simulation's start, and looks.
///
/// # Errors
/// A configuration that does not fit, or a flight that does not reach its survey.
pub fn hover(
    scenario: &Scenario,
    plan: &FlightPlan,
    span: Duration,
) -> anyhow::Result<HoverReport> {
    let mut flight = direct_flight(scenario, plan)?;
    run_until(&mut flight, LONGEST_START, |f| f.phase() == Phase::Survey);
    if flight.phase() != Phase::Survey {
        bail!("no survey after {LONGEST_START:?}; last words: {:?}", flight.texts());
    }
    let hold_at = flight.rig.now().plus(SURVEY_FOR).seconds();
    run_until(&mut flight, Duration::from_secs_f64(hold_at), |_| false);
    flight.operator_mut().ask(MavCmd::MAV_CMD_USER_2);

    let mut looks = Vec::new();
    let mut resident_settled_kb = 0;
    let mut next_look = Duration::from_secs_f64(hold_at);
    while next_look < span {
        next_look += LOOK_EVERY;
        run_until(&mut flight, next_look, |_| false);
        flight.rig.vehicle_mut().battery_mut().set_charge_ratio(1.0);
        looks.extend(look_at(&flight).map(|look| Look { is_flying: true, n_tags: 4, ..look }));
        if next_look <= SETTLED_AFTER {
            resident_settled_kb = resident_kb();
        }
    }
    Ok(report(&flight, looks, resident_settled_kb))
}

fn run_until(flight: &mut DirectFlight, until: Duration, done: impl Fn(&DirectFlight) -> bool) {
    while flight.rig.now() < Stamp::ZERO.plus(until) && !done(flight) {
        flight.step(&mut |_, _| {});
    }
}

fn report(flight: &DirectFlight, looks: Vec<Look>, resident_settled_kb: u64) -> HoverReport {
    let flown_s = flight.rig.now().seconds();
    let sum_up = |looks: Vec<Look>| {
        let flown = FlownFlight { looks, ..FlownFlight::default() };
        let report = SettingReport::new(0, "", "", &[flown]);
        let groups = report.groups;
        let means = [groups.position, groups.attitude, groups.velocity].map(|g| g.nees_mean);
        (means, report.position_rms_m)
    };
    let at_end = looks.iter().filter(|look| look.at_s >= flown_s - LAST_MINUTES).copied();
    let (nees_mean_at_end, _) = sum_up(at_end.collect());
    let position_max_m = looks.iter().map(|look| look.position_error_m).fold(0.0, f64::max);
    let (nees_mean, position_rms_m) = sum_up(looks);
    HoverReport {
        flown_s,
        is_holding: flight.phase() == Phase::Hold,
        nees_mean,
        nees_mean_at_end,
        position_rms_m,
        position_max_m,
        resident_settled_kb,
        resident_end_kb: resident_kb(),
    }
}

/// Resident memory of this process as Linux tells it, kB; 0 if it does not.
fn resident_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}
