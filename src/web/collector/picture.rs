//! The picture of a moment.

use super::Collector;
use crate::camera::CameraStats;
use crate::lidar::{LidarHealth, LidarStatus};
use crate::mapping::statement::{COVERAGE_FACTOR, Statement};
use crate::messages::{FlightMode, Room, VolumeAccount};
use crate::mission::Phase;
use crate::pilot::{OfferedGap, Outlook};
use crate::planning::planner::PlanEnd;
use crate::web::advice;
use crate::web::state::{
    Battery, Camera, Check, Computer, Fix, Gap, Level, Lidar, Link, Pose, Review, Source, State,
    Target, Viewers, Volume,
};
use std::time::Duration;
use tokio::time::Instant;

/// A brain that is silent for longer is told.
const BRAIN_SILENT_AFTER: Duration = Duration::from_secs(1);
/// U that changes by less than this share stays the same for people.
const STEADY_RATIO: f64 = 0.02;
/// Sources that are shown.
const SOURCES_SHOWN: usize = 4;
/// Position σ from which on a fix is worth a look, m.
const SIGMA_DEGRADED_M: f64 = 0.1;
/// Smaller volumes have no percentage, m³.
const LEAST_VOLUME_M3: f64 = 1.0;
/// Lines that are shown.
const LINES_SHOWN: usize = 12;

/// What is known beside the brain's news.
#[derive(Debug, Clone)]
pub(in crate::web) struct Beside {
    pub(in crate::web) lidar: LidarStatus,
    pub(in crate::web) camera: CameraStats,
    pub(in crate::web) viewers: Viewers,
    pub(in crate::web) has_token: bool,
    pub(in crate::web) free_bytes: Option<u64>,
    pub(in crate::web) news_lost: u64,
    pub(in crate::web) now: Instant,
}

impl Collector {
    /// The picture.
    pub(in crate::web) fn picture(&self, beside: &Beside) -> State {
        let is_brain_alive =
            self.heard_at.is_some_and(|at| beside.now.duration_since(at) <= BRAIN_SILENT_AFTER);
        let outlook = self.outlook.as_ref();
        let phase = outlook.map_or(Phase::Idle, |outlook| outlook.phase);
        let at_s = outlook.map_or(0.0, |outlook| outlook.at.seconds());
        let mut state = State {
            seq: self.seq,
            at_s,
            version: env!("CARGO_PKG_VERSION"),
            is_brain_alive,
            phase: phase.name(),
            is_into_gaps: outlook.is_some_and(|outlook| outlook.is_into_gaps),
            phase_reason: self.phase_reason.clone(),
            flight_s: self.took_off_at.map(|from| {
                let end = self.landed_at.filter(|_| phase == Phase::Idle);
                end.map_or(at_s, |at| at.seconds()) - from.seconds()
            }),
            volumes: self.volumes(),
            is_final: self.ended.as_ref().is_some_and(|ended| ended.is_final),
            target: self.target(),
            steps: outlook.map_or([0; 2], |o| [o.steps_done, o.ahead_m.len()]),
            pose: outlook.and_then(pose),
            ahead_m: outlook.map_or_else(Vec::new, |o| o.ahead_m.clone()),
            fix: self.fix(),
            lidar: self.lidar(&beside.lidar),
            camera: self.camera(&beside.camera),
            battery: outlook.map_or_else(no_battery, battery),
            link: self.link(),
            computer: self.computer(beside),
            preflight: outlook.map_or_else(Vec::new, |o| o.checks.iter().map(check).collect()),
            warnings: Vec::new(),
            lines: self.lines.iter().rev().take(LINES_SHOWN).rev().cloned().collect(),
            review: self.review(),
            maps: self.maps.versions(),
            n_points: self.series.volume.len(),
            has_token: beside.has_token,
            viewers: beside.viewers,
        };
        state.warnings = advice::warnings(&state, phase);
        state
    }

    fn volumes(&self) -> Vec<Volume> {
        // With one bay the whole is told twice.
        let skip = usize::from(self.accounts.len() == 2);
        let shown = self.accounts.iter().enumerate().skip(skip);
        shown.filter_map(|(k, account)| volume(account, self.earlier_accounts.get(k))).collect()
    }

    fn target(&self) -> Target {
        let ends_survey = self.scene.target_sigma_ratio;
        let percent =
            ends_survey.map_or(self.target_percent, |ratio| 100.0 * COVERAGE_FACTOR * ratio);
        let now_percent = self.accounts.first().and_then(expanded_percent);
        let left_s = self.left_s();
        Target {
            percent,
            now_percent,
            ends_survey: ends_survey.is_some(),
            left_s,
            end_percent: left_s.and_then(|_| self.end_percent()),
        }
    }

    /// U of the whole at the end of the plan, % of the volume as it is now, from planners that know.
    fn end_percent(&self) -> Option<f64> {
        let sigma_end_m3 = self.plan.as_ref()?.prediction?.sigma_end_m3;
        let volume_m3 = self.accounts.first()?.estimate.volume_m3;
        (volume_m3 > LEAST_VOLUME_M3).then(|| 100.0 * COVERAGE_FACTOR * sigma_end_m3 / volume_m3)
    }

    /// Time for the way ahead at the pace of the survey so far; nothing where the plan is shorter than the survey.
    fn left_s(&self) -> Option<f64> {
        if !self.plan.as_ref().is_some_and(|plan| is_to_the_end(plan.end)) {
            return None;
        }
        let outlook = self.outlook.as_ref()?;
        if !matches!(outlook.phase, Phase::Survey | Phase::TakeOff | Phase::Hold) {
            return None;
        }
        let here = outlook.estimate.as_ref()?.hall_from_body.origin.coords.into();
        let stations = std::iter::once(&here).chain(&outlook.ahead_m);
        let legs = stations.zip(&outlook.ahead_m).map(|(a, b)| distance_m(a, b));
        let pace_mps = self.gauges.pace_mps.unwrap_or(0.7 * self.scene.max_speed_mps);
        (!outlook.ahead_m.is_empty()).then(|| legs.sum::<f64>() / pace_mps)
    }

    fn fix(&self) -> Fix {
        let newest = self.gauges.newest;
        let outlook = self.outlook.as_ref();
        let sigma_m = outlook.and_then(|o| o.estimate.as_ref()).map(|e| e.position_sigma_m());
        let largest_m = sigma_m.map_or(f64::INFINITY, |sigma_m| sigma_m.max());
        let level = match outlook {
            None => Level::Unknown,
            Some(outlook) if !outlook.has_position => Level::Bad,
            Some(_) if largest_m > SIGMA_DEGRADED_M => Level::Degraded,
            Some(_) => Level::Good,
        };
        Fix {
            level,
            markers: newest.map_or([0; 2], |fix| fix.markers),
            residual_px: newest.and_then(|fix| fix.residual_px),
            sigma_xy_m: sigma_m.map(|s| s.x.max(s.y)).filter(|s| s.is_finite()),
            sigma_z_m: sigma_m.map(|s| s.z).filter(|s| s.is_finite()),
            age_s: newest
                .and_then(|fix| fix.used_at)
                .zip(outlook)
                .map(|(at, outlook)| outlook.at.seconds_since(at).max(0.0)),
            used_ratio: self.gauges.frames().0,
        }
    }

    fn lidar(&self, status: &LidarStatus) -> Lidar {
        let (level, health) = match &status.health {
            LidarHealth::Starting => (Level::Unknown, "starting".to_owned()),
            LidarHealth::Streaming => (Level::Good, "measuring".to_owned()),
            LidarHealth::Silent => (Level::Bad, "silent".to_owned()),
            LidarHealth::NoFrames { baud } => {
                (Level::Bad, format!("nothing readable at {baud} baud"))
            }
            LidarHealth::Unknown { name, baud } => {
                (Level::Bad, format!("{name} answers at {baud} baud: set lidar.model"))
            }
            LidarHealth::Stalled => (Level::Bad, "its head stands still".to_owned()),
            LidarHealth::Faulty { reason } | LidarHealth::Disconnected { reason } => {
                (Level::Bad, reason.clone())
            }
            LidarHealth::Stopped => (Level::Bad, "stopped".to_owned()),
        };
        let dust_ratio = self.gauges.dust_ratio();
        let is_dusty = dust_ratio.is_some_and(|ratio| ratio > advice::DUSTY_RATIO);
        Lidar {
            level: if is_dusty { level.max(Level::Degraded) } else { level },
            health,
            turns_hz: status.rates.turns_hz,
            samples_hz: status.rates.samples_hz,
            return_ratio: self.gauges.return_ratio(),
            dust_ratio,
            lost_beams: status.stats.lost_beams,
        }
    }

    fn camera(&self, stats: &CameraStats) -> Camera {
        let frames_hz = self.gauges.frames().1;
        let level = match (stats.frames, frames_hz) {
            (0, _) => Level::Unknown,
            (_, hz) if hz < 1.0 => Level::Bad,
            (_, hz) if hz < 5.0 => Level::Degraded,
            _ => Level::Good,
        };
        let latency_s = self.gauges.newest.map(|fix| fix.latency_s);
        Camera { level, frames_hz, latency_s, refused: stats.refused }
    }

    fn link(&self) -> Link {
        let outlook = self.outlook.as_ref();
        let vehicle = outlook.and_then(|outlook| outlook.vehicle);
        let is_lost = outlook.is_some_and(|outlook| outlook.is_autopilot_lost);
        let missed_ratio = self.pulse.link.missed_ratio();
        let level = match vehicle {
            None => Level::Unknown,
            Some(_) if is_lost => Level::Bad,
            Some(vehicle) if vehicle.in_failsafe => Level::Bad,
            Some(_) if missed_ratio > 0.02 => Level::Degraded,
            Some(_) => Level::Good,
        };
        Link {
            level,
            mode: vehicle.map_or_else(|| "not heard".to_owned(), |v| mode_name(v.mode)),
            is_armed: vehicle.is_some_and(|vehicle| vehicle.is_armed),
            missed_ratio,
            disagreement_m: outlook.and_then(|outlook| outlook.disagreement_m),
            refused_frames: self.pulse.refused_frames,
        }
    }

    fn computer(&self, beside: &Beside) -> Computer {
        let pulse = &self.pulse;
        let other_lost =
            pulse.outgoing_lost + pulse.received_lost + pulse.jobs_failed + beside.news_lost;
        let storage = self.outlook.as_ref().and_then(|outlook| outlook.storage);
        let is_short = storage.is_some_and(|storage| storage.room != Room::Enough);
        let level = if self.outlook.is_none() {
            Level::Unknown
        } else if pulse.records_lost > 0 || !pulse.is_clock_known {
            Level::Bad
        } else if is_short || pulse.ticks_skipped + other_lost > 0 {
            Level::Degraded
        } else {
            Level::Good
        };
        Computer {
            level,
            is_clock_known: pulse.is_clock_known,
            ticks_skipped: pulse.ticks_skipped,
            records_lost: pulse.records_lost,
            other_lost,
            free_bytes: beside.free_bytes,
            is_disk_short: is_short,
            log: self.log.clone(),
        }
    }

    fn review(&self) -> Review {
        let Some(ended) = &self.ended else {
            return Review {
                is_due: false,
                verdict: None,
                is_complete: false,
                remarks: Vec::new(),
                gaps: Vec::new(),
            };
        };
        let volumes = self.volumes();
        Review {
            is_due: self.verdict.is_none(),
            verdict: self.verdict,
            is_complete: ended.is_complete,
            remarks: advice::remarks(ended.is_complete, &volumes, self.target().percent),
            gaps: self.outlook.as_ref().map_or_else(Vec::new, |o| o.gaps.iter().map(gap).collect()),
        }
    }
}

fn volume(account: &VolumeAccount, before: Option<&VolumeAccount>) -> Option<Volume> {
    let estimate = &account.estimate;
    let stated = Statement::of_volume(estimate.volume_m3, estimate.sigma_m3).ok()?;
    let digits = |s: &Statement| [s.value_digits().to_owned(), s.expanded_digits().to_owned()];
    let mass = account.mass.as_ref().and_then(|m| Statement::of_mass(m.mass_t, m.sigma_t).ok());
    let trend = before.map_or(0, |before| {
        let change = estimate.sigma_m3 / before.estimate.sigma_m3 - 1.0;
        if change < -STEADY_RATIO { -1 } else { i8::from(change > STEADY_RATIO) }
    });
    let shares = &account.shares;
    let var_m6 = account.budget.var_m6();
    let sources = account.budget.largest_first().into_iter();
    let is_of_volume = |row: &crate::messages::BudgetRow| {
        row.source != crate::messages::BudgetSource::Density && row.var_m6 > 0.0
    };
    Some(Volume {
        name: account.name.clone(),
        volume_m3: estimate.volume_m3,
        expanded_m3: COVERAGE_FACTOR * estimate.sigma_m3,
        stated_m3: digits(&stated),
        expanded_percent: expanded_percent(account),
        stated_t: mass.as_ref().map(digits),
        shares: [
            shares.measured_ratio,
            shares.interpolated_ratio,
            shares.unseen_ratio,
            shares.disturbed_ratio,
        ],
        trend,
        sources: sources
            .filter(is_of_volume)
            .take(SOURCES_SHOWN)
            .map(|row| Source { name: row.source.name(), share: row.var_m6 / var_m6 })
            .collect(),
    })
}

/// The survey ends where such a plan does. With others the planner is asked again on the way, also where the number of
/// waypoints or the battery has cut a plan short.
const fn is_to_the_end(end: PlanEnd) -> bool {
    matches!(end, PlanEnd::Complete | PlanEnd::Target | PlanEnd::SmallGain)
}

fn expanded_percent(account: &VolumeAccount) -> Option<f64> {
    let estimate = &account.estimate;
    (estimate.volume_m3 > LEAST_VOLUME_M3)
        .then(|| 100.0 * COVERAGE_FACTOR * estimate.sigma_m3 / estimate.volume_m3)
}

fn gap(gap: &OfferedGap) -> Gap {
    Gap {
        centre_m: gap.centre_m,
        area_m2: gap.area_m2,
        share: gap.share,
        bay: gap.bay.clone(),
        is_in_reach: gap.is_in_reach,
    }
}

fn pose(outlook: &Outlook) -> Option<Pose> {
    let estimate = outlook.estimate.as_ref()?;
    let velocity = estimate.velocity_mps.coords;
    Some(Pose {
        place_m: estimate.hall_from_body.origin.coords.into(),
        yaw_rad: estimate.hall_from_body.rotation.yaw_rad(),
        speed_mps: velocity.xy().norm(),
        is_trusted: outlook.has_position,
    })
}

fn check(check: &crate::mission::PreflightCheck) -> Check {
    Check {
        subject: check.subject,
        found: check.found.clone(),
        fault: check.fault.map(|fault| fault.to_string()),
    }
}

const fn no_battery() -> Battery {
    Battery {
        level: Level::Unknown,
        percent: None,
        voltage_v: None,
        left_s: None,
        turns_home_at_percent: 0.0,
    }
}

fn battery(outlook: &Outlook) -> Battery {
    let turns_home_at_percent = 100.0 * outlook.turns_home_at_ratio;
    let percent = outlook.battery.map(|battery| 100.0 * battery.remaining_ratio);
    let level = match percent {
        None => Level::Unknown,
        Some(percent) if percent < turns_home_at_percent => Level::Bad,
        Some(percent) if percent < turns_home_at_percent + 10.0 => Level::Degraded,
        Some(_) => Level::Good,
    };
    Battery {
        level,
        percent,
        voltage_v: outlook.battery.map(|battery| battery.voltage_v),
        left_s: outlook.until_turn_home_s,
        turns_home_at_percent,
    }
}

fn mode_name(mode: FlightMode) -> String {
    match mode {
        FlightMode::Companion => "stockpilot steers".to_owned(),
        FlightMode::Hold => "autopilot holds".to_owned(),
        FlightMode::Land => "autopilot lands".to_owned(),
        FlightMode::TakeOff => "autopilot climbs".to_owned(),
        FlightMode::Return => "autopilot returns".to_owned(),
        FlightMode::Pilot => "the pilot steers".to_owned(),
        FlightMode::Other(number) => format!("mode {number}"),
    }
}

fn distance_m(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}
