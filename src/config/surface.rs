//! The surface in the file.

use super::convert::{invalid, rect, within};
use super::error::ConfigError;
use super::file::Config;
use crate::mapping::budget::CalibrationSigmas;
use crate::mapping::roughness::OCCLUSION_SHARE;
use crate::mapping::{self, VolumeVariance, field_map, grid_map, kalman_grid, sparse_gp};
use crate::units::rad_from_deg;
use serde::{Deserialize, Serialize};

/// Which surface is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SurfaceName {
    /// The paper's height grid.
    KalmanGrid,
    /// A Gauss–Markov field with the budget of all error sources.
    MaternField,
}

/// Which law shrinks a cell's uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VarianceUpdateName {
    /// σ ← (1 − K) σ.
    Printed,
    /// σ² ← (1 − K) σ².
    Kalman,
}

/// How the cells' variances become the volume's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VolumeVarianceName {
    /// Marginals added.
    Printed,
    /// The variance of the sum.
    Full,
}

/// The surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceSection {
    /// Which surface.
    pub method: SurfaceName,
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Length scale l, m.
    pub length_scale_m: f64,
    /// Reach γ in length scales.
    pub reach: f64,
    /// Standard deviation `σ_t` of the terrain's slope, no unit.
    pub slope_sigma: f64,
    /// Height expected before anything is seen, m; what planners assume.
    pub prior_height_m: f64,
    /// Ground that nothing saw counts as the mean of the measured, instead of `prior_height_m`.
    pub estimates_prior_height: bool,
    /// Standard deviation `σ_f` of that expectation, m.
    pub prior_sigma_m: f64,
    /// Smoothness ν of the field between the cells, no unit.
    pub smoothness_nu: f64,
    /// The kernel is cut at its reach as printed, without the taper that keeps it valid.
    pub has_literal_cut: bool,
    /// Which law shrinks a cell's uncertainty.
    pub variance_update: VarianceUpdateName,
    /// How the cells' variances become the volume's.
    pub volume_variance: VolumeVarianceName,
    /// Beams are not used while the position is less certain than this, m.
    pub max_position_sigma_m: f64,
    /// The surface is solved this often in flight, s; left out, every 5 s, and with a target every 2 s: then accounts say
    /// where to fly and when it is enough.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solve_interval_s: Option<f64>,
    /// The volume is reported this often, s.
    pub report_interval_s: f64,
    /// What the field assumes of the material.
    pub field: FieldSection,
    /// Errors that last a whole flight.
    pub uncertainty: UncertaintySection,
}

/// What the field of `matern-field` assumes of the material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FieldSection {
    /// Practical range of the heights: so far apart they are nearly independent, m.
    pub range_m: f64,
    /// Standard deviation of the heights about their mean level, m.
    pub sigma_m: f64,
    /// Roughness below the cell size, m.
    pub nugget_m: f64,
}

impl Default for FieldSection {
    fn default() -> Self {
        Self { range_m: 5.0, sigma_m: 1.0, nugget_m: 0.007 }
    }
}

/// Standard deviations of errors that last a whole flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UncertaintySection {
    /// Every range is off by the same distance, m.
    pub range_bias_sigma_m: f64,
    /// Every range is off by the same share of itself.
    pub range_scale_sigma: f64,
    /// Place of the LiDAR on the body, per axis, m.
    pub mount_position_sigma_m: f64,
    /// Rotation of the LiDAR on the body, per axis, deg.
    pub mount_rotation_sigma_deg: f64,
    /// Clock of the LiDAR against the clock of the pose, ms.
    pub clock_offset_sigma_ms: f64,
    /// Place of each tag in the marker map, per axis, m.
    pub marker_sigma_m: f64,
    /// Place of the marker map as a whole against the frame of bases and bays, per axis, m. 0 where the
    /// markers are that frame: `hall.base_sigma_m` then says how well the floor is known below them.
    pub marker_datum_sigma_m: f64,
}

impl Default for UncertaintySection {
    fn default() -> Self {
        Self {
            range_bias_sigma_m: 0.01,
            range_scale_sigma: 0.001,
            mount_position_sigma_m: 0.005,
            mount_rotation_sigma_deg: 0.2,
            clock_offset_sigma_ms: 2.0,
            marker_sigma_m: 0.005,
            marker_datum_sigma_m: 0.0,
        }
    }
}

impl Default for SurfaceSection {
    fn default() -> Self {
        Self {
            method: SurfaceName::MaternField,
            cell_m: 0.25,
            length_scale_m: 0.5,
            reach: 1.5,
            slope_sigma: 0.6,
            prior_height_m: 1.5,
            estimates_prior_height: true,
            prior_sigma_m: 1.5,
            smoothness_nu: 1.5,
            has_literal_cut: false,
            variance_update: VarianceUpdateName::Kalman,
            volume_variance: VolumeVarianceName::Full,
            max_position_sigma_m: 0.15,
            solve_interval_s: None,
            report_interval_s: 1.0,
            field: FieldSection::default(),
            uncertainty: UncertaintySection::default(),
        }
    }
}

impl Config {
    pub(super) fn mapping_settings(&self) -> Result<mapping::Settings, ConfigError> {
        let (s, hall) = (&self.surface, &self.hall);
        let bounds = rect("hall.region", &hall.region)?;
        let (width_m, depth_m) = bounds.size_m();
        let cell_m = within("surface.cell_m", s.cell_m, (0.05, 5.0), "m")?;
        let n_cells = width_m * depth_m / (cell_m * cell_m);
        within("cells of the region", n_cells, (1.0, 1e6), "")?;
        let region = self.region(cell_m)?;
        let kalman_grid = self.kalman_grid_settings()?;
        // The solve holds one number for each pair of cells within reach.
        let reach_cells = kalman_grid.reach * kalman_grid.length_scale_m / cell_m;
        let n_pairs = n_cells * 0.5 * std::f64::consts::PI * (reach_cells + 1.0).powi(2);
        within("pairs of cells within surface.reach", n_pairs, (1.0, 3e7), "")?;
        Ok(mapping::Settings {
            method: match s.method {
                SurfaceName::KalmanGrid => mapping::Method::KalmanGrid,
                SurfaceName::MaternField => mapping::Method::MaternField,
            },
            region,
            cell_m,
            base_height_m: within(
                "hall.base_height_m",
                hall.base_height_m,
                (-100.0, hall.max_pile_height_m),
                "m",
            )?,
            obstacles: self.solids()?,
            below_base_m: 0.5,
            max_height_m: within(
                "hall.max_pile_height_m",
                hall.max_pile_height_m,
                (0.1, 100.0),
                "m",
            )?,
            lidar: self.lidar_mount()?,
            grid: self.grid_settings(kalman_grid)?,
            field: self.field_settings(&kalman_grid)?,
            max_position_sigma_m: within(
                "surface.max_position_sigma_m",
                s.max_position_sigma_m,
                (0.01, 5.0),
                "m",
            )?,
        })
    }

    fn grid_settings(
        &self,
        kalman_grid: kalman_grid::Settings,
    ) -> Result<grid_map::Settings, ConfigError> {
        let s = &self.surface;
        Ok(grid_map::Settings {
            kalman_grid,
            gp: sparse_gp::Settings {
                smoothness_nu: within("surface.smoothness_nu", s.smoothness_nu, (0.05, 50.0), "")?,
                length_scale_m: kalman_grid.length_scale_m,
                reach: kalman_grid.reach,
                sigma_m: kalman_grid.prior_sigma_m,
                mean_m: kalman_grid.prior_height_m,
                cut: if s.has_literal_cut {
                    sparse_gp::Cut::Literal
                } else {
                    sparse_gp::Cut::Taper
                },
            },
            estimates_prior_height: s.estimates_prior_height,
            volume_variance: match s.volume_variance {
                VolumeVarianceName::Printed => VolumeVariance::Printed,
                VolumeVarianceName::Full => VolumeVariance::Full,
            },
        })
    }

    fn field_settings(
        &self,
        kalman_grid: &kalman_grid::Settings,
    ) -> Result<field_map::Settings, ConfigError> {
        let field = &self.surface.field;
        Ok(field_map::Settings {
            range_m: within("surface.field.range_m", field.range_m, (0.2, 100.0), "m")?,
            sigma_m: within("surface.field.sigma_m", field.sigma_m, (0.01, 50.0), "m")?,
            nugget_m: within("surface.field.nugget_m", field.nugget_m, (1e-3, 2.0), "m")?,
            mean_level_m: (kalman_grid.prior_height_m, kalman_grid.prior_sigma_m),
            slope_sigma: kalman_grid.slope_sigma,
            occlusion_share: OCCLUSION_SHARE.0,
            calibration: self.calibration_sigmas()?,
        })
    }

    fn calibration_sigmas(&self) -> Result<CalibrationSigmas, ConfigError> {
        let u = &self.surface.uncertainty;
        let sigma = |key, value, most, unit| within(key, value, (0.0, most), unit);
        let datum_key = "surface.uncertainty.marker_datum_sigma_m";
        if u.marker_datum_sigma_m > 0.0 && u.marker_sigma_m <= 0.0 {
            let message = "needs a marker_sigma_m above 0: without one nothing follows what the markers \
                           do to a pose";
            return Err(invalid(datum_key, message));
        }
        Ok(CalibrationSigmas {
            range_bias_m: sigma(
                "surface.uncertainty.range_bias_sigma_m",
                u.range_bias_sigma_m,
                1.0,
                "m",
            )?,
            range_scale: sigma(
                "surface.uncertainty.range_scale_sigma",
                u.range_scale_sigma,
                0.1,
                "",
            )?,
            mount_position_m: sigma(
                "surface.uncertainty.mount_position_sigma_m",
                u.mount_position_sigma_m,
                1.0,
                "m",
            )?,
            mount_rotation_rad: rad_from_deg(sigma(
                "surface.uncertainty.mount_rotation_sigma_deg",
                u.mount_rotation_sigma_deg,
                20.0,
                "deg",
            )?),
            clock_offset_s: 1e-3
                * sigma(
                    "surface.uncertainty.clock_offset_sigma_ms",
                    u.clock_offset_sigma_ms,
                    1000.0,
                    "ms",
                )?,
            tag_place_m: sigma("surface.uncertainty.marker_sigma_m", u.marker_sigma_m, 1.0, "m")?,
            tag_datum_m: sigma(datum_key, u.marker_datum_sigma_m, 1.0, "m")?,
        })
    }

    fn kalman_grid_settings(&self) -> Result<kalman_grid::Settings, ConfigError> {
        let s = &self.surface;
        Ok(kalman_grid::Settings {
            length_scale_m: within("surface.length_scale_m", s.length_scale_m, (0.05, 50.0), "m")?,
            reach: within("surface.reach", s.reach, (0.1, 10.0), "l")?,
            slope_sigma: within("surface.slope_sigma", s.slope_sigma, (0.01, 5.0), "")?,
            prior_height_m: within(
                "surface.prior_height_m",
                s.prior_height_m,
                (-100.0, 100.0),
                "m",
            )?,
            prior_sigma_m: within("surface.prior_sigma_m", s.prior_sigma_m, (0.01, 100.0), "m")?,
            variance_update: match s.variance_update {
                VarianceUpdateName::Printed => kalman_grid::VarianceUpdate::Printed,
                VarianceUpdateName::Kalman => kalman_grid::VarianceUpdate::Kalman,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_marker_datum_reaches_the_budget_and_needs_places_that_may_be_off() {
        const EXAMPLE: &str = include_str!("../../deploy/config.example.toml");
        let of = |place_m: f64, datum_m: f64| {
            let mut config = Config::from_toml(EXAMPLE, Path::new("hall.toml")).expect("valid");
            config.surface.uncertainty.marker_sigma_m = place_m;
            config.surface.uncertainty.marker_datum_sigma_m = datum_m;
            config.calibration_sigmas().map(|sigmas| sigmas.tag_datum_m)
        };
        assert!(of(0.005, 0.0).expect("the default").abs() < 1e-15);
        assert!((of(0.005, 0.002).expect("valid") - 0.002).abs() < 1e-15);
        for (place_m, datum_m) in [(0.0, 0.002), (0.005, -0.001), (0.005, 1.5)] {
            let error = of(place_m, datum_m).expect_err("refused").to_string();
            assert!(error.contains("surface.uncertainty.marker_datum_sigma_m"), "{error}");
        }
    }
}
