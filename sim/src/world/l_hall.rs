//! A hall with the shape of an L: rooms for people fill the corner of high x and y.
//!
//! ```text
//!   y ▲ ┌────────┬───────┐
//!     │ │        │ block │
//!     │ │        └───────┤
//!     │ │                │
//!     │ └────────────────┘▶ x
//! ```

use super::{Cuboid, Region};
use stockpilot::stats::SeedBook;

/// The block begins between these shares of the hall's length and width.
const BEGINS_AT: (f64, f64) = (0.5, 0.62);

/// The block, from the floor to the ceiling and to the walls.
pub(super) fn block(seeds: SeedBook, hall: &Cuboid) -> Cuboid {
    let mut noise = seeds.stream("world.l-hall");
    let [x_m, y_m] = [0, 1].map(|axis| {
        let extent_m = hall.max_m[axis] - hall.min_m[axis];
        hall.min_m[axis] + extent_m * noise.between(BEGINS_AT.0, BEGINS_AT.1)
    });
    let footprint = Region::new(x_m, y_m, hall.max_m.x, hall.max_m.y);
    Cuboid::over(&footprint, hall.min_m.z, hall.max_m.z)
}

/// The inner faces of the hall around the block, x and y, counter-clockwise, m.
pub(super) fn outline(hall: &Cuboid, block: &Cuboid) -> Vec<[f64; 2]> {
    let (low, high, corner) = (hall.min_m, hall.max_m, block.min_m);
    vec![
        [low.x, low.y],
        [high.x, low.y],
        [high.x, corner.y],
        [corner.x, corner.y],
        [corner.x, high.y],
        [low.x, high.y],
    ]
}

#[cfg(test)]
mod tests {
    use super::super::World;
    use super::super::bay::signed_area_m2;
    use stockpilot::geometry::Point;

    #[test]
    fn nothing_is_left_of_the_corner_but_the_block() {
        for seed in 0..20 {
            let world = World::l_hall(seed, 1.0).unwrap();
            let [block] = world.walls_inside[..] else { panic!("one block") };
            let foot = block.footprint();
            let hall = world.hall.footprint();
            // The outline is the hall without the block, counter-clockwise.
            let area_m2 = signed_area_m2(&world.outline_m);
            assert!((area_m2 - (hall.area_m2() - foot.area_m2())).abs() < 1e-9);
            assert!((0.14..0.26).contains(&(foot.area_m2() / hall.area_m2())), "seed {seed}");
            // Markers hang on what is left of the walls and on the block's faces, before them.
            let mut n_on_block = 0;
            for tag in &world.tags {
                let middle = tag.centre();
                let ahead = Point::from_coords(middle.coords + 0.1 * tag.normal.coords);
                assert!(world.clearance_m(&ahead, 1.0) > 0.09, "seed {seed}, tag {}", tag.id);
                n_on_block += usize::from(block.distance_m(&middle.coords) < 1e-9);
            }
            assert!(n_on_block > 20, "{n_on_block}");
            let ids: std::collections::BTreeSet<u32> = world.tags.iter().map(|t| t.id).collect();
            assert!(ids.len() == world.tags.len() && ids.iter().all(|id| *id < 587));
        }
    }
}
