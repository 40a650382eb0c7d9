//! `stockpilot calibrate`.

use clap::{Args, Subcommand};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stockpilot::calibration::mount::{AXES, Found, Limits, MountCalibration};
use stockpilot::config::{self, FoundMount};
use stockpilot::survey::{LidarCalibration, MountOptions, calibrate_mount};

#[derive(Debug, Args)]
pub(crate) struct CalibrateArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Where the LiDAR sits on the body and where it looks, from a flight along floor and walls.
    Lidar(LidarArgs),
    /// How late the LiDAR's stamps come, from the same kind of flight: the faster it turns, the better.
    Time(LidarArgs),
}

#[derive(Debug, Args)]
struct LidarArgs {
    /// Log of a flight that turned to several headings near the walls; `hall.walls_m` must be configured.
    log: PathBuf,
    /// No material lies in the hall.
    #[arg(long)]
    empty: bool,
    /// How well the places of the walls are known, 1σ, m.
    #[arg(long, value_name = "M", default_value_t = 0.005)]
    wall_sigma_m: f64,
    /// How well the level of the floor is known, 1σ, m; as configured if left out.
    #[arg(long, value_name = "M")]
    floor_sigma_m: Option<f64>,
    /// Write what was seen into this configuration file.
    #[arg(long, value_name = "CONFIG")]
    write: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &CalibrateArgs) -> anyhow::Result<ExitCode> {
    match &args.what {
        What::Lidar(args) => run_lidar(args),
        What::Time(args) => run_time(args),
    }
}

/// Stamps may be off by so much before their offset is known, s.
const ANY_CLOCK_S: f64 = 0.05;

fn calibration(args: &LidarArgs, clock_sigma_s: Option<f64>) -> anyhow::Result<LidarCalibration> {
    for sigma_m in [Some(args.wall_sigma_m), args.floor_sigma_m].into_iter().flatten() {
        anyhow::ensure!(sigma_m > 0.0 && sigma_m <= 1.0, "{sigma_m} m is no standard deviation");
    }
    let options = MountOptions {
        hall_is_empty: args.empty,
        wall_sigma_m: args.wall_sigma_m,
        floor_sigma_m: args.floor_sigma_m,
        clock_sigma_s,
        limits: Limits::default(),
    };
    Ok(calibrate_mount(&args.log, &options)?)
}

#[derive(Debug, Serialize)]
struct ClockLine {
    clock_offset_ms: f64,
    change_ms: f64,
    sigma_ms: f64,
    seen: bool,
    halves_z: f64,
    contradicts: bool,
    written: Option<PathBuf>,
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn run_time(args: &LidarArgs) -> anyhow::Result<ExitCode> {
    let LidarCalibration { mount, flown_with } = calibration(args, Some(ANY_CLOCK_S))?;
    let found = mount.clock_offset_s;
    let Found { change, is_seen, halves_z, .. } = found;
    let sigma = found.sigma_by_halves();
    // The mounting was found beside it: what contradicts itself there is in the clock, too.
    let mut contradicting = contradicting(&mount);
    contradicting.extend(found.contradicts_itself().then_some("clock offset"));
    let contradicts = !contradicting.is_empty();
    let offset_s = flown_with.clock_offset_s + change;
    let written = args.write.as_ref().filter(|_| is_seen && !contradicts);
    if let Some(path) = written {
        config::write_clock(path, offset_s, sigma)?;
    }
    if args.json {
        let line = ClockLine {
            clock_offset_ms: 1e3 * offset_s,
            change_ms: 1e3 * change,
            sigma_ms: 1e3 * sigma,
            seen: is_seen,
            halves_z,
            contradicts,
            written: written.cloned(),
        };
        println!("{}", serde_json::to_string(&line)?);
    } else if is_seen {
        println!(
            "clock_offset_ms = {:.3}  # ± {:.3}, {:+.3} against the flight; halves differ by {:.1} σ",
            1e3 * offset_s,
            1e3 * sigma,
            1e3 * change,
            halves_z.abs()
        );
    } else {
        println!(
            "not seen: ± {:.1} ms; turn fast to and fro near walls, and climb and sink over the floor",
            1e3 * sigma
        );
    }
    if contradicts {
        eprint_line(&contradiction(&contradicting, args.write.is_some()));
    }
    Ok(if is_seen && !contradicts { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn run_lidar(args: &LidarArgs) -> anyhow::Result<ExitCode> {
    let found = calibration(args, None)?.mount;
    let contradicting = contradicting(&found);
    let written = write_if_it_agrees(&found, args.write.as_deref())?;
    print_mount(&found, args.json, written)?;
    if !contradicting.is_empty() {
        eprint_line(&contradiction(&contradicting, args.write.is_some()));
    }
    let is_whole = found.axes.iter().all(|axis| axis.is_seen) && contradicting.is_empty();
    Ok(if is_whole { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

#[expect(clippy::print_stderr, reason = "beside the program's output, which may be JSON")]
fn eprint_line(text: &str) {
    eprintln!("{text}");
}

/// The axes whose halves contradict each other.
fn contradicting(found: &MountCalibration) -> Vec<&'static str> {
    let axes = found.axes.iter().zip(AXES);
    axes.filter(|(axis, _)| axis.contradicts_itself()).map(|(_, name)| name).collect()
}

/// Writes the mounting, unless an axis contradicts itself: the others were found beside it and err with it.
fn write_if_it_agrees(
    found: &MountCalibration,
    path: Option<&Path>,
) -> anyhow::Result<Option<PathBuf>> {
    let Some(path) = path.filter(|_| contradicting(found).is_empty()) else { return Ok(None) };
    config::write_mount(path, &for_file(found))?;
    Ok(Some(path.to_owned()))
}

/// What halves that contradict each other mean.
fn contradiction(axes: &[&str], was_to_write: bool) -> String {
    let refused = if was_to_write { "nothing was written: " } else { "" };
    format!(
        "{refused}{}: both halves of the flight contradict each other by more than 3 σ. Either the LiDAR moved on the \
         body in flight, or what it saw did (a gate, a vehicle, material), or a wall or the floor is not where the \
         configuration has it. Tighten the mounting, check hall.walls_m and the floor, and fly again.",
        axes.join(", ")
    )
}

/// The configuration has one σ for the place and one for the direction: the largest.
fn for_file(found: &MountCalibration) -> FoundMount {
    let largest = |axes: &[Found]| axes.iter().map(Found::sigma_by_halves).fold(0.0, f64::max);
    FoundMount {
        body_from_lidar: found.body_from_lidar,
        position_sigma_m: largest(&found.axes[..3]),
        rotation_sigma_rad: largest(&found.axes[3..]),
    }
}

#[derive(Debug, Serialize)]
struct MountLine {
    position_m: [f64; 3],
    rotation_deg: [f64; 3],
    axes: Vec<AxisLine>,
    range_bias_m: f64,
    range_bias_sigma_m: f64,
    faces: Vec<FaceLine>,
    written: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct AxisLine {
    name: &'static str,
    unit: &'static str,
    change: f64,
    sigma: f64,
    seen: bool,
    halves_z: f64,
    contradicts: bool,
}

#[derive(Debug, Serialize)]
struct FaceLine {
    name: String,
    beams: usize,
    rms_m: f64,
}

impl MountLine {
    fn new(found: &MountCalibration, written: Option<PathBuf>) -> Self {
        let (roll, pitch, yaw) = found.body_from_lidar.rotation.euler_rad();
        let axis = |(k, axis): (usize, &Found)| {
            let (unit, scale) = if k < 3 { ("m", 1.0) } else { ("deg", 1_f64.to_degrees()) };
            AxisLine {
                name: AXES[k],
                unit,
                change: axis.change * scale,
                sigma: axis.sigma_by_halves() * scale,
                seen: axis.is_seen,
                halves_z: axis.halves_z,
                contradicts: axis.contradicts_itself(),
            }
        };
        let faces = found.faces.iter();
        Self {
            position_m: found.body_from_lidar.origin.coords.into(),
            rotation_deg: [roll, pitch, yaw].map(f64::to_degrees),
            axes: found.axes.iter().enumerate().map(axis).collect(),
            range_bias_m: found.range_bias_m.0,
            range_bias_sigma_m: found.range_bias_m.1,
            faces: faces
                .map(|f| FaceLine { name: f.name.clone(), beams: f.n_beams, rms_m: f.rms_m })
                .collect(),
            written,
        }
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_mount(
    found: &MountCalibration,
    as_json: bool,
    written: Option<PathBuf>,
) -> anyhow::Result<()> {
    let line = MountLine::new(found, written);
    if as_json {
        println!("{}", serde_json::to_string(&line)?);
        return Ok(());
    }
    for face in &line.faces {
        println!("{:8} {:>8} beams, rms {:.1} mm", face.name, face.beams, 1e3 * face.rms_m);
    }
    for axis in &line.axes {
        let (scale, unit) = if axis.unit == "m" { (1e3, "mm") } else { (1.0, "°") };
        let (change, sigma) = (scale * axis.change, scale * axis.sigma);
        if axis.seen {
            println!(
                "{:13} {change:+8.3} ± {sigma:.3} {unit}; halves of the flight differ by {:.1} σ",
                axis.name,
                axis.halves_z.abs()
            );
        } else {
            println!(
                "{:13} not seen, stays as configured, ± {sigma:.3} {unit}: {}",
                axis.name,
                advice(axis.name)
            );
        }
    }
    let [x, y, z] = line.position_m;
    let [roll, pitch, yaw] = line.rotation_deg;
    println!(
        "mount = {{ position_m = [{x:.4}, {y:.4}, {z:.4}], rotation_deg = [{roll:.4}, {pitch:.4}, {yaw:.4}] }}"
    );
    if let Some(path) = &line.written {
        println!("written to {}", path.display());
    }
    Ok(())
}

/// What would show an axis.
fn advice(axis: &str) -> &'static str {
    match axis {
        "place z" => "the level of the floor must be known better (--floor-sigma-m)",
        "place x" | "place y" => {
            "turn to headings all around near walls whose places are known (--wall-sigma-m)"
        }
        _ => "fly near walls at several headings, at different distances",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stockpilot::geometry::{Point, Rotation, Transform};

    const EXAMPLE: &str = include_str!("../../deploy/config.example.toml");

    fn found(halves_z: [f64; 6]) -> MountCalibration {
        let axis = |halves_z| Found { change: 0.001, sigma: 0.0007, is_seen: true, halves_z };
        MountCalibration {
            body_from_lidar: Transform::new(Rotation::identity(), Point::new(0.1, 0.0, 0.0)),
            axes: halves_z.map(axis),
            range_bias_m: (0.0, 0.002),
            clock_offset_s: axis(0.0),
            faces: Vec::new(),
        }
    }

    /// What a run leaves in the file, and whether it says that it wrote.
    fn file_after(found: &MountCalibration) -> (String, bool) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.toml");
        std::fs::write(&path, EXAMPLE).unwrap();
        let written = write_if_it_agrees(found, Some(&path)).unwrap();
        (std::fs::read_to_string(&path).unwrap(), written.is_some())
    }

    #[test]
    fn a_mounting_whose_halves_contradict_each_other_is_not_written() {
        let agreeing = found([0.4, -1.2, 0.1, 1.9, -0.3, 0.0]);
        let (text, was_written) = file_after(&agreeing);
        assert!(was_written && text.contains("position_m = [0.1, 0.0, 0.0]"));
        assert!(text.contains("mount_position_sigma_m = 0.0007"), "the σ as it is");

        let hardly = found([0.4, -2.6, 0.1, 1.9, -0.3, 0.0]);
        let (text, _) = file_after(&hardly);
        assert!(text.contains("mount_position_sigma_m = 0.0009"), "0.7 mm · 2.6/2");

        let slipped = found([0.4, 0.2, 0.1, 1.9, -0.3, 3.4]);
        assert_eq!(file_after(&slipped), (EXAMPLE.to_owned(), false));
        assert_eq!(contradicting(&slipped), ["about lidar z"]);
        let said = contradiction(&contradicting(&slipped), true);
        assert!(said.starts_with("nothing was written: about lidar z:"), "{said}");
    }
}
