//! `stockpilot-sim lidar`: one emulated sensor on a pseudo-terminal, for any program.

use crate::lidar::{LidarModel, LineFaults, Mishap, Optics, Room, SerialLidar};
use anyhow::Context;
use clap::Args;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// The emulator looks after its line this often.
const STEP: Duration = Duration::from_millis(1);

/// A sensor in a room of 6 m × 4 m, and what goes wrong with it.
#[derive(Debug, Args)]
pub struct LidarArgs {
    /// The sensor, by its name in the configuration.
    #[arg(long, value_parser = model)]
    model: LidarModel,
    /// Make this path a link to the pseudo-terminal.
    #[arg(long)]
    pty: PathBuf,
    /// Talk at this line speed instead of the model's own, bit/s.
    #[arg(long, value_name = "BIT/S")]
    baud: Option<u32>,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Share of bytes with one bit flipped.
    #[arg(long, value_name = "RATIO", default_value_t = 0.0)]
    corrupt_bytes: f64,
    /// Share of frames of which only half arrives.
    #[arg(long, value_name = "RATIO", default_value_t = 0.0)]
    half_frames: f64,
    /// Hold the head after this long, s.
    #[arg(long, value_name = "S")]
    stall_after: Option<f64>,
    /// Let the head go after this long, s.
    #[arg(long, value_name = "S")]
    release_after: Option<f64>,
    /// Report an internal error after this long, s.
    #[arg(long, value_name = "S")]
    error_after: Option<f64>,
    /// Pull the plug after this long, s.
    #[arg(long, value_name = "S")]
    unplug_after: Option<f64>,
    /// Plug it in again after this long, s, as a new device behind the same link.
    #[arg(long, value_name = "S")]
    replug_after: Option<f64>,
    /// Ranges without noise and without lost returns.
    #[arg(long)]
    exact: bool,
    /// End after this long, s.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
}

fn model(name: &str) -> Result<LidarModel, String> {
    let known = stockpilot::lidar::Model::from_name(name);
    known.map(LidarModel::of).ok_or_else(|| format!("{name:?} is no model that is known"))
}

/// Serves until its time is over.
///
/// # Errors
/// A link that cannot be made, or a line that breaks.
pub fn run(args: &LidarArgs) -> anyhow::Result<()> {
    let mut model = args.model.clone();
    model.baud = args.baud.unwrap_or(model.baud);
    if args.exact {
        (model.range_sigma_m, model.angle_sigma_rad, model.dropout_ratio) = (0.0, 0.0, 0.0);
    }
    let seeds = SeedBook::new(args.seed);
    let mut room = Room::new(Optics::new(model.clone(), seeds));
    let faults = LineFaults {
        corrupt_byte_ratio: args.corrupt_bytes,
        half_frame_ratio: args.half_frames,
        checks_speed: true,
    };
    let clock = WallClock::start();
    let plug = |now| -> anyhow::Result<SerialLidar> {
        let lidar = SerialLidar::open(&model, faults, seeds, now, false)
            .context("there is no pseudo-terminal to be had")?;
        link(lidar.path(), &args.pty)?;
        Ok(lidar)
    };
    let mut lidar = Some(plug(clock.now())?);
    say_ready(&args.pty, &model);
    let mut plan = args.plan();
    loop {
        let now = clock.now();
        while plan.first().is_some_and(|(at_s, _)| now.seconds() >= *at_s) {
            match plan.remove(0).1 {
                Planned::Suffer(mishap) => {
                    lidar.iter_mut().for_each(|lidar| lidar.suffer(mishap, now));
                }
                Planned::Unplug => lidar = None,
                Planned::Plug => lidar = Some(plug(now)?),
                Planned::End => return Ok(()),
            }
        }
        if let Some(lidar) = &mut lidar {
            lidar.advance(now, &mut room).context("the line broke")?;
        }
        clock.pause();
    }
}

/// What happens at a time.
enum Planned {
    Suffer(Mishap),
    Unplug,
    Plug,
    End,
}

impl LidarArgs {
    /// Everything that is to happen, in order of time.
    fn plan(&self) -> Vec<(f64, Planned)> {
        let events = [
            (self.stall_after, Planned::Suffer(Mishap::HeadHeld(true))),
            (self.release_after, Planned::Suffer(Mishap::HeadHeld(false))),
            (self.error_after, Planned::Suffer(Mishap::InternalError)),
            (self.unplug_after, Planned::Unplug),
            (self.replug_after, Planned::Plug),
            (self.duration, Planned::End),
        ];
        let mut plan: Vec<_> =
            events.into_iter().filter_map(|(at_s, what)| at_s.map(|at_s| (at_s, what))).collect();
        plan.sort_by(|a, b| a.0.total_cmp(&b.0));
        plan
    }
}

/// Makes `at` a link to the device, in place of a link that is there.
fn link(device: &Path, at: &Path) -> anyhow::Result<()> {
    if at.is_symlink() {
        std::fs::remove_file(at).with_context(|| format!("cannot replace {}", at.display()))?;
    }
    std::os::unix::fs::symlink(device, at)
        .with_context(|| format!("cannot make {} a link", at.display()))
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn say_ready(at: &Path, model: &LidarModel) {
    println!("ready: {} on {} at {} bit/s", model.name, at.display(), model.baud);
}

/// Time since the emulator began.
struct WallClock(Instant);

impl WallClock {
    #[expect(clippy::disallowed_methods, reason = "an emulator for other programs keeps real time")]
    fn start() -> Self {
        Self(Instant::now())
    }

    fn now(&self) -> Stamp<Mono> {
        Stamp::ZERO.plus(self.0.elapsed())
    }

    #[expect(clippy::disallowed_methods, reason = "an emulator for other programs keeps real time")]
    fn pause(&self) {
        std::thread::sleep(STEP);
    }
}
