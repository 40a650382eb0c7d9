//! What a run came to, as people and scripts read it.

use crate::judge::PoseJudge;
use crate::rig::Rig;
use crate::scenario::Scenario;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;
use stockpilot::pilot::FlightSummary;

/// One run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunReport {
    /// Name of the world.
    pub world: String,
    /// Seed of everything drawn.
    pub seed: u64,
    /// Who chose the waypoints.
    pub planner: &'static str,
    /// How the surface was kept.
    pub surface: &'static str,
    /// Which autopilot flew.
    pub autopilot: &'static str,
    /// Which LiDAR measured.
    pub lidar: &'static str,
    /// The truth, m³.
    pub volume_true_m3: f64,
    /// The measurement, m³.
    pub volume_m3: f64,
    /// Its claimed standard deviation, m³.
    pub sigma_m3: f64,
    /// (measured − true) / true.
    pub relative_error: f64,
    /// Length of the true path, m.
    pub path_length_m: f64,
    /// Waypoints reached.
    pub steps: usize,
    /// Samples that the sensor sent.
    pub beams_sent: u64,
    /// Beams that reached the map; with the dropped ones and the last unfinished turn, all sent.
    pub beams: u64,
    /// Samples that were lost on the way, as counted where it happened.
    pub beams_dropped: u64,
    /// Flight time, s.
    pub sim_time_s: f64,
    /// Time it took, s.
    pub wall_time_s: f64,
    /// Where the log is; `null` without one.
    pub log: Option<PathBuf>,
    /// The survey ran to its end and the vehicle landed by itself.
    pub complete: bool,
    /// The vehicle touched something.
    pub collided: bool,
    /// Share of the area that a beam has hit.
    pub coverage: f64,
    /// Share of the flight with the position error inside its 3σ.
    pub position_within_3_sigma: f64,
    /// Share of each source in (σ^V)², by its name.
    pub budget: BTreeMap<&'static str, f64>,
    /// Root mean square of the position error, m.
    pub position_rms_m: f64,
}

/// What only the runner knows.
#[derive(Debug, Clone)]
pub struct Measured {
    /// The flight's own summary.
    pub flight: FlightSummary,
    /// Errors of the published pose.
    pub poses: PoseJudge,
    /// Samples that the sensor sent.
    pub beams_sent: u64,
    /// Samples that were lost on the way.
    pub beams_dropped: u64,
    /// Time the run took.
    pub wall_time: Duration,
}

impl RunReport {
    /// Puts truth and measurement side by side.
    #[must_use]
    pub fn new(scenario: &Scenario, rig: &Rig, measured: &Measured, log: Option<PathBuf>) -> Self {
        let world = &scenario.world;
        let volume_true_m3 = world.volume_m3();
        let volume = measured.flight.volume;
        Self {
            world: world.name.clone(),
            seed: scenario.seed,
            planner: scenario.planner.name(),
            surface: scenario.surface.name(),
            autopilot: "px4",
            lidar: scenario.lidar.name(),
            volume_true_m3,
            volume_m3: volume.volume_m3,
            sigma_m3: volume.sigma_m3,
            relative_error: (volume.volume_m3 - volume_true_m3) / volume_true_m3,
            path_length_m: rig.flown_m(),
            steps: measured.flight.steps_done,
            beams: measured.flight.hits.received,
            beams_sent: measured.beams_sent,
            beams_dropped: measured.beams_dropped,
            sim_time_s: rig.now().seconds(),
            wall_time_s: measured.wall_time.as_secs_f64(),
            log,
            complete: measured.flight.is_complete,
            collided: rig.vehicle().collision().is_some(),
            coverage: volume.coverage_ratio,
            budget: budget_shares(&measured.flight),
            position_within_3_sigma: measured.poses.within_3_sigma(),
            position_rms_m: measured.poses.position_rms_m(),
        }
    }
}

/// Share of each source in (σ^V)².
fn budget_shares(flight: &FlightSummary) -> BTreeMap<&'static str, f64> {
    let Some(account) = flight.accounts.first() else { return BTreeMap::new() };
    let var_m6 = account.budget.var_m6();
    let share = |var: f64| if var_m6 > 0.0 { var / var_m6 } else { 0.0 };
    account.budget.rows.iter().map(|row| (row.source.name(), share(row.var_m6))).collect()
}

/// Many runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CampaignReport {
    /// Each run.
    pub runs: Vec<RunReport>,
    /// Share of the runs whose V ± 1.96 σ holds the truth.
    pub coverage_95: f64,
    /// Root mean square of error/σ.
    pub rms_z: f64,
    /// Root mean square of the relative error.
    pub rms_relative_error: f64,
    /// Mean of σ/V.
    pub mean_sigma_over_volume: f64,
    /// Flight time over the time it took.
    pub realtime_factor: f64,
}

impl CampaignReport {
    /// Sums up the runs.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "few runs")]
    pub fn new(runs: Vec<RunReport>) -> Self {
        let n = runs.len().max(1) as f64;
        let mean = |f: &dyn Fn(&RunReport) -> f64| runs.iter().map(f).sum::<f64>() / n;
        let z = |run: &RunReport| (run.volume_m3 - run.volume_true_m3) / run.sigma_m3;
        let sum = |f: &dyn Fn(&RunReport) -> f64| runs.iter().map(f).sum::<f64>();
        Self {
            coverage_95: mean(&|run| f64::from(u8::from(z(run).abs() <= 1.96))),
            rms_z: mean(&|run| z(run).powi(2)).sqrt(),
            rms_relative_error: mean(&|run| run.relative_error.powi(2)).sqrt(),
            mean_sigma_over_volume: mean(&|run| run.sigma_m3 / run.volume_m3),
            realtime_factor: sum(&|run| run.sim_time_s) / sum(&|run| run.wall_time_s),
            runs,
        }
    }
}
