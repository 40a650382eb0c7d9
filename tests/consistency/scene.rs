//! A hall with tags on all walls, a camera, and flights through it that start on the ground.
//!
//! Pixels are drawn from the true pose with own arithmetic: a pinhole camera, one line of algebra.

use crate::truth::{Motion, Sensors, stamp};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::time::Duration;
use stockpilot::geometry::{Body, Camera, Hall, Point, Rotation, Transform};
use stockpilot::localization::camera_model::{CameraModel, Lens};
use stockpilot::localization::filter::ImuNoise;
use stockpilot::localization::marker_map::MarkerMap;
use stockpilot::localization::{Health, Localizer, Settings, Update, vision_fix};
use stockpilot::messages::{
    CameraId, FixRecord, StatusText, TagDetection, TagDetections, TagFamily,
};
use stockpilot::stats::{Noise, SeedBook};

pub(crate) const IMU_RATE_HZ: f64 = 200.0;
/// A frame every so many samples.
pub(crate) const STEPS_PER_FRAME: u32 = 10;
pub(crate) const CORNER_SIGMA_PX: f64 = 0.4;
pub(crate) const CAPTURE_SIGMA_S: f64 = 0.002;
/// The vehicle stands this long at first, s.
pub(crate) const STANDS_S: f64 = 2.0;
const FOCAL_PX: f64 = 640.0;
const CENTRE_PX: [f64; 2] = [640.0, 400.0];

pub(crate) type Corners = [Vector3<f64>; 4];

/// Tags of half a metre on four walls 11 m from the middle, every three metres in two rows.
pub(crate) fn tags() -> BTreeMap<u32, Corners> {
    let mut tags = BTreeMap::new();
    for wall in 0..4_u32 {
        let turn = std::f64::consts::FRAC_PI_2 * f64::from(wall);
        let turned =
            |v: Vector3<f64>| nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), turn) * v;
        for k in 0..14_u32 {
            let (y, z) = (f64::from(k % 7) * 3.0 - 9.0, f64::from(k / 7) * 2.2 - 1.4);
            // Lower left, lower right, upper right, upper left, seen from the inside.
            let corners = [(0.25, -0.25), (-0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)];
            let corners = corners.map(|(dy, dz)| turned(Vector3::new(11.0, y + dy, z + dz)));
            tags.insert(100 * wall + k, corners);
        }
    }
    tags
}

/// A camera that looks forward.
pub(crate) fn body_from_camera() -> Transform<Body, Camera> {
    let quarter = std::f64::consts::FRAC_PI_2;
    Transform::new(
        Rotation::<Body, Camera>::from_euler_rad(-quarter, 0.0, -quarter),
        Point::new(0.1, 0.0, -0.02),
    )
}

pub(crate) fn settings(update: Update) -> Settings {
    // The tags hang exactly where the map says.
    let mut marker_map = MarkerMap::default().with_place_sigma_m(0.0);
    for (id, corners) in tags() {
        let corners = corners.map(Point::from_coords);
        marker_map.insert(TagFamily::Tag36h11, id, corners).expect("a square");
    }
    Settings {
        cameras: vec![CameraModel {
            width_px: 1280,
            height_px: 800,
            fx_px: FOCAL_PX,
            fy_px: FOCAL_PX,
            cx_px: CENTRE_PX[0],
            cy_px: CENTRE_PX[1],
            lens: Lens::pinhole(),
            readout: Duration::ZERO,
            body_from_camera: body_from_camera(),
        }],
        marker_map,
        vision: vision_fix::Settings {
            corner_sigma_px: CORNER_SIGMA_PX,
            max_position_sigma_m: 0.5,
        },
        update,
        capture_sigma_s: CAPTURE_SIGMA_S,
        imu_noise: ImuNoise::default(),
        pad: None,
        ring_span: Duration::from_secs(1),
        lost_after: Duration::from_millis(1500),
        lost_sigma_m: 0.25,
    }
}

/// The true pixels of the tags in view, corners in the order of the map.
pub(crate) fn pixels(
    pose: &Transform<Hall, Body>,
    tags: &BTreeMap<u32, Corners>,
) -> Vec<(u32, [[f64; 2]; 4])> {
    let r_hall_body = pose.rotation.matrix();
    // x right is −y of the body, y down is −z, z ahead is x.
    let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    let lever = Vector3::new(0.1, 0.0, -0.02);
    let pixel = |corner: &Vector3<f64>| {
        let body = r_hall_body.transpose() * (corner - pose.origin.coords);
        let p = axes * (body - lever);
        let at = [FOCAL_PX * p.x / p.z + CENTRE_PX[0], FOCAL_PX * p.y / p.z + CENTRE_PX[1]];
        let is_seen = p.z > 0.5 && (0.0..1280.0).contains(&at[0]) && (0.0..800.0).contains(&at[1]);
        is_seen.then_some(at)
    };
    tags.iter()
        .filter_map(|(id, corners)| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| pixel(&corners[k]));
            Some((*id, [a?, b?, c?, d?]))
        })
        .collect()
}

/// A flight under way: truth, sensors, and a localizer that hears of them late.
pub(crate) struct Flight {
    pub(crate) motion: Motion,
    pub(crate) sensors: Sensors,
    pub(crate) localizer: Localizer,
    pub(crate) noise: Noise,
    /// Where the tags really hang.
    pub(crate) tags: BTreeMap<u32, Corners>,
    pub(crate) latency_s: f64,
    pub(crate) k: u32,
    /// No inertial sample arrives in this time, s.
    pub(crate) deaf: std::ops::Range<f64>,
    waiting: Vec<(f64, TagDetections)>,
    pub(crate) records: Vec<FixRecord>,
    pub(crate) notices: Vec<StatusText>,
}

impl Flight {
    pub(crate) fn new(seed: u64, settings: Settings, latency_s: f64) -> Self {
        let mut noise = SeedBook::new(seed).stream("flight");
        let motion = Motion::drawn(&mut noise).standing_until(STANDS_S);
        // The σ that the filter starts with: 0.15 m/s²; gyroscope biases are averaged at rest.
        let (gyro_bias, accel_bias) = (noise.normal3() * 0.01, noise.normal3() * 0.15);
        Self {
            motion,
            sensors: Sensors::new(gyro_bias, accel_bias, ImuNoise::default()),
            localizer: Localizer::new(settings),
            noise,
            tags: tags(),
            latency_s,
            k: 0,
            deaf: 0.0..0.0,
            waiting: Vec::new(),
            records: Vec::new(),
            notices: Vec::new(),
        }
    }

    /// The vehicle stands this long at first, s.
    pub(crate) fn standing_until(self, stands_until: f64) -> Self {
        Self { motion: self.motion.standing_until(stands_until), ..self }
    }

    /// Flies until `t`, with or without frames.
    pub(crate) fn fly_until(&mut self, t: f64, has_frames: bool) {
        while self.t() < t - 1e-9 {
            self.step(&mut |_, _| has_frames);
        }
    }

    pub(crate) fn health(&self) -> Health {
        self.localizer.health(stamp(self.t()))
    }

    pub(crate) fn t(&self) -> f64 {
        f64::from(self.k) / IMU_RATE_HZ
    }

    /// One inertial step; `spoil` sees each frame before it is sent, and may drop it.
    pub(crate) fn step(&mut self, spoil: &mut dyn FnMut(&mut TagDetections, &mut Noise) -> bool) {
        self.k += 1;
        let (t, dt) = (self.t(), 1.0 / IMU_RATE_HZ);
        let imu = self.sensors.sample(&self.motion, t, dt, &mut self.noise);
        if !self.deaf.contains(&t) {
            self.localizer.on_imu(imu);
        }
        if self.k.is_multiple_of(STEPS_PER_FRAME) {
            let mut frame = self.frame(t);
            if spoil(&mut frame, &mut self.noise) {
                self.waiting.push((t + self.latency_s, frame));
            }
        }
        while self.waiting.first().is_some_and(|(due, _)| *due <= t + 1e-9) {
            let (_, frame) = self.waiting.remove(0);
            self.records.push(self.localizer.on_tags(&frame));
        }
        self.records.extend(self.localizer.take_records());
        self.notices.extend(self.localizer.take_notices());
    }

    /// The frame stamped `t`, exposed a little before or after.
    pub(crate) fn frame(&mut self, t: f64) -> TagDetections {
        let exposed = t + self.noise.normal() * CAPTURE_SIGMA_S;
        let seen = pixels(&self.motion.pose(exposed), &self.tags);
        let tags = seen
            .into_iter()
            .map(|(id, corners_px)| TagDetection {
                id,
                family: TagFamily::Tag36h11,
                corners_px: corners_px
                    .map(|pixel| pixel.map(|x| x + self.noise.normal() * CORNER_SIGMA_PX)),
                decision_margin: 50.0,
            })
            .collect();
        TagDetections {
            captured_at: stamp(t),
            received_at: stamp(t + self.latency_s),
            camera: CameraId(0),
            tags,
            points: Vec::new(),
        }
    }

    /// Truth minus estimate: position, attitude, velocity.
    pub(crate) fn error(&self) -> [Vector3<f64>; 3] {
        let estimate = self.localizer.estimate().expect("a started filter");
        let t = self.t();
        let pose = self.motion.pose(t);
        [
            (pose.origin - estimate.hall_from_body.origin).coords,
            pose.rotation.minus(&estimate.hall_from_body.rotation),
            self.motion.velocity_mps(t) - estimate.velocity_mps.coords,
        ]
    }

    /// NEES of position, attitude, velocity.
    pub(crate) fn nees(&self) -> [f64; 3] {
        let cov = self.localizer.estimate().expect("a started filter").error_cov;
        let error = self.error();
        [0, 1, 2].map(|group| {
            let block = cov.fixed_view::<3, 3>(3 * group, 3 * group).into_owned();
            let factor = block.cholesky().expect("positive definite");
            error[group].dot(&factor.solve(&error[group]))
        })
    }
}
