//! Flies stockpilot without hardware.

use clap::{Args, Parser, Subcommand};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::link::Address;
use stockpilot::messages::Verdict;
use stockpilot::pilot::{Action, PlanChoice};
use stockpilot::survey::accounts_table;
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::autopilot_command::{self, AutopilotArgs, GateAddress};
use stockpilot_sim::camera::{CameraArgs, CameraOutput};
use stockpilot_sim::campaign::{self, Witnessed};
use stockpilot_sim::carry::carry;
use stockpilot_sim::comparison::{self, ComparisonArgs};
use stockpilot_sim::consistency::{self, ConsistencyArgs};
use stockpilot_sim::faults::{self, FaultsArgs};
use stockpilot_sim::fly::{self, FlyOptions, PageOptions};
use stockpilot_sim::lidar_command::{self, LidarArgs};
use stockpilot_sim::outside::{self, WorldArgs};
use stockpilot_sim::paper::{self, PaperArgs};
use stockpilot_sim::parallel::{n_cores, run_in_order};
use stockpilot_sim::report::{CampaignReport, RunReport};
use stockpilot_sim::scenario::ScenarioArgs;
use stockpilot_sim::sitl::{self, SitlOptions, TruthAddress};

/// Worlds, vehicle, sensors and autopilot that fly stockpilot on a laptop.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// One flight of the real service with emulated devices (the default).
    Fly(FlyArgs),
    /// Many flights without bytes and threads in between, as fast as the machine allows.
    Campaign(CampaignArgs),
    /// Many flights; NEES and NIS of the localisation beside their χ² bands.
    Consistency(ConsistencyArgs),
    /// Everything that can go wrong, and the judgement of what follows.
    Faults(FaultsArgs),
    /// The experiment of the paper: its pictures and its table.
    Paper(PaperArgs),
    /// Somebody carries the vehicle around to survey the tags: a log, tapes and the truth.
    Carry(CarryArgs),
    /// One emulated LiDAR on a pseudo-terminal, for any program.
    Lidar(LidarArgs),
    /// The stub autopilot as a program of its own, for clients that others wrote.
    Autopilot(AutopilotArgs),
    /// A hall with a vehicle for a service in another process, in real time.
    World(WorldArgs),
}

#[derive(Debug, Args)]
struct CampaignArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    camera: CameraArgs,
    /// Seeds, first to last plus one.
    #[arg(long, default_value = "0..20", value_parser = stockpilot_sim::scenario::seeds)]
    seeds: Range<u64>,
    /// Flights at once; as many as there are cores if left out. Results do not depend on it.
    #[arg(long)]
    jobs: Option<NonZeroUsize>,
    #[command(flatten)]
    comparison: ComparisonArgs,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// Print what the brain says and decides.
    #[arg(long)]
    trace: bool,
}

#[derive(Debug, Parser)]
struct FlyArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    camera: CameraArgs,
    /// What the camera hands over: tags as a detector would, or rendered pictures that the service's own detector
    /// looks at.
    #[arg(long = "camera", value_enum, default_value_t = CameraOutput::Tags)]
    output: CameraOutput,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Flight seconds per second; slower where this machine cannot keep up.
    #[arg(long, default_value_t = 4.0)]
    speed: f64,
    /// Where the log goes.
    #[arg(long, default_value = "logs")]
    log: PathBuf,
    /// Print one JSON object as the last line.
    #[arg(long)]
    json: bool,
    /// Take off when a ground station says so that speaks MAVLink to this UDP address (`HOST:PORT`, port
    /// 0 for a free one); the address is the first line of the output.
    #[arg(long, value_name = "ADDRESS")]
    ground: Option<String>,
    /// Fly a PX4 or ArduPilot simulator that runs already instead of the stub, in real time: the
    /// service's link to it, `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcpout:HOST:PORT` or
    /// `serial:PATH:BAUD`.
    #[arg(long, value_name = "ADDRESS", requires = "truth", conflicts_with = "ground")]
    autopilot_link: Option<Address>,
    /// Where that simulator tells its vehicle's true motion: `link` for the same link, or
    /// `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcpout:HOST:PORT`.
    #[arg(long, value_name = "ADDRESS", requires = "autopilot_link")]
    truth: Option<TruthAddress>,
    /// The simulator's link for a ground station, from which to say start; left out, your own ground
    /// station does.
    #[arg(long, value_name = "ADDRESS", requires = "autopilot_link")]
    ground_link: Option<GateAddress>,
    /// Sign the link with the key in this file (64 hexadecimal digits).
    #[arg(long, value_name = "FILE", requires = "autopilot_link")]
    signing_key: Option<PathBuf>,
    /// Serve the live page at this address (`HOST:PORT`, port 0 for a free one); address and token are
    /// the first line of the output.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "autopilot_link")]
    page: Option<String>,
    /// The log of an earlier survey of this hall: the page shows what has changed since.
    #[arg(long, value_name = "LOG", requires = "page")]
    last_survey: Option<PathBuf>,
    /// Serve the channels of the log live, for Foxglove or Lichtblick, at this address (`HOST:PORT`, port 0 for
    /// a free one); it is told on a line of the output.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "autopilot_link")]
    foxglove: Option<String>,
    /// Nobody starts the flight but the page, which stays after the landing until Ctrl-C.
    #[arg(long, requires = "page")]
    wait: bool,
}

impl FlyArgs {
    fn options(&self) -> FlyOptions {
        FlyOptions {
            speed: self.speed,
            directory: self.log.clone(),
            shows_progress: true,
            ground: self.ground.clone(),
            foxglove: self.foxglove.clone(),
            page: self.page.clone().map(|listen| PageOptions {
                listen,
                last_survey: self.last_survey.clone(),
                waits: self.wait,
            }),
        }
    }
}

#[derive(Debug, Args)]
struct CarryArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The log to write; it must not exist. Beside it: `.constraints.toml` and `.truth.toml`.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

fn main() -> anyhow::Result<ExitCode> {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("warn"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match Cli::parse().command {
        Some(Command::Campaign(args)) => run_campaign(&args),
        Some(Command::Consistency(args)) => consistency::run(&args).map(|()| ExitCode::SUCCESS),
        Some(Command::Faults(args)) => {
            let is_passed = faults::run(&args)?;
            Ok(if is_passed { ExitCode::SUCCESS } else { ExitCode::FAILURE })
        }
        Some(Command::Paper(args)) => paper::run(&args).map(|()| ExitCode::SUCCESS),
        Some(Command::Carry(args)) => run_carry(&args).map(|()| ExitCode::SUCCESS),
        Some(Command::Lidar(args)) => lidar_command::run(&args).map(|()| ExitCode::SUCCESS),
        Some(Command::Autopilot(args)) => autopilot_command::run(&args).map(|()| ExitCode::SUCCESS),
        Some(Command::World(args)) => {
            let has_flown = outside::run(&args)?;
            Ok(if has_flown { ExitCode::SUCCESS } else { ExitCode::FAILURE })
        }
        Some(Command::Fly(args)) => run_fly(&args),
        None => run_fly(&FlyArgs::parse_from(["fly"])),
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn run_fly(args: &FlyArgs) -> anyhow::Result<ExitCode> {
    anyhow::ensure!(args.speed > 0.0 && args.speed <= 100.0, "--speed is 0 to 100");
    let mut scenario = args.scenario.scenario(args.seed)?;
    args.camera.apply(&mut scenario.camera);
    args.output.apply(&mut scenario.camera);
    let run = match args.autopilot_link.clone().zip(args.truth.clone()) {
        Some((link, truth)) => {
            let is_rendered = scenario.camera.pictures.is_some();
            anyhow::ensure!(!is_rendered, "--camera rendered flies with the stub only");
            let (ground, signing_key) = (args.ground_link.clone(), args.signing_key.clone());
            let directory = args.log.clone();
            let options = SitlOptions { link, truth, ground, signing_key, directory };
            sitl::run(&scenario, &options)?
        }
        None => fly::run(&scenario, &args.options())?,
    };
    if args.json {
        println!("{}", serde_json::to_string(&run)?);
    } else {
        print_run(&run);
    }
    Ok(ExitCode::SUCCESS)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn run_carry(args: &CarryArgs) -> anyhow::Result<()> {
    let scenario = args.scenario.scenario(args.seed)?;
    let carried = carry(&scenario, &args.out)?;
    let beside = |ending: &str| args.out.with_extension(ending);
    std::fs::write(beside("constraints.toml"), &carried.constraints_toml)?;
    std::fs::write(beside("truth.toml"), carried.truth_toml())?;
    println!(
        "stockpilot markers survey {} --constraints {}",
        args.out.display(),
        beside("constraints.toml").display()
    );
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_run(run: &RunReport) {
    print!("{}", accounts_table(&run.accounts));
    for bay in &run.bays {
        let percent = 100.0 * bay.relative_error;
        println!("truth    {} {:.1} m³, error {percent:+.2} %", bay.name, bay.volume_true_m3);
    }
    println!("volume   {:.1} m³ ± {:.1} m³ (k = 2)", run.volume_m3, 2.0 * run.sigma_m3);
    println!("truth    {:.1} m³, error {:+.2} %", run.volume_true_m3, 100.0 * run.relative_error);
    println!(
        "flight   {:.0} s in {:.0} s, path {:.0} m, {} steps, coverage {:.0} %{}{}",
        run.sim_time_s,
        run.wall_time_s,
        run.path_length_m,
        run.steps,
        100.0 * run.coverage,
        if run.complete { "" } else { ", CUT SHORT" },
        if run.collided { ", COLLIDED" } else { "" },
    );
    println!(
        "position rms {:.1} cm, inside its 3σ {:.1} % of the flight",
        100.0 * run.position_rms_m,
        100.0 * run.position_within_3_sigma,
    );
    println!(
        "beams    {} sent, {} mapped, {} dropped",
        run.beams_sent, run.beams, run.beams_dropped
    );
    if let Some(load) = &run.load {
        println!(
            "service  {:.1} % of one core at real time, with the simulator {:.0} MiB at most",
            100.0 * load.core_share,
            load.resident_peak_mib,
        );
    }
    if let Some(log) = &run.log {
        println!("log      {}", log.display());
    }
}

#[expect(clippy::print_stderr, reason = "the program's output")]
fn trace(at: Stamp<Mono>, action: &Action) {
    match action {
        Action::Say(text) => eprintln!("{at:?} {:?}: {}", text.severity, text.text),
        Action::PlanChosen(plan) => {
            let PlanChoice { ahead, end, prediction, .. } = plan.as_ref();
            eprintln!("{at:?} plans {} waypoints, {end:?}: {prediction:?}", ahead.len());
        }
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

#[expect(clippy::print_stdout, reason = "the program's output")]
fn run_campaign(args: &CampaignArgs) -> anyhow::Result<ExitCode> {
    // Traces of several flights at once could not be told apart.
    let n_jobs = if args.trace { NonZeroUsize::MIN } else { args.jobs.unwrap_or_else(n_cores) };
    if args.comparison.is_wanted() {
        let CampaignArgs { scenario, camera, comparison, seeds, .. } = args;
        let compared = comparison::run(scenario, camera, comparison, seeds.clone(), n_jobs)?;
        compared.print(args.json)?;
        return Ok(ExitCode::SUCCESS);
    }
    let fly = |seed| -> anyhow::Result<RunReport> {
        let mut scenario = args.scenario.scenario(seed)?;
        args.camera.apply(&mut scenario.camera);
        let run = campaign::run(&scenario, |at, seen| {
            if let (true, Witnessed::Action(action)) = (args.trace, seen) {
                trace(at, action);
            }
        })?;
        Ok(run)
    };
    let report =
        CampaignReport::new(run_in_order(args.seeds.clone(), n_jobs, fly, print_progress)?);
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print_campaign(&report);
    }
    Ok(ExitCode::SUCCESS)
}

#[expect(clippy::print_stderr, reason = "the program's output")]
fn print_progress(run: &RunReport) {
    eprintln!(
        "seed {}: {:.1} ± {:.1} m³, truth {:.1} m³, error {:+.2} %, coverage {:.0} %, \
         path {:.0} m, {:.0} s in {:.2} s, 3σ {:.1} %, rms {:.1} cm{}",
        run.seed,
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
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_campaign(report: &CampaignReport) {
    println!(
        "{} runs: 95 % coverage {:.2}, rms z {:.2}, rms error {:.2} %, bias {:+.2} %, \
         mean σ/V {:.2} %, {:.0} × real time",
        report.runs.len(),
        report.coverage_95,
        report.rms_z,
        100.0 * report.rms_relative_error,
        100.0 * report.bias,
        100.0 * report.mean_sigma_over_volume,
        report.realtime_factor,
    );
    if let Some(worst) = report.worst {
        let percent = 100.0 * worst.relative_error;
        println!("worst: seed {}, error {percent:+.2} %, z {:+.1}", worst.seed, worst.z);
    }
    if let (Some(coverage), Some(rms_z)) = (report.bay_coverage_95, report.bay_rms_z) {
        println!("bays: 95 % coverage {coverage:.2}, rms z {rms_z:.2}");
    }
    for (source, share) in &report.budget {
        println!("{:5.1} %  {source}", 100.0 * share);
    }
}
