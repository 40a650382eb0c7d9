//! The onboard program and its tools.

use anyhow::Context;
use clap::{Args, Parser, Subcommand};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use stockpilot::config::{self, Config, ConfigError};
use stockpilot::pilot::Pilot;
use stockpilot::record::replay::{ReplayReport, replay};
use stockpilot::service::clock::Clock;
use stockpilot::service::onboard::{Onboard, Surroundings};
use stockpilot::service::plan::{Extent, Plan, Suggestions};
use tokio_util::sync::CancellationToken;

/// How much bulk material lies in this hall, measured by a drone, and how sure the answer is.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The onboard service.
    Run(RunArgs),
    /// The same flight again from its log.
    Replay(ReplayArgs),
    /// Where the vehicle may fly, and where one more marker would help most.
    Plan(PlanArgs),
}

#[derive(Debug, Args)]
struct PlanArgs {
    /// The configuration file.
    #[arg(long)]
    config: PathBuf,
    /// Override a key of the file; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// Draw the free space of every height into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Tell where one more marker would open most free space.
    #[arg(long)]
    what_if: bool,
    /// Places for it are this far apart along the walls, m.
    #[arg(long, value_name = "M", default_value_t = 2.0, value_parser = spacing_m)]
    spacing_m: f64,
    /// Length of its sides, m; that of the tags in the map if left out.
    #[arg(long, value_name = "M", value_parser = edge_m)]
    edge_m: Option<f64>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

fn spacing_m(text: &str) -> Result<f64, String> {
    metres(text, 0.2..=50.0)
}

fn edge_m(text: &str) -> Result<f64, String> {
    metres(text, 0.05..=2.0)
}

fn metres(text: &str, range: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    let (low, high) = (range.start(), range.end());
    if range.contains(&value) { Ok(value) } else { Err(format!("is {low} to {high} m")) }
}

#[derive(Debug, Args)]
struct RunArgs {
    /// The configuration file.
    #[arg(long)]
    config: PathBuf,
    /// Override a key of the file; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// Print the effective configuration and end.
    #[arg(long)]
    print_config: bool,
}

#[derive(Debug, Args)]
struct ReplayArgs {
    /// The log.
    log: PathBuf,
    /// Fail unless every result is equal to the last bit.
    #[arg(long)]
    verify: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

fn main() -> anyhow::Result<ExitCode> {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("info"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match Cli::parse().command {
        Command::Run(args) => run(&args),
        Command::Replay(args) => run_replay(&args),
        Command::Plan(args) => plan(&args),
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn run(args: &RunArgs) -> anyhow::Result<ExitCode> {
    let config = config::load(&args.config, &args.overrides)?;
    let printed = config.to_toml()?;
    if args.print_config {
        print!("{printed}");
        return Ok(ExitCode::SUCCESS);
    }
    tracing::info!(config = printed, "effective configuration");
    let runtime = tokio::runtime::Runtime::new().context("cannot start the runtime")?;
    runtime.block_on(fly(&config))
}

/// What `plan` prints with `--json`.
#[derive(Debug, Serialize)]
struct PlanLine {
    extent: Extent,
    evaluation_s: f64,
    pictures: Vec<String>,
    what_if: Option<Suggestions>,
}

fn plan(args: &PlanArgs) -> anyhow::Result<ExitCode> {
    let config = config::load(&args.config, &args.overrides)?;
    let began = now();
    let plan = Plan::new(&config)?;
    let evaluation_s = began.elapsed().as_secs_f64();
    let what_if = args.what_if.then(|| plan.what_if(args.spacing_m, args.edge_m)).transpose()?;
    let mut pictures = Vec::new();
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make {}", folder.display()))?;
        pictures = plan.draw(folder, what_if.as_ref())?;
    }
    print_plan(&PlanLine { extent: plan.extent(), evaluation_s, pictures, what_if }, args.json)?;
    Ok(ExitCode::SUCCESS)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_plan(line: &PlanLine, as_json: bool) -> anyhow::Result<()> {
    if as_json {
        println!("{}", serde_json::to_string(line)?);
        return Ok(());
    }
    let e = &line.extent;
    println!(
        "free at the survey's height and heading: {:.0} of {:.0} m² that are clear",
        e.survey_area_m2, e.survey_clear_area_m2
    );
    println!(
        "free at all heights and headings: {} of {} clear nodes ({} in all, evaluated in {:.1} s)",
        e.n_free_nodes, e.n_clear_nodes, e.n_nodes, line.evaluation_s
    );
    for name in &line.pictures {
        println!("drawn: {name}.svg, {name}.png");
    }
    let Some(what_if) = &line.what_if else { return Ok(()) };
    println!(
        "one more marker of {:.2} m, {} places tried; the best:",
        what_if.edge_m, what_if.n_candidates
    );
    for (i, s) in what_if.best.iter().enumerate() {
        let [x, y, z] = s.place_m;
        println!(
            "{}. at ({x:.2}, {y:.2}, {z:.2}) m, facing {:.0}°: +{:.0} m², +{} nodes",
            i + 1,
            s.facing_deg,
            s.gain_m2,
            s.gain_nodes
        );
    }
    Ok(())
}

async fn fly(config: &Config) -> anyhow::Result<ExitCode> {
    let stop = CancellationToken::new();
    let around = Surroundings { clock: Clock::real(), stop: stop.clone(), waits_for_disk: false };
    let onboard = Onboard::start(config, around).await?;
    tracing::info!(log = %onboard.log().display(), "recording");
    tokio::select! {
        signal = wait_for_signal() => {
            signal?;
            tracing::info!("ending: the autopilot takes over by its own failsafe");
        }
        () = onboard.ended() => tracing::error!("the brain has stopped by itself"),
    }
    onboard.stop();
    let stats = onboard.join().await?;
    tracing::info!(?stats, "ended");
    Ok(ExitCode::SUCCESS)
}

/// Returns at the first SIGINT or SIGTERM.
async fn wait_for_signal() -> anyhow::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).context("cannot listen for SIGTERM")?;
    tokio::select! {
        result = tokio::signal::ctrl_c() => result.context("cannot listen for SIGINT"),
        _ = terminate.recv() => Ok(()),
    }
}

#[derive(Debug, Serialize)]
struct ReplayLine {
    identical: bool,
    events: u64,
    results_compared: u64,
    complete: bool,
    first_difference: Option<String>,
    wall_time_s: f64,
}

#[expect(clippy::disallowed_methods, reason = "says how long the replay took")]
fn now() -> Instant {
    Instant::now()
}

fn run_replay(args: &ReplayArgs) -> anyhow::Result<ExitCode> {
    let began = now();
    let report = replay(&args.log, |toml| pilot_from(toml, &args.log))
        .with_context(|| format!("cannot replay {}", args.log.display()))?;
    print_replay(&report, began.elapsed().as_secs_f64(), args.json)?;
    let is_failed = args.verify && !report.identical;
    Ok(if is_failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn pilot_from(toml: &str, log: &Path) -> Result<Pilot, ConfigError> {
    Config::from_toml(toml, log)?.pilot_settings().map(Pilot::new)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_replay(report: &ReplayReport, wall_time_s: f64, as_json: bool) -> anyhow::Result<()> {
    let first_difference = report.first_difference.as_ref().map(|d| format!("{d:?}"));
    if as_json {
        let line = ReplayLine {
            identical: report.identical,
            events: report.events,
            results_compared: report.results_compared,
            complete: report.is_complete,
            first_difference,
            wall_time_s,
        };
        println!("{}", serde_json::to_string(&line)?);
        return Ok(());
    }
    let verdict = if report.identical { "identical" } else { "different" };
    let end = if report.is_complete { "" } else { "; the log ends early" };
    println!(
        "{verdict}: {} events, {} results compared in {wall_time_s:.1} s{end}",
        report.events, report.results_compared,
    );
    if let Some(difference) = first_difference {
        println!("first difference: {difference}");
    }
    Ok(())
}
