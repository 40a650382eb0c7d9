//! Flies stockpilot without hardware.

use clap::{Args, Parser, Subcommand};
use std::ops::Range;
use std::process::ExitCode;
use stockpilot::messages::Verdict;
use stockpilot::pilot::Action;
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::campaign;
use stockpilot_sim::report::CampaignReport;
use stockpilot_sim::scenario::ScenarioArgs;

/// Worlds, vehicle, sensors and autopilot that fly stockpilot on a laptop.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Many flights without bytes and threads in between, as fast as the machine allows.
    Campaign(CampaignArgs),
}

#[derive(Debug, Args)]
struct CampaignArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seeds, first to last plus one.
    #[arg(long, default_value = "0..20", value_parser = seeds)]
    seeds: Range<u64>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// Print what the brain says and decides.
    #[arg(long)]
    trace: bool,
}

fn seeds(text: &str) -> Result<Range<u64>, String> {
    let wrong = || format!("{text:?} is not of the form 0..20");
    let (first, end) = text.split_once("..").ok_or_else(wrong)?;
    let number = |part: &str| part.parse::<u64>().map_err(|_| wrong());
    let range = number(first)?..number(end)?;
    if range.is_empty() { Err(wrong()) } else { Ok(range) }
}

fn main() -> anyhow::Result<ExitCode> {
    match Cli::parse().command {
        Some(Command::Campaign(args)) => run_campaign(&args),
        None => Ok(ExitCode::SUCCESS),
    }
}

#[expect(clippy::print_stderr, reason = "the program's output")]
fn trace(at: Stamp<Mono>, action: &Action) {
    match action {
        Action::Say(text) => eprintln!("{at:?} {:?}: {}", text.severity, text.text),
        Action::PhaseChanged(change) => {
            eprintln!("{at:?} {} → {}: {}", change.from.name(), change.to.name(), change.reason);
        }
        Action::FixTreated(record) if record.verdict != Verdict::Fused => {
            eprintln!("{at:?} fix {record:?}");
        }
        Action::Command(command) => eprintln!("{at:?} asks the autopilot: {command:?}"),
        _ => {}
    }
}

#[expect(clippy::print_stdout, clippy::print_stderr, reason = "the program's output")]
fn run_campaign(args: &CampaignArgs) -> anyhow::Result<ExitCode> {
    let mut runs = Vec::new();
    for seed in args.seeds.clone() {
        let run = campaign::run(&args.scenario.scenario(seed)?, |at, action| {
            if args.trace {
                trace(at, action);
            }
        })?;
        eprintln!(
            "seed {seed}: {:.1} ± {:.1} m³, truth {:.1} m³, error {:+.2} %, coverage {:.0} %, \
             path {:.0} m, {:.0} s in {:.2} s, 3σ {:.1} %, rms {:.1} cm{}",
            run.volume_m3,
            2.0 * run.sigma_m3,
            run.volume_true_m3,
            100.0 * run.relative_error,
            100.0 * run.coverage,
            run.path_length_m,
            run.sim_time_s,
            run.wall_time_s,
            100.0 * run.position_within_3_sigma,
            100.0 * run.position_rms_m,
            if run.collided { ", COLLIDED" } else { "" },
        );
        runs.push(run);
    }
    let report = CampaignReport::new(runs);
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        println!(
            "{} runs: 95 % coverage {:.2}, rms z {:.2}, rms error {:.2} %, {:.0} × real time",
            report.runs.len(),
            report.coverage_95,
            report.rms_z,
            100.0 * report.rms_relative_error,
            report.realtime_factor,
        );
    }
    Ok(ExitCode::SUCCESS)
}
