//! Waypoints and trajectory in the file.

use super::convert::{invalid, rect, seconds, within};
use super::error::ConfigError;
use super::file::Config;
use super::obstacles::SpaceSection;
use crate::mapping::region::Rect;
use crate::planning::external::ExternalSettings;
use crate::planning::trajectory::Limits;
use crate::planning::{self, PlannerKind};
use crate::units::rad_from_deg;
use serde::{Deserialize, Serialize};

/// Variance of the filter's pose over that of one fix: 20 frames a second, each believed for about
/// half a second.
const FIX_VAR_SHARE: f64 = 0.1;

/// Who chooses the waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlannerName {
    /// Parallel legs at equal distance.
    SquareWave,
    /// The paper's one-step planner.
    Greedy,
    /// Whole paths, scored by the σ^V that they leave.
    Horizon,
    /// The program of `[planning.external]`.
    External,
}

/// A program that plans.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExternalSection {
    /// The program and its arguments; no shell stands between.
    pub command: Vec<String>,
    /// It is ended if it has not answered by then, s.
    pub time_limit_s: f64,
}

impl Default for ExternalSection {
    fn default() -> Self {
        Self { command: Vec::new(), time_limit_s: 5.0 }
    }
}

/// Waypoints and trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanningSection {
    /// Who chooses the waypoints; left out, `horizon` if there is a target and the square wave if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub planner: Option<PlannerName>,
    /// Waypoints of a survey.
    pub n_steps: usize,
    /// Height of the flight over the hall floor, m.
    pub height_m: f64,
    /// Heading during the survey, deg, from x towards y.
    pub yaw_deg: f64,
    /// Waypoints keep this distance inside the region's border, m; negative flies beyond it.
    pub inset_m: f64,
    /// The survey ends once σ^V is this share of V, %; left out, it flies all its waypoints.
    pub target_percent: Option<f64>,
    /// Distance of neighbouring legs of the square wave, m; left out, 5 m, or with a target the best.
    pub leg_spacing_m: Option<f64>,
    /// How far the greedy planner looks, R, m.
    pub step_radius_m: f64,
    /// Distance of neighbouring candidate waypoints, m.
    pub candidate_spacing_m: f64,
    /// Predicted beams reach this far from straight down, deg.
    pub swath_half_angle_deg: f64,
    /// Waypoints need a quality of fix above τ, 1/√(m² + rad²).
    pub min_fix_quality: f64,
    /// Predictions know that high ground hides what is behind it; otherwise they see a flat surface.
    /// Left out, `horizon` does and the others, to the paper's letter, do not.
    pub shadows: Option<bool>,
    /// Seed of the search for paths.
    pub seed: u64,
    /// Changes of paths that `horizon` tries, over their usual number: less where a plan in flight takes longer than the
    /// second that it should. The paths that it begins with are always looked at.
    pub search_effort: f64,
    /// Largest speed, m/s.
    pub max_speed_mps: f64,
    /// Largest acceleration, m/s².
    pub max_accel_mps2: f64,
    /// Largest jerk, m/s³.
    pub max_jerk_mps3: f64,
    /// Largest snap, m/s⁴.
    pub max_snap_mps4: f64,
    /// Largest rate of the heading, deg/s.
    pub max_yaw_rate_degps: f64,
    /// Largest acceleration of the heading, deg/s².
    pub max_yaw_accel_degps2: f64,
    /// The program that plans with `planner = "external"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub external: Option<ExternalSection>,
    /// The grid of the free space and the room around the vehicle.
    pub space: SpaceSection,
}

impl Default for PlanningSection {
    fn default() -> Self {
        Self {
            planner: None,
            n_steps: 50,
            height_m: 7.0,
            yaw_deg: 0.0,
            inset_m: 0.0,
            target_percent: None,
            leg_spacing_m: None,
            step_radius_m: 2.0,
            candidate_spacing_m: 1.0,
            swath_half_angle_deg: 50.0,
            min_fix_quality: 8.0,
            shadows: None,
            seed: 0,
            search_effort: 1.0,
            max_speed_mps: 2.0,
            max_accel_mps2: 2.0,
            max_jerk_mps3: 12.0,
            max_snap_mps4: 150.0,
            max_yaw_rate_degps: 45.0,
            max_yaw_accel_degps2: 90.0,
            external: None,
            space: SpaceSection::default(),
        }
    }
}

impl PlanningSection {
    /// The planner that is named, or the one that suits: a target is reached on the shortest way by `horizon`, and without
    /// one every place is to be flown over.
    #[must_use]
    pub fn chosen_planner(&self) -> PlannerName {
        self.planner.unwrap_or(if self.target_percent.is_some() {
            PlannerName::Horizon
        } else {
            PlannerName::SquareWave
        })
    }
}

impl Config {
    pub(super) fn planning_settings(&self) -> Result<planning::Settings, ConfigError> {
        let p = &self.planning;
        let region = rect("hall.region", &self.hall.region)?;
        let (width_m, depth_m) = region.size_m();
        let widest_m = width_m.min(depth_m) / 2.0 - 0.1;
        let inset_m = within("planning.inset_m", p.inset_m, (-5.0, widest_m), "m")?;
        // Room for the vehicle between the highest pile and the flight.
        let space = self.space_settings()?;
        let over_piles_m = space.vehicle_radius_m + space.surface_clearance_m;
        let highest_pile_m = self.hall.max_pile_height_m.max(self.surface.prior_height_m);
        let lowest_m = highest_pile_m + over_piles_m;
        let metres = |key, value, range| within(key, value, range, "m");
        let sites =
            (width_m / p.candidate_spacing_m + 1.0) * (depth_m / p.candidate_spacing_m + 1.0);
        within("candidate waypoints in the region", sites, (1.0, 20_000.0), "")?;
        self.check_square_wave_heading()?;
        self.check_space(&space)?;
        #[expect(clippy::cast_precision_loss, reason = "only its size is judged")]
        within("planning.n_steps", p.n_steps as f64, (1.0, 10_000.0), "")?;
        Ok(planning::Settings {
            planner: match p.chosen_planner() {
                PlannerName::SquareWave => PlannerKind::SquareWave,
                PlannerName::Greedy => PlannerKind::Greedy,
                PlannerName::Horizon => PlannerKind::Horizon,
                PlannerName::External => PlannerKind::External,
            },
            n_steps: p.n_steps,
            height_m: metres("planning.height_m", p.height_m, (lowest_m, 100.0))?,
            yaw_rad: rad_from_deg(within("planning.yaw_deg", p.yaw_deg, (-360.0, 360.0), "deg")?),
            bounds: Rect {
                x_min_m: region.x_min_m + inset_m,
                y_min_m: region.y_min_m + inset_m,
                x_max_m: region.x_max_m - inset_m,
                y_max_m: region.y_max_m - inset_m,
            },
            target_ratio: p
                .target_percent
                .map(|percent| within("planning.target_percent", percent, (0.01, 100.0), "%"))
                .transpose()?
                .map(|percent| percent / 100.0),
            leg_spacing_m: p
                .leg_spacing_m
                .map(|spacing_m| metres("planning.leg_spacing_m", spacing_m, (0.2, 100.0)))
                .transpose()?,
            step_radius_m: metres("planning.step_radius_m", p.step_radius_m, (0.2, 100.0))?,
            candidate_spacing_m: metres(
                "planning.candidate_spacing_m",
                p.candidate_spacing_m,
                (0.2, p.step_radius_m),
            )?,
            nominal_height_m: self.surface.prior_height_m,
            swath_half_angle_rad: rad_from_deg(within(
                "planning.swath_half_angle_deg",
                p.swath_half_angle_deg,
                (1.0, 85.0),
                "deg",
            )?),
            min_fix_quality: within(
                "planning.min_fix_quality",
                p.min_fix_quality,
                (0.0, 1e6),
                "1/√(m² + rad²)",
            )?,
            slope_sigma: self.surface.slope_sigma,
            sees_shadows: p.shadows.unwrap_or(p.chosen_planner() == PlannerName::Horizon),
            fix_var_share: FIX_VAR_SHARE,
            seed: p.seed,
            search_effort: within("planning.search_effort", p.search_effort, (0.05, 10.0), "")?,
            external: self.external_planner()?,
            limits: trajectory_limits(p)?,
            space,
        })
    }

    /// The program that plans; it is read even where another planner is chosen, so that mistakes show.
    fn external_planner(&self) -> Result<Option<ExternalSettings>, ConfigError> {
        let key = "planning.external.command";
        let is_chosen = self.planning.chosen_planner() == PlannerName::External;
        let Some(section) = &self.planning.external else {
            let missing =
                || invalid(key, "planner = \"external\" needs the program and its arguments");
            return if is_chosen { Err(missing()) } else { Ok(None) };
        };
        if section.command.first().is_none_or(String::is_empty) {
            return Err(invalid(key, "the first entry is the program"));
        }
        let limit_key = "planning.external.time_limit_s";
        let time_limit = seconds(limit_key, section.time_limit_s, (0.1, 60.0))?;
        Ok(Some(ExternalSettings { command: section.command.clone(), time_limit }))
    }

    /// The legs of the square wave run along x, so the scan plane must stand across x.
    fn check_square_wave_heading(&self) -> Result<(), ConfigError> {
        let p = &self.planning;
        let is_along_x = rad_from_deg(p.yaw_deg).cos().abs() > 0.95;
        let is_fixed = p.chosen_planner() == PlannerName::SquareWave && p.leg_spacing_m.is_some();
        if is_fixed && !is_along_x {
            let message = "the square wave's legs run along x: head along x (0 or 180 deg)";
            return Err(invalid("planning.yaw_deg", message));
        }
        Ok(())
    }
}

/// Bounds of the trajectory.
fn trajectory_limits(p: &PlanningSection) -> Result<Limits, ConfigError> {
    let yaw =
        |key, degrees, low, high, unit| within(key, degrees, (low, high), unit).map(rad_from_deg);
    let (v, a, j, s) = (p.max_speed_mps, p.max_accel_mps2, p.max_jerk_mps3, p.max_snap_mps4);
    Ok(Limits {
        speed_mps: within("planning.max_speed_mps", v, (0.1, 15.0), "m/s")?,
        accel_mps2: within("planning.max_accel_mps2", a, (0.1, 10.0), "m/s²")?,
        jerk_mps3: within("planning.max_jerk_mps3", j, (0.1, 200.0), "m/s³")?,
        snap_mps4: within("planning.max_snap_mps4", s, (0.1, 5_000.0), "m/s⁴")?,
        yaw_rate_radps: yaw(
            "planning.max_yaw_rate_degps",
            p.max_yaw_rate_degps,
            1.0,
            360.0,
            "deg/s",
        )?,
        yaw_accel_radps2: yaw(
            "planning.max_yaw_accel_degps2",
            p.max_yaw_accel_degps2,
            1.0,
            3_600.0,
            "deg/s²",
        )?,
    })
}
