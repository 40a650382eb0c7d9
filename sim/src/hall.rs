//! The service's configuration for a simulated hall: what an integrator would write down.

use crate::calibration::CalibrationErrors;
use crate::calibration::CalibrationSigmas;
use crate::camera::CameraModel;
use crate::lidar::LidarModel;
use crate::scenario::{Scenario, Variance};
use crate::vehicle::VehicleSettings;
use crate::world::{Bay, Cuboid, Region, World};
use std::path::PathBuf;
use stockpilot::config::{
    BaySection, CameraSection, Config, DetectorSection, DustZone, ExternalSection, FilterSection,
    FoxgloveSection, HallSection, ImagesSection, LensName, LidarSection, LinkSection, LogSection,
    MarkersSection, MissionSection, MountSection, ObstacleSection, PageSection, PlanningSection,
    RectSection, SourceName, SurfaceSection, TagSection, UncertaintySection,
};
use stockpilot::geometry::{Body, Camera, Frame, Rotation, Transform};

/// Where the service finds the emulated devices.
#[derive(Debug, Clone, PartialEq)]
pub struct Devices {
    /// Address of the autopilot's link.
    pub link: String,
    /// The serial port of the LiDAR.
    pub lidar_port: String,
    /// Address of the marker detections.
    pub detections: String,
    /// The socket for the camera's pictures, if it hands over those.
    pub pictures: Option<PathBuf>,
    /// Where the log goes.
    pub log_directory: PathBuf,
}

impl Devices {
    /// For campaigns, where nothing is opened.
    #[must_use]
    pub fn none() -> Self {
        Self {
            link: "udpin:127.0.0.1:14540".to_owned(),
            lidar_port: "none".to_owned(),
            detections: "udp:127.0.0.1:0".to_owned(),
            pictures: None,
            log_directory: PathBuf::new(),
        }
    }
}

/// No pile of the worlds is higher, m; the relief is 4 m at most.
const MAX_PILE_HEIGHT_M: f64 = 5.0;

/// The configuration of this scenario: true where an integrator can know the truth, nominal where
/// the run draws errors.
#[must_use]
pub fn config(scenario: &Scenario, devices: Devices) -> Config {
    let world = &scenario.world;
    let conditions = &scenario.conditions;
    let surface = SurfaceSection::default();
    let planning = PlanningSection::default();
    let (variance_update, volume_variance) = scenario
        .variance
        .map_or((surface.variance_update, surface.volume_variance), Variance::config_names);
    Config {
        hall: hall(world),
        link: LinkSection { address: devices.link, ..LinkSection::default() },
        lidar: lidar(scenario.lidar.name(), &scenario.lidar.model(), devices.lidar_port),
        filter: filter(&scenario.camera),
        surface: SurfaceSection {
            method: scenario.surface.config_name(),
            slope_sigma: surface.slope_sigma * conditions.steepness,
            variance_update,
            volume_variance,
            uncertainty: uncertainty(&conditions.sigmas),
            ..surface
        },
        planning: PlanningSection {
            planner: Some(scenario.planner.config_name()),
            n_steps: scenario.n_steps,
            leg_spacing_m: conditions.leg_spacing_m,
            target_percent: conditions.target_percent,
            shadows: conditions.shadows,
            external: external(&conditions.planner_command),
            max_speed_mps: conditions.cruise_mps.unwrap_or(planning.max_speed_mps),
            ..planning
        },
        mission: MissionSection::default(),
        log: LogSection { directory: devices.log_directory, ..LogSection::default() },
        page: PageSection { enabled: false, ..PageSection::default() },
        foxglove: FoxgloveSection::default(),
        detections: devices.detections,
        detector: DetectorSection::default(),
        cameras: vec![camera(&scenario.camera, devices.pictures)],
        markers: MarkersSection::default(),
        tags: tags(world, &conditions.errors),
        bays: bays(world),
        exclusions: Vec::new(),
        obstacles: obstacles(world),
        fence: None,
        points: Vec::new(),
    }
}

fn external(command: &[String]) -> Option<ExternalSection> {
    (!command.is_empty())
        .then(|| ExternalSection { command: command.to_vec(), ..ExternalSection::default() })
}

const fn uncertainty(sigmas: &CalibrationSigmas) -> UncertaintySection {
    UncertaintySection {
        range_bias_sigma_m: sigmas.range_bias_sigma_m,
        range_scale_sigma: sigmas.range_scale_sigma,
        mount_position_sigma_m: sigmas.mount_position_sigma_m,
        mount_rotation_sigma_deg: sigmas.mount_rotation_sigma_deg,
        clock_offset_sigma_ms: sigmas.clock_offset_sigma_ms,
        marker_sigma_m: sigmas.marker_sigma_m,
        marker_datum_sigma_m: sigmas.marker_datum_sigma_m,
    }
}

/// A detector without noise is still not believed any further, px.
const LEAST_CORNER_SIGMA_PX: f64 = 0.02;

/// The noise that the simulated sensors have, and nothing on top.
///
/// The defaults of the configuration leave room for vibration, a blurred picture and stamps that
/// are a little off; with those the simulated filter would claim three times too much.
fn filter(camera: &CameraModel) -> FilterSection {
    let imu = VehicleSettings::default().imu;
    FilterSection {
        corner_sigma_px: camera.detector.pixel_sigma_px.max(LEAST_CORNER_SIGMA_PX),
        // Frames carry the true time, and without sockets the clocks compare exactly.
        capture_sigma_s: 0.0,
        accel_density_mps2_rthz: imu.accel_density_mps2_rthz,
        gyro_density_radps_rthz: imu.gyro_density_radps_rthz,
        accel_walk_mps2_rts: imu.accel_bias_walk_mps2_rts,
        gyro_walk_radps_rts: imu.gyro_bias_walk_radps_rts,
        ..FilterSection::default()
    }
}

const fn rect(r: &Region) -> RectSection {
    RectSection { x_min_m: r.x_min_m, y_min_m: r.y_min_m, x_max_m: r.x_max_m, y_max_m: r.y_max_m }
}

fn hall(world: &World) -> HallSection {
    HallSection {
        region: rect(&world.region),
        base_height_m: 0.0,
        // The worlds' floor is level by construction.
        base_sigma_m: 0.0,
        base: None,
        density_t_per_m3: None,
        density_sigma_t_per_m3: None,
        max_pile_height_m: MAX_PILE_HEIGHT_M,
        walls_m: Some(world.outline_m.clone()),
        ceiling_m: Some(world.hall.max_m.z),
        exclusions: world
            .walls_inside
            .iter()
            .map(|wall| rect(&up_to_the_border(&wall.footprint(), &world.region)))
            .collect(),
        exclusion_margin_m: 0.12,
        dust_zone: DustZone::None,
        dust_released_by: None,
    }
}

/// Bulk density of the simulated material and its σ, t/m³: gravel that nobody has weighed.
pub const DENSITY_T_PER_M3: (f64, f64) = (1.6, 0.05);

/// The bays of the world, with the density of their material.
fn bays(world: &World) -> Vec<BaySection> {
    let (mean, sigma) = DENSITY_T_PER_M3;
    let section = |bay: &Bay| BaySection {
        name: bay.name.clone(),
        polygon_m: bay.outline_m.clone(),
        base: None,
        density_t_per_m3: Some(mean),
        density_sigma_t_per_m3: Some(sigma),
        density_source: None,
        density_date: None,
        moisture: None,
        material: None,
    };
    world.bays.iter().map(section).collect()
}

/// What stands in the hall, the walls of bays included: planners must know what they hide. What reaches
/// the ceiling as a part of the hall's own walls is in their outline.
fn obstacles(world: &World) -> Vec<ObstacleSection> {
    let is_low = |wall: &&Cuboid| wall.max_m.z < world.hall.max_m.z;
    let low_walls = world.walls_inside.iter().filter(is_low);
    world.obstacles.iter().chain(low_walls).map(obstacle).collect()
}

fn obstacle(cuboid: &Cuboid) -> ObstacleSection {
    let size_m = cuboid.max_m - cuboid.min_m;
    let centre_m = cuboid.min_m + 0.5 * size_m;
    ObstacleSection::Box { centre_m: centre_m.into(), size_m: size_m.into(), yaw_deg: 0.0 }
}

/// A strip narrower than this between a wall and the region's border belongs to no bay, m.
const DEAD_STRIP_M: f64 = 0.5;

/// The footprint of a wall with the dead strip behind it: no material lies there, and no beam over
/// the wall reaches it.
fn up_to_the_border(wall: &Region, region: &Region) -> Region {
    let low = |wall: f64, border: f64| if wall - border < DEAD_STRIP_M { border } else { wall };
    let high = |wall: f64, border: f64| if border - wall < DEAD_STRIP_M { border } else { wall };
    Region::new(
        low(wall.x_min_m, region.x_min_m),
        low(wall.y_min_m, region.y_min_m),
        high(wall.x_max_m, region.x_max_m),
        high(wall.y_max_m, region.y_max_m),
    )
}

fn lidar(name: &str, model: &LidarModel, port: String) -> LidarSection {
    LidarSection {
        model: name.to_owned(),
        port,
        baud: None,
        mount: mount(&model.body_from_lidar),
        range_sigma_m: model.range_sigma_m,
        angle_sigma_deg: model.angle_sigma_rad.to_degrees(),
        min_range_m: 0.15,
        max_range_m: model.range_max_m,
        range_bias_m: 0.0,
        range_scale: 0.0,
        clock_offset_ms: 0.0,
        blind_sectors_deg: Vec::new(),
    }
}

fn camera(model: &CameraModel, pictures: Option<PathBuf>) -> CameraSection {
    let lens = &model.lens;
    // The configuration turns a camera that looks forward; undo that turn to find the angles.
    let looking_forward = Rotation::<Body, Camera>::from_euler_rad(
        -std::f64::consts::FRAC_PI_2,
        0.0,
        -std::f64::consts::FRAC_PI_2,
    );
    let turn: Rotation<Body, Body> = model.body_from_camera.rotation * looking_forward.inverse();
    CameraSection {
        calibration_file: None,
        size_px: Some([lens.width_px, lens.height_px]),
        focal_px: Some([lens.fx_px, lens.fy_px]),
        principal_px: Some([lens.cx_px, lens.cy_px]),
        lens: LensName::RadialTangential,
        distortion: vec![lens.k1, lens.k2, lens.p1, lens.p2],
        readout_s: 0.0,
        images: pictures.map(|path| ImagesSection {
            source: SourceName::PgmStream,
            path,
            stamp_delay_ms: None,
            frames_per_s: 20,
            exposure_ms: None,
        }),
        mount: mount(&Transform::new(turn, model.body_from_camera.origin)),
    }
}

fn mount<F: Frame>(body_from_sensor: &Transform<Body, F>) -> MountSection {
    let (roll, pitch, yaw) = body_from_sensor.rotation.euler_rad();
    MountSection {
        position_m: body_from_sensor.origin.coords.into(),
        rotation_deg: [roll, pitch, yaw].map(f64::to_degrees),
    }
}

/// The map of the markers, as wrong as it was measured.
fn tags(world: &World, errors: &CalibrationErrors) -> Vec<TagSection> {
    world
        .tags
        .iter()
        .enumerate()
        .map(|(i, tag)| TagSection {
            family: tag.family.name().to_owned(),
            id: tag.id,
            corners_m: errors.mapped_corners(i, tag).map(|corner| corner.coords.into()),
            faces_away: false,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Conditions, Lidar, Planner, Surface};
    use nalgebra::Vector3;
    use stockpilot::config::{VarianceUpdateName, VolumeVarianceName};
    use stockpilot::planning::free_space::FreeSpace;

    #[test]
    fn the_configuration_holds_the_true_mountings_and_lens() {
        let scenario = Scenario {
            world: World::piles(0).expect("a world"),
            planner: Planner::Greedy,
            surface: Surface::KalmanGrid,
            variance: None,
            lidar: Lidar::Ld19,
            autopilot: crate::autopilot::Flavour::Px4,
            camera: CameraModel::ahead(),
            n_steps: 50,
            seed: 0,
            conditions: Conditions::default(),
        };
        let settings = config(&scenario, Devices::none()).pilot_settings().expect("valid");
        let camera = &settings.localization.cameras[0];
        let truth = &scenario.camera;
        assert!(
            camera.body_from_camera.rotation.minus(&truth.body_from_camera.rotation).norm() < 1e-9
        );
        let lidar = settings.mapping.lidar.body_from_lidar;
        let true_lidar = scenario.lidar.model().body_from_lidar;
        // Pitch of 90° is the singularity of the angles: the rotation must survive it.
        assert!(lidar.rotation.minus(&true_lidar.rotation).norm() < 1e-6);
        // The same pixel from two independent implementations of the lens.
        let p = Vector3::new(1.3, -0.7, 4.0);
        let ours = camera.project(&stockpilot::geometry::Point::from_coords(p)).expect("seen").0;
        let theirs = truth.lens.project(&p).expect("seen");
        assert!((ours - nalgebra::Vector2::from(theirs)).norm() < 1e-9);
    }

    /// How many of the candidate sites of the configured flight are feasible.
    fn feasible_share(world: &str, seed: u64) -> f64 {
        let option = format!("--world={world}");
        let words = ["test", option.as_str()];
        let options = <Options as clap::Parser>::try_parse_from(words).expect("options");
        let scenario = options.scenario.scenario(seed).expect("a scenario");
        let settings = config(&scenario, Devices::none()).pilot_settings().expect("valid");
        let localization = &settings.localization;
        let space = FreeSpace::evaluate(
            &settings.planning,
            &localization.cameras,
            &localization.marker_map,
            localization.vision.corner_sigma_px,
        );
        for site in space.feasible() {
            let clearance_m = scenario.world.clearance_m(&site.waypoint.place, 1.0);
            assert!(clearance_m > 0.49, "{world}: {:?} is {clearance_m} m", site.waypoint);
        }
        space.feasible().count() as f64 / 441.0
    }

    #[test]
    fn every_world_has_the_free_space_that_its_name_says() {
        assert!((feasible_share("alps", 1) - 1.0).abs() < 1e-12);
        let [columns, l_hall, poor_fix] =
            ["columns", "l-hall", "poor-fix"].map(|world| feasible_share(world, 2));
        println!("columns {columns}, l-hall {l_hall}, poor-fix {poor_fix}");
        assert!((0.9..1.0).contains(&columns), "{columns}");
        assert!((0.6..0.9).contains(&l_hall), "{l_hall}");
        assert!((0.4..0.8).contains(&poor_fix), "{poor_fix}");
    }

    #[derive(Debug, clap::Parser)]
    struct Options {
        #[command(flatten)]
        scenario: crate::scenario::ScenarioArgs,
    }

    fn scenario(options: &[&str]) -> anyhow::Result<Scenario> {
        let words = ["test"].iter().chain(options);
        <Options as clap::Parser>::try_parse_from(words)?.scenario.scenario(4)
    }

    #[test]
    fn the_service_is_told_nominal_values_and_the_noise_but_no_drawn_error() {
        let usual = scenario(&[]).expect("a scenario");
        let unusual = scenario(&[
            "--draw-errors",
            "--steepness=2",
            "--marker-noise=2",
            "--surface=kalman-grid",
            "--variance=printed",
            "--cruise-mps=0.5",
            "--leg-spacing-m=2.5",
        ]);
        let unusual = unusual.expect("a scenario");
        let [plain, told] = [&usual, &unusual].map(|s| config(s, Devices::none()));
        assert_eq!(told.lidar, plain.lidar, "mounting and range stay nominal");
        let true_lidar = unusual.conditions.errors.true_lidar(&unusual.lidar.model());
        let nominal = unusual.lidar.model();
        assert_ne!(true_lidar.body_from_lidar, nominal.body_from_lidar);
        let ratio = told.filter.corner_sigma_px / plain.filter.corner_sigma_px;
        assert!((ratio - 2.0).abs() < 1e-12);
        let true_ratio =
            unusual.camera.detector.pixel_sigma_px / usual.camera.detector.pixel_sigma_px;
        assert!((true_ratio - 2.0).abs() < 1e-12);
        assert!((told.surface.slope_sigma / plain.surface.slope_sigma - 2.0).abs() < 1e-12);
        assert_eq!(told.surface.volume_variance, VolumeVarianceName::Printed);
        assert_eq!(told.surface.variance_update, VarianceUpdateName::Printed);
        assert!((told.planning.max_speed_mps - 0.5).abs() < 1e-12);
        assert_eq!(told.planning.leg_spacing_m, Some(2.5));
        let offsets_m: Vec<f64> = std::iter::zip(&told.tags, &unusual.world.tags)
            .flat_map(|(told, hung)| {
                (0..3).map(|k| told.corners_m[0][k] - hung.corners[0].coords[k])
            })
            .collect();
        let var_m2 = offsets_m.iter().map(|m| m * m).sum::<f64>() / offsets_m.len() as f64;
        // 5 mm; four standard errors of a deviation from 300 numbers and more are 16 %.
        assert!(offsets_m.len() > 300 && (var_m2.sqrt() / 0.005 - 1.0).abs() < 0.16);
        told.pilot_settings().expect("valid");
        plain.pilot_settings().expect("valid");
    }

    #[test]
    fn a_datum_is_drawn_only_where_it_is_named() {
        let offset_m = |options: &[&str]| {
            let scenario = scenario(options).expect("a scenario");
            let told = config(&scenario, Devices::none());
            assert!(told.pilot_settings().is_ok());
            let datum_m = scenario.conditions.errors.datum_m;
            (datum_m.norm(), told.surface.uncertainty.marker_datum_sigma_m)
        };
        assert_eq!(offset_m(&["--draw-errors"]), (0.0, 0.0));
        let (drawn_m, told_m) = offset_m(&["--draw-errors=markers,datum"]);
        assert!(drawn_m > 0.0 && (told_m - 0.005).abs() < 1e-15);
    }

    #[test]
    fn options_out_of_range_are_refused() {
        for options in [
            &["--dust=1.5"][..],
            &["--steepness=0"],
            &["--marker-noise=-1"],
            &["--world=nowhere.asc", "--steepness=2"],
            &["--draw-errors=wind"],
            // What would stay without effect.
            &["--variance=printed"],
            &["--variance=full", "--surface=matern-field"],
            &["--draw-errors=datum"],
        ] {
            assert!(scenario(options).is_err(), "{options:?}");
        }
    }
}
