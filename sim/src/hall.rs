//! The service's configuration for a simulated hall: what an integrator would write down.

use crate::calibration::CalibrationErrors;
use crate::calibration::CalibrationSigmas;
use crate::camera::CameraModel;
use crate::lidar::LidarModel;
use crate::scenario::{Scenario, Variance};
use crate::world::{Region, World};
use std::path::PathBuf;
use stockpilot::config::{
    CameraSection, Config, FilterSection, HallSection, LidarSection, LinkSection, LogSection,
    MissionSection, MountSection, PlanningSection, RectSection, SurfaceSection, TagSection,
    UncertaintySection,
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
    let (filter, surface) = (FilterSection::default(), SurfaceSection::default());
    let planning = PlanningSection::default();
    Config {
        hall: hall(world),
        link: LinkSection { address: devices.link, ..LinkSection::default() },
        lidar: lidar(scenario.lidar.name(), &scenario.lidar.model(), devices.lidar_port),
        filter: FilterSection {
            corner_sigma_px: filter.corner_sigma_px * conditions.marker_noise,
            ..filter
        },
        surface: SurfaceSection {
            method: scenario.surface.config_name(),
            slope_sigma: surface.slope_sigma * conditions.steepness,
            volume_variance: scenario
                .variance
                .map_or(surface.volume_variance, Variance::config_name),
            uncertainty: uncertainty(&conditions.sigmas),
            ..surface
        },
        planning: PlanningSection {
            planner: scenario.planner.config_name(),
            n_steps: scenario.n_steps,
            max_speed_mps: conditions.cruise_mps.unwrap_or(planning.max_speed_mps),
            ..planning
        },
        mission: MissionSection::default(),
        log: LogSection { directory: devices.log_directory },
        detections: devices.detections,
        cameras: vec![camera(&scenario.camera)],
        tags: tags(world, &conditions.errors),
        bays: Vec::new(),
        exclusions: Vec::new(),
    }
}

const fn uncertainty(sigmas: &CalibrationSigmas) -> UncertaintySection {
    UncertaintySection {
        range_bias_sigma_m: sigmas.range_bias_sigma_m,
        range_scale_sigma: sigmas.range_scale_sigma,
        mount_position_sigma_m: sigmas.mount_position_sigma_m,
        mount_rotation_sigma_deg: sigmas.mount_rotation_sigma_deg,
        clock_offset_sigma_ms: sigmas.clock_offset_sigma_ms,
        marker_sigma_m: sigmas.marker_sigma_m,
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
        max_pile_height_m: MAX_PILE_HEIGHT_M,
        exclusions: world
            .walls_inside
            .iter()
            .map(|wall| rect(&up_to_the_border(&wall.footprint(), &world.region)))
            .collect(),
        exclusion_margin_m: 0.12,
    }
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
        range_sigma_m: 0.012,
        angle_sigma_deg: 0.1,
        min_range_m: 0.15,
        max_range_m: model.range_max_m,
        blind_sectors_deg: Vec::new(),
    }
}

fn camera(model: &CameraModel) -> CameraSection {
    let lens = &model.lens;
    // The configuration turns a camera that looks forward; undo that turn to find the angles.
    let looking_forward = Rotation::<Body, Camera>::from_euler_rad(
        -std::f64::consts::FRAC_PI_2,
        0.0,
        -std::f64::consts::FRAC_PI_2,
    );
    let turn: Rotation<Body, Body> = model.body_from_camera.rotation * looking_forward.inverse();
    CameraSection {
        size_px: [lens.width_px, lens.height_px],
        focal_px: [lens.fx_px, lens.fy_px],
        principal_px: [lens.cx_px, lens.cy_px],
        distortion: [lens.k1, lens.k2, lens.p1, lens.p2],
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
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Conditions, Lidar, Planner, Surface};
    use nalgebra::Vector3;

    #[test]
    fn the_configuration_holds_the_true_mountings_and_lens() {
        let scenario = Scenario {
            world: World::piles(0).expect("a world"),
            planner: Planner::Greedy,
            surface: Surface::KalmanGrid,
            variance: None,
            lidar: Lidar::Ld19,
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
}
