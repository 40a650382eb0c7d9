//! The command line of `paper`.

use super::pictures::{self, Flown};
use super::summary::Summary;
use super::{EXPERIMENTS, Experiment};
use crate::hall::{Devices, config};
use crate::parallel::{n_cores, run_in_order};
use crate::scenario::{Scenario, ScenarioArgs};
use crate::survey;
use anyhow::Context;
use clap::Args;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use stockpilot::config::Config;

/// The experiment of the paper. Planner, surface and variance are those of the experiment, whatever
/// the options say.
#[derive(Debug, Clone, Args)]
pub struct PaperArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Where pictures and tables go; files of the same names are replaced.
    #[arg(long)]
    out: PathBuf,
    /// Surfaces are shown after so many waypoints, rising; with commas.
    #[arg(long, value_delimiter = ',', default_value = "20,50")]
    maps_after: Vec<usize>,
    /// The surface is solved this often in flight, s.
    #[arg(long, default_value_t = 1.0)]
    solve_interval_s: f64,
    /// Flights at once; as many as there are cores if left out. Results do not depend on it.
    #[arg(long)]
    jobs: Option<NonZeroUsize>,
}

/// Runs the command.
///
/// # Errors
/// A scenario that cannot be built or flown, or a folder that cannot be written to.
#[expect(clippy::print_stdout, reason = "the program's output")]
pub fn run(args: &PaperArgs) -> anyhow::Result<()> {
    anyhow::ensure!(
        (0.2..=60.0).contains(&args.solve_interval_s),
        "--solve-interval-s is 0.2 to 60"
    );
    anyhow::ensure!(
        args.maps_after.is_sorted_by(|a, b| a < b) && !args.maps_after.contains(&0),
        "--maps-after rises from 1 on"
    );
    let scenario = args.scenario.scenario(args.seed)?;
    let settings = Settings {
        maps_after: args.maps_after.clone(),
        solve_interval_s: args.solve_interval_s,
        quality_cell_m: 0.25,
        n_jobs: args.jobs.unwrap_or_else(n_cores),
    };
    let summary = make(&scenario, EXPERIMENTS, &settings, &args.out)?;
    print!("{}", summary.markdown());
    println!("\npictures, their numbers and this table: {}", args.out.display());
    Ok(())
}

/// What does not depend on the scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Surfaces are shown after so many waypoints, rising.
    pub maps_after: Vec<usize>,
    /// The surface is solved this often in flight, s.
    pub solve_interval_s: f64,
    /// Pitch of the picture of the quality of fix, m.
    pub quality_cell_m: f64,
    /// Flights at once.
    pub n_jobs: NonZeroUsize,
}

/// Flies the experiments and writes pictures, tables and summary into a folder, which is made.
///
/// # Errors
/// A scenario that cannot be flown, or a folder that cannot be written to.
pub fn make(
    scenario: &Scenario,
    experiments: &[Experiment],
    settings: &Settings,
    out: &Path,
) -> anyhow::Result<Summary> {
    std::fs::create_dir_all(out)
        .with_context(|| format!("cannot make the folder {}", out.display()))?;
    let fly = |k: u64| -> anyhow::Result<Flown> {
        let experiment = experiments[usize::try_from(k)?];
        let scenario = experiment.applied_to(scenario);
        let config = experiment_config(&experiment, &scenario, settings);
        let survey = survey::fly(&scenario, &config, &settings.maps_after)?;
        Ok(Flown { experiment, survey })
    };
    let flown = run_in_order(0..experiments.len() as u64, settings.n_jobs, fly, print_progress)?;
    let summary = Summary::new(scenario, &flown);
    pictures::write(scenario, &flown, settings, out)?;
    write_text(out, "summary.md", &summary.markdown())?;
    write_text(out, "summary.json", &(serde_json::to_string_pretty(&summary)? + "\n"))?;
    Ok(summary)
}

fn experiment_config(experiment: &Experiment, scenario: &Scenario, settings: &Settings) -> Config {
    let mut config = config(scenario, Devices::none());
    config.surface.solve_interval_s = Some(settings.solve_interval_s);
    experiment.method.set(&mut config);
    config
}

fn write_text(out: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    let path = out.join(name);
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
}

#[expect(clippy::print_stderr, reason = "the program's output")]
fn print_progress(flown: &Flown) {
    let last = flown.survey.samples.last();
    let claim = last.map_or_else(
        || "no volume".to_owned(),
        |s| format!("{:.1} ± {:.1} m³ after {} steps", s.volume_m3, 2.0 * s.sigma_m3, s.steps),
    );
    eprintln!("{}: {claim}", flown.experiment.name());
}
