use super::*;
use crate::world::{GridScale, HeightField, Region};
use stockpilot::stats::{Noise, SeedBook};

/// True if a point is in the free air of the hall.
fn is_free(world: &World, p: &Vector3<f64>) -> bool {
    world.hall.depth_m(p) > 0.0 && p.z > world.height_at(p.x, p.y)
}

/// Length of a beam by walking along it in steps of 1 mm.
fn marched_m(world: &World, origin: &Point<Hall>, direction: &Direction<Hall>) -> f64 {
    let mut n_steps = 0.0;
    while is_free(world, &(origin.coords + direction.coords * (n_steps * 1e-3))) {
        n_steps += 1.0;
    }
    n_steps * 1e-3
}

fn random_ray(world: &World, noise: &mut Noise) -> (Point<Hall>, Direction<Hall>) {
    loop {
        let (low, high) = (world.hall.min_m, world.hall.max_m);
        let along = |axis: usize, noise: &mut Noise| noise.between(low[axis], high[axis]);
        let origin = Vector3::new(along(0, noise), along(1, noise), along(2, noise));
        if is_free(world, &origin) {
            let direction = Direction::from_coords(noise.normal3().normalize());
            return (Point::from_coords(origin), direction);
        }
    }
}

#[test]
fn cast_meets_marching_in_steps_of_a_millimetre() {
    let mut noise = SeedBook::new(11).stream("rays");
    let halls = [
        World::alps(0).unwrap(),
        World::piles(4).unwrap(),
        World::columns(0, 1.0).unwrap(),
        World::l_hall(1, 1.0).unwrap(),
    ];
    for world in halls {
        for _ in 0..700 {
            let (origin, direction) = random_ray(&world, &mut noise);
            let marched = marched_m(&world, &origin, &direction);
            let hit = cast(&world, &origin, &direction, 100.0).unwrap();
            // Marching overshoots by up to one step, and may step through a crest that is
            // thinner than a step: then it goes on, never short.
            let late_m = marched - hit.distance_m;
            let inside = origin.coords + direction.coords * (hit.distance_m + 2e-6);
            let is_crest = late_m > 1.1e-3 && !is_free(&world, &inside);
            assert!(
                (-1e-6..1.1e-3).contains(&late_m) || is_crest,
                "{origin:?} {direction:?} {late_m}"
            );
        }
    }
}

#[test]
fn steep_plane_is_hit_where_algebra_says() {
    let region = Region::new(0.0, 0.0, 10.0, 10.0);
    let terrain = HeightField::from_fn(&region, 0.1, |x, _| 0.4 * x).unwrap();
    let world = World::assemble("plane", terrain, Vec::new(), SeedBook::new(0));
    let down_ahead = Vector3::new(0.6, 0.0, -0.8);
    let hit = cast(&world, &Point::new(1.0, 3.33, 6.0), &Direction::from_coords(down_ahead), 50.0);
    // 6 − 0.8 s = 0.4 (1 + 0.6 s)  ⇒  s = 5.6 / 1.04
    let hit = hit.unwrap();
    assert!((hit.distance_m - 5.6 / 1.04).abs() < 1e-9);
    let normal = Vector3::new(-0.4, 0.0, 1.0).normalize();
    assert!((hit.normal.coords - normal).norm() < 1e-9);
    assert_eq!(hit.surface, Surface::Material);
}

#[test]
fn beams_end_at_cliffs_walls_floor_and_ceiling() {
    let region = Region::new(0.0, 0.0, 10.0, 10.0);
    let terrain = HeightField::from_fn(&region, 0.1, |_, _| 1.0).unwrap();
    let wall = Cuboid::over(&Region::new(4.0, 2.0, 4.3, 6.0), 0.0, 2.0);
    let world = World::assemble("box", terrain, vec![wall], SeedBook::new(0));
    let ends = |origin: (f64, f64, f64), direction: (f64, f64, f64)| {
        let origin = Point::new(origin.0, origin.1, origin.2);
        let direction = Direction::new(direction.0, direction.1, direction.2);
        let hit = cast(&world, &origin, &direction, 30.0).unwrap();
        (hit.surface, hit.distance_m, hit.normal.coords)
    };
    let is = |end: (Surface, f64, Vector3<f64>), surface, distance_m: f64, normal: Vector3<f64>| {
        end.0 == surface && (end.1 - distance_m).abs() < 1e-9 && (end.2 - normal).norm() < 1e-9
    };
    let (x, z) = (Vector3::x(), Vector3::z());
    assert!(is(ends((-1.5, 5.0, 0.5), (1.0, 0.0, 0.0)), Surface::Material, 1.5, -x), "cliff");
    assert!(is(ends((1.0, 5.0, 1.5), (1.0, 0.0, 0.0)), Surface::InsideWall, 3.0, -x), "wall");
    assert!(is(ends((4.1, 5.0, 7.0), (0.0, 0.0, -1.0)), Surface::InsideWall, 5.0, z), "wall top");
    assert!(is(ends((5.0, 5.0, 7.0), (0.0, 0.0, -1.0)), Surface::Material, 6.0, z), "material");
    assert!(is(ends((5.0, 5.0, 7.0), (0.0, 0.0, 1.0)), Surface::Hall, 3.0, -z), "ceiling");
    assert!(is(ends((-1.0, 5.0, 7.0), (0.0, 0.0, -1.0)), Surface::Hall, 7.0, z), "floor");
    assert!(is(ends((5.0, 5.0, 7.0), (-1.0, 0.0, 0.0)), Surface::Hall, 7.0, x), "hall wall");
}

#[test]
fn nothing_is_hit_beyond_the_range_or_from_outside() {
    let world = World::alps(0).unwrap();
    let up = Direction::new(0.0, 0.0, 1.0);
    assert!(cast(&world, &Point::new(5.0, 5.0, 6.0), &up, 3.9).is_none());
    assert!(cast(&world, &Point::new(5.0, 5.0, 6.0), &up, 4.1).is_some());
    assert!(cast(&world, &Point::new(50.0, 5.0, 6.0), &up, 100.0).is_none());
}

#[test]
fn flat_patches_and_nodes_are_hit_from_straight_above() {
    let text = "ncols 3\nnrows 3\nxll 0\nyll 0\ncellsize 1\n0 0 0\n0 2 0\n0 0 0\n";
    let world = World::from_esri_ascii("tent", text, GridScale { xy: 1.0, z: 1.0 }).unwrap();
    let down = Direction::new(0.0, 0.0, -1.0);
    for (x, y, height) in [(1.0, 1.0, 2.0), (0.5, 0.5, 0.5), (0.0, 0.0, 0.0), (1.0, 1.5, 1.0)] {
        let hit = cast(&world, &Point::new(x, y, 9.0), &down, 20.0).unwrap();
        assert!((hit.distance_m - (9.0 - height)).abs() < 1e-9, "{x} {y}");
    }
}

#[test]
fn beams_through_openings_see_the_ground_outside_or_nothing() {
    let world = World::alps(1).unwrap().with_gaps(SeedBook::new(5));
    let [gate, skylight] = world.openings[..] else { panic!("two openings") };
    let aimed_at = |origin: Vector3<f64>, target: Vector3<f64>| {
        let direction = Direction::from_coords((target - origin).normalize());
        (cast(&world, &Point::from_coords(origin), &direction, 100.0), direction)
    };
    let (gate_x, _) = gate.footprint().centre_m();
    // From 1 m inside at 2 m height through the gate at 1 m: 1 m down per 1 m on, so the ground
    // 3.5 m lower comes after 3.5 m of way along y.
    let inside = Vector3::new(gate_x, world.hall.min_m.y + 1.0, 2.0);
    let (hit, _) = aimed_at(inside, Vector3::new(gate_x, world.hall.min_m.y, 1.0));
    let hit = hit.unwrap();
    assert_eq!(hit.surface, Surface::Outside);
    assert!((hit.distance_m - 3.5 * 2.0_f64.sqrt()).abs() < 1e-9, "{hit:?}");
    // Upwards through the gate, and straight up through the skylight, there is only sky.
    assert!(aimed_at(inside, Vector3::new(gate_x, world.hall.min_m.y, 3.0)).0.is_none());
    let (x, y) = skylight.footprint().centre_m();
    let below = Vector3::new(x, y, 6.0);
    assert!(aimed_at(below, below + Vector3::z()).0.is_none());
    // Beside the openings nothing has changed.
    let beside = Vector3::new(gate.min_m.x - 0.1, world.hall.min_m.y, 1.0);
    assert_eq!(aimed_at(inside, beside).0.unwrap().surface, Surface::Hall);
    // Markers hang on walls, not in openings.
    assert!(world.tags.len() < World::alps(1).unwrap().tags.len());
    for tag in &world.tags {
        assert!(tag.corners.iter().all(|c| gate.distance_m(&c.coords) > 0.0));
    }
}

#[test]
fn a_guest_hides_what_lies_behind_it() {
    let mut world = World::alps(1).unwrap();
    let origin = Point::new(10.0, 10.0, 8.0);
    let down = Direction::new(0.0, 0.0, -1.0);
    let free = cast(&world, &origin, &down, 20.0).unwrap();
    assert_eq!(free.surface, Surface::Material);
    world.guests = vec![Cuboid::over(&Region::new(9.0, 9.0, 11.0, 11.0), 0.0, 5.0)];
    let hit = cast(&world, &origin, &down, 20.0).unwrap();
    assert_eq!(hit.surface, Surface::Guest);
    assert!((hit.distance_m - 3.0).abs() < 1e-12 && hit.distance_m < free.distance_m);
}
