//! The onboard program and its tools.

#[path = "main/audit.rs"]
mod audit;
#[path = "main/calibrate.rs"]
mod calibrate;
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
#[path = "main/params.rs"]
mod params;
#[path = "main/prior.rs"]
mod prior;
#[path = "main/report.rs"]
mod report;
#[path = "main/survey.rs"]
mod survey;

use anyhow::Context;
use clap::{Args, Parser, Subcommand, ValueEnum};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use stockpilot::config::{self, Config, ConfigError};
use stockpilot::mapping::change::USUAL_RISK;
use stockpilot::pilot::Pilot;
use stockpilot::record::replay::{ReplayReport, replay};
use stockpilot::service::clock::Clock;
use stockpilot::service::onboard::{Onboard, Surroundings};
use stockpilot::service::plan::{Extent, Plan, Suggestions};
use stockpilot::service::watchdog;
use stockpilot::survey::{
    AccountLine, BayChange, ChangeReport, MergeOptions, MergedSurvey, Origin, Survey,
    accounts_table, compare, merge_logs,
};
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
    /// One map of several logs: of cut-off flights, of several flights or vehicles.
    Merge(MergeArgs),
    /// The likeliest numbers of the field for the material that these flights saw.
    Prior(prior::PriorArgs),
    /// What a flight says about the hall.
    Survey(survey::SurveyArgs),
    /// What a flight says about the vehicle itself.
    Calibrate(calibrate::CalibrateArgs),
    /// What the LiDAR itself says, on the ground.
    Lidar(lidar::LidarArgs),
    /// What has changed between two surveys of the same bays.
    Change(ChangeArgs),
    /// The files for people: PDF, HTML, JSON, CSV, maps and point clouds.
    Report(report::ReportArgs),
    /// Packs with all that somebody needs to compute a survey again, signed.
    Audit(audit::AuditArgs),
    /// The books of halls: what was in each bay, survey by survey.
    Inventory(inventory::InventoryArgs),
    /// The folder with the logs: what each holds, and what may go when the disk fills.
    Logs(logs::LogsArgs),
    /// Where the vehicle may fly, and where one more marker would help most.
    Plan(PlanArgs),
    /// The autopilot's parameters beside a file's.
    Params(params::ParamsArgs),
    /// What is connected, whether it works, and what to do where it does not.
    Doctor(doctor::DoctorArgs),
    /// Markers to print, to hang and to survey.
    Markers(markers::MarkersArgs),
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

#[derive(Debug, Args)]
struct MergeArgs {
    /// The logs, in their order; a log without an end is read as far as it goes.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Write the merged survey as a log; the file must not exist.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Every log is of a vehicle of its own. Else logs with the same LiDAR, mounted alike, are of one.
    #[arg(long)]
    separate_vehicles: bool,
    /// All flights of each log, not its last one only; the material must not have moved in between.
    #[arg(long)]
    all_flights: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct ChangeArgs {
    /// Log of the earlier survey, or what `merge` has written.
    earlier: PathBuf,
    /// Log of the later survey.
    later: PathBuf,
    /// How often noise may be called significant, for each line by itself.
    #[arg(long, default_value_t = USUAL_RISK)]
    risk: f64,
    /// Errors that the surveys do not share although their configurations are equal.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "ORIGINS")]
    independent: Vec<OriginName>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Where constant errors come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum OriginName {
    /// The LiDAR on its vehicle: another vehicle, or mounted anew.
    Lidar,
    /// The marker map: hung or surveyed anew.
    Markers,
    /// What the material lies on.
    Base,
}

impl From<OriginName> for Origin {
    fn from(name: OriginName) -> Self {
        match name {
            OriginName::Lidar => Self::Lidar,
            OriginName::Markers => Self::Markers,
            OriginName::Base => Self::Base,
        }
    }
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
        Command::Replay(args) => run_replay(&args),
        Command::Merge(args) => run_merge(&args),
        Command::Prior(args) => prior::run(&args),
        Command::Survey(args) => survey::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Lidar(args) => lidar::run(&args),
        Command::Change(args) => run_change(&args),
        Command::Report(args) => report::run(&args),
        Command::Audit(args) => audit::run(&args),
        Command::Inventory(args) => inventory::run(&args),
        Command::Logs(args) => logs::run(&args),
        Command::Plan(args) => plan(&args),
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
    let onboard = Box::pin(Onboard::start(config, around)).await?;
    tracing::info!(log = %onboard.log().display(), "recording");
    if let Some(address) = onboard.page_addr() {
        tracing::info!("live page: http://{address}/");
    }
    tokio::select! {
        signal = wait_for_signal() => {
            signal?;
            tracing::info!("ending: a vehicle in the air lands");
        }
        () = onboard.ended() => tracing::error!("the brain has stopped by itself"),
        () = watchdog::feed(|| onboard.last_tick()) => {}
    }
    watchdog::stopping();
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

#[derive(Debug, Serialize)]
struct MergeLine {
    accounts: Vec<AccountLine>,
    logs: Vec<MergedLogLine>,
    beams: u64,
    beams_refused: u64,
    out: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct MergedLogLine {
    log: PathBuf,
    flights: usize,
    turns: usize,
    vehicle: usize,
    complete: bool,
}

fn run_merge(args: &MergeArgs) -> anyhow::Result<ExitCode> {
    let options =
        MergeOptions { separate_vehicles: args.separate_vehicles, all_flights: args.all_flights };
    let survey = merge_logs(&args.logs, options)?;
    if let Some(out) = &args.out {
        survey.write(out)?;
    }
    print_merged(&survey, args)?;
    Ok(ExitCode::SUCCESS)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_merged(survey: &MergedSurvey, args: &MergeArgs) -> anyhow::Result<()> {
    if args.json {
        let line = MergeLine {
            accounts: survey.accounts.iter().map(AccountLine::from).collect(),
            logs: survey
                .logs
                .iter()
                .map(|log| MergedLogLine {
                    log: log.path.clone(),
                    flights: log.n_flights,
                    turns: log.n_turns,
                    vehicle: log.vehicle_idx,
                    complete: log.is_complete,
                })
                .collect(),
            beams: survey.hits.received,
            beams_refused: survey.hits.refused,
            out: args.out.clone(),
        };
        println!("{}", serde_json::to_string(&line)?);
        return Ok(());
    }
    for log in &survey.logs {
        let end = if log.is_complete { "" } else { "; it ends early" };
        println!(
            "{}: {} flight(s), {} turns, vehicle {}{end}",
            log.path.display(),
            log.n_flights,
            log.n_turns,
            log.vehicle_idx,
        );
    }
    print!("{}", accounts_table(&survey.accounts));
    if let Some(out) = &args.out {
        println!("written to {}", out.display());
    }
    Ok(())
}

#[derive(Debug, Serialize)]
struct ChangeLine {
    bays: Vec<BayChangeLine>,
    shared: Vec<&'static str>,
    only_earlier: Vec<String>,
    only_later: Vec<String>,
}

#[derive(Debug, Serialize)]
struct BayChangeLine {
    name: String,
    earlier_m3: f64,
    later_m3: f64,
    change_m3: f64,
    sigma_m3: f64,
    unshared_sigma_m3: f64,
    statement: Option<String>,
    change_t: Option<f64>,
    sigma_t: Option<f64>,
    verdict: &'static str,
    p_value: f64,
    risk: f64,
    detectable_m3: f64,
}

impl From<&BayChange> for BayChangeLine {
    fn from(bay: &BayChange) -> Self {
        let change = &bay.change;
        Self {
            name: bay.name.clone(),
            earlier_m3: bay.earlier.volume_m3,
            later_m3: bay.later.volume_m3,
            change_m3: change.change_m3,
            sigma_m3: change.sigma_m3,
            unshared_sigma_m3: change.unshared_sigma_m3,
            statement: change.statement().ok().map(|statement| statement.to_string()),
            change_t: bay.mass.map(|mass| mass.mass_t),
            sigma_t: bay.mass.map(|mass| mass.sigma_t),
            verdict: change.verdict.name(),
            p_value: change.p_value,
            risk: change.risk,
            detectable_m3: change.detectable_m3,
        }
    }
}

fn run_change(args: &ChangeArgs) -> anyhow::Result<ExitCode> {
    let (earlier, later) = (Survey::read(&args.earlier)?, Survey::read(&args.later)?);
    for survey in [&earlier, &later] {
        if !survey.is_final {
            tracing::warn!(
                log = %survey.path.display(),
                "the volume is one of the flight under way; `stockpilot merge` uses all it saw"
            );
        }
    }
    let independent: Vec<Origin> = args.independent.iter().map(|name| (*name).into()).collect();
    let report = compare(&earlier, &later, args.risk, &independent)?;
    print_change(&report, args.json)?;
    Ok(ExitCode::SUCCESS)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_change(report: &ChangeReport, as_json: bool) -> anyhow::Result<()> {
    let shared: Vec<&str> = report.shared.iter().map(|origin| origin.name()).collect();
    if as_json {
        let line = ChangeLine {
            bays: report.bays.iter().map(BayChangeLine::from).collect(),
            shared,
            only_earlier: report.only_earlier.clone(),
            only_later: report.only_later.clone(),
        };
        println!("{}", serde_json::to_string(&line)?);
        return Ok(());
    }
    for bay in &report.bays {
        println!("{bay}");
    }
    let shared = if shared.is_empty() { "none".to_owned() } else { shared.join(", ") };
    println!("errors that both surveys share: {shared}");
    for (names, which) in [(&report.only_earlier, "earlier"), (&report.only_later, "later")] {
        if !names.is_empty() {
            println!("only in the {which} survey: {}", names.join(", "));
        }
    }
    Ok(())
}
