//! From the file's twin to the settings of the modules, with every number checked.

use super::error::ConfigError;
use super::file::{
    Config, MountSection, PadSection, PlannerName, PlanningSection, RectSection, SurfaceName,
    UpdateName, VarianceUpdateName, VolumeVarianceName,
};
use crate::geometry::{Body, Frame, Point, Rotation, Transform};
use crate::localization::filter::ImuNoise;
use crate::localization::{self, vision_fix};
use crate::mapping::budget::CalibrationSigmas;
use crate::mapping::projection::LidarMount;
use crate::mapping::region::Rect;
use crate::mapping::{self, VolumeVariance, field_map, grid_map, kalman_grid, sparse_gp};
use crate::planning::external::ExternalSettings;
use crate::planning::trajectory::Limits;
use crate::planning::{self, PlannerKind};
use crate::units::rad_from_deg;
use crate::{camera, lidar, link, mission, pilot, web};
use std::time::Duration;

/// Variance of the filter's pose over that of one fix: 20 frames a second, each believed for about
/// half a second.
const FIX_VAR_SHARE: f64 = 0.1;

/// A number inside its range, or the error that names key, value and range.
pub(super) fn within(
    key: &str,
    value: f64,
    (low, high): (f64, f64),
    unit: &'static str,
) -> Result<f64, ConfigError> {
    if (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(ConfigError::OutOfRange { key: key.to_owned(), value, unit, low, high })
    }
}

pub(super) fn seconds(
    key: &str,
    value_s: f64,
    range_s: (f64, f64),
) -> Result<Duration, ConfigError> {
    within(key, value_s, range_s, "s").map(Duration::from_secs_f64)
}

pub(super) fn invalid(key: &str, message: impl Into<String>) -> ConfigError {
    ConfigError::Invalid { key: key.to_owned(), message: message.into() }
}

impl Config {
    /// The brain's settings.
    ///
    /// # Errors
    /// The first value that is out of range or does not fit the others.
    pub fn pilot_settings(&self) -> Result<pilot::Settings, ConfigError> {
        Ok(pilot::Settings {
            localization: self.localization_settings()?,
            mapping: self.mapping_settings()?,
            planning: self.planning_settings()?,
            mission: self.mission_settings()?,
            scan_correction: self.scan_correction()?,
            solve_interval: seconds(
                "surface.solve_interval_s",
                self.surface.solve_interval_s,
                (0.2, 60.0),
            )?,
            report_interval: seconds(
                "surface.report_interval_s",
                self.surface.report_interval_s,
                (0.1, 60.0),
            )?,
        })
    }

    /// The link's settings.
    ///
    /// # Errors
    /// A malformed address, a rate out of range, or a serial line too slow for the rates.
    pub fn link_settings(&self) -> Result<link::Settings, ConfigError> {
        let address = self
            .link
            .address
            .parse()
            .map_err(|error: link::AddressError| invalid("link.address", error.to_string()))?;
        let rate = |key, value| within(key, value, (1.0, 1000.0), "Hz");
        let settings = link::Settings {
            address,
            imu_rate_hz: rate("link.imu_rate_hz", self.link.imu_rate_hz)?,
            autopilot_pose_rate_hz: rate(
                "link.autopilot_pose_rate_hz",
                self.link.autopilot_pose_rate_hz,
            )?,
            security: self.link.security()?,
            published: self.published(),
        };
        match link::LinkBudget::of(&settings) {
            Some(budget) if !budget.fits() => Err(invalid(
                "link.address",
                format!(
                    "the line carries {:.0} bytes/s each way, but {:.0} are asked of the autopilot \
                     and {:.0} are sent: raise the baud rate or lower link.imu_rate_hz",
                    budget.capacity_bytes_per_s,
                    budget.inbound_bytes_per_s,
                    budget.outbound_bytes_per_s,
                ),
            )),
            _ => Ok(settings),
        }
    }

    /// The LiDAR driver's settings.
    ///
    /// # Errors
    /// An unknown model, no port, or a baud rate out of range.
    pub fn lidar_settings(&self) -> Result<lidar::Settings, ConfigError> {
        let name = self.lidar.model.as_str();
        let model = if name.eq_ignore_ascii_case("auto") {
            None
        } else {
            let known = lidar::Model::ALL.map(lidar::Model::name).join(", ");
            let unknown = || invalid("lidar.model", format!("{name:?} is not auto, {known}"));
            Some(lidar::Model::from_name(name).ok_or_else(unknown)?)
        };
        lidar::Settings { port: self.lidar.port.clone(), model, baud: self.lidar.baud }
            .validated()
            .map_err(|error| invalid("lidar", error.to_string()))
    }

    /// The detection listener's settings.
    ///
    /// # Errors
    /// A malformed address, or a camera without sound intrinsics.
    pub fn camera_settings(&self) -> Result<camera::Settings, ConfigError> {
        let address = detections_address(&self.detections)?;
        let intrinsics = self.cameras.iter().enumerate().map(|(k, c)| c.intrinsics(k));
        let image_sizes_px =
            intrinsics.map(|found| found.map(|i| i.size_px)).collect::<Result<_, _>>()?;
        Ok(camera::Settings { address, image_sizes_px })
    }

    /// Where the live log for Foxglove is served; `None` if it is not.
    ///
    /// # Errors
    /// An address of another form.
    pub fn foxglove_address(&self) -> Result<Option<std::net::SocketAddr>, ConfigError> {
        self.foxglove.address()
    }

    /// How the live page is served; `None` if it is not.
    ///
    /// # Errors
    /// A malformed address or name, or a target out of range.
    pub fn page_settings(&self) -> Result<Option<web::Settings>, ConfigError> {
        self.page.settings()
    }

    /// The effective configuration as TOML.
    ///
    /// # Errors
    /// [`ConfigError::Print`] for a path that is not UTF-8.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        Ok(toml::to_string_pretty(self)?)
    }

    fn localization_settings(&self) -> Result<localization::Settings, ConfigError> {
        let f = &self.filter;
        if self.cameras.is_empty() {
            return Err(invalid("cameras", "there must be at least one camera"));
        }
        let cameras = self.cameras.iter().enumerate().map(|(k, c)| c.model(k));
        let density = |key, value| within(key, value, (1e-8, 10.0), "1/√Hz");
        Ok(localization::Settings {
            cameras: cameras.collect::<Result<_, _>>()?,
            marker_map: self.marker_map()?,
            vision: vision_fix::Settings {
                corner_sigma_px: within(
                    "filter.corner_sigma_px",
                    f.corner_sigma_px,
                    (0.01, 20.0),
                    "px",
                )?,
                max_position_sigma_m: within(
                    "filter.max_fix_sigma_m",
                    f.max_fix_sigma_m,
                    (0.01, 10.0),
                    "m",
                )?,
            },
            update: match f.update {
                UpdateName::Loose => localization::Update::Loose,
                UpdateName::Tight => localization::Update::Tight,
            },
            pad: f.pad.as_ref().map(pad_pose).transpose()?,
            capture_sigma_s: within("filter.capture_sigma_s", f.capture_sigma_s, (0.0, 0.1), "s")?,
            imu_noise: ImuNoise {
                accel_density_mps2_rthz: density(
                    "filter.accel_density_mps2_rthz",
                    f.accel_density_mps2_rthz,
                )?,
                gyro_density_radps_rthz: density(
                    "filter.gyro_density_radps_rthz",
                    f.gyro_density_radps_rthz,
                )?,
                accel_walk_mps2_rts: density("filter.accel_walk_mps2_rts", f.accel_walk_mps2_rts)?,
                gyro_walk_radps_rts: density("filter.gyro_walk_radps_rts", f.gyro_walk_radps_rts)?,
            },
            ring_span: seconds("filter.ring_span_s", f.ring_span_s, (0.3, 5.0))?,
            lost_after: seconds("filter.lost_after_s", f.lost_after_s, (0.2, 10.0))?,
            lost_sigma_m: within("filter.lost_sigma_m", f.lost_sigma_m, (0.02, 5.0), "m")?,
        })
    }

    fn mapping_settings(&self) -> Result<mapping::Settings, ConfigError> {
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
        let (field, u) = (&self.surface.field, &self.surface.uncertainty);
        let sigma = |key, value, most, unit| within(key, value, (0.0, most), unit);
        Ok(field_map::Settings {
            range_m: within("surface.field.range_m", field.range_m, (0.2, 100.0), "m")?,
            sigma_m: within("surface.field.sigma_m", field.sigma_m, (0.01, 50.0), "m")?,
            nugget_m: within("surface.field.nugget_m", field.nugget_m, (1e-3, 2.0), "m")?,
            mean_level_m: (kalman_grid.prior_height_m, kalman_grid.prior_sigma_m),
            slope_sigma: kalman_grid.slope_sigma,
            calibration: CalibrationSigmas {
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
                tag_place_m: sigma(
                    "surface.uncertainty.marker_sigma_m",
                    u.marker_sigma_m,
                    1.0,
                    "m",
                )?,
            },
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

    fn scan_correction(&self) -> Result<crate::messages::ScanCorrection, ConfigError> {
        let l = &self.lidar;
        let offset_ms =
            within("lidar.clock_offset_ms", l.clock_offset_ms, (-1000.0, 1000.0), "ms")?;
        Ok(crate::messages::ScanCorrection {
            range_bias_m: within("lidar.range_bias_m", l.range_bias_m, (-1.0, 1.0), "m")?,
            range_scale: within("lidar.range_scale", l.range_scale, (-0.1, 0.1), "")?,
            clock_offset_s: 1e-3 * offset_ms,
        })
    }

    fn lidar_mount(&self) -> Result<LidarMount, ConfigError> {
        let l = &self.lidar;
        let mut blind_sectors_rad = Vec::new();
        for [from_deg, to_deg] in &l.blind_sectors_deg {
            let from = within("lidar.blind_sectors_deg", *from_deg, (-180.0, 180.0), "deg")?;
            let to = within("lidar.blind_sectors_deg", *to_deg, (from, 180.0), "deg")?;
            blind_sectors_rad.push((rad_from_deg(from), rad_from_deg(to)));
        }
        let min_range_m = within("lidar.min_range_m", l.min_range_m, (0.0, 100.0), "m")?;
        let angle_sigma_deg =
            within("lidar.angle_sigma_deg", l.angle_sigma_deg, (0.0, 10.0), "deg")?;
        Ok(LidarMount {
            body_from_lidar: mount("lidar.mount", &l.mount)?,
            range_sigma_m: within("lidar.range_sigma_m", l.range_sigma_m, (1e-4, 1.0), "m")?,
            angle_sigma_rad: rad_from_deg(angle_sigma_deg),
            min_range_m,
            max_range_m: within("lidar.max_range_m", l.max_range_m, (min_range_m, 200.0), "m")?,
            blind_sectors_rad,
        })
    }

    fn planning_settings(&self) -> Result<planning::Settings, ConfigError> {
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
            planner: match p.planner {
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
            sees_shadows: p.shadows.unwrap_or(p.planner == PlannerName::Horizon),
            fix_var_share: FIX_VAR_SHARE,
            seed: p.seed,
            external: self.external_planner()?,
            limits: trajectory_limits(p)?,
            space,
        })
    }

    /// The program that plans; it is read even where another planner is chosen, so that mistakes show.
    fn external_planner(&self) -> Result<Option<ExternalSettings>, ConfigError> {
        let key = "planning.external.command";
        let is_chosen = self.planning.planner == PlannerName::External;
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
        let is_fixed = p.planner == PlannerName::SquareWave && p.leg_spacing_m.is_some();
        if is_fixed && !is_along_x {
            let message = "the square wave's legs run along x: head along x (0 or 180 deg)";
            return Err(invalid("planning.yaw_deg", message));
        }
        Ok(())
    }

    fn mission_settings(&self) -> Result<mission::Settings, ConfigError> {
        let m = &self.mission;
        let ratio = |key, percent, high| {
            within(key, percent, (0.0, high), "%").map(|percent: f64| percent / 100.0)
        };
        let land = m.land_battery_percent;
        let back = m.return_battery_percent;
        Ok(mission::Settings {
            min_take_off_battery_ratio: ratio(
                "mission.min_take_off_battery_percent",
                m.min_take_off_battery_percent,
                100.0,
            )
            .and_then(|take_off| {
                let least = back / 100.0;
                within("mission.min_take_off_battery_percent", take_off, (least, 1.0), "")
            })?,
            return_battery_ratio: ratio("mission.return_battery_percent", back, 100.0)?,
            land_battery_ratio: ratio("mission.land_battery_percent", land, back)?,
            preflight_timeout: seconds(
                "mission.preflight_timeout_s",
                m.preflight_timeout_s,
                (5.0, 600.0),
            )?,
            land_after_fix_lost: seconds(
                "mission.land_after_fix_lost_s",
                m.land_after_fix_lost_s,
                (0.5, 60.0),
            )?,
            return_after_lidar_lost: seconds(
                "mission.return_after_lidar_lost_s",
                m.return_after_lidar_lost_s,
                (0.5, 600.0),
            )?,
            ..mission::Settings::default()
        })
    }
}

/// `udp:HOST:PORT`, `unix:PATH` (datagrams) or `unix-stream:PATH`.
fn detections_address(text: &str) -> Result<camera::Address, ConfigError> {
    let refuse = || {
        let message = format!("{text:?} is not udp:HOST:PORT, unix:PATH or unix-stream:PATH");
        invalid("detections", message)
    };
    match text.split_once(':') {
        Some(("udp", address)) => address.parse().map(camera::Address::Udp).map_err(|_| refuse()),
        Some(("unix", path)) if !path.is_empty() => Ok(camera::Address::UnixDatagram(path.into())),
        Some(("unix-stream", path)) if !path.is_empty() => {
            Ok(camera::Address::UnixStream(path.into()))
        }
        _ => Err(refuse()),
    }
}

pub(super) fn rect(key: &str, r: &RectSection) -> Result<Rect, ConfigError> {
    let place = |value| within(key, value, (-10_000.0, 10_000.0), "m");
    let (x_min_m, y_min_m) = (place(r.x_min_m)?, place(r.y_min_m)?);
    Ok(Rect {
        x_min_m,
        y_min_m,
        x_max_m: within(key, r.x_max_m, (x_min_m + 0.01, 10_000.0), "m")?,
        y_max_m: within(key, r.y_max_m, (y_min_m + 0.01, 10_000.0), "m")?,
    })
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

/// Pose of a sensor on the body.
pub(super) fn mount<F: Frame>(
    key: &str,
    m: &MountSection,
) -> Result<Transform<Body, F>, ConfigError> {
    for value in m.position_m {
        within(key, value, (-5.0, 5.0), "m")?;
    }
    for value in m.rotation_deg {
        within(key, value, (-360.0, 360.0), "deg")?;
    }
    let [roll, pitch, yaw] = m.rotation_deg.map(rad_from_deg);
    let [x, y, z] = m.position_m;
    Ok(Transform::new(Rotation::from_euler_rad(roll, pitch, yaw), Point::new(x, y, z)))
}

fn pad_pose(pad: &PadSection) -> Result<localization::PadPose, ConfigError> {
    let coordinate =
        |k: usize| within("filter.pad.position_m", pad.position_m[k], (-10_000.0, 10_000.0), "m");
    let sigma_deg = within("filter.pad.yaw_sigma_deg", pad.yaw_sigma_deg, (0.1, 30.0), "°")?;
    Ok(localization::PadPose {
        position: Point::new(coordinate(0)?, coordinate(1)?, coordinate(2)?),
        yaw_rad: within("filter.pad.yaw_deg", pad.yaw_deg, (-360.0, 360.0), "°")?.to_radians(),
        position_sigma_m: within(
            "filter.pad.position_sigma_m",
            pad.position_sigma_m,
            (0.005, 5.0),
            "m",
        )?,
        yaw_sigma_rad: sigma_deg.to_radians(),
    })
}
