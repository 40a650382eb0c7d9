//! The onboard program and its tools.

#[path = "main/audit.rs"]
mod audit;
#[path = "main/calibrate.rs"]
mod calibrate;
#[path = "main/change.rs"]
mod change;
#[path = "main/doctor.rs"]
mod doctor;
#[path = "main/inventory.rs"]
mod inventory;
#[path = "main/lidar.rs"]
mod lidar;
#[path = "main/logs.rs"]
mod logs;
#[path = "main/markers.rs"]
mod markers;
#[path = "main/merge.rs"]
mod merge;
#[path = "main/params.rs"]
mod params;
#[path = "main/plan.rs"]
mod plan;
#[path = "main/prior.rs"]
mod prior;
#[path = "main/replay.rs"]
mod replay;
#[path = "main/report.rs"]
mod report;
#[path = "main/survey.rs"]
mod survey;

use anyhow::Context;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;
use stockpilot::config::{self, Config};
use stockpilot::service::clock::Clock;
use stockpilot::service::onboard::{Onboard, Surroundings};
use stockpilot::service::watchdog;
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
    Replay(replay::ReplayArgs),
    /// One map of several logs: of cut-off flights, of several flights or vehicles.
    Merge(merge::MergeArgs),
    /// The likeliest numbers of the field for the material that these flights saw.
    Prior(prior::PriorArgs),
    /// What a flight says about the hall.
    Survey(survey::SurveyArgs),
    /// What a flight says about the vehicle itself.
    Calibrate(calibrate::CalibrateArgs),
    /// What the LiDAR itself says, on the ground.
    Lidar(lidar::LidarArgs),
    /// What has changed between two surveys of the same bays.
    Change(change::ChangeArgs),
    /// The files for people: PDF, HTML, JSON, CSV, maps and point clouds.
    Report(report::ReportArgs),
    /// Packs with all that somebody needs to compute a survey again, signed.
    Audit(audit::AuditArgs),
    /// The books of halls: what was in each bay, survey by survey.
    Inventory(inventory::InventoryArgs),
    /// The folder with the logs: what each holds, and what may go when the disk fills.
    Logs(logs::LogsArgs),
    /// Where the vehicle may fly, and where one more marker would help most.
    Plan(plan::PlanArgs),
    /// The autopilot's parameters beside a file's.
    Params(params::ParamsArgs),
    /// What is connected, whether it works, and what to do where it does not.
    Doctor(doctor::DoctorArgs),
    /// Markers to print, to hang and to survey.
    Markers(markers::MarkersArgs),
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

fn main() -> anyhow::Result<ExitCode> {
    let command = Cli::parse().command;
    // What drivers tell the log, the doctor's table tells with its cure.
    let usual = if matches!(command, Command::Doctor(_)) { "error" } else { "info" };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new(usual));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match command {
        Command::Run(args) => run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Prior(args) => prior::run(&args),
        Command::Survey(args) => survey::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Lidar(args) => lidar::run(&args),
        Command::Change(args) => change::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Audit(args) => audit::run(&args),
        Command::Inventory(args) => inventory::run(&args),
        Command::Logs(args) => logs::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Params(args) => params::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Markers(args) => markers::run(&args),
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
    let onboard = Box::pin(Onboard::start(config, around)).await?;
    tracing::info!(log = %onboard.log().display(), "recording");
    if let Some(address) = onboard.page_addr() {
        tracing::info!("live page: http://{address}/");
    }
    tokio::select! {
        signal = wait_for_signal() => {
            signal?;
            tracing::info!("ending: a vehicle in the air lands first; once more ends at once");
        }
        () = onboard.ended() => tracing::error!("the brain has stopped by itself"),
        () = watchdog::feed(|| onboard.last_tick()) => {}
    }
    watchdog::stopping();
    onboard.stop();
    let stats = tokio::select! {
        stats = onboard.join() => stats?,
        signal = wait_for_signal() => {
            signal?;
            tracing::warn!("ended at once: a vehicle in the air is left to its autopilot");
            return Ok(ExitCode::FAILURE);
        }
    };
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

#[expect(clippy::disallowed_methods, reason = "says how long something took")]
fn now() -> Instant {
    Instant::now()
}
