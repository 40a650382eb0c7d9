//! `stockpilot plan`: where the vehicle may fly.

use crate::now;
use anyhow::Context;
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::config;
use stockpilot::service::plan::{Extent, Plan, Suggestions};

#[derive(Debug, Args)]
pub(crate) struct PlanArgs {
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

/// What `plan` prints with `--json`.
#[derive(Debug, Serialize)]
struct PlanLine {
    extent: Extent,
    evaluation_s: f64,
    pictures: Vec<String>,
    what_if: Option<Suggestions>,
}

/// Says how much of the hall is free, draws it, and tries markers.
pub(crate) fn run(args: &PlanArgs) -> anyhow::Result<ExitCode> {
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
