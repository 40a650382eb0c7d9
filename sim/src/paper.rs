//! The experiment of the paper, flown in the simulator: every picture of its section 6 and its
//! table, and the same with what goes past it.
//!
//! Source: Balula, Liao-McPherson, Stevšić, Rupenyan, Lygeros (2023), *Drone-based Volume
//! Estimation in Indoor Environments*, IFAC. It gives neither the parameters of surface and LiDAR
//! nor the number of runs, and its landscape is not published: what can be compared is the method,
//! not the number to its last digit.

mod command;
mod pictures;
mod summary;

pub use command::{PaperArgs, Settings, make, run};
pub use summary::{Row, Summary};

use crate::scenario::{Planner, Scenario, Surface};
use serde::Serialize;
use stockpilot::config::{Config, VarianceUpdateName, VolumeVarianceName};

/// How the surface is kept, and what the volume's variance is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The paper's grid with its equations as printed: σ ← (1 − K) σ, and marginal variances
    /// added.
    AsPrinted,
    /// The Gauss–Markov field with the budget of all error sources.
    MaternField,
}

impl Method {
    /// All of them, in the order of the pictures.
    pub const ALL: [Self; 2] = [Self::AsPrinted, Self::MaternField];

    /// Its name in file names and tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::AsPrinted => "kalman-grid-printed",
            Self::MaternField => "matern-field",
        }
    }

    /// Its name in titles.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::AsPrinted => "kalman_grid as printed",
            Self::MaternField => "matern_field",
        }
    }

    const fn surface(self) -> Surface {
        match self {
            Self::AsPrinted => Surface::KalmanGrid,
            Self::MaternField => Surface::MaternField,
        }
    }

    fn set(self, config: &mut Config) {
        if self == Self::AsPrinted {
            config.surface.variance_update = VarianceUpdateName::Printed;
            config.surface.volume_variance = VolumeVarianceName::Printed;
        }
    }
}

/// What the paper prints for one of its two runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Published {
    /// σ^V/μ^V, %.
    pub sigma_over_volume_percent: f64,
    /// Error of the volume, %.
    pub error_percent: f64,
}

/// One flight of the experiment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Experiment {
    /// Who chooses the waypoints.
    pub planner: Planner,
    /// How the surface is kept.
    pub method: Method,
    /// What the paper has to compare with.
    pub published: Option<Published>,
}

/// Greedy, as published.
const GREEDY: Published = Published { sigma_over_volume_percent: 2.26, error_percent: 2.53 };
/// Square wave, as published.
const SQUARE_WAVE: Published = Published { sigma_over_volume_percent: 2.42, error_percent: 2.30 };

/// What is flown. A further planner is one more line.
pub const EXPERIMENTS: &[Experiment] = &[
    Experiment::new(Planner::Greedy, Method::AsPrinted, Some(GREEDY)),
    Experiment::new(Planner::SquareWave, Method::AsPrinted, Some(SQUARE_WAVE)),
    Experiment::new(Planner::Greedy, Method::MaternField, None),
    Experiment::new(Planner::SquareWave, Method::MaternField, None),
    Experiment::new(Planner::Horizon, Method::MaternField, None),
];

impl Experiment {
    /// A flight from all of its parts.
    #[must_use]
    pub const fn new(planner: Planner, method: Method, published: Option<Published>) -> Self {
        Self { planner, method, published }
    }

    /// Its name in file names.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}_{}", self.method.name(), self.planner.name())
    }

    /// The scenario of the options with this planner and surface.
    fn applied_to(&self, scenario: &Scenario) -> Scenario {
        Scenario { planner: self.planner, surface: self.method.surface(), ..scenario.clone() }
    }
}

#[cfg(test)]
mod tests;
