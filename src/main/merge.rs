//! `stockpilot merge`: one map of several logs.

use clap::Args;
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::survey::{AccountLine, MergeOptions, MergedSurvey, accounts_table, merge_logs};

#[derive(Debug, Args)]
pub(crate) struct MergeArgs {
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

/// Solves the turns of all logs together, and writes the result.
pub(crate) fn run(args: &MergeArgs) -> anyhow::Result<ExitCode> {
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
