//! `stockpilot survey`.

use anyhow::Context;
use clap::{Args, Subcommand};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::survey::{Floor, FloorMemory, Learned, MergeOptions, survey_floor};

#[derive(Debug, Args)]
pub(crate) struct SurveyArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// The empty floor, to be what later surveys measure over.
    Floor(FloorArgs),
}

#[derive(Debug, Args)]
struct FloorArgs {
    /// Logs of flights over the floor.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Write PATH.asc and PATH-sigma.asc, the files of a base of kind "survey".
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Keep the lowest surface ever seen in this folder; its files stand for a base too.
    #[arg(long, value_name = "DIR")]
    memory: Option<PathBuf>,
    /// Date of the flights for the memory, such as 2026-03-04; today if left out.
    #[arg(long, value_name = "DATE")]
    date: Option<jiff::civil::Date>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct FloorLine {
    cells_seen: usize,
    cells: usize,
    mean_height_m: f64,
    mean_sigma_m: f64,
    shared_sigma_m: f64,
    height_file: Option<PathBuf>,
    sigma_file: Option<PathBuf>,
    memory: Option<LearnedLine>,
}

#[derive(Debug, Serialize)]
struct LearnedLine {
    new: usize,
    lower: usize,
    confirmed: usize,
    level_m: Option<f64>,
    height_file: PathBuf,
    sigma_file: PathBuf,
    shared_sigma_m: f64,
}

pub(crate) fn run(args: &SurveyArgs) -> anyhow::Result<ExitCode> {
    match &args.what {
        What::Floor(args) => run_floor(args),
    }
}

fn run_floor(args: &FloorArgs) -> anyhow::Result<ExitCode> {
    let floor = survey_floor(&args.logs, MergeOptions::default())?;
    let written = args.out.as_ref().map(|stem| floor.write(stem)).transpose()?;
    let learned = args.memory.as_ref().map(|_| remember(&floor, args)).transpose()?;
    let (height_file, sigma_file) = written.unzip();
    print_floor(&line(&floor, height_file, sigma_file, learned), args)?;
    Ok(ExitCode::SUCCESS)
}

fn remember(floor: &Floor, args: &FloorArgs) -> anyhow::Result<LearnedLine> {
    let folder = args.memory.as_ref().context("no folder")?;
    let date = args
        .date
        .unwrap_or_else(|| jiff::Timestamp::now().to_zoned(jiff::tz::TimeZone::UTC).date());
    let number = u32::try_from(i32::from(date.year()) * 10_000).context("a date before our era")?
        + u32::from(date.month().unsigned_abs()) * 100
        + u32::from(date.day().unsigned_abs());
    let mut memory = FloorMemory::read(folder, floor.grid)?;
    let Learned { n_new, n_lower, n_confirmed, level_m } = memory.take(floor, number);
    memory.write(folder)?;
    let (height_file, sigma_file) = FloorMemory::base_files(folder);
    Ok(LearnedLine {
        new: n_new,
        lower: n_lower,
        confirmed: n_confirmed,
        level_m,
        height_file,
        sigma_file,
        shared_sigma_m: memory.level.map_or(0.0, |level| level.sigma_m),
    })
}

#[expect(clippy::cast_precision_loss, reason = "counts of cells")]
fn line(
    floor: &Floor,
    height_file: Option<PathBuf>,
    sigma_file: Option<PathBuf>,
    memory: Option<LearnedLine>,
) -> FloorLine {
    let seen: Vec<(f64, f64)> = std::iter::zip(&floor.height_m, &floor.sigma_m)
        .filter(|(height_m, _)| height_m.is_finite())
        .map(|(height_m, sigma_m)| (*height_m, *sigma_m))
        .collect();
    let n = seen.len().max(1) as f64;
    FloorLine {
        cells_seen: seen.len(),
        cells: floor.height_m.len(),
        mean_height_m: seen.iter().map(|(height_m, _)| height_m).sum::<f64>() / n,
        mean_sigma_m: seen.iter().map(|(_, sigma_m)| sigma_m).sum::<f64>() / n,
        shared_sigma_m: floor.shared_sigma_m,
        height_file,
        sigma_file,
        memory,
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_floor(line: &FloorLine, args: &FloorArgs) -> anyhow::Result<()> {
    if args.json {
        println!("{}", serde_json::to_string(line)?);
        return Ok(());
    }
    println!(
        "{} of {} cells seen, mean height {:.4} m; σ of a cell {:.1} mm, shared by all {:.1} mm",
        line.cells_seen,
        line.cells,
        line.mean_height_m,
        1e3 * line.mean_sigma_m,
        1e3 * line.shared_sigma_m
    );
    if let (Some(heights), Some(sigmas)) = (&line.height_file, &line.sigma_file) {
        println!("{}", base_line(heights, sigmas, line.shared_sigma_m));
    }
    if let (Some(memory), Some(folder)) = (&line.memory, &args.memory) {
        println!(
            "memory in {}: {} cells new, {} lower than ever, {} confirmed",
            folder.display(),
            memory.new,
            memory.lower,
            memory.confirmed
        );
        if let Some(level_m) = memory.level_m {
            println!("the survey as a whole lay {:+.1} mm above it: taken out", 1e3 * level_m);
        }
        println!("{}", base_line(&memory.height_file, &memory.sigma_file, memory.shared_sigma_m));
    }
    Ok(())
}

/// What stands in the configuration for a surveyed base.
fn base_line(heights: &Path, sigmas: &Path, shared_sigma_m: f64) -> String {
    format!(
        "base = {{ kind = \"survey\", height_file = {:?}, sigma_file = {:?}, sigma_m = {shared_sigma_m:.4} }}",
        heights.display().to_string(),
        sigmas.display().to_string(),
    )
}
