//! `stockpilot calibrate lidar`: the mounting of the LiDAR from a flight along floor and walls.

use crate::calibration::mount::{
    self, Before, CalibrationError, Limits, MountCalibration, PlacedBeam, PlacedTurn,
};
use crate::calibration::planes;
use crate::config::{Config, ConfigError};
use crate::messages::{Scan, ScanCorrection};
use crate::pilot::Pilot;
use crate::record::read_scans;
use crate::record::replay::ReplayError;
use std::path::Path;

/// What the log does not say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountOptions {
    /// No material lies in the hall: the whole floor counts, and the walls from their foot on.
    pub hall_is_empty: bool,
    /// How well the walls' places are known, m.
    pub wall_sigma_m: f64,
    /// How well the floor's level is known, m; as configured if left out.
    pub floor_sigma_m: Option<f64>,
    /// How well the stamps are known against the poses, s; as configured if left out.
    pub clock_sigma_s: Option<f64>,
    /// How well all of it must be known to count as seen.
    pub limits: Limits,
}

/// Why there is no calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] ReplayError),
    /// The configuration in the log does not work with this build.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The data do not give one.
    #[error(transparent)]
    Data(#[from] CalibrationError),
}

/// What was found, beside what the flight was flown with.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarCalibration {
    /// The mounting.
    pub mount: MountCalibration,
    /// Corrections of ranges and stamps that were taken off already.
    pub flown_with: ScanCorrection,
}

/// More beams of a turn say nothing new: they share its pose.
const BEAMS_PER_TURN: usize = 200;

/// Finds the mounting, and the offset of the stamps, from a log.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_mount(
    log: &Path,
    options: &MountOptions,
) -> Result<LidarCalibration, CalibrateError> {
    let mut found_config = None;
    let mut turns = Vec::new();
    let make_pilot = |toml: &str| -> Result<Pilot, ConfigError> {
        let config = Config::from_log(toml, log)?;
        let pilot = Pilot::new(config.pilot_settings()?);
        found_config = Some(config);
        Ok(pilot)
    };
    read_scans(log, make_pilot, |scan, pilot| turns.extend(placed(scan, pilot)))?;
    let Some(config) = found_config else { return Err(CalibrationError::NoSolution.into()) };
    let settings = config.pilot_settings()?;
    let known = settings.mapping.field.calibration;
    let hall = planes::Hall {
        floor_m: (
            config.hall.base_height_m,
            options.floor_sigma_m.unwrap_or(config.hall.base_sigma_m),
        ),
        walls: settings.planning.space.walls.map(|walls| (walls, options.wall_sigma_m)),
        ceiling_m: None,
        material: (!options.hall_is_empty).then_some(settings.mapping.region.bounds),
        material_height_m: config.hall.max_pile_height_m,
    };
    let before = Before {
        lidar: settings.mapping.lidar,
        position_sigma_m: known.mount_position_m,
        rotation_sigma_rad: known.mount_rotation_rad,
        range_bias_sigma_m: known.range_bias_m,
        clock_sigma_s: options.clock_sigma_s.unwrap_or(known.clock_offset_s),
    };
    let mount = mount::calibrate(&turns, &hall.planes(), &before, &options.limits)?;
    Ok(LidarCalibration { mount, flown_with: settings.scan_correction })
}

/// The turn with the poses of its beams; `None` where they are not known.
fn placed(scan: &Scan, pilot: &Pilot) -> Option<PlacedTurn> {
    let localizer = pilot.localizer();
    let middle = scan.beams.get(scan.beams.len() / 2)?;
    let error = localizer.pose_error_at(scan.beam_at(middle), None)?;
    let step = scan.beams.len().div_ceil(BEAMS_PER_TURN).max(1);
    let beam = |beam: &crate::messages::Beam| {
        let (hall_from_body, _) = localizer.pose_at(scan.beam_at(beam))?;
        let (angle_rad, range_m) = (f64::from(beam.angle_rad), f64::from(beam.range_m));
        Some(PlacedBeam { hall_from_body, angle_rad, range_m })
    };
    let beams = scan.beams.iter().step_by(step).filter_map(beam).collect();
    let pose_cov = error.cov.fixed_view::<6, 6>(0, 0).into_owned();
    error.is_finite().then_some(PlacedTurn {
        pose_cov,
        velocity_mps: error.velocity_mps,
        rate_radps: error.rate_radps,
        beams,
    })
}
