//! From the file's twin to the settings of the modules, with every number checked.

use super::error::ConfigError;
use super::file::{Config, MountSection, RectSection};
use crate::geometry::{Body, Frame, Point, Rotation, Transform};
use crate::mapping::projection::LidarMount;
use crate::mapping::region::Rect;
use crate::units::rad_from_deg;
use crate::{camera, lidar, link, pilot, web};
use std::time::Duration;

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
        let has_target = self.planning.target_percent.is_some();
        let usual_interval_s = if has_target { 2.0 } else { 5.0 };
        Ok(pilot::Settings {
            localization: self.localization_settings()?,
            mapping: self.mapping_settings()?,
            planning: self.planning_settings()?,
            mission: self.mission_settings()?,
            scan_correction: self.scan_correction()?,
            solve_interval: seconds(
                "surface.solve_interval_s",
                self.surface.solve_interval_s.unwrap_or(usual_interval_s),
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

    pub(super) fn lidar_mount(&self) -> Result<LidarMount, ConfigError> {
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
