//! Heaps and bays in a hall whose roof stands on columns.

use super::{Cuboid, Region};
use stockpilot::stats::SeedBook;

/// Edges of a column, m.
const EDGE_M: (f64, f64) = (0.35, 0.6);
/// Middles of the columns before they are moved a little: in front of the bays and among the heaps,
/// where straight legs of a survey pass, m.
const PLACES_M: [(f64, f64); 6] =
    [(4.5, 10.6), (10.0, 10.6), (15.5, 10.6), (5.8, 3.4), (10.4, 7.2), (15.2, 2.6)];
/// A column is moved by this at most, m.
const MOVED_M: f64 = 0.7;

/// The columns, from the floor to the ceiling; none touches a wall of the bays.
pub(super) fn columns(seeds: SeedBook, ceiling_m: f64) -> Vec<Cuboid> {
    let mut noise = seeds.stream("world.columns");
    PLACES_M
        .iter()
        .map(|(x_m, y_m)| {
            let half_m = 0.5 * noise.between(EDGE_M.0, EDGE_M.1);
            let x_m = x_m + noise.between(-MOVED_M, MOVED_M);
            let y_m = y_m + noise.between(-MOVED_M, MOVED_M);
            let footprint = Region::new(x_m - half_m, y_m - half_m, x_m + half_m, y_m + half_m);
            Cuboid::over(&footprint, 0.0, ceiling_m)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::World;
    use crate::raycast::{Surface, cast};
    use nalgebra::Vector3;
    use stockpilot::geometry::{Direction, Point};

    #[test]
    fn columns_stand_free_and_end_beams_and_material() {
        for seed in 0..20 {
            let world = World::columns(seed, 1.0).unwrap();
            let piles = World::piles(seed).unwrap();
            assert_eq!((world.obstacles.len(), world.name.as_str()), (6, "columns"));
            for (i, column) in world.obstacles.iter().enumerate() {
                let foot = column.footprint();
                let others = world.obstacles[..i].iter().chain(&world.walls_inside);
                let apart = others.clone().all(|other| other.footprint().overlap(&foot).is_none());
                assert!(apart && world.region.overlap(&foot) == Some(foot), "seed {seed}");
                // From 1 m before its middle, straight at it.
                let (x, y) = foot.centre_m();
                let from = Point::new(x - 1.0, y, 7.0);
                let hit = cast(&world, &from, &Direction::new(1.0, 0.0, 0.0), 30.0).unwrap();
                assert_eq!(hit.surface, Surface::Obstacle);
                assert!((hit.distance_m - (1.0 - 0.5 * foot.length_m())).abs() < 1e-9);
                assert!(world.clearance_m(&from, 3.0) <= hit.distance_m + 1e-12);
                assert!((world.height_at(x, y) - world.hall.max_m.z).abs() < 1e-12);
            }
            // What a column stands on is no material: at most 4 m over 0.6 m × 0.6 m each.
            let lost_m3 = piles.volume_m3() - world.volume_m3();
            let by_sum: f64 = world
                .obstacles
                .iter()
                .map(|column| piles.true_volume_m3(&column.footprint()))
                .sum();
            assert!((lost_m3 - by_sum).abs() < 0.01 && (0.0..8.7).contains(&lost_m3), "{lost_m3}");
        }
    }

    #[test]
    fn a_column_hides_a_marker_behind_it() {
        let mut world = World::columns(3, 1.0).unwrap();
        let camera = crate::camera::CameraModel::ahead();
        let pose = stockpilot::geometry::Transform::new(
            stockpilot::geometry::Rotation::identity(),
            Point::new(4.0, 7.0, 7.0),
        );
        let seen = camera.view(&world, &pose);
        let n_before = seen.len();
        let hidden = seen[n_before / 2].tag.centre().coords;
        // A post half-way to the marker.
        let middle: Vector3<f64> = 0.5 * (pose.origin.coords + hidden);
        let half = Vector3::new(0.05, 0.05, 0.05);
        let post = super::Cuboid { min_m: middle - half, max_m: middle + half };
        world.obstacles = vec![post];
        let after = camera.view(&world, &pose);
        assert!(after.iter().all(|seen| (seen.tag.centre().coords - hidden).norm() > 1e-9));
    }
}
