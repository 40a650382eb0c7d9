//! `stockpilot markers survey`.

use super::markers_file;
use anyhow::{Context, ensure};
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::config;
use stockpilot::markers::{Constraints, SurveyReport, SurveyRequest, TagName, survey};

#[derive(Debug, Args)]
pub(crate) struct SurveyArgs {
    /// Log of a flight, or of the vehicle carried through the hall with the service running.
    log: PathBuf,
    /// Tags whose places in the log's configuration are trusted, such as 36h11:0,36h11:7.
    #[arg(long, value_delimiter = ',', value_name = "TAGS")]
    fix: Vec<TagName>,
    /// σ of each of their corners, m.
    #[arg(long, value_name = "M", default_value_t = 0.003)]
    fix_sigma_m: f64,
    /// Known places, tapes and edges (TOML).
    #[arg(long, value_name = "FILE")]
    constraints: Option<PathBuf>,
    /// Edge of the black square of tags whose size nothing else tells, m.
    #[arg(long, value_name = "M")]
    edge_m: Option<f64>,
    /// σ of the size of all sheets together, relative.
    #[arg(long, value_name = "RATIO", default_value_t = 0.003)]
    scale_sigma: f64,
    /// Use a frame each so many seconds.
    #[arg(long, value_name = "S", default_value_t = 0.3)]
    every_s: f64,
    /// σ of a corner, px; that of the log's configuration if left out.
    #[arg(long, value_name = "PX")]
    corner_sigma_px: Option<f64>,
    /// Write the map for markers.file of the configuration; the file must not exist.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the map's file and its σ into this configuration file, unless what was held out disagrees.
    #[arg(long, value_name = "CONFIG", requires = "out")]
    write: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[expect(clippy::print_stdout, reason = "the program's output")]
pub(crate) fn run(args: &SurveyArgs) -> anyhow::Result<ExitCode> {
    let is_positive = |value: f64| value.is_finite() && value > 0.0;
    ensure!(is_positive(args.fix_sigma_m) && is_positive(args.scale_sigma), "a σ is positive");
    ensure!(args.every_s.is_finite() && args.every_s >= 0.0, "--every-s is 0 or more");
    ensure!(args.corner_sigma_px.is_none_or(is_positive), "a σ is positive");
    ensure!(args.edge_m.is_none_or(is_positive), "an edge is positive");
    let constraints = args.constraints.as_ref().map(|path| Constraints::read(path)).transpose()?;
    let request = SurveyRequest {
        fixed: args.fix.clone(),
        fixed_sigma_m: args.fix_sigma_m,
        edge_m: args.edge_m,
        scale_sigma: args.scale_sigma,
        every_s: args.every_s,
        corner_sigma_px: args.corner_sigma_px,
        constraints: constraints.unwrap_or_default(),
    };
    let report = survey(&args.log, &request)?;
    if let Some(out) = &args.out {
        markers_file(out, &report.sections())?;
    }
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print_survey(&report);
    }
    let agrees = agrees(&report);
    if let (Some(config), Some(map)) = (&args.write, &args.out) {
        write_into(config, map, &report)?;
    }
    if !args.json {
        print_next(args, report.marker_sigma_m);
    }
    Ok(if agrees { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// What the map was not made of agrees with it.
fn agrees(report: &SurveyReport) -> bool {
    report.held_out.is_none_or(|held_out| held_out.agrees)
        && report.tapes.iter().all(|tape| tape.agrees)
}

/// Puts the map and its σ into a configuration.
fn write_into(config: &Path, map: &Path, report: &SurveyReport) -> anyhow::Result<()> {
    ensure!(
        agrees(report),
        "nothing was written into {}: what was held out of the map disagrees with it, so its σ are too small",
        config.display()
    );
    config::write_markers(config, map, report.marker_sigma_m).with_context(|| {
        format!(
            "cannot write {}; tags that it has of its own go out first where the survey has them, too",
            config.display()
        )
    })
}

/// What was done with the σ, or is still to be done: an old one would go into every volume.
#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_next(args: &SurveyArgs, sigma_m: f64) {
    if let Some(config) = &args.write {
        println!("markers.file and marker_sigma_m = {sigma_m:.4} written to {}", config.display());
        return;
    }
    println!(
        "into the configuration belong markers.file and surface.uncertainty.marker_sigma_m = {sigma_m:.4} (root mean \
         square of the σ above): --out FILE --write CONFIG puts them there"
    );
}

/// What a survey says to people.
#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_survey(report: &SurveyReport) {
    println!(
        "{} tags from {} of {} frames, {} corners ({} left out), residual {:.2} px, variance factor {:.2}",
        report.tags.len(),
        report.n_frames_used,
        report.n_frames,
        report.n_corners,
        report.n_outliers,
        report.residual_rms_px,
        report.variance_factor,
    );
    println!(
        "edges are {:.4} ± {:.4} (1σ) of what was told",
        report.edge_factor, report.edge_factor_sigma
    );
    println!("tag            x        y        z m    σx   σy   σz mm  frames");
    for tag in &report.tags {
        let ([x, y, z], [sx, sy, sz]) = (tag.place_m, tag.sigma_m.map(|m| 1e3 * m));
        let known = if tag.is_known { ", known" } else { "" };
        let name = tag.name.to_string();
        println!(
            "{name:<10} {x:8.3} {y:8.3} {z:8.3}   {sx:5.1}{sy:5.1}{sz:5.1}     {}{known}",
            tag.n_views
        );
    }
    for name in &report.not_tied {
        println!(
            "{name}: seen, but no frame ties it to the others: carry the camera past it, near enough"
        );
    }
    if let Some(held_out) = &report.held_out {
        let verdict = if held_out.agrees { "agrees" } else { "DISAGREES" };
        println!(
            "{} frames held out: variance {:.2}, {:.2} in those used: {verdict}",
            held_out.n_frames, held_out.variance_factor, held_out.variance_factor_used
        );
    }
    for tape in &report.tapes {
        let verdict = if tape.agrees { "agrees" } else { "DISAGREES" };
        println!(
            "tape {} to {}: {:.3} m, without it {:.3} m ± {:.3} m (2σ): {verdict}",
            tape.from,
            tape.to,
            tape.measured_m,
            tape.predicted_m,
            2.0 * tape.sigma_m
        );
    }
    if !report.is_complete {
        println!("the log ends early or has gaps; what is there was used");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stockpilot::markers::HeldOut;

    const EXAMPLE: &str = include_str!("../../../deploy/config.example.toml");

    fn report(agrees: bool) -> SurveyReport {
        SurveyReport {
            tags: Vec::new(),
            not_tied: Vec::new(),
            n_frames: 10,
            n_frames_used: 10,
            n_corners: 400,
            n_outliers: 0,
            residual_rms_px: 0.2,
            variance_factor: 1.0,
            marker_sigma_m: 0.0027,
            edge_factor: 1.0,
            edge_factor_sigma: 0.001,
            held_out: Some(HeldOut {
                n_frames: 2,
                variance_factor: 3.0,
                variance_factor_used: 1.0,
                agrees,
            }),
            tapes: Vec::new(),
            is_complete: true,
        }
    }

    #[test]
    fn the_sigma_of_a_survey_reaches_the_budget_unless_it_disagrees() {
        let folder = tempfile::tempdir().unwrap();
        let (config, map) = (folder.path().join("hall.toml"), folder.path().join("map.toml"));
        std::fs::write(&config, EXAMPLE).unwrap();
        let corners = "[[0.0, 6.0, 2.0], [0.0, 6.5, 2.0], [0.0, 6.5, 2.5], [0.0, 6.0, 2.5]]";
        let tag = format!("[[tags]]\nfamily = \"36h11\"\nid = 40\ncorners_m = {corners}\n");
        std::fs::write(&map, tag).unwrap();
        let refusal = write_into(&config, &map, &report(false)).unwrap_err().to_string();
        assert!(refusal.contains("disagrees"), "{refusal}");
        assert_eq!(std::fs::read_to_string(&config).unwrap(), EXAMPLE);
        write_into(&config, &map, &report(true)).unwrap();
        let read = config::load(&config, &[]).unwrap();
        assert!((read.surface.uncertainty.marker_sigma_m - 0.0027).abs() < 1e-12);
        assert!(read.tags.iter().any(|tag| tag.id == 40));
    }
}
