use super::*;
use crate::geometry::{Point, Rotation, Transform};
use crate::messages::{GridGeometry, PoseError};
use crate::stats::SeedBook;
use crate::time::Stamp;
use nalgebra::SMatrix;

const SLOPES: [(f64, f64); 4] = [(0.0, 0.0), (0.8, -0.3), (-1.4, 0.6), (0.2, 1.9)];
const ANGLES_RAD: [f64; 4] = [-0.9, -0.2, 0.4, 1.1];

/// A plane under a LiDAR that hangs askew, and one turn over it.
struct Scene {
    lattice: Lattice,
    heights_m: Vec<f64>,
    slope: (f64, f64),
    lidars: [LidarMount; 1],
    footprint: Footprint,
}

impl Scene {
    fn new(slope: (f64, f64)) -> Self {
        let grid =
            GridGeometry { x_min_m: -20.0, y_min_m: -20.0, cell_m: 0.5, n_cols: 80, n_rows: 80 };
        let lattice = Lattice::covering(&grid, 1.0, |_, _| false);
        let heights_m = (0..lattice.n_nodes())
            .map(|node| lattice.place_m(node))
            .map(|(x, y)| slope.0 * x + slope.1 * y)
            .collect();
        // The scan plane stands upright across the flight; 0 looks down.
        let rotation = Rotation::from_euler_rad(0.03, std::f64::consts::FRAC_PI_2 - 0.05, 0.02);
        let lidar = LidarMount {
            body_from_lidar: Transform::new(rotation, Point::new(0.06, -0.02, -0.08)),
            range_sigma_m: 0.02,
            angle_sigma_rad: 0.002,
            min_range_m: 0.1,
            max_range_m: 40.0,
            blind_sectors_rad: Vec::new(),
        };
        let pose = Rotation::from_euler_rad(0.05, -0.04, 0.7);
        let footprint = Footprint {
            error: PoseError {
                at: Stamp::ZERO,
                cov: SMatrix::identity() * 1e-6,
                from_previous: SMatrix::zeros(),
                velocity_mps: Vector3::zeros(),
                rate_radps: Vector3::zeros(),
                tags: Vec::new(),
            },
            hall_from_body: Transform::new(pose, Point::new(0.3, 0.2, 6.0)),
            lidar_idx: 0,
            patches: Vec::new(),
            passed_to_m: Vec::new(),
            silent: Vec::new(),
        };
        Self { lattice, heights_m, slope, lidars: [lidar], footprint }
    }

    fn linearization(&self) -> Linearization<'_> {
        Linearization {
            lattice: &self.lattice,
            heights_m: Some(&self.heights_m),
            is_known: &[],
            n_patches: &[],
            lidars: &self.lidars,
            roughness_m: 0.0,
            scatter_m: 0.0,
            slope_sigma: 0.6,
            occlusion_share: 0.3,
        }
    }

    fn above_m(&self, place: &Vector3<f64>) -> f64 {
        place.z - self.slope.0 * place.x - self.slope.1 * place.y
    }

    /// The hit in the hall of a beam, its pose and mounting moved by these errors.
    fn hit(
        &self,
        (angle_rad, range_m): (f64, f64),
        by_pose: &Vector6<f64>,
        by_mount: &Vector6<f64>,
    ) -> Vector3<f64> {
        let parts = |v: &Vector6<f64>| (v.fixed_rows::<3>(0).into(), v.fixed_rows::<3>(3).into());
        let (moved_m, turned_rad): (Vector3<f64>, Vector3<f64>) = parts(by_pose);
        let pose = &self.footprint.hall_from_body;
        let rotation = pose.rotation.perturbed(&turned_rad).matrix();
        let (offset_m, twisted_rad): (Vector3<f64>, Vector3<f64>) = parts(by_mount);
        let mount = &self.lidars[0].body_from_lidar;
        let axes = mount.rotation.perturbed(&twisted_rad).matrix();
        let ray = Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0) * range_m;
        pose.origin.coords + moved_m + rotation * (mount.origin.coords + offset_m + axes * ray)
    }

    /// Range of the beam in this direction to the plane, m; `None` if it never meets it.
    fn range_m(&self, angle_rad: f64) -> Option<f64> {
        let zero = Vector6::zeros();
        let [at_0, at_1] =
            [0.0, 1.0].map(|range_m| self.above_m(&self.hit((angle_rad, range_m), &zero, &zero)));
        let range_m = at_0 / (at_0 - at_1);
        (range_m > 0.0 && range_m < 40.0).then_some(range_m)
    }

    fn datum(&self, angle_rad: f64, range_m: f64) -> Datum {
        let zero = Vector6::zeros();
        let place = self.hit((angle_rad, range_m), &zero, &zero);
        let pose = &self.footprint.hall_from_body;
        let arm = pose.rotation.matrix().transpose() * (place - pose.origin.coords);
        #[expect(clippy::cast_possible_truncation, reason = "as patches are kept")]
        let patch = Patch {
            place_m: place.map(|c| c as f32).into(),
            arm_m: arm.map(|c| c as f32).into(),
            n_beams: 1,
            level: Patch::NO_LEVEL,
        };
        let turn = Turn::new(&self.footprint, self.linearization()).expect("its LiDAR");
        turn.datum(&patch).expect("on the lattice")
    }
}

/// Every beam of every scene that meets the plane.
fn beams() -> Vec<(Scene, f64, f64)> {
    let all = SLOPES.into_iter().flat_map(|slope| ANGLES_RAD.map(|angle| (slope, angle)));
    let met: Vec<_> = all
        .filter_map(|(slope, angle_rad)| {
            let scene = Scene::new(slope);
            let range_m = scene.range_m(angle_rad)?;
            let zero = Vector6::zeros();
            let place = scene.hit((angle_rad, range_m), &zero, &zero);
            (place.xy().amax() < 19.0).then_some((scene, angle_rad, range_m))
        })
        .collect();
    assert!(met.len() >= 10, "{}", met.len());
    met
}

#[test]
fn derivatives_match_moved_hits() {
    const STEP: f64 = 1e-5;
    let zero = Vector6::zeros();
    for (scene, angle_rad, range_m) in beams() {
        let datum = scene.datum(angle_rad, range_m);
        let central = |hit: &dyn Fn(f64) -> Vector3<f64>| {
            (scene.above_m(&hit(STEP)) - scene.above_m(&hit(-STEP))) / (2.0 * STEP)
        };
        let near = |a: f64, b: f64| (a - b).abs() < 1e-4 * (1.0 + b.abs());
        for k in 0..6 {
            let unit = |step: f64| Vector6::from_fn(|row, _| if row == k { step } else { 0.0 });
            let by_pose = central(&|s| scene.hit((angle_rad, range_m), &unit(s), &zero));
            assert!(near(datum.by_pose[k], by_pose), "pose {k}: {} {by_pose}", datum.by_pose[k]);
            let by_mount = central(&|s| scene.hit((angle_rad, range_m), &zero, &unit(s)));
            assert!(near(datum.by_mount[k], by_mount), "mounting {k}");
        }
        let by_range = central(&|s| scene.hit((angle_rad, range_m + s), &zero, &zero));
        assert!(near(datum.by_range, by_range));
        let by_angle = central(&|s| scene.hit((angle_rad + s, range_m), &zero, &zero));
        let lidar = &scene.lidars[0];
        let sensor_var_m2 =
            (by_range * lidar.range_sigma_m).powi(2) + (by_angle * lidar.angle_sigma_rad).powi(2);
        assert!(near(datum.sensor_var_m2, sensor_var_m2));
    }
}

/// The mean over many beams whose direction is wrong: what is reported must lie on the plane.
#[test]
fn sinking_matches_beams_cast_on_a_plane() {
    let seed = 11;
    println!("seed {seed}");
    let mut noise = SeedBook::new(seed).stream("directions");
    let zero = Vector6::zeros();
    for (scene, angle_rad, range_m) in beams() {
        let sigma_rad = scene.lidars[0].angle_sigma_rad;
        let datum = scene.datum(angle_rad, range_m);
        let hit = scene.hit((angle_rad, range_m), &zero, &zero);
        let put_back_m = datum.height_m - hit.z;
        // Both signs of each error: what is of first order cancels exactly.
        let (mut sum_m, mut n) = (0.0, 0.0);
        for _ in 0..20_000 {
            let off_rad = sigma_rad * noise.normal();
            for off_rad in [off_rad, -off_rad] {
                let measured_m = scene.range_m(angle_rad + off_rad).expect("meets the plane");
                sum_m += scene.above_m(&scene.hit((angle_rad, measured_m), &zero, &zero));
                n += 1.0;
            }
        }
        let sunk_m: f64 = -sum_m / n;
        // Single precision of the patch, and the scatter of a mean of 20,000 squares.
        let tolerance_m = 2e-6 + 0.05 * sunk_m.abs();
        assert!(sunk_m > 0.0 && (put_back_m - sunk_m).abs() < tolerance_m, "{put_back_m} {sunk_m}");
    }
}
