//! Silent rays over a level plain with a hole in what is known of it.

use super::*;
use crate::geometry::{Body, Lidar, Rotation, Transform};
use crate::mapping::matern_field::Lattice;
use crate::mapping::projection::LidarMount;
use crate::messages::{GridGeometry, PoseError};
use crate::time::Stamp;
use nalgebra::SMatrix;

const PLAIN_M: f64 = 1.0;
/// West of this the plain is known, m.
const KNOWN_TO_X_M: f64 = 6.0;

struct Plain {
    lattice: Lattice,
    heights_m: Vec<f64>,
    is_known: Vec<bool>,
    lidars: Vec<LidarMount>,
}

impl Plain {
    /// 20 m × 6 m.
    fn new() -> Self {
        let grid =
            GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 80, n_rows: 24 };
        let lattice = Lattice::covering(&grid, 0.5, |_, _| false);
        let is_known =
            (0..lattice.n_nodes()).map(|node| lattice.place_m(node).0 < KNOWN_TO_X_M).collect();
        let lidar = LidarMount {
            body_from_lidar: Transform::<Body, Lidar>::new(Rotation::identity(), Point::origin()),
            range_sigma_m: 0.01,
            angle_sigma_rad: 0.001,
            min_range_m: 0.1,
            max_range_m: 12.0,
            blind_sectors_rad: Vec::new(),
        };
        let heights_m = vec![PLAIN_M; lattice.n_nodes()];
        Self { lattice, heights_m, is_known, lidars: vec![lidar] }
    }

    fn linearization(&self) -> Linearization<'_> {
        Linearization {
            lattice: &self.lattice,
            heights_m: Some(&self.heights_m),
            is_known: &self.is_known,
            n_patches: &[],
            lidars: &self.lidars,
            roughness_m: 0.01,
            scatter_m: 0.0,
            slope_sigma: 0.6,
            occlusion_share: 0.0,
        }
    }

    /// 0 m everywhere.
    fn floor(&self) -> Floor {
        Floor { of_cells_m: vec![0.0; self.lattice.grid().n_cells()], elsewhere_m: 0.0 }
    }

    /// The ends of the free rays of these turns, m.
    fn free_ends(&self, turns: &[Arc<Footprint>]) -> Vec<Vector3<f64>> {
        free_rays(turns, &self.linearization(), &self.floor())
            .into_iter()
            .flat_map(|free| free.to_m)
            .collect()
    }
}

/// A turn from (2, 3, 5): echoes at these ranges in x, y and z, beams by hundreds; silent rays to these
/// points.
#[expect(clippy::cast_possible_truncation, reason = "single precision on purpose")]
fn turn(hits_m: &[[f64; 3]], silent_to_m: &[[f64; 3]]) -> Arc<Footprint> {
    let single = |p: &[f64; 3]| p.map(|c| c as f32);
    let patch = |hit: &[f64; 3]| Patch {
        place_m: single(hit),
        arm_m: [0.0; 3],
        n_beams: 100,
        level: Patch::NO_LEVEL,
    };
    Arc::new(Footprint {
        error: PoseError {
            at: Stamp::ZERO,
            cov: SMatrix::identity() * 1e-5,
            from_previous: SMatrix::zeros(),
            velocity_mps: Vector3::zeros(),
            rate_radps: Vector3::zeros(),
            tags: Vec::new(),
        },
        hall_from_body: Transform::new(Rotation::identity(), Point::new(2.0, 3.0, 5.0)),
        lidar_idx: 0,
        patches: hits_m.iter().map(patch).collect(),
        passed_to_m: Vec::new(),
        silent: silent_to_m.iter().map(|to| SilentRay { to_m: single(to), n_beams: 10 }).collect(),
    })
}

/// Ground answers from everywhere under the LiDAR to 9 m away from it: 4,760 beams in each half metre.
fn answers() -> Arc<Footprint> {
    let hits: Vec<[f64; 3]> = (0..475)
        .map(|k| (4.0 + 0.0105 * f64::from(k)).powi(2))
        .map(|squared_m2| (squared_m2 - 16.0).sqrt())
        .map(|aside_m| [2.0 + aside_m, 3.0, PLAIN_M])
        .collect();
    turn(&hits, &[])
}

#[test]
fn only_runs_of_silent_beams_count() {
    let silent = [2, 5, 6, 7, 8, 9, 10, 13, 14, 15, 16];
    let beam = |k: u16| Beam {
        offset_ns: u32::from(k),
        angle_rad: 0.01 * f32::from(k),
        range_m: if silent.contains(&k) { 0.0 } else { 4.0 },
        intensity: 9,
    };
    let scan =
        |beams: std::ops::Range<u16>| Scan { start: Stamp::ZERO, beams: beams.map(beam).collect() };
    let found =
        |scan: &Scan| -> Vec<u32> { silent_beams(scan).map(|beam| beam.offset_ns).collect() };
    assert_eq!(found(&scan(0..18)), [7, 8]);
    assert!(found(&scan(6..10)).is_empty(), "a part of a turn with fewer than a run");
}

#[test]
fn rays_that_would_have_met_known_ground_are_lost() {
    let plain = Plain::new();
    // 12 m long: one that meets the plain at x = 5.6, where it is known; one that meets it where it is
    // not, and the floor 7.5 m away; one that meets the floor beyond the reach; one over everything.
    let along = |down: f64| {
        let length = down.hypot(1.0);
        [2.0 + 12.0 / length, 3.0, 5.0 - 12.0 * down / length]
    };
    let ray_to_x = |x_m: f64| along(4.0 / (x_m - 2.0));
    let reach = answers();
    let ends = |to_m: [f64; 3]| plain.free_ends(&[Arc::clone(&reach), turn(&[], &[to_m])]);
    assert!(ends(ray_to_x(5.6)).is_empty());
    assert!(ends(along(0.9)).is_empty());
    for to_m in [ray_to_x(8.5), along(0.3)] {
        let [end] = ends(to_m)[..] else { panic!("one free ray to {to_m:?}") };
        let (whole, free) = (Vector3::from(to_m), end);
        let from = Vector3::new(2.0, 3.0, 5.0);
        // 8.98 m is the farthest echo; the reach ends at its step of 0.1 m.
        assert!(((free - from).norm() - 8.9).abs() < 1e-6, "{free:?}");
        assert!((free - from).cross(&(whole - from)).norm() < 1e-5);
    }
    // Before there is a surface nothing can be judged.
    let before = Linearization { heights_m: None, ..plain.linearization() };
    assert!(free_rays(&[reach, turn(&[], &[along(0.3)])], &before, &plain.floor()).is_empty());
}

#[test]
fn rays_that_graze_known_ground_say_nothing() {
    // The ray falls by 0.3; a ridge of two nodes across it stands at x = 5, where the ray is at 4.1 m.
    let to_m = [2.0 + 12.0 / 0.3_f64.hypot(1.0), 3.0, 5.0 - 3.6 / 0.3_f64.hypot(1.0)];
    let ends = |ridge_m: f64, n_silent: usize| {
        let mut plain = Plain::new();
        for node in 0..plain.lattice.n_nodes() {
            if (plain.lattice.place_m(node).0 - 5.0).abs() < 0.2 {
                plain.heights_m[node] = ridge_m;
            }
        }
        let rays = vec![to_m; n_silent];
        let over_all = [2.0, 14.9, 5.0];
        plain.free_ends(&[answers(), turn(&[], &rays), turn(&[], &[over_all])])
    };
    let reach_m = |ends: &[Vector3<f64>]| ends.last().map(|end| end.y - 3.0).expect("a free ray");
    // Over it, within a hand's breadth below it, well below it: 3 m away, where nothing answers.
    assert_eq!(ends(4.0, 1).len(), 2);
    let grazing = ends(4.14, 30);
    assert!(grazing.len() == 1 && (reach_m(&grazing) - 8.9).abs() < 1e-6, "{grazing:?}");
    let lost = ends(4.4, 30);
    // The ridge is met 2.97 m away, by rays that are followed in steps of a quarter of a metre.
    assert!((2.49..3.01).contains(&reach_m(&lost)), "{lost:?}");
}

#[test]
fn what_is_beside_the_region_tells_nothing_of_the_reach() {
    let plain = Plain::new();
    let far = [13.5, 3.0, 3.0];
    let reach_m = |silent: Vec<[f64; 3]>| {
        let ends = plain.free_ends(&[answers(), turn(&[], &[far]), turn(&[], &silent)]);
        (ends.first().expect("the far one") - Vector3::new(2.0, 3.0, 5.0)).norm()
    };
    // Down to the floor beside the region; straight down to the plain, 4 m away.
    assert!((reach_m(vec![[-6.0, 3.0, -5.0]; 30]) - 8.9).abs() < 1e-6);
    assert!((reach_m(vec![[2.0, 3.0, -7.0]; 30]) - 8.9).abs() > 1.0);
}

#[test]
fn every_cell_has_its_own_floor() {
    let plain = Plain::new();
    // To x = 7.5, where nothing is known: 0.2 m under a floor at 0.
    let to_m = [7.5, 3.0, -0.2];
    let is_free = |pit_m: f64| {
        let mut floor = plain.floor();
        for (cell, of_cell_m) in floor.of_cells_m.iter_mut().enumerate() {
            let is_pit = plain.lattice.grid().centre_m(cell).0 > 6.0;
            *of_cell_m = if is_pit { pit_m } else { 0.0 };
        }
        let turns = [answers(), turn(&[], &[to_m])];
        !free_rays(&turns, &plain.linearization(), &floor).is_empty()
    };
    assert!(is_free(-2.0) && !is_free(0.0));
}

#[test]
fn ground_that_stays_silent_shortens_the_reach() {
    let plain = Plain::new();
    let far = [13.5, 3.0, 3.0];
    let meets = |x_m: f64| {
        let direction = (Vector3::new(x_m, 3.0, PLAIN_M) - Vector3::new(2.0, 3.0, 5.0)).normalize();
        let end = Vector3::new(2.0, 3.0, 5.0) + 12.0 * direction;
        [end.x, end.y, end.z]
    };
    let length_m = |turns: &[Arc<Footprint>]| {
        let ends = plain.free_ends(turns);
        ends.iter().map(|end| (end - Vector3::new(2.0, 3.0, 5.0)).norm()).fold(0.0, f64::max)
    };
    let seen = answers();
    assert!((length_m(&[Arc::clone(&seen), turn(&[], &[far])]) - 8.9).abs() < 1e-6);
    // Rays to x = 5.6 meet the plain 5.38 m away; 4,760 beams answer between 5 and 5.5 m: three of a
    // hundred and 20 more are 167 lost ones, in rays of 10.
    for (n_lost, reach_m) in [(16, 8.9), (17, 5.0)] {
        let mut silent = vec![far];
        silent.extend((0..n_lost).map(|_| meets(5.6)));
        let reach = length_m(&[Arc::clone(&seen), turn(&[], &silent)]);
        assert!((reach - reach_m).abs() < 1e-6, "{n_lost}: {reach} m");
    }
}
