//! `stockpilot lidar`.

use anyhow::Context;
use clap::{Args, Subcommand};
use serde::Serialize;
use std::io::BufRead;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use stockpilot::calibration::range::{Known, Position, RangeCheck, Request, SCALE_SPAN_M, check};
use stockpilot::config::{self, Config, FoundRange};
use stockpilot::lidar::{Driver, LidarHealth, Settings};
use stockpilot::messages::Scan;
use stockpilot::pilot::Event;
use stockpilot::service::clock::Clock;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

#[derive(Debug, Args)]
pub(crate) struct LidarArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Bias, scale and noise of the ranges before a flat wall at taped distances, and where the
    /// LiDAR sees the vehicle. Put the vehicle down at each distance and press Enter.
    Check(CheckArgs),
}

#[derive(Debug, Args)]
struct CheckArgs {
    /// The configuration file; its `[lidar]` says where the sensor is.
    #[arg(long)]
    config: PathBuf,
    /// Override a key of the file; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// Taped distances from the axis of the head to the wall, square on, m: three or more, over a
    /// metre at least, such as 0.8,2,4.
    #[arg(long, value_name = "M", value_delimiter = ',', required = true)]
    at: Vec<f64>,
    /// How well each distance is taped, 1σ, m.
    #[arg(long, value_name = "M", default_value_t = 0.002)]
    tape_sigma_m: f64,
    /// How well the place of the head's axis is known, 1σ, m.
    #[arg(long, value_name = "M", default_value_t = 0.002)]
    axis_sigma_m: f64,
    /// Record so long at each distance, s.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    seconds: f64,
    /// Where the wall is, from x of the LiDAR towards y, if several are equally far.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    towards_deg: Option<f64>,
    /// Write what was seen into the configuration file.
    #[arg(long)]
    write: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &LidarArgs) -> anyhow::Result<ExitCode> {
    let What::Check(args) = &args.what;
    let (low, high) = (0.0, 1.0);
    for sigma_m in [args.tape_sigma_m, args.axis_sigma_m] {
        anyhow::ensure!(sigma_m > low && sigma_m <= high, "{sigma_m} m is no standard deviation");
    }
    anyhow::ensure!((0.5..=600.0).contains(&args.seconds), "--seconds is 0.5 to 600");
    let config = config::load(&args.config, &args.overrides)?;
    let runtime = tokio::runtime::Runtime::new().context("cannot start the runtime")?;
    let (positions, model) = runtime.block_on(recorded(&config, args))?;
    let spec = model.map(stockpilot::lidar::Model::spec);
    let request = Request {
        tape_sigma_m: args.tape_sigma_m,
        axis_sigma_m: args.axis_sigma_m,
        range_m: spec.map_or((config.lidar.min_range_m, config.lidar.max_range_m), |s| s.range_m),
        range_step_m: spec.map_or(0.001, |s| s.range_step_m),
        scale: (config.lidar.range_scale, config.surface.uncertainty.range_scale_sigma),
    };
    let found = check(&positions, args.towards_deg.map(f64::to_radians), &request)?;
    if args.write {
        config::write_range(&args.config, &for_file(&found))?;
    }
    let report = CheckReport::new(&found, args.write.then(|| args.config.clone()));
    print(&report, &found, args.json)?;
    Ok(ExitCode::SUCCESS)
}

type Recorded = (Vec<Position>, Option<stockpilot::lidar::Model>);

/// Asks for each distance and records there.
async fn recorded(config: &Config, args: &CheckArgs) -> anyhow::Result<Recorded> {
    let clock = Clock::real();
    let (events_tx, mut events) = mpsc::channel(256);
    let settings: Settings = config.lidar_settings()?;
    let cancel = CancellationToken::new();
    let now = clock.clone();
    let driver = Driver::start(settings, move || now.now(), events_tx, &cancel)?;
    let mut positions = Vec::new();
    for taped_m in &args.at {
        if !asked(*taped_m)? {
            anyhow::bail!("the input ended before {taped_m} m: press Enter at each distance");
        }
        // What waited in the channel was seen at the distance before.
        while events.try_recv().is_ok() {}
        let scans = scans(&mut events, Duration::from_secs_f64(args.seconds)).await;
        if scans.is_empty() {
            let health = driver.status().borrow().health.clone();
            anyhow::bail!(
                "at {taped_m} m no scan came in ({}): see `stockpilot doctor`",
                told(&health)
            );
        }
        positions.push(Position { taped_m: *taped_m, scans });
    }
    let identity = driver.status().borrow().identity.clone();
    driver.stop();
    Ok((positions, identity.and_then(|identity| identity.model)))
}

/// Waits for Enter; false at the end of the input.
#[expect(clippy::print_stderr, reason = "the question to the person")]
fn asked(taped_m: f64) -> anyhow::Result<bool> {
    eprintln!(
        "put the vehicle down with the LiDAR {taped_m:.3} m from the wall, step aside, press Enter"
    );
    let mut line = String::new();
    Ok(std::io::stdin().lock().read_line(&mut line)? > 0)
}

async fn scans(events: &mut mpsc::Receiver<Event>, span: Duration) -> Vec<Scan> {
    let mut scans = Vec::new();
    let recording = async {
        // The first may have begun while somebody still stood in the way.
        let mut is_first = true;
        while let Some(event) = events.recv().await {
            if let Event::Scanned(scan) = event {
                if !is_first {
                    scans.push(scan);
                }
                is_first = false;
            }
        }
    };
    // The end of the time is what is waited for.
    let _ended_early = tokio::time::timeout(span, recording).await;
    scans
}

fn told(health: &LidarHealth) -> String {
    match health {
        LidarHealth::Disconnected { reason } | LidarHealth::Faulty { reason } => reason.clone(),
        other => format!("{other:?}"),
    }
}

fn for_file(found: &RangeCheck) -> FoundRange {
    let pair = |known: &Known| (known.value, known.sigma);
    let whole = |rad: f64| rad.to_degrees().round();
    let body = found.body.iter().flatten();
    FoundRange {
        bias_m: pair(&found.bias_m),
        scale: found.scale.as_ref().map(pair),
        noise_m: found.noise_m.value,
        blind_sectors_deg: body.map(|s| [whole(s.from_rad), whole(s.to_rad)]).collect(),
    }
}

#[derive(Debug, Serialize)]
struct CheckReport {
    range_bias_m: f64,
    range_bias_sigma_m: f64,
    range_scale: Option<f64>,
    range_scale_sigma: Option<f64>,
    range_sigma_m: f64,
    range_sigma_sigma_m: f64,
    distances: Vec<DistanceLine>,
    /// `None` if the vehicle was not moved enough.
    own_body: Option<Vec<BodyLine>>,
    written: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct DistanceLine {
    taped_m: f64,
    measured_m: f64,
    left_mm: f64,
    noise_mm: f64,
    towards_deg: f64,
    beams: usize,
    share: f64,
}

#[derive(Debug, Serialize)]
struct BodyLine {
    from_deg: f64,
    to_deg: f64,
    nearest_m: f64,
}

impl CheckReport {
    fn new(found: &RangeCheck, written: Option<PathBuf>) -> Self {
        let distance = |line: &stockpilot::calibration::range::Line| DistanceLine {
            taped_m: line.taped_m,
            measured_m: line.measured_m,
            left_mm: 1e3 * line.left_m,
            noise_mm: 1e3 * line.noise_m,
            towards_deg: line.direction_rad.to_degrees(),
            beams: line.n_beams,
            share: line.share,
        };
        let body = |sector: &stockpilot::calibration::range::Sector| BodyLine {
            from_deg: sector.from_rad.to_degrees(),
            to_deg: sector.to_rad.to_degrees(),
            nearest_m: sector.nearest_m,
        };
        Self {
            range_bias_m: found.bias_m.value,
            range_bias_sigma_m: found.bias_m.sigma,
            range_scale: found.scale.map(|scale| scale.value),
            range_scale_sigma: found.scale.map(|scale| scale.sigma),
            range_sigma_m: found.noise_m.value,
            range_sigma_sigma_m: found.noise_m.sigma,
            distances: found.lines.iter().map(distance).collect(),
            own_body: found.body.as_ref().map(|sectors| sectors.iter().map(body).collect()),
            written,
        }
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print(report: &CheckReport, found: &RangeCheck, as_json: bool) -> anyhow::Result<()> {
    if as_json {
        println!("{}", serde_json::to_string(report)?);
        return Ok(());
    }
    println!("taped m  measured m  left mm  noise mm  towards  beams  on the wall");
    for line in &report.distances {
        println!(
            "{:7.3} {:11.4} {:+8.1} {:9.1} {:7.1}° {:6} {:11.0} %",
            line.taped_m,
            line.measured_m,
            line.left_mm,
            line.noise_mm,
            line.towards_deg,
            line.beams,
            100.0 * line.share
        );
    }
    let in_mm = |known: &Known| format!("{:+.1} ± {:.1} mm", 1e3 * known.value, 1e3 * known.sigma);
    println!("bias   {}", in_mm(&found.bias_m));
    match &found.scale {
        Some(scale) => println!("scale  {:+.3} ± {:.3} %", 1e2 * scale.value, 1e2 * scale.sigma),
        None => println!(
            "scale  not seen, stays as configured: three distances over {SCALE_SPAN_M} m would show it"
        ),
    }
    println!("noise  {:.1} ± {:.2} mm", 1e3 * found.noise_m.value, 1e3 * found.noise_m.sigma);
    match &report.own_body {
        None => println!("own body not judged: the distances must differ by 0.3 m or more"),
        Some(parts) if parts.is_empty() => println!("own body: nothing of the vehicle in view"),
        Some(parts) => {
            for part in parts {
                let BodyLine { from_deg, to_deg, nearest_m } = part;
                println!(
                    "own body from {from_deg:.0}° to {to_deg:.0}°, nearest at {nearest_m:.2} m"
                );
            }
        }
    }
    if let Some(path) = &report.written {
        written(path);
    }
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn written(path: &Path) {
    println!("written to {}", path.display());
}
