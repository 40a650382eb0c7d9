//! What is flown: world, planner, sensors and seeds of one run.

use crate::autopilot::Flavour;
use crate::calibration::{CalibrationErrors, CalibrationSigmas, ErrorSource};
use crate::camera::CameraModel;
use crate::hazards::Hazards;
use crate::lidar::LidarModel;
use crate::machine::Machine;
use crate::rig::Rig;
use crate::world::{GridScale, World, WorldError};
use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};
use std::ops::Range;
use std::path::Path;
use stockpilot::config::{PlannerName, SurfaceName, VarianceUpdateName, VolumeVarianceName};
use stockpilot::lidar;
use stockpilot::stats::SeedBook;

/// Worlds that are made from a seed.
const GENERATED: [&str; 5] = ["alps", "piles", "columns", "l-hall", "poor-fix"];

/// The options that `fly` and `campaign` share.
#[derive(Debug, Clone, Args)]
pub struct ScenarioArgs {
    /// `alps`, `piles`, `columns`, `l-hall`, `poor-fix`, or the path of an ESRI ASCII grid.
    #[arg(long, default_value = "alps")]
    pub world: String,
    /// Who chooses the waypoints.
    #[arg(long, value_enum, default_value_t = Planner::SquareWave)]
    pub planner: Planner,
    /// The program that plans with `--planner external`, and its arguments, with blanks between.
    #[arg(long, value_name = "COMMAND")]
    pub planner_command: Option<String>,
    /// Metres in the hall per unit of length in the grid file.
    #[arg(long, default_value_t = 0.001)]
    pub scale_xy: f64,
    /// Metres in the hall per unit of height in the grid file.
    #[arg(long, default_value_t = 0.001)]
    pub scale_z: f64,
    /// How the surface is kept.
    #[arg(long, value_enum, default_value_t = Surface::MaternField)]
    pub surface: Surface,
    /// The paper's laws of variance as printed, or corrected, of `--surface kalman-grid` only; the service's
    /// own default if left out.
    #[arg(long, value_enum)]
    pub variance: Option<Variance>,
    /// The LiDAR: ld19, rplidar-a3, ydlidar-g4, hokuyo-utm30lx, or any other with a driver.
    #[arg(long, value_parser = lidar_named, default_value = "ld19")]
    pub lidar: Lidar,
    /// The family of the stub autopilot.
    #[arg(long, value_enum, default_value_t = Flavour::Px4)]
    pub autopilot: Flavour,
    /// Waypoints of the survey.
    #[arg(long, default_value_t = 50)]
    pub steps: usize,
    /// Largest speed of the survey, m/s; the service's own default if left out. Below 0.3 m/s the
    /// climb takes longer than a take-off may.
    #[arg(long, value_name = "M_PER_S")]
    pub cruise_mps: Option<f64>,
    /// Distance of neighbouring legs of the square wave, m; left out, 5 m, or with a target the best.
    #[arg(long, value_name = "M")]
    pub leg_spacing_m: Option<f64>,
    /// The survey ends once σ^V is this share of V, %; left out, it flies all its steps.
    #[arg(long, value_name = "PERCENT")]
    pub target_percent: Option<f64>,
    /// Whether planners know that high ground hides what is behind it; the service's own default if
    /// left out.
    #[arg(long, value_name = "BOOL")]
    pub shadows: Option<bool>,
    /// Each run draws errors of calibration from their σ, and the service is told these σ: of all
    /// sources, or of those named after `=`.
    #[arg(
        long,
        value_enum,
        value_name = "SOURCES",
        value_delimiter = ',',
        num_args = 0..,
        require_equals = true,
        default_missing_value = "range,mount,clock,markers"
    )]
    pub draw_errors: Vec<ErrorSource>,
    /// Slopes of generated worlds times this; the service is told of the slopes.
    #[arg(long, value_name = "TIMES", default_value_t = 1.0)]
    pub steepness: f64,
    /// Noise of the markers' corners times this; the service is told of the noise.
    #[arg(long, value_name = "TIMES", default_value_t = 1.0)]
    pub marker_noise: f64,
    /// What gets into the way of the beams.
    #[command(flatten)]
    pub hazards: Hazards,
}

/// Who chooses the waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Planner {
    /// Parallel legs at equal distance.
    SquareWave,
    /// The paper's one-step planner.
    Greedy,
    /// Whole paths, scored by the σ^V that they leave.
    Horizon,
    /// The program of `--planner-command`.
    External,
}

/// How the surface is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Surface {
    /// The paper's height grid.
    KalmanGrid,
    /// A Gauss–Markov field with the budget of all error sources.
    MaternField,
}

/// The paper's laws of variance, of a cell and of the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Variance {
    /// Both as printed: a hit shrinks a cell's σ like its variance, and the cells' variances are added.
    Printed,
    /// The Kalman filter's, and the variance of the sum.
    Full,
}

impl Variance {
    /// Both laws' names in the configuration.
    #[must_use]
    pub const fn config_names(self) -> (VarianceUpdateName, VolumeVarianceName) {
        match self {
            Self::Printed => (VarianceUpdateName::Printed, VolumeVarianceName::Printed),
            Self::Full => (VarianceUpdateName::Kalman, VolumeVarianceName::Full),
        }
    }

    /// Its name in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Printed => "printed",
            Self::Full => "full",
        }
    }
}

impl Planner {
    /// The planner's name in the configuration.
    #[must_use]
    pub const fn config_name(self) -> PlannerName {
        match self {
            Self::SquareWave => PlannerName::SquareWave,
            Self::Greedy => PlannerName::Greedy,
            Self::Horizon => PlannerName::Horizon,
            Self::External => PlannerName::External,
        }
    }

    /// The planner's name in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SquareWave => "square-wave",
            Self::Greedy => "greedy",
            Self::Horizon => "horizon",
            Self::External => "external",
        }
    }
}

impl Surface {
    /// The surface's name in the configuration.
    #[must_use]
    pub const fn config_name(self) -> SurfaceName {
        match self {
            Self::KalmanGrid => SurfaceName::KalmanGrid,
            Self::MaternField => SurfaceName::MaternField,
        }
    }

    /// The surface's name in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::KalmanGrid => "kalman-grid",
            Self::MaternField => "matern-field",
        }
    }
}

/// Which LiDAR: any that the service has a driver for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lidar(pub lidar::Model);

impl Lidar {
    /// LDROBOT LD19.
    #[expect(non_upper_case_globals, reason = "reads like the other choices of a scenario")]
    pub const Ld19: Self = Self(lidar::Model::Ld19);

    /// The simulated sensor.
    #[must_use]
    pub fn model(self) -> LidarModel {
        LidarModel::of(self.0)
    }

    /// The sensor's name in the configuration and in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.0.name()
    }
}

/// The sensor with this name.
fn lidar_named(name: &str) -> Result<Lidar, String> {
    lidar::Model::from_name(name).map(Lidar).ok_or_else(|| {
        format!("{name:?} is not {}", lidar::Model::ALL.map(lidar::Model::name).join(", "))
    })
}

/// How a run differs from a hall and a vehicle that are exactly as they should be.
#[derive(Debug, Clone, PartialEq)]
pub struct Conditions {
    /// σ of the errors of calibration, as the service is told; all 0 without errors.
    pub sigmas: CalibrationSigmas,
    /// The errors of this run.
    pub errors: CalibrationErrors,
    /// Slopes of the material over the usual ones.
    pub steepness: f64,
    /// Noise of the markers' corners over the usual one.
    pub marker_noise: f64,
    /// What gets into the way of the beams.
    pub hazards: Hazards,
    /// Largest speed of the survey, m/s; the service's own default if `None`.
    pub cruise_mps: Option<f64>,
    /// Distance of the square wave's legs, m; the best is looked for if `None`.
    pub leg_spacing_m: Option<f64>,
    /// The survey ends once σ^V is this share of V, %; it flies all its steps if `None`.
    pub target_percent: Option<f64>,
    /// Whether predictions know shadows; the service's own default if `None`.
    pub shadows: Option<bool>,
    /// The program that plans, and its arguments; empty if none is named.
    pub planner_command: Vec<String>,
}

impl Default for Conditions {
    fn default() -> Self {
        Self {
            sigmas: CalibrationSigmas::NONE,
            errors: CalibrationErrors::default(),
            steepness: 1.0,
            marker_noise: 1.0,
            hazards: Hazards::default(),
            cruise_mps: None,
            leg_spacing_m: None,
            target_percent: None,
            shadows: None,
            planner_command: Vec::new(),
        }
    }
}

/// One run: the options with their world built.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The hall.
    pub world: World,
    /// Who chooses the waypoints.
    pub planner: Planner,
    /// How the surface is kept.
    pub surface: Surface,
    /// The laws of variance; the service's own default if `None`.
    pub variance: Option<Variance>,
    /// Which LiDAR.
    pub lidar: Lidar,
    /// The family of the autopilot.
    pub autopilot: Flavour,
    /// The camera.
    pub camera: CameraModel,
    /// Waypoints.
    pub n_steps: usize,
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// What is unusual.
    pub conditions: Conditions,
}

impl Scenario {
    /// The true vehicle on its pad in the true hall.
    #[must_use]
    pub fn rig(&self) -> Rig {
        let rig = Rig::new(self.world.clone(), self.true_lidar(), self.camera.clone(), self.seed)
            .with_autopilot(self.autopilot);
        match self.machine() {
            Some(machine) => rig.with_machine(machine),
            None => rig,
        }
    }

    /// The LiDAR as it truly is.
    #[must_use]
    pub fn true_lidar(&self) -> LidarModel {
        let Conditions { errors, hazards, .. } = &self.conditions;
        hazards.applied_to(&errors.true_lidar(&self.lidar.model()))
    }

    /// The machine that drives through the hall, if one does.
    #[must_use]
    pub fn machine(&self) -> Option<Machine> {
        let has_machine = self.conditions.hazards.has_machine;
        has_machine.then(|| Machine::drawn(&self.world, SeedBook::new(self.seed)))
    }
}

impl ScenarioArgs {
    /// The run with this seed.
    ///
    /// # Errors
    /// A grid file that cannot be read or parsed, or a number that makes no sense.
    pub fn scenario(&self, seed: u64) -> anyhow::Result<Scenario> {
        self.check()?;
        let world = self.world(seed)?;
        let mut camera = CameraModel::ahead();
        camera.detector.pixel_sigma_px *= self.marker_noise;
        Ok(Scenario {
            planner: self.planner,
            surface: self.surface,
            variance: self.variance,
            lidar: self.lidar,
            autopilot: self.autopilot,
            camera,
            n_steps: self.steps,
            seed,
            conditions: self.conditions(&world, seed),
            world,
        })
    }

    fn conditions(&self, world: &World, seed: u64) -> Conditions {
        let sigmas = CalibrationSigmas::default().only(&self.draw_errors);
        Conditions {
            sigmas,
            errors: CalibrationErrors::drawn(&sigmas, world.tags.len(), SeedBook::new(seed)),
            steepness: self.steepness,
            marker_noise: self.marker_noise,
            hazards: self.hazards,
            cruise_mps: self.cruise_mps,
            leg_spacing_m: self.leg_spacing_m,
            target_percent: self.target_percent,
            shadows: self.shadows,
            planner_command: self.planner_words(),
        }
    }

    fn planner_words(&self) -> Vec<String> {
        let words = self.planner_command.iter().flat_map(|line| line.split_whitespace());
        words.map(str::to_owned).collect()
    }

    fn check(&self) -> anyhow::Result<()> {
        let is_generated = GENERATED.contains(&self.world.as_str());
        let is_usual = (self.steepness - 1.0).abs() < f64::EPSILON;
        ensure!((0.1..=4.0).contains(&self.steepness), "--steepness is 0.1 to 4");
        ensure!(is_generated || is_usual, "--steepness is for generated worlds: use --scale-z");
        ensure!((0.0..=20.0).contains(&self.marker_noise), "--marker-noise is 0 to 20");
        let has_laws = self.variance.is_none() || self.surface == Surface::KalmanGrid;
        ensure!(has_laws, "--variance is of --surface kalman-grid: matern-field has one law only");
        let draws = |source| self.draw_errors.contains(&source);
        let has_markers = !draws(ErrorSource::Datum) || draws(ErrorSource::Markers);
        ensure!(has_markers, "--draw-errors: datum is drawn beside markers only");
        ensure!((0.0..=1.0).contains(&self.hazards.dust_ratio), "--dust is a share from 0 to 1");
        Ok(())
    }

    fn world(&self, seed: u64) -> anyhow::Result<World> {
        let named = |world: Result<World, WorldError>| world.context("cannot build the world");
        let world = match self.world.as_str() {
            "alps" => named(World::steep_alps(seed, self.steepness)),
            "piles" => named(World::steep_piles(seed, self.steepness)),
            "columns" => named(World::columns(seed, self.steepness)),
            "l-hall" => named(World::l_hall(seed, self.steepness)),
            "poor-fix" => named(World::poor_fix(seed, self.steepness)),
            path => {
                let text = std::fs::read_to_string(path).with_context(|| {
                    format!("world {path:?} is none of {GENERATED:?} and no file")
                })?;
                let name = Path::new(path).file_stem().map_or(path.into(), |s| s.to_string_lossy());
                let scale = GridScale { xy: self.scale_xy, z: self.scale_z };
                World::from_esri_ascii(&name, &text, scale)
                    .with_context(|| format!("cannot build a world from {path}"))
            }
        }?;
        let has_gaps = self.hazards.has_gaps;
        Ok(if has_gaps { world.with_gaps(SeedBook::new(seed)) } else { world })
    }
}

/// Seeds as they stand on the command line: `0..20`.
///
/// # Errors
/// Anything else, and an empty range.
pub fn seeds(text: &str) -> Result<Range<u64>, String> {
    let wrong = || format!("{text:?} is not of the form 0..20");
    let (first, end) = text.split_once("..").ok_or_else(wrong)?;
    let number = |part: &str| part.parse::<u64>().map_err(|_| wrong());
    let range = number(first)?..number(end)?;
    if range.is_empty() { Err(wrong()) } else { Ok(range) }
}
