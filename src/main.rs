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
