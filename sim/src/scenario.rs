//! What is flown: world, planner, sensors and seeds of one run.

use crate::camera::CameraModel;
use crate::lidar::LidarModel;
use crate::world::{GridScale, World, WorldError};
use anyhow::Context;
use clap::{Args, ValueEnum};
use std::ops::Range;
use std::path::Path;
use stockpilot::config::{PlannerName, SurfaceName};

/// The options that `fly` and `campaign` share.
#[derive(Debug, Clone, Args)]
pub struct ScenarioArgs {
    /// `alps`, `piles`, or the path of an ESRI ASCII grid.
    #[arg(long, default_value = "alps")]
    pub world: String,
    /// Who chooses the waypoints.
    #[arg(long, value_enum, default_value_t = Planner::Greedy)]
    pub planner: Planner,
    /// Metres in the hall per unit of length in the grid file.
    #[arg(long, default_value_t = 0.001)]
    pub scale_xy: f64,
    /// Metres in the hall per unit of height in the grid file.
    #[arg(long, default_value_t = 0.001)]
    pub scale_z: f64,
    /// How the surface is kept.
    #[arg(long, value_enum, default_value_t = Surface::KalmanGrid)]
    pub surface: Surface,
    /// The LiDAR: 4,500 or 21,600 samples/s.
    #[arg(long, value_enum, default_value_t = Lidar::Ld19)]
    pub lidar: Lidar,
    /// Waypoints of the survey.
    #[arg(long, default_value_t = 50)]
    pub steps: usize,
}

/// Who chooses the waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Planner {
    /// Parallel legs at equal distance.
    SquareWave,
    /// The paper's one-step planner.
    Greedy,
}

/// How the surface is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Surface {
    /// The paper's height grid.
    KalmanGrid,
}

/// Which LiDAR.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Lidar {
    /// LD19, 4,500 samples/s.
    Ld19,
    /// STL-27L, 21,600 samples/s.
    Stl27l,
}

impl Planner {
    /// The planner's name in the configuration.
    #[must_use]
    pub const fn config_name(self) -> PlannerName {
        match self {
            Self::SquareWave => PlannerName::SquareWave,
            Self::Greedy => PlannerName::Greedy,
        }
    }

    /// The planner's name in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SquareWave => "square-wave",
            Self::Greedy => "greedy",
        }
    }
}

impl Surface {
    /// The surface's name in the configuration.
    #[must_use]
    pub const fn config_name(self) -> SurfaceName {
        match self {
            Self::KalmanGrid => SurfaceName::KalmanGrid,
        }
    }

    /// The surface's name in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::KalmanGrid => "kalman-grid",
        }
    }
}

impl Lidar {
    /// The simulated sensor.
    #[must_use]
    pub fn model(self) -> LidarModel {
        match self {
            Self::Ld19 => LidarModel::ld19(),
            Self::Stl27l => LidarModel::stl27l(),
        }
    }

    /// The sensor's name in the configuration and in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ld19 => "ld19",
            Self::Stl27l => "stl27l",
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
    /// Which LiDAR.
    pub lidar: Lidar,
    /// The camera.
    pub camera: CameraModel,
    /// Waypoints.
    pub n_steps: usize,
    /// Seed of everything that is drawn.
    pub seed: u64,
}

impl ScenarioArgs {
    /// The run with this seed.
    ///
    /// # Errors
    /// A grid file that cannot be read or parsed.
    pub fn scenario(&self, seed: u64) -> anyhow::Result<Scenario> {
        Ok(Scenario {
            world: self.world(seed)?,
            planner: self.planner,
            surface: self.surface,
            lidar: self.lidar,
            camera: CameraModel::ahead(),
            n_steps: self.steps,
            seed,
        })
    }

    fn world(&self, seed: u64) -> anyhow::Result<World> {
        let named = |world: Result<World, WorldError>| world.context("cannot build the world");
        match self.world.as_str() {
            "alps" => named(World::alps(seed)),
            "piles" => named(World::piles(seed)),
            path => {
                let text = std::fs::read_to_string(path)
                    .with_context(|| format!("world {path:?} is not alps, piles or a file"))?;
                let name = Path::new(path).file_stem().map_or(path.into(), |s| s.to_string_lossy());
                let scale = GridScale { xy: self.scale_xy, z: self.scale_z };
                World::from_esri_ascii(&name, &text, scale)
                    .with_context(|| format!("cannot build a world from {path}"))
            }
        }
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
