//! `stockpilot markers`.

#[path = "markers/survey.rs"]
mod survey;

use anyhow::{Context, ensure};
use clap::{Args, Subcommand};
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::camera::picture::read_picture;
use stockpilot::camera::tag_finder::{Settings, TagFinder};
use stockpilot::config::{self, TagSection};
use stockpilot::markers::{
    self, Paper, PlanRequest, PlannedMarkers, PrintJob, RULER_MM, TagName, true_edge,
};
use stockpilot::messages::TagFamily;

#[derive(Debug, Args)]
pub(crate) struct MarkersArgs {
    #[command(subcommand)]
    command: MarkersCommand,
}

#[derive(Debug, Subcommand)]
enum MarkersCommand {
    /// Sheets to print, one tag each, with rulers that tell whether the printer kept the size.
    Print(PrintArgs),
    /// Where to hang how many, and how good fixes will be with them.
    Plan(PlanArgs),
    /// Where tags hang, from a carried flight's log.
    Survey(survey::SurveyArgs),
    /// The tags in pictures (PNG, PGM), a line of JSON for each picture.
    Detect(DetectArgs),
}

#[derive(Debug, Args)]
struct PrintArgs {
    /// 36h11, 25h9 or 16h5.
    #[arg(long, default_value = "36h11", value_parser = family)]
    family: TagFamily,
    /// The tags: numbers and ranges, such as 0-11,20.
    #[arg(long, default_value = "0-11")]
    ids: String,
    /// A0 to A4, letter or ledger.
    #[arg(long, default_value = "A4")]
    paper: String,
    /// Edge of the black square, mm; the largest that fits if left out.
    #[arg(long, value_name = "MM")]
    edge_mm: Option<f64>,
    /// What the horizontal and the vertical ruler of a printed sheet measure, mm: tells the true edge.
    #[arg(long, num_args = 2, value_names = ["X_MM", "Y_MM"])]
    measured_mm: Option<Vec<f64>>,
    /// Draw larger by what was measured, so that this printer's next sheets are true.
    #[arg(long, requires = "measured_mm")]
    compensate: bool,
    /// Note the true edge of these tags in this file, for `markers survey --constraints`.
    #[arg(long, value_name = "FILE", conflicts_with = "compensate")]
    edges: Option<PathBuf>,
    /// The PDF to write.
    #[arg(long, value_name = "FILE", default_value = "markers.pdf")]
    out: PathBuf,
}

#[derive(Debug, Args)]
struct PlanArgs {
    /// The configuration file: hall, cameras, planning; its tags count as hung.
    #[arg(long)]
    config: PathBuf,
    /// Override a key of the file; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// The tags of the file are not hung.
    #[arg(long)]
    from_nothing: bool,
    /// Family of the new markers.
    #[arg(long, default_value = "36h11", value_parser = family)]
    family: TagFamily,
    /// Length of their sides, m.
    #[arg(long, value_name = "M", default_value_t = 0.3)]
    edge_m: f64,
    /// Places for them are this far apart along the walls, m.
    #[arg(long, value_name = "M", default_value_t = 1.5)]
    spacing_m: f64,
    /// Markers to be seen from everywhere: one more than are needed.
    #[arg(long, default_value_t = 4)]
    in_view: usize,
    /// Quality of a fix to be had everywhere, in multiples of `planning.min_fix_quality`.
    #[arg(long, default_value_t = 2.0)]
    quality_factor: f64,
    /// No more new markers than this.
    #[arg(long, default_value_t = 60)]
    most: usize,
    /// For all headings, not the survey's alone.
    #[arg(long)]
    all_headings: bool,
    /// Write markers.toml and pictures into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct DetectArgs {
    /// The pictures.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// The families to look for.
    #[arg(long, value_delimiter = ',', default_value = "36h11", value_parser = family)]
    families: Vec<TagFamily>,
    /// Tags are looked for in a picture this many times smaller.
    #[arg(long, default_value_t = 1.5)]
    decimation: f32,
}

fn family(name: &str) -> Result<TagFamily, String> {
    TagFamily::from_name(name).ok_or_else(|| "is 36h11, 25h9 or 16h5".to_owned())
}

pub(crate) fn run(args: &MarkersArgs) -> anyhow::Result<ExitCode> {
    match &args.command {
        MarkersCommand::Print(args) => print(args),
        MarkersCommand::Plan(args) => plan(args),
        MarkersCommand::Survey(args) => survey::run(args),
        MarkersCommand::Detect(args) => detect(args),
    }
}

/// `0-3,7` is 0, 1, 2, 3, 7.
fn ids(text: &str) -> anyhow::Result<Vec<u32>> {
    let mut ids = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let number = |text: &str| text.trim().parse::<u32>().context("--ids is like 0-11,20");
        let (first, last) = (number(first)?, number(last)?);
        ensure!(first <= last && last < 10_000, "--ids: {part:?} is no range");
        ids.extend(first..=last);
    }
    Ok(ids)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print(args: &PrintArgs) -> anyhow::Result<ExitCode> {
    let paper = Paper::named(&args.paper)?;
    let edge_mm = args.edge_mm.unwrap_or_else(|| paper.largest_edge_mm(args.family));
    let mut job =
        PrintJob { family: args.family, ids: ids(&args.ids)?, paper, edge_mm, scale: [1.0; 2] };
    let measured = args.measured_mm.as_deref().map(|mm| [mm[0], mm[1]]);
    if let Some(measured) = measured {
        if !args.compensate {
            return tell_edge(&job, measured, args.edges.as_deref());
        }
        job.scale = true_edge(edge_mm, measured)?.scale;
    }
    write(&args.out, &job.pdf()?)?;
    println!(
        "{}: {} sheets, {edge_mm:.1} mm tags on {}",
        args.out.display(),
        job.ids.len(),
        paper.name
    );
    println!("print at 100 % (\"actual size\"), then measure both rulers of a sheet");
    if job.scale[0].to_bits() == 1.0_f64.to_bits() && std::io::stdin().is_terminal() {
        return ask(&job, args.edges.as_deref());
    }
    println!(
        "and say what they measure: --measured-mm X Y --edges FILE, with the same tags, paper and edge"
    );
    Ok(ExitCode::SUCCESS)
}

/// Asks for both rulers; nothing entered means later.
#[expect(clippy::print_stdout, reason = "the program's output")]
fn ask(job: &PrintJob, edges: Option<&Path>) -> anyhow::Result<ExitCode> {
    let mut measured_mm = [RULER_MM; 2];
    for (name, measured_mm) in ["horizontal", "vertical"].iter().zip(&mut measured_mm) {
        print!("the {name} ruler measures, mm (nothing to do it later): ");
        std::io::stdout().flush()?;
        let mut line = String::new();
        std::io::stdin().read_line(&mut line)?;
        if line.trim().is_empty() {
            return Ok(ExitCode::SUCCESS);
        }
        *measured_mm = line.trim().parse().context("a length in mm, such as 199.5")?;
    }
    tell_edge(job, measured_mm, edges)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn tell_edge(
    job: &PrintJob,
    measured_mm: [f64; 2],
    edges: Option<&Path>,
) -> anyhow::Result<ExitCode> {
    let edge_mm = job.edge_mm;
    let edge = true_edge(edge_mm, measured_mm)?;
    println!(
        "true edge: {:.2} mm, {:.4} m (asked: {edge_mm:.1} mm)",
        edge.edge_mm,
        edge.edge_mm / 1e3
    );
    if edge.is_square() {
        note(job, edge.edge_mm / 1e3, edges)?;
        return Ok(ExitCode::SUCCESS);
    }
    println!(
        "both directions differ by {:.2} %: no square; print again with --compensate, or on another printer",
        100.0 * edge.difference
    );
    Ok(ExitCode::FAILURE)
}

/// Keeps what was measured where the survey of the markers reads it.
#[expect(clippy::print_stdout, reason = "the program's output")]
fn note(job: &PrintJob, edge_m: f64, edges: Option<&Path>) -> anyhow::Result<()> {
    let Some(path) = edges else {
        println!("--edges FILE keeps it for `markers survey --constraints FILE`");
        return Ok(());
    };
    let tags: Vec<TagName> = job.ids.iter().map(|id| TagName::new(job.family, *id)).collect();
    markers::note_edges(path, &tags, edge_m)?;
    println!("noted in {}: `markers survey --constraints` reads it there", path.display());
    Ok(())
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn plan(args: &PlanArgs) -> anyhow::Result<ExitCode> {
    ensure!((0.05..=2.0).contains(&args.edge_m), "--edge-m is 0.05 to 2 m");
    ensure!((0.2..=50.0).contains(&args.spacing_m), "--spacing-m is 0.2 to 50 m");
    ensure!(args.quality_factor > 0.0 && args.in_view > 0, "nothing is asked");
    let config = config::load(&args.config, &args.overrides)?;
    let request = PlanRequest {
        family: args.family,
        edge_m: args.edge_m,
        spacing_m: args.spacing_m,
        n_markers: args.in_view,
        quality_factor: args.quality_factor,
        n_most: args.most,
        all_headings: args.all_headings,
        from_nothing: args.from_nothing,
    };
    let (planned, with_them) = markers::plan(&config, &request)?;
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make {}", folder.display()))?;
        markers_file(&folder.join("markers.toml"), &with_them.tags)?;
        markers::draw(&with_them, folder)?;
    }
    if args.json {
        println!("{}", serde_json::to_string(&planned)?);
    } else {
        print_plan(&planned);
    }
    let is_served = planned.n_served == planned.n_poses;
    Ok(if is_served { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Writes a file for `markers.file` of the configuration, which must not exist.
fn markers_file(path: &Path, tags: &[TagSection]) -> anyhow::Result<()> {
    let text = toml::to_string(&MarkersToml { tags })?;
    let told = || format!("cannot write {}", path.display());
    std::fs::File::create_new(path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .with_context(told)
}

/// A file for `markers.file` of the configuration.
#[derive(Debug, Serialize)]
struct MarkersToml<'a> {
    tags: &'a [TagSection],
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_plan(planned: &PlannedMarkers) {
    let n_new = planned.markers.len();
    println!(
        "hang {n_new} markers of {:.2} m beside {} that are there:",
        planned.edge_m, planned.n_there
    );
    for marker in &planned.markers {
        let [x, y, z] = marker.place_m;
        println!(
            "{:4}  ({x:6.2}, {y:6.2}, {z:5.2}) m, facing {:.0}°",
            marker.id, marker.facing_deg
        );
    }
    println!(
        "{} of {} poses see enough (quality {:.1}); {} would not with a marker at all {} places",
        planned.n_served,
        planned.n_poses,
        planned.quality,
        planned.n_hopeless,
        planned.n_candidates
    );
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn detect(args: &DetectArgs) -> anyhow::Result<ExitCode> {
    let settings = Settings {
        families: args.families.clone(),
        decimation: args.decimation,
        ..Settings::default()
    };
    let mut finder = TagFinder::new(&settings)?;
    for path in &args.pictures {
        let told = || path.display().to_string();
        let stamped = read_picture(&std::fs::read(path).with_context(told)?).with_context(told)?;
        let found = finder.find(&stamped.picture)?;
        let tags: Vec<_> = found
            .tags
            .iter()
            .map(|tag| {
                serde_json::json!({
                    "id": tag.id,
                    "family": tag.family.name(),
                    "corners_px": tag.corners_px,
                    "decision_margin": tag.decision_margin,
                })
            })
            .collect();
        let size_px = [stamped.picture.width_px(), stamped.picture.height_px()];
        let line = serde_json::json!({
            "picture": path, "size_px": size_px, "tags": tags, "left_out": found.n_left_out,
        });
        println!("{line}");
    }
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stockpilot::markers::Constraints;

    #[test]
    fn a_measured_sheet_is_kept_for_the_survey_and_a_crooked_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("edges.toml");
        let job = PrintJob {
            family: TagFamily::Tag36h11,
            ids: vec![4, 5],
            paper: Paper::named("A4").unwrap(),
            edge_mm: 150.0,
            scale: [1.0; 2],
        };
        // 199 mm instead of 200 in both directions: 0.5 % smaller; then one direction 2 % larger than the other.
        tell_edge(&job, [199.0, 199.0], Some(&path)).unwrap();
        let edges = Constraints::read(&path).unwrap().edges;
        assert!((edges[0].edge_m - 0.14925).abs() < 1e-9, "{edges:?}");
        assert_eq!(edges[0].tags.iter().map(|tag| tag.id).collect::<Vec<_>>(), [4, 5]);
        tell_edge(&job, [202.0, 198.0], Some(&path)).unwrap();
        assert_eq!(Constraints::read(&path).unwrap().edges, edges);
    }
}
