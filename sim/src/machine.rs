//! A wheel loader that drives to and fro through the hall while it is measured.

use crate::world::{Cuboid, Region, World};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

/// Length, width and height of its body, and of the cab at its rear, m.
const BODY_M: [f64; 3] = [5.0, 2.5, 1.6];
const CAB_M: [f64; 3] = [1.8, 2.0, 3.0];

/// A machine of two boxes on the floor, along the x axis of the hall.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// Its middle line, y, m.
    lane_m: f64,
    /// The middle of its body lies between these x, m.
    between_m: (f64, f64),
    speed_mps: f64,
    /// Way from the low end at time zero, to and fro, m.
    start_m: f64,
}

impl Machine {
    /// A machine with a drawn lane, speed and starting place in this hall.
    ///
    /// Before bays it keeps to the mouths of the bays, else to the middle of the region; where heaps
    /// stand on its lane, it drives through them.
    #[must_use]
    pub fn drawn(world: &World, seeds: SeedBook) -> Self {
        let mut noise = seeds.stream("machine");
        let region = &world.region;
        let lane = noise.uniform();
        let lane_m = world.walls_bounds.map_or_else(
            || region.y_min_m + region.width_m() * (0.35 + 0.3 * lane),
            |walls| walls.min_m.y - 0.5 * BODY_M[1] - 0.05 - 0.7 * lane,
        );
        let low_m = world.hall.min_m.x + 0.5 * BODY_M[0];
        let high_m = world.hall.max_m.x - 0.5 * BODY_M[0];
        let start_m = noise.between(0.0, 2.0 * (high_m - low_m));
        let speed_mps = noise.between(0.8, 2.0);
        Self { lane_m, between_m: (low_m, high_m), speed_mps, start_m }
    }

    /// Where it stands now.
    #[must_use]
    pub fn solids_at(&self, now: Stamp<Mono>) -> [Cuboid; 2] {
        let (low_m, high_m) = self.between_m;
        let way_m = high_m - low_m;
        let driven_m = (self.start_m + self.speed_mps * now.seconds()).rem_euclid(2.0 * way_m);
        let is_returning = driven_m > way_m;
        let x_m = low_m + if is_returning { 2.0 * way_m - driven_m } else { driven_m };
        let rear = if is_returning { 1.0 } else { -1.0 };
        let cab_x_m = x_m + rear * 0.5 * (BODY_M[0] - CAB_M[0]);
        [self.solid(x_m, BODY_M), self.solid(cab_x_m, CAB_M)]
    }

    fn solid(&self, x_m: f64, [length_m, width_m, height_m]: [f64; 3]) -> Cuboid {
        let (half_m, side_m) = (0.5 * length_m, 0.5 * width_m);
        let footprint =
            Region::new(x_m - half_m, self.lane_m - side_m, x_m + half_m, self.lane_m + side_m);
        Cuboid::over(&footprint, 0.0, height_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn it_drives_through_the_region_and_stays_in_the_hall() {
        for world in [World::alps(2).unwrap(), World::piles(2).unwrap()] {
            for seed in 0..5 {
                let machine = Machine::drawn(&world, SeedBook::new(seed));
                let mut middles_m = Vec::new();
                for step in 0..2000_u64 {
                    let now = Stamp::ZERO.plus(Duration::from_millis(50 * step));
                    let solids = machine.solids_at(now);
                    for solid in &solids {
                        assert!(world.hall.depth_m(&solid.min_m) > -1e-9);
                        assert!(world.hall.depth_m(&solid.max_m) > -1e-9);
                        assert!(solid.max_m.z < 4.0, "below the flight");
                        let touches =
                            |wall: &Cuboid| wall.footprint().overlap(&solid.footprint()).is_some();
                        assert!(!world.walls_inside.iter().any(touches));
                    }
                    middles_m.push(solids[0].footprint().centre_m().0);
                }
                // 2 m/s is the fastest; 100 s at 0.8 m/s and more reach both ends.
                assert!(middles_m.windows(2).all(|p| (p[0] - p[1]).abs() < 0.11));
                let low_m = middles_m.iter().copied().fold(f64::INFINITY, f64::min);
                let high_m = middles_m.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                assert!(low_m < world.region.x_min_m + 2.0 && high_m > world.region.x_max_m - 2.0);
            }
        }
    }

    #[test]
    fn beams_hit_it_and_its_volume_is_no_material() {
        use crate::raycast::{Surface, cast};
        use stockpilot::geometry::{Direction, Point};
        let mut world = World::piles(2).unwrap();
        let volume_m3 = world.volume_m3();
        let machine = Machine::drawn(&world, SeedBook::new(1));
        world.guests = machine.solids_at(Stamp::ZERO).to_vec();
        let (x, y) = world.guests[1].footprint().centre_m();
        let down = Direction::new(0.0, 0.0, -1.0);
        let hit = cast(&world, &Point::new(x, y, 7.0), &down, 12.0).unwrap();
        assert_eq!(hit.surface, Surface::Guest);
        // The cab is 3 m high.
        assert!((hit.distance_m - 4.0).abs() < 1e-12);
        assert!((world.volume_m3() - volume_m3).abs() < 1e-12);
    }
}
