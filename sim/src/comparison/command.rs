//! The part of `campaign` that compares planners.

use super::{ComparedRun, Comparison, table};
use crate::camera::CameraArgs;
use crate::hall::{Devices, config};
use crate::parallel::run_in_order;
use crate::scenario::{Planner, ScenarioArgs};
use crate::survey;
use clap::Args;
use std::num::NonZeroUsize;
use std::ops::Range;

/// Options of a comparison; with the first or the second, a campaign becomes one.
#[derive(Debug, Clone, Args)]
pub struct ComparisonArgs {
    /// Compare these planners; with commas.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub planners: Vec<Planner>,
    /// In these worlds; with commas, each as for `--world`.
    #[arg(long, value_delimiter = ',')]
    pub worlds: Vec<String>,
    /// In a comparison the surface is solved this often, s: that is how well the way to the target
    /// is known.
    #[arg(long, default_value_t = 1.0)]
    pub solve_interval_s: f64,
}

/// The σ/V to be reached where nothing else is asked for, %.
const TARGET_PERCENT: f64 = 1.0;

impl ComparisonArgs {
    /// True if planners or worlds are named.
    #[must_use]
    pub const fn is_wanted(&self) -> bool {
        !self.planners.is_empty() || !self.worlds.is_empty()
    }
}

/// What is flown.
#[derive(Debug, Clone)]
struct Flights<'a> {
    scenario: &'a ScenarioArgs,
    camera: &'a CameraArgs,
    comparison: &'a ComparisonArgs,
    target_percent: f64,
    planners: Vec<Planner>,
    worlds: Vec<String>,
    seeds: Range<u64>,
}

impl Flights<'_> {
    fn n_planners(&self) -> u64 {
        self.planners.len() as u64
    }

    fn n_seeds(&self) -> u64 {
        self.seeds.end - self.seeds.start
    }

    fn n(&self) -> u64 {
        self.worlds.len() as u64 * self.n_seeds() * self.n_planners()
    }

    /// The k-th flight: planners change fastest, then seeds, then worlds.
    fn fly(&self, k: u64) -> anyhow::Result<ComparedRun> {
        let planner = self.planners[to_index(k % self.n_planners())];
        let seed = self.seeds.start + k / self.n_planners() % self.n_seeds();
        let world = &self.worlds[to_index(k / self.n_planners() / self.n_seeds())];
        let args = ScenarioArgs {
            world: world.clone(),
            planner,
            // Planners are told what they are asked for.
            target_percent: Some(self.target_percent),
            ..self.scenario.clone()
        };
        let mut scenario = args.scenario(seed)?;
        self.camera.apply(&mut scenario.camera);
        let mut config = config(&scenario, Devices::none());
        config.surface.solve_interval_s = Some(self.comparison.solve_interval_s);
        let survey = survey::fly(&scenario, &config, &[])?;
        let target = self.target_percent / 100.0;
        let who = (world.as_str(), seed, planner);
        Ok(ComparedRun::new(who, scenario.world.volume_m3(), target, survey))
    }
}

/// Of a list in memory.
fn to_index(k: u64) -> usize {
    usize::try_from(k).unwrap_or(usize::MAX)
}

/// Flies every planner in every world with every seed.
///
/// # Errors
/// A scenario that cannot be built, or options out of range.
pub fn run(
    scenario: &ScenarioArgs,
    camera: &CameraArgs,
    comparison: &ComparisonArgs,
    seeds: Range<u64>,
    n_jobs: NonZeroUsize,
) -> anyhow::Result<Comparison> {
    let solve_interval_s = comparison.solve_interval_s;
    let target_percent = scenario.target_percent.unwrap_or(TARGET_PERCENT);
    anyhow::ensure!((0.001..=100.0).contains(&target_percent), "--target-percent is 0.001 to 100");
    anyhow::ensure!((0.2..=60.0).contains(&solve_interval_s), "--solve-interval-s is 0.2 to 60");
    let or = |named: bool, list: Vec<Planner>| if named { list } else { vec![scenario.planner] };
    let mut worlds = comparison.worlds.clone();
    if worlds.is_empty() {
        worlds.push(scenario.world.clone());
    }
    let flights = Flights {
        scenario,
        camera,
        comparison,
        target_percent,
        planners: or(!comparison.planners.is_empty(), comparison.planners.clone()),
        worlds,
        seeds,
    };
    let runs = run_in_order(0..flights.n(), n_jobs, |k| flights.fly(k), table::print_progress)?;
    Ok(Comparison::new(target_percent / 100.0, scenario.surface.name(), solve_interval_s, runs))
}

impl Comparison {
    /// Prints one JSON object, or a table for people.
    ///
    /// # Errors
    /// Never in practice: all of it can be written as JSON.
    #[expect(clippy::print_stdout, reason = "the program's output")]
    pub fn print(&self, as_json: bool) -> anyhow::Result<()> {
        if as_json {
            println!("{}", serde_json::to_string(self)?);
        } else {
            print!("{}", table::text(self));
        }
        Ok(())
    }
}
