//! `stockpilot params`: the autopilot's parameters beside a file's.

use anyhow::Context;
use clap::{Args, Subcommand};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use stockpilot::link::params::{Comparison, Kind, LiveAutopilot, ParamFile, Value};
use stockpilot::link::signing::{SigningSettings, WallClock};
use stockpilot::link::{Address, Guard, SecuritySettings};
use stockpilot::service::clock::Clock;

/// Frames from further ahead than this are refused.
const MAX_AHEAD: Duration = Duration::from_secs(60);

/// Options of `stockpilot params`.
#[derive(Debug, Args)]
pub(crate) struct ParamsArgs {
    #[command(subcommand)]
    command: ParamsCommand,
}

#[derive(Debug, Subcommand)]
enum ParamsCommand {
    /// Fail unless the autopilot has every value of the file.
    Check(LinkArgs),
    /// Show every value of the file beside the autopilot's.
    Diff(LinkArgs),
    /// Write what differs, and read it back.
    Write(LinkArgs),
}

#[derive(Debug, Args)]
struct LinkArgs {
    /// The file: `.params` of `QGroundControl` or `.parm` of Mission Planner and MAVProxy.
    file: PathBuf,
    /// The autopilot: `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcpout:HOST:PORT` or `serial:PATH:BAUD`.
    #[arg(long, default_value = "udpin:0.0.0.0:14540")]
    link: Address,
    /// Sign with the key in this file.
    #[arg(long, value_name = "FILE")]
    signing_key: Option<PathBuf>,
    /// Where used-up signing timestamps are remembered; share it with the service.
    #[arg(long, value_name = "FILE", default_value = "mavlink-signing.stamp")]
    signing_stamp: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    parameters: Vec<Row>,
    wrong: usize,
    written: usize,
}

#[derive(Debug, Serialize)]
struct Row {
    name: String,
    wanted: String,
    found: Option<String>,
    kind: Option<String>,
    problem: Option<String>,
}

impl From<&Comparison> for Row {
    fn from(comparison: &Comparison) -> Self {
        Self {
            name: comparison.name.clone(),
            wanted: comparison.wanted.clone(),
            found: comparison.found.map(|(_, value)| value.to_string()),
            kind: comparison.found.map(|(kind, _)| kind.to_string()),
            problem: comparison.problem.map(|problem| problem.to_string()),
        }
    }
}

pub(crate) fn run(args: &ParamsArgs) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("cannot start the runtime")?;
    match &args.command {
        ParamsCommand::Check(link) => runtime.block_on(check(link)),
        ParamsCommand::Diff(link) => runtime.block_on(diff(link)),
        ParamsCommand::Write(link) => runtime.block_on(write(link)),
    }
}

async fn check(args: &LinkArgs) -> anyhow::Result<ExitCode> {
    let file = read_file(&args.file)?;
    let mut autopilot = find(args).await?;
    let comparisons = autopilot.compare(&file).await?;
    let wrong: Vec<_> = comparisons.iter().filter(|c| c.problem.is_some()).cloned().collect();
    print(&wrong, comparisons.len(), 0, args.json)?;
    Ok(if wrong.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

async fn diff(args: &LinkArgs) -> anyhow::Result<ExitCode> {
    let file = read_file(&args.file)?;
    let mut autopilot = find(args).await?;
    let comparisons = autopilot.compare(&file).await?;
    print(&comparisons, comparisons.len(), 0, args.json)?;
    Ok(ExitCode::SUCCESS)
}

async fn write(args: &LinkArgs) -> anyhow::Result<ExitCode> {
    let file = read_file(&args.file)?;
    let mut autopilot = find(args).await?;
    let before = autopilot.compare(&file).await?;
    let changes: Vec<_> = before.iter().filter_map(change).collect();
    let asked: BTreeSet<String> = changes.iter().map(|(name, ..)| name.clone()).collect();
    if !changes.is_empty() {
        autopilot.write(changes).await?;
    }
    // Read anew: what the autopilot has, not what it has answered.
    let after = autopilot.compare(&file).await?;
    let n_written = after.iter().filter(|c| c.problem.is_none() && asked.contains(&c.name)).count();
    let wrong: Vec<_> = after.iter().filter(|c| c.problem.is_some()).cloned().collect();
    print(&wrong, after.len(), n_written, args.json)?;
    Ok(if wrong.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// What has to be written so that a line holds; `None` if it does or cannot.
fn change(comparison: &Comparison) -> Option<(String, Kind, Value)> {
    use stockpilot::link::params::Problem::{Differs, WrongEncoding};
    let is_mendable = matches!(comparison.problem, Some(Differs | WrongEncoding));
    let (kind, _) = comparison.found.filter(|_| is_mendable)?;
    Some((comparison.name.clone(), kind, Value::parse(&comparison.wanted, kind)?))
}

fn read_file(path: &Path) -> anyhow::Result<ParamFile> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    ParamFile::parse(&text).with_context(|| format!("in {}", path.display()))
}

async fn find(args: &LinkArgs) -> anyhow::Result<LiveAutopilot<Clock>> {
    let clock = Clock::real();
    let signing = args.signing_key.clone().map(|key_file| SigningSettings {
        key_file,
        stamp_file: args.signing_stamp.clone(),
        link_id: 0,
        max_ahead: MAX_AHEAD,
        accept_unsigned: BTreeSet::new(),
    });
    let wall = clock.clone();
    let settings = SecuritySettings { peers: Vec::new(), signing };
    let guard = Guard::open(&settings, WallClock::new(move || wall.since_1970()))?;
    Ok(LiveAutopilot::find(&args.link, guard, clock).await?)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print(rows: &[Comparison], n_all: usize, n_written: usize, as_json: bool) -> anyhow::Result<()> {
    let n_wrong = rows.iter().filter(|row| row.problem.is_some()).count();
    if as_json {
        let parameters = rows.iter().map(Row::from).collect();
        let report = Report { parameters, wrong: n_wrong, written: n_written };
        println!("{}", serde_json::to_string(&report)?);
        return Ok(());
    }
    for row in rows {
        let found = row.found.map_or_else(|| "-".to_owned(), |(_, value)| value.to_string());
        let problem = row.problem.map_or_else(|| "as wanted".to_owned(), |p| p.to_string());
        println!("{:<16} wanted {:<10} found {found:<10} {problem}", row.name, row.wanted);
    }
    if n_written > 0 {
        println!("{n_written} written. Reboot the autopilot: some of them count only then.");
    }
    println!("{} of {n_all} parameters as wanted", n_all - n_wrong);
    Ok(())
}
