//! The command line of `consistency`.

use super::files::{write_setting, write_summary};
use super::flight::{FlightPlan, FlownFlight, fly};
use super::hover::hover;
use super::summary::SettingReport;
use super::update::Update;
use crate::camera_faults::CameraFault;
use crate::parallel::{n_cores, run_in_order};
use crate::scenario::ScenarioArgs;
use anyhow::Context;
use clap::Args;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

/// Many flights; NEES and NIS of the localisation beside their χ² bands.
#[derive(Debug, Clone, Args)]
pub struct ConsistencyArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seeds, first to last plus one.
    #[arg(long, default_value = "0..50", value_parser = crate::scenario::seeds)]
    seeds: Range<u64>,
    /// From exposure to arrival of a camera frame, ms; several with commas.
    #[arg(long, value_delimiter = ',', default_value = "30", value_parser = clap::value_parser!(u64).range(0..1000))]
    latency_ms: Vec<u64>,
    /// How frames enter the filter; several with commas.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "tight")]
    update: Vec<Update>,
    /// Each flight is watched this long from its start, s.
    #[arg(long, default_value_t = 90.0)]
    flight_s: f64,
    /// What the detector gets wrong from 3 to 9 s after the survey's start.
    #[arg(long, value_enum)]
    fault: Option<CameraFault>,
    /// Instead of many flights one that hovers this long, s; the first seed only.
    #[arg(long)]
    hover_s: Option<f64>,
    /// Flights at once; as many as there are cores if left out. Results do not depend on it.
    #[arg(long)]
    jobs: Option<NonZeroUsize>,
    /// Where the CSV files and pictures go; nothing is written without it.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Several<'a> {
    settings: &'a [SettingReport],
}

/// When a fault begins and ends, s after the survey's start.
const FAULT_S: (f64, f64) = (3.0, 9.0);

/// Runs the command.
///
/// # Errors
/// A scenario that cannot be built or flown, or a directory that cannot be written to.
pub fn run(args: &ConsistencyArgs) -> anyhow::Result<()> {
    anyhow::ensure!((10.0..=3600.0).contains(&args.flight_s), "--flight-s is 10 to 3600");
    if let Some(hover_s) = args.hover_s {
        return run_hover(args, hover_s);
    }
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out)
            .with_context(|| format!("cannot make the directory {}", out.display()))?;
    }
    let mut reports = Vec::new();
    for &update in &args.update {
        for &latency_ms in &args.latency_ms {
            let flights = flights(args, &plan(args, update, latency_ms))?;
            let world = &args.scenario.world;
            let report = SettingReport::new(latency_ms, update.name(), world, &flights);
            if let Some(out) = &args.out {
                write_setting(out, &report, &flights)?;
            }
            reports.push(report);
        }
    }
    if let Some(out) = &args.out {
        write_summary(out, &reports)?;
    }
    print(&reports, args.json)
}

fn plan(args: &ConsistencyArgs, update: Update, latency_ms: u64) -> FlightPlan {
    FlightPlan {
        latency: Duration::from_millis(latency_ms),
        update,
        longest: Duration::from_secs_f64(args.flight_s),
        fault: args.fault.map(|fault| (fault, FAULT_S.0, FAULT_S.1)),
    }
}

#[expect(clippy::print_stderr, reason = "the program's output")]
fn flights(args: &ConsistencyArgs, plan: &FlightPlan) -> anyhow::Result<Vec<FlownFlight>> {
    let fly_one = |seed| fly(&args.scenario.scenario(seed)?, plan);
    let show = |flight: &FlownFlight| {
        eprintln!("{} {} ms: {}", plan.update.name(), plan.latency.as_millis(), line(flight));
    };
    run_in_order(args.seeds.clone(), args.jobs.unwrap_or_else(n_cores), fly_one, show)
}

/// One flight in a line.
fn line(flight: &FlownFlight) -> String {
    let report = SettingReport::new(0, "", "", std::slice::from_ref(flight));
    let means = report.by_name().map(|(name, group)| format!("{name} {:.2}", group.nees_mean));
    format!(
        "seed {}: {}, NIS/dof {:.2}, gated {:.1} %, rms {:.1} mm, yaw {:.3}°",
        flight.seed,
        means.join(", "),
        report.nis.per_dof_mean,
        100.0 * report.nis.gated_ratio,
        1000.0 * report.position_rms_m,
        report.yaw_rms_deg,
    )
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print(reports: &[SettingReport], as_json: bool) -> anyhow::Result<()> {
    match (as_json, reports) {
        (true, [only]) => println!("{}", serde_json::to_string(only)?),
        (true, several) => println!("{}", serde_json::to_string(&Several { settings: several })?),
        (false, reports) => reports.iter().for_each(print_table),
    }
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_table(report: &SettingReport) {
    println!(
        "{} update, {} ms, {} flights, {} looks ({} without a factor)",
        report.update, report.latency_ms, report.n_runs, report.n_looks, report.n_broken
    );
    for (name, group) in report.by_name() {
        println!(
            "  {name:<18} NEES {:6.3}, band {:.3} to {:.3}, {}",
            group.nees_mean,
            group.band_low,
            group.band_high,
            if group.is_inside { "inside" } else { "OUTSIDE" },
        );
    }
    let nis = report.nis;
    println!(
        "  NIS/dof {:.3}, band {:.3} to {:.3}, {:.2} % of {} gated",
        nis.per_dof_mean,
        nis.band_low,
        nis.band_high,
        100.0 * nis.gated_ratio,
        nis.n
    );
    println!(
        "  position rms {:.1} mm, yaw rms {:.3}° with four tags or more ({} looks)",
        1000.0 * report.position_rms_m,
        report.yaw_rms_deg,
        report.n_looks_enough_tags
    );
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn run_hover(args: &ConsistencyArgs, hover_s: f64) -> anyhow::Result<()> {
    anyhow::ensure!((10.0..=86_400.0).contains(&hover_s), "--hover-s is 10 to 86400");
    let (Some(&latency_ms), Some(&update)) = (args.latency_ms.first(), args.update.first()) else {
        anyhow::bail!("a latency and an update are needed");
    };
    let scenario = args.scenario.scenario(args.seeds.start)?;
    let plan = plan(args, update, latency_ms);
    let report = hover(&scenario, &plan, Duration::from_secs_f64(hover_s))?;
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        println!("{report}");
    }
    Ok(())
}
