//! Ceilings against a fine walk along every ray.

use super::*;
use crate::geometry::{Body, Lidar, Point, Rotation, Transform};
use crate::mapping::footprint::Patch;
use crate::messages::{GridGeometry, PoseError};
use crate::stats::SeedBook;
use crate::time::Stamp;
use nalgebra::SMatrix;

fn lattice() -> Lattice {
    let grid = GridGeometry { x_min_m: -2.0, y_min_m: 1.0, cell_m: 0.25, n_cols: 36, n_rows: 28 };
    Lattice::covering(&grid, 1.0, |_, _| false)
}

fn lidar() -> LidarMount {
    let origin = Point::<Body>::new(0.1, -0.05, -0.2);
    LidarMount {
        body_from_lidar: Transform::<Body, Lidar>::new(Rotation::identity(), origin),
        range_sigma_m: 0.01,
        angle_sigma_rad: 0.001,
        min_range_m: 0.1,
        max_range_m: 20.0,
        blind_sectors_rad: Vec::new(),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "single precision on purpose")]
fn turn(from: &Transform<crate::geometry::Hall, Body>, hits: &[Vector3<f64>]) -> Footprint {
    let patch = |hit: &Vector3<f64>| Patch {
        place_m: [hit.x as f32, hit.y as f32, hit.z as f32],
        arm_m: [0.0; 3],
        n_beams: 1,
        level: Patch::NO_LEVEL,
    };
    Footprint {
        error: PoseError {
            at: Stamp::ZERO,
            cov: SMatrix::identity() * 1e-5,
            from_previous: SMatrix::zeros(),
            velocity_mps: Vector3::zeros(),
            rate_radps: Vector3::zeros(),
            tags: Vec::new(),
        },
        hall_from_body: *from,
        lidar_idx: 0,
        patches: hits.iter().map(patch).collect(),
        passed_to_m: Vec::new(),
        silent: Vec::new(),
    }
}

fn pose(x: f64, y: f64, z: f64, yaw: f64) -> Transform<crate::geometry::Hall, Body> {
    Transform::new(Rotation::from_euler_rad(0.05, -0.08, yaw), Point::new(x, y, z))
}

#[test]
fn rays_match_a_walk_along_them() {
    let (lattice, lidar) = (lattice(), lidar());
    let mut noise = SeedBook::new(3).stream("rays");
    for _ in 0..200 {
        let from =
            pose(noise.between(-3.0, 8.0), noise.between(0.0, 9.0), 6.0, noise.between(-3.0, 3.0));
        let hit = Vector3::new(
            noise.between(-3.0, 8.0),
            noise.between(0.0, 9.0),
            noise.between(0.0, 3.0),
        );
        let mut ceiling = RayCeiling::new(lattice.n_nodes());
        for turn_idx in 0..2 {
            ceiling.take(&lattice, &lidar, turn_idx, &turn(&from, &[hit]));
        }
        let lidar_m = (from * lidar.body_from_lidar.origin).coords;
        let way = lidar_m - hit;
        let mut n_under = 0;
        for node in 0..lattice.n_nodes() {
            let Some(height_m) = ceiling.at_node_m(&lattice, node) else { continue };
            n_under += 1;
            let (x, y) = lattice.place_m(node);
            // The nearest of 4,000 points of the ray, looked at from above.
            let near = (0..=4_000)
                .map(|k| hit + way * (f64::from(k) / 4_000.0))
                .min_by(|a, b| {
                    let off = |p: &Vector3<f64>| (p.x - x).hypot(p.y - y);
                    off(a).total_cmp(&off(b))
                })
                .expect("some");
            let off_m = (near.x - x).hypot(near.y - y);
            // Half a cell beside the ray at most, measured along a line of the lattice.
            assert!(off_m <= 0.125 + 1e-3, "{off_m}");
            let descent = way.z / way.xy().norm();
            assert!((near.z - height_m).abs() <= descent * 0.125 + 1e-3, "{} {height_m}", near.z);
        }
        let run = way.x.abs().max(way.y.abs());
        if run < 0.25 {
            assert_eq!(n_under, 0);
        } else {
            // One node on each line, as far as the ray lies over the lattice.
            assert!(f64::from(n_under) <= run / 0.25 + 1.0);
        }
    }
}

#[test]
fn one_wrong_range_lowers_the_ceiling_by_half_a_metre_of_a_ray_at_most() {
    let (lattice, lidar) = (lattice(), lidar());
    let from = pose(0.0, 4.0, 6.0, 0.0);
    let good = Vector3::new(5.0, 4.0, 1.0);
    let wrong = Vector3::new(5.0, 4.0, -4.0);
    let mut ceiling = RayCeiling::new(lattice.n_nodes());
    // Several beams of the same turn are one witness.
    ceiling.take(&lattice, &lidar, 0, &turn(&from, &[good, good]));
    let lidar_m = (from * lidar.body_from_lidar.origin).coords;
    let column_m = lattice.place_m(lattice.nearest_node(3.0, 4.0)).0;
    let along = (column_m - lidar_m.x) / (good.x - lidar_m.x);
    let node = lattice.nearest_node(column_m, lidar_m.y + along * (good.y - lidar_m.y));
    assert_eq!(ceiling.at_node_m(&lattice, node), None);
    ceiling.take(&lattice, &lidar, 1, &turn(&from, &[wrong]));
    ceiling.take(&lattice, &lidar, 2, &turn(&from, &[good]));
    let height_m = ceiling.at_node_m(&lattice, node).expect("two turns looked over it");
    let of_good = lidar_m.z + along * (good.z - lidar_m.z);
    // By itself the wrong one is 1.6 m lower there.
    let descent = (lidar_m.z - good.z) / (lidar_m - good).xy().norm();
    let least_m = of_good - descent * (BESIDE_M + 0.125);
    assert!((least_m..=of_good + 0.02).contains(&height_m), "{height_m} {of_good}");
}

#[test]
fn a_ray_of_another_turn_within_half_a_metre_confirms() {
    let lattice = lattice();
    let at = |x_m: f64| lattice.nearest_node(x_m, 4.125);
    let ceilings = |rays: &[(f64, f32, u32)]| {
        let mut ceiling = RayCeiling::new(lattice.n_nodes());
        rays.iter().for_each(|&(x_m, height_m, turn)| ceiling.nodes[at(x_m)].take(height_m, turn));
        let of = |&(x_m, ..): &(f64, f32, u32)| ceiling.at_node_m(&lattice, at(x_m));
        rays.iter().map(of).collect::<Vec<_>>()
    };
    // The ground stays below the higher of both.
    assert_eq!(ceilings(&[(2.125, 1.0, 1), (2.625, 1.5, 2)]), [Some(1.5), Some(1.5)]);
    assert_eq!(ceilings(&[(2.125, 1.0, 1), (2.875, 1.5, 2)]), [None, None]);
    assert_eq!(ceilings(&[(2.125, 1.0, 1), (2.375, 1.5, 1)]), [None, None]);
    // The lowest ray beside is of the same turn, but another of its own is not.
    let of_both = [(2.125, 1.0, 1), (2.375, 0.5, 1), (2.375, 1.25, 2)];
    assert_eq!(ceilings(&of_both)[0], Some(1.25));
}

#[test]
fn nodes_half_a_metre_beside_rays_have_their_ceilings() {
    // A wall stands along x = 2 m.
    let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 16, n_rows: 12 };
    let lattice = Lattice::covering(&grid, 0.0, |a, b| (a.0 < 2.0) != (b.0 < 2.0));
    let mut ceiling = RayCeiling::new(lattice.n_nodes());
    let at = |col: u32, row: u32| {
        lattice.nearest_node(0.25 * (f64::from(col) + 0.5), 0.25 * (f64::from(row) + 0.5))
    };
    // Two lines of nodes under rays, 5 steps apart, one 1 m high, the other 2 m.
    for (row, height_m) in [(2, 1.0), (7, 2.0)] {
        for turn in 1..=2 {
            for col in 0..8 {
                ceiling.nodes[at(col, row)].take(height_m, turn);
            }
        }
    }
    let all = vec![true; lattice.n_nodes()];
    let none = vec![false; lattice.n_nodes()];
    let over = ceiling.over_hidden(&lattice, &all, &all);
    let under = |height_m| Some(Ceiling { height_m, steps: 0 });
    let beside = |height_m| Some(Ceiling { height_m, steps: 2 });
    let rows = [
        (0, beside(1.0)),
        (1, None),
        (2, under(1.0)),
        (3, None),
        (4, beside(1.0)),
        (5, beside(2.0)),
        (6, None),
        (7, under(2.0)),
        (9, beside(2.0)),
        (10, None),
    ];
    for (row, expected) in rows {
        (0..8).for_each(|col| assert_eq!(over[at(col, row)], expected, "{col} {row}"));
    }
    // Nothing is known behind the wall.
    assert!((8..16).all(|col| over[at(col, 2)].is_none()));
    // In the middle between two lines a node has their mean.
    for turn in 1..=2 {
        (0..8).for_each(|col| ceiling.nodes[at(col, 6)].take(4.0, turn));
    }
    let over = ceiling.over_hidden(&lattice, &all, &all);
    assert_eq!(over[at(4, 4)], beside(2.5));
    // What is not measured has ceilings only under rays.
    let outside = ceiling.over_hidden(&lattice, &all, &none);
    assert_eq!((outside[at(4, 4)], outside[at(4, 2)]), (None, under(1.0)));
    // The padding has none.
    for turn in 1..=2 {
        for node in (0..lattice.n_nodes()).filter(|node| !lattice.is_of_grid(*node)) {
            ceiling.nodes[node].take(0.5, turn);
        }
    }
    let with_padding = ceiling.over_hidden(&lattice, &all, &all);
    assert_eq!(with_padding, over);
    // Rays that end on ground that is seen say nothing of the ground beside.
    let mut is_hidden = all.clone();
    (0..8).for_each(|col| is_hidden[at(col, 2)] = false);
    let over = ceiling.over_hidden(&lattice, &is_hidden, &all);
    assert_eq!((over[at(4, 2)], over[at(4, 0)], over[at(4, 4)]), (None, None, beside(4.0)));
}
