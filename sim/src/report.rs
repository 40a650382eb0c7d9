//! What a run came to, as people and scripts read it.

use crate::calibration::CalibrationSigmas;
use crate::judge::PoseJudge;
use crate::rig::Rig;
use crate::scenario::{Scenario, Variance};
use crate::world::{Bay, World};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;
use stockpilot::messages::{BudgetSource, VolumeAccount};
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
    /// How the volume's variance was added up, if that was asked for.
    pub variance: Option<&'static str>,
    /// The calibration had errors, drawn from the σ that the service was told.
    pub draws_errors: bool,
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
    /// Share of each source in the claimed variance, by the source's name; empty where the surface
    /// keeps no budget.
    pub budget: BTreeMap<String, f64>,
    /// The volumes of the bays beside their truth; empty in a hall without bays.
    pub bays: Vec<BayReport>,
    /// Share of the volume where something moved since the ground was last seen.
    pub disturbed: f64,
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
    /// Squared position error over its claimed variance, mean over the flight and the axes; 1 is right.
    pub position_error_over_claim: f64,
    /// Root mean square of the position error, m.
    pub position_rms_m: f64,
    /// What the service needed of the computer; `null` where it is not measured.
    pub load: Option<ServiceLoad>,
    /// The accounts of all volumes, for people.
    #[serde(skip)]
    pub accounts: Vec<VolumeAccount>,
}

/// One bay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BayReport {
    /// Its name.
    pub name: String,
    /// The truth, m³.
    pub volume_true_m3: f64,
    /// The measurement, m³.
    pub volume_m3: f64,
    /// Its claimed standard deviation, m³.
    pub sigma_m3: f64,
    /// (measured − true) / true.
    pub relative_error: f64,
    /// (measured − true) / claimed σ.
    pub z: f64,
}

/// The bays of the flight that the world knows the truth of.
fn bay_reports(world: &World, flight: &FlightSummary) -> Vec<BayReport> {
    let of = |bay: &Bay| {
        let account = flight.accounts.iter().find(|account| account.name == bay.name)?;
        let (volume_m3, sigma_m3) = (account.estimate.volume_m3, account.estimate.sigma_m3);
        let volume_true_m3 = world.bay_volume_m3(bay);
        let error_m3 = volume_m3 - volume_true_m3;
        Some(BayReport {
            name: bay.name.clone(),
            volume_true_m3,
            volume_m3,
            sigma_m3,
            relative_error: error_m3 / volume_true_m3,
            z: error_m3 / sigma_m3,
        })
    };
    world.bays.iter().filter_map(of).collect()
}

/// What the service needed of the computer, beside the simulator in the same process.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ServiceLoad {
    /// Processor time of all threads of the service from its start to the landing, s.
    pub cpu_s: f64,
    /// The same over the flight time: share of one core at real time.
    pub core_share: f64,
    /// Processor time of the simulator's thread, s.
    pub simulator_cpu_s: f64,
    /// Memory of the process before the service started, world and log buffers included, MiB.
    pub resident_before_mib: f64,
    /// Most memory that service and simulator held together, MiB.
    pub resident_peak_mib: f64,
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
    /// What the service needed of the computer.
    pub load: Option<ServiceLoad>,
}

/// What truly became of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// Length of the true path, m.
    pub path_length_m: f64,
    /// Flight time, s.
    pub time_s: f64,
    /// The vehicle touched something.
    pub has_collided: bool,
}

impl Flown {
    fn by(rig: &Rig) -> Self {
        Self {
            path_length_m: rig.flown_m(),
            time_s: rig.now().seconds(),
            has_collided: rig.vehicle().collision().is_some(),
        }
    }
}

impl RunReport {
    /// Puts truth and measurement side by side.
    #[must_use]
    pub fn new(scenario: &Scenario, rig: &Rig, measured: &Measured, log: Option<PathBuf>) -> Self {
        Self::of(scenario, &Flown::by(rig), measured, log)
    }

    /// The same for a vehicle that is not the rig's.
    #[must_use]
    pub fn of(
        scenario: &Scenario,
        flown: &Flown,
        measured: &Measured,
        log: Option<PathBuf>,
    ) -> Self {
        let world = &scenario.world;
        let volume_true_m3 = world.volume_m3();
        let volume = measured.flight.volume;
        Self {
            world: world.name.clone(),
            seed: scenario.seed,
            planner: scenario.planner.name(),
            surface: scenario.surface.name(),
            variance: scenario.variance.map(Variance::name),
            draws_errors: scenario.conditions.sigmas != CalibrationSigmas::NONE,
            autopilot: scenario.autopilot.name(),
            lidar: scenario.lidar.name(),
            volume_true_m3,
            volume_m3: volume.volume_m3,
            sigma_m3: volume.sigma_m3,
            relative_error: (volume.volume_m3 - volume_true_m3) / volume_true_m3,
            budget: budget_shares(&measured.flight),
            bays: bay_reports(world, &measured.flight),
            disturbed: measured
                .flight
                .accounts
                .first()
                .map_or(0.0, |account| account.shares.disturbed_ratio),
            path_length_m: flown.path_length_m,
            steps: measured.flight.steps_done,
            beams: measured.flight.hits.received,
            beams_sent: measured.beams_sent,
            beams_dropped: measured.beams_dropped,
            sim_time_s: flown.time_s,
            wall_time_s: measured.wall_time.as_secs_f64(),
            log,
            complete: measured.flight.is_complete,
            collided: flown.has_collided,
            coverage: volume.coverage_ratio,
            position_within_3_sigma: measured.poses.within_3_sigma(),
            position_error_over_claim: measured.poses.error_over_claim(),
            position_rms_m: measured.poses.position_rms_m(),
            load: measured.load,
            accounts: measured.flight.accounts.clone(),
        }
    }

    /// (measured − true) / claimed σ.
    #[must_use]
    pub fn z(&self) -> f64 {
        (self.volume_m3 - self.volume_true_m3) / self.sigma_m3
    }
}

/// One run among many.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NotedRun {
    /// Its seed.
    pub seed: u64,
    /// (measured − true) / true.
    pub relative_error: f64,
    /// (measured − true) / claimed σ.
    pub z: f64,
}

/// Share of each source in (σ^V)²; the density is no part of it.
fn budget_shares(flight: &FlightSummary) -> BTreeMap<String, f64> {
    let Some(account) = flight.accounts.first() else { return BTreeMap::new() };
    let var_m6 = account.budget.var_m6();
    let share = |var: f64| if var_m6 > 0.0 { var / var_m6 } else { 0.0 };
    account
        .budget
        .rows
        .iter()
        .filter(|row| row.source != BudgetSource::Density)
        .map(|row| (row.source.name().to_owned(), share(row.var_m6)))
        .collect()
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
    /// Mean of the relative error.
    pub bias: f64,
    /// Mean of σ/V.
    pub mean_sigma_over_volume: f64,
    /// The run with the largest relative error; `null` without runs.
    pub worst: Option<NotedRun>,
    /// Mean share of each source in the claimed variance, by the source's name.
    pub budget: BTreeMap<String, f64>,
    /// Share of all bays of all runs whose V ± 1.96 σ holds the truth; `null` without bays.
    pub bay_coverage_95: Option<f64>,
    /// Root mean square of error/σ of all bays of all runs; `null` without bays.
    pub bay_rms_z: Option<f64>,
    /// Flight time over the time it took, of one run by itself.
    pub realtime_factor: f64,
}

impl CampaignReport {
    /// Sums up the runs.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "few runs")]
    pub fn new(runs: Vec<RunReport>) -> Self {
        let n = runs.len().max(1) as f64;
        let sum = |f: &dyn Fn(&RunReport) -> f64| runs.iter().map(f).sum::<f64>();
        let mean = |f: &dyn Fn(&RunReport) -> f64| sum(f) / n;
        let noted = |run: &RunReport| NotedRun {
            seed: run.seed,
            relative_error: run.relative_error,
            z: run.z(),
        };
        let worst = runs
            .iter()
            .max_by(|a, b| a.relative_error.abs().total_cmp(&b.relative_error.abs()))
            .map(noted);
        Self {
            coverage_95: mean(&|run| f64::from(u8::from(run.z().abs() <= 1.96))),
            rms_z: mean(&|run| run.z().powi(2)).sqrt(),
            rms_relative_error: mean(&|run| run.relative_error.powi(2)).sqrt(),
            bias: mean(&|run| run.relative_error),
            mean_sigma_over_volume: mean(&|run| run.sigma_m3 / run.volume_m3),
            worst,
            budget: mean_budget(&runs, n),
            bay_coverage_95: mean_of_bays(&runs, |z| f64::from(u8::from(z.abs() <= 1.96))),
            bay_rms_z: mean_of_bays(&runs, |z| z * z).map(f64::sqrt),
            realtime_factor: sum(&|run| run.sim_time_s) / sum(&|run| run.wall_time_s),
            runs,
        }
    }
}

/// The mean of a function of z over all bays of all runs.
#[expect(clippy::cast_precision_loss, reason = "few bays")]
fn mean_of_bays(runs: &[RunReport], f: impl Fn(f64) -> f64) -> Option<f64> {
    let z: Vec<f64> = runs.iter().flat_map(|run| &run.bays).map(|bay| bay.z).collect();
    (!z.is_empty()).then(|| z.iter().map(|z| f(*z)).sum::<f64>() / z.len() as f64)
}

/// The mean share of every source that any run names; a run that does not name it counts as 0.
fn mean_budget(runs: &[RunReport], n: f64) -> BTreeMap<String, f64> {
    let mut shares = BTreeMap::new();
    for (source, share) in runs.iter().flat_map(|run| &run.budget) {
        *shares.entry(source.clone()).or_insert(0.0) += share / n;
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bay(z: f64) -> BayReport {
        BayReport {
            name: "bay 1".to_owned(),
            volume_true_m3: 10.0,
            volume_m3: 10.0 + 0.1 * z,
            sigma_m3: 0.1,
            relative_error: 0.01 * z,
            z,
        }
    }

    fn run(seed: u64, volume_m3: f64, shares: &[(&str, f64)]) -> RunReport {
        RunReport {
            world: "alps".to_owned(),
            seed,
            planner: "greedy",
            surface: "kalman-grid",
            variance: None,
            draws_errors: false,
            autopilot: "px4",
            lidar: "ld19",
            volume_true_m3: 100.0,
            volume_m3,
            sigma_m3: 2.0,
            relative_error: (volume_m3 - 100.0) / 100.0,
            budget: shares.iter().map(|(source, share)| ((*source).to_owned(), *share)).collect(),
            bays: [0.5, -2.5].map(bay).into(),
            disturbed: 0.0,
            path_length_m: 0.0,
            steps: 0,
            beams_sent: 0,
            beams: 0,
            beams_dropped: 0,
            sim_time_s: 100.0,
            wall_time_s: 2.0,
            log: None,
            complete: true,
            collided: false,
            coverage: 1.0,
            position_within_3_sigma: 1.0,
            position_error_over_claim: 1.0,
            position_rms_m: 0.0,
            load: None,
            accounts: Vec::new(),
        }
    }

    #[test]
    fn the_summary_is_that_of_a_calculation_by_hand() {
        let runs = vec![
            run(0, 103.0, &[("pose", 0.6), ("prior", 0.4)]),
            run(1, 101.0, &[("pose", 1.0)]),
            run(2, 94.0, &[("pose", 0.5), ("prior", 0.5)]),
            run(3, 100.0, &[]),
        ];
        let report = CampaignReport::new(runs);
        // z = 1.5, 0.5, −3, 0; relative errors 3, 1, −6, 0 %.
        assert!((report.coverage_95 - 0.75).abs() < 1e-12);
        assert!((report.rms_z - (11.5_f64 / 4.0).sqrt()).abs() < 1e-12);
        assert!((report.rms_relative_error - (46e-4_f64 / 4.0).sqrt()).abs() < 1e-12);
        assert!((report.bias + 0.005).abs() < 1e-12);
        let worst = report.worst.unwrap();
        assert_eq!(worst.seed, 2);
        assert!((worst.relative_error + 0.06).abs() < 1e-12 && (worst.z + 3.0).abs() < 1e-12);
        let sigma_over_volume = (2.0 / 103.0 + 2.0 / 101.0 + 2.0 / 94.0 + 0.02) / 4.0;
        assert!((report.mean_sigma_over_volume - sigma_over_volume).abs() < 1e-12);
        assert!((report.budget["pose"] - 2.1 / 4.0).abs() < 1e-12);
        assert!((report.budget["prior"] - 0.9 / 4.0).abs() < 1e-12);
        assert!((report.realtime_factor - 50.0).abs() < 1e-12);
        assert_eq!(report.bay_coverage_95, Some(0.5));
        assert!((report.bay_rms_z.unwrap() - 3.25_f64.sqrt()).abs() < 1e-12);
        let none = CampaignReport::new(Vec::new());
        assert!(none.worst.is_none() && none.bay_rms_z.is_none());
    }
}
