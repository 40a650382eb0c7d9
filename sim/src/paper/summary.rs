//! The table beside the published one.

use super::Published;
use super::pictures::Flown;
use crate::scenario::Scenario;
use serde::Serialize;

/// One flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// How the surface was kept.
    pub surface: &'static str,
    /// Who chose the waypoints.
    pub planner: &'static str,
    /// Waypoints reached.
    pub steps: usize,
    /// True path from the survey's start to the last volume, m.
    pub path_m: f64,
    /// Samples that the LiDAR sent until then.
    pub n_samples: u64,
    /// The measurement, m³.
    pub volume_m3: f64,
    /// Its claimed standard deviation, m³.
    pub sigma_m3: f64,
    /// σ^V/μ^V, %.
    pub sigma_over_volume_percent: f64,
    /// (measured − true)/true, %.
    pub error_percent: f64,
    /// (measured − true)/σ.
    pub error_over_sigma: f64,
    /// What the paper prints.
    pub published: Option<Published>,
}

/// The whole experiment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The landscape.
    pub world: String,
    /// Seed of everything drawn.
    pub seed: u64,
    /// The truth, m³.
    pub volume_true_m3: f64,
    /// One row for each flight that gave a volume.
    pub rows: Vec<Row>,
}

impl Summary {
    pub(super) fn new(scenario: &Scenario, flown: &[Flown]) -> Self {
        let volume_true_m3 = scenario.world.volume_m3();
        let row = |flown: &Flown| {
            let last = flown.survey.samples.last()?;
            let error_m3 = last.volume_m3 - volume_true_m3;
            let report = flown.survey.report.as_ref();
            Some(Row {
                surface: flown.experiment.method.name(),
                planner: flown.experiment.planner.name(),
                steps: report.map_or(last.steps, |report| report.steps),
                path_m: last.path_m,
                n_samples: last.n_samples,
                volume_m3: last.volume_m3,
                sigma_m3: last.sigma_m3,
                sigma_over_volume_percent: 100.0 * last.sigma_m3 / last.volume_m3,
                error_percent: 100.0 * error_m3 / volume_true_m3,
                error_over_sigma: error_m3 / last.sigma_m3,
                published: flown.experiment.published,
            })
        };
        Self {
            world: scenario.world.name.clone(),
            seed: scenario.seed,
            volume_true_m3,
            rows: flown.iter().filter_map(row).collect(),
        }
    }

    /// The table for people.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!(
            "# The paper's experiment\n\n\
             World `{}`, seed {}, true volume {:.2} m³. After landing; the path is counted from the \
             survey's start. Published: Balula et al. 2023, one run each, on a landscape and with \
             parameters that are not published; its error is without a sign.\n\n\
             | surface | planner | steps | path m | samples | V m³ | σ m³ | σ/V % | error % | error/σ \
             | published σ/V % | published error % |\n\
             | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n",
            self.world, self.seed, self.volume_true_m3
        );
        for row in &self.rows {
            let published = |f: fn(&Published) -> f64| {
                row.published.as_ref().map_or_else(|| "–".to_owned(), |p| format!("{:.2}", f(p)))
            };
            text.push_str(&format!(
                "| {} | {} | {} | {:.1} | {} | {:.2} | {:.3} | {:.3} | {:+.3} | {:+.1} | {} | {} |\n",
                row.surface,
                row.planner,
                row.steps,
                row.path_m,
                row.n_samples,
                row.volume_m3,
                row.sigma_m3,
                row.sigma_over_volume_percent,
                row.error_percent,
                row.error_over_sigma,
                published(|p| p.sigma_over_volume_percent),
                published(|p| p.error_percent),
            ));
        }
        text
    }
}
