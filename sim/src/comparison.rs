//! Planners side by side over the same worlds: how far, how long and at what cost until the volume
//! is as sure as wanted, and whether they stayed out of trouble.
//!
//! A flight that never gets there counts as infinitely long, so a median over flights may be
//! infinite too; JSON has `null` for it.

mod command;
mod table;

pub use command::{ComparisonArgs, run};

use crate::scenario::Planner;
use crate::survey::Survey;
use serde::Serialize;
use std::collections::BTreeMap;

/// One flight of one planner.
#[expect(clippy::struct_excessive_bools, reason = "each is a column of its own")]
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedRun {
    /// The world.
    pub world: String,
    /// Seed of everything drawn.
    pub seed: u64,
    /// Who chose the waypoints.
    pub planner: &'static str,
    /// True path from the survey's start until σ/V first fell to the target, m; `null` if it never
    /// did.
    pub path_to_target_m: Option<f64>,
    /// Time until then, s.
    pub time_to_target_s: Option<f64>,
    /// Energy out of the battery until then, Wh.
    pub energy_to_target_wh: Option<f64>,
    /// σ/V of the flight's last volume; `null` without one that is above 0.
    pub final_sigma_over_volume: Option<f64>,
    /// (measured − true)/true of that volume.
    pub relative_error: Option<f64>,
    /// (measured − true)/σ.
    pub z: Option<f64>,
    /// True path from the survey's start to the last volume, m.
    pub path_m: f64,
    /// Waypoints reached.
    pub steps: usize,
    /// Landed by itself with a result.
    pub has_ended: bool,
    /// The survey ran to its own end.
    pub is_complete: bool,
    /// Touched something.
    pub has_collided: bool,
    /// Left the true free space.
    pub has_left_free_space: bool,
    /// Smallest distance of the body's middle to anything solid during the survey, m, 2 at most.
    pub least_clearance_m: Option<f64>,
    /// Charge of the battery at the end, 0 to 1.
    pub final_charge_ratio: f64,
    /// Planning jobs.
    pub n_plans: usize,
    /// What each of them took on this machine, ms.
    #[serde(skip)]
    pub plan_ms: Vec<f64>,
}

impl ComparedRun {
    /// What a flight came to.
    #[must_use]
    pub fn new(
        (world, seed, planner): (&str, u64, Planner),
        volume_true_m3: f64,
        target: f64,
        survey: Survey,
    ) -> Self {
        let reached = survey.first_within(target).copied();
        let last = survey.samples.last().copied();
        let error_m3 = last.map(|s| s.volume_m3 - volume_true_m3);
        Self {
            world: world.to_owned(),
            seed,
            planner: planner.name(),
            path_to_target_m: reached.map(|s| s.path_m),
            time_to_target_s: reached.map(|s| s.at_s),
            energy_to_target_wh: reached.map(|s| s.energy_wh),
            final_sigma_over_volume: last
                .filter(|s| s.volume_m3 > 0.0)
                .map(|s| s.sigma_m3 / s.volume_m3),
            relative_error: error_m3.map(|e| e / volume_true_m3),
            z: error_m3.zip(last).map(|(e, s)| e / s.sigma_m3),
            path_m: last.map_or(0.0, |s| s.path_m),
            steps: survey.report.as_ref().map_or_else(|| last.map_or(0, |s| s.steps), |r| r.steps),
            has_ended: survey.report.is_some(),
            is_complete: survey.report.as_ref().is_some_and(|r| r.complete),
            has_collided: survey.has_collided,
            has_left_free_space: survey.has_left_free_space,
            least_clearance_m: Some(survey.least_clearance_m).filter(|m| m.is_finite()),
            final_charge_ratio: survey.final_charge_ratio,
            n_plans: survey.plan_ms.len(),
            plan_ms: survey.plan_ms,
        }
    }
}

/// All flights of one planner.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannerSummary {
    /// Flights.
    pub n_runs: usize,
    /// Flights that reached the target.
    pub n_reached: usize,
    /// Median of the true path to the target, m; `null` if it is infinite.
    pub median_path_to_target_m: Option<f64>,
    /// Median of the time to it, s; `null` if it is infinite.
    pub median_time_to_target_s: Option<f64>,
    /// Median of the energy to it, Wh; `null` if it is infinite.
    pub median_energy_to_target_wh: Option<f64>,
    /// Median of σ/V of the last volumes; a flight without one counts as infinite.
    pub final_sigma_over_volume: Option<f64>,
    /// Root mean square of the relative error, over the flights that ended with a volume.
    pub rms_relative_error: Option<f64>,
    /// Share of those flights whose V ± 1.96 σ holds the truth.
    pub coverage_95: Option<f64>,
    /// Flights that touched something.
    pub collisions: usize,
    /// Flights that left the true free space.
    pub left_free_space: usize,
    /// Flights without an end by themselves.
    pub not_ended: usize,
    /// Smallest charge at the end of a flight, 0 to 1; `null` without flights.
    pub least_charge_ratio: Option<f64>,
    /// Median over all planning jobs of the time one takes on this machine, ms; 0 if the planner
    /// has none in flight.
    pub plan_ms_median: f64,
}

impl PlannerSummary {
    fn new(runs: &[&ComparedRun]) -> Self {
        let of = |f: &dyn Fn(&ComparedRun) -> Option<f64>| {
            median(runs.iter().map(|run| f(run).unwrap_or(f64::INFINITY)).collect())
        };
        let count = |f: &dyn Fn(&ComparedRun) -> bool| runs.iter().filter(|run| f(run)).count();
        let errors: Vec<f64> = runs.iter().filter_map(|run| run.relative_error).collect();
        let z: Vec<f64> = runs.iter().filter_map(|run| run.z).collect();
        let least = runs.iter().map(|run| run.final_charge_ratio).fold(f64::INFINITY, f64::min);
        let plan_ms: Vec<f64> = runs.iter().flat_map(|run| run.plan_ms.iter().copied()).collect();
        Self {
            n_runs: runs.len(),
            n_reached: count(&|run| run.path_to_target_m.is_some()),
            median_path_to_target_m: of(&|run| run.path_to_target_m),
            median_time_to_target_s: of(&|run| run.time_to_target_s),
            median_energy_to_target_wh: of(&|run| run.energy_to_target_wh),
            final_sigma_over_volume: of(&|run| run.final_sigma_over_volume),
            rms_relative_error: mean(errors.iter().map(|e| e * e)).map(f64::sqrt),
            coverage_95: mean(z.iter().map(|z| f64::from(u8::from(z.abs() <= 1.96)))),
            collisions: count(&|run| run.has_collided),
            left_free_space: count(&|run| run.has_left_free_space),
            not_ended: count(&|run| !run.has_ended),
            least_charge_ratio: Some(least).filter(|ratio| ratio.is_finite()),
            plan_ms_median: median(plan_ms).unwrap_or(0.0),
        }
    }
}

/// The middle value, or the mean of the two in the middle; `None` if that is infinite or if there
/// is none.
#[must_use]
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let upper = values.len() / 2;
    let middle = if values.len().is_multiple_of(2) {
        0.5 * (values.get(upper.wrapping_sub(1))? + values[upper])
    } else {
        values[upper]
    };
    middle.is_finite().then_some(middle)
}

#[expect(clippy::cast_precision_loss, reason = "few runs")]
fn mean(values: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    let n = values.len();
    (n > 0).then(|| values.sum::<f64>() / n as f64)
}

/// All flights of all planners.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// σ/V to be reached.
    pub target_sigma_over_volume: f64,
    /// How the surface was kept.
    pub surface: &'static str,
    /// The surface was solved this often in flight, s; the way to the target is known as well as
    /// the vehicle flies in that time.
    pub solve_interval_s: f64,
    /// The planners by name.
    pub planners: BTreeMap<&'static str, PlannerSummary>,
    /// Each flight.
    pub runs: Vec<ComparedRun>,
}

impl Comparison {
    /// Sums up the flights, planner by planner.
    #[must_use]
    pub fn new(
        target_sigma_over_volume: f64,
        surface: &'static str,
        solve_interval_s: f64,
        runs: Vec<ComparedRun>,
    ) -> Self {
        let mut by_planner: BTreeMap<&'static str, Vec<&ComparedRun>> = BTreeMap::new();
        for run in &runs {
            by_planner.entry(run.planner).or_default().push(run);
        }
        let planners =
            by_planner.iter().map(|(name, runs)| (*name, PlannerSummary::new(runs))).collect();
        Self { target_sigma_over_volume, surface, solve_interval_s, planners, runs }
    }
}

#[cfg(test)]
mod tests;
