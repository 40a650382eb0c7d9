//! `stockpilot replay`: the same flight again from its log.

use crate::now;
use anyhow::Context;
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::config::{Config, ConfigError};
use stockpilot::pilot::Pilot;
use stockpilot::record::replay::{ReplayReport, replay};

#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// The log.
    log: PathBuf,
    /// Fail unless every result is equal to the last bit.
    #[arg(long)]
    verify: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
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

/// Runs the brain on what the log holds, and compares what comes out.
pub(crate) fn run(args: &ReplayArgs) -> anyhow::Result<ExitCode> {
    let began = now();
    let report = replay(&args.log, |toml| pilot_from(toml, &args.log))
        .with_context(|| format!("cannot replay {}", args.log.display()))?;
    print_replay(&report, began.elapsed().as_secs_f64(), args.json)?;
    let is_failed = args.verify && !report.identical;
    Ok(if is_failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn pilot_from(toml: &str, log: &Path) -> Result<Pilot, ConfigError> {
    Config::from_log(toml, log)?.pilot_settings().map(Pilot::new)
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
