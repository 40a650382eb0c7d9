use super::*;
use crate::localization::marker_map::MarkerMap;
use crate::mapping::solid::{Prism, Solid};
use crate::planning::Settings;
use crate::planning::free_space::tests::{marker_map, settings, space_of};

fn at(x: f64, y: f64, z: f64) -> Waypoint {
    Waypoint { place: Point::new(x, y, z), yaw_rad: 0.2 }
}

fn upright(centre: (f64, f64), size: (f64, f64), heights: (f64, f64)) -> Solid {
    let (low, high) = heights;
    let centre = Vector3::new(centre.0, centre.1, 0.5 * (low + high));
    let size = Vector3::new(size.0, size.1, high - low);
    Prism::turned_box(&centre, &size, 0.0).expect("a box").into()
}

/// One height of flight only, and two walls across the hall of 16 m × 12 m with gaps at their ends:
/// an S.
fn maze() -> Settings {
    let mut maze = settings();
    maze.space.ceiling_m = None;
    maze.space.highest_surface_m = Some(4.5);
    maze.space.obstacles = vec![
        upright((5.5, 5.0), (0.2, 10.0), (0.0, 9.0)),
        upright((10.5, 7.0), (0.2, 10.0), (0.0, 9.0)),
    ];
    maze
}

fn length_m(from: &Waypoint, way: &[Waypoint]) -> f64 {
    let mut all = vec![*from];
    all.extend(way);
    all.windows(2).map(|leg| leg[0].distance_m(&leg[1])).sum()
}

/// The shortest way over the same lattice by relaxing every leg until nothing changes.
fn relaxed_m(search: &Search<'_>) -> f64 {
    let n = search.n_nodes();
    let mut legs = Vec::new();
    for node in 0..n {
        for next in search.neighbours(node) {
            if next != node && search.is_leg_free(node, next) {
                legs.push((node, next, (search.place(next) - search.place(node)).norm()));
            }
        }
    }
    let mut length_m = vec![f64::INFINITY; n];
    length_m[END_FROM] = 0.0;
    loop {
        let mut is_done = true;
        for (from, to, leg_m) in &legs {
            if length_m[*from] + leg_m < length_m[*to] - 1e-12 {
                length_m[*to] = length_m[*from] + leg_m;
                is_done = false;
            }
        }
        if is_done {
            return length_m[END_TO];
        }
    }
}

#[test]
fn the_way_through_a_maze_is_the_shortest_and_free() {
    let mut coarse = maze();
    coarse.space.grid_m = 2.0;
    let space = space_of(&coarse, &MarkerMap::default());
    let (from, to) = (at(1.5, 1.0, 5.0), at(14.5, 11.0, 5.0));
    let search = Search::new(&space, &from, &to, Demand::Clear);
    let nodes = search.shortest().expect("a way");
    let by_lattice: f64 =
        nodes.windows(2).map(|leg| (search.place(leg[1]) - search.place(leg[0])).norm()).sum();
    assert!((by_lattice - relaxed_m(&search)).abs() < 1e-9, "{by_lattice}");
    // By hand: around the end of the first wall at (5.5, 10) and of the second at (10.5, 2), with
    // half a metre kept off: no shorter than the strings through the gaps, and little longer,
    // because corners stand on a lattice of 1 m.
    let way = way_within(&space, &from, &to, Demand::Clear).expect("a way");
    let string = |a: (f64, f64), b: (f64, f64)| (b.0 - a.0).hypot(b.1 - a.1);
    let least_m = string((1.5, 1.0), (5.5, 10.5))
        + string((5.5, 10.5), (10.5, 1.5))
        + string((10.5, 1.5), (14.5, 11.0));
    let ours_m = length_m(&from, &way);
    assert!(
        ours_m <= by_lattice + 1e-9 && (least_m..1.1 * least_m).contains(&ours_m),
        "{ours_m} {least_m}"
    );
    let mut before = from;
    for corner in &way {
        assert!(space.clearance().is_way_clear(&before.place.coords, &corner.place.coords));
        before = *corner;
    }
    assert_eq!(before.place, to.place);
}

#[test]
fn there_is_no_way_through_a_closed_wall_and_a_straight_one_needs_no_corner() {
    let mut shut = maze();
    shut.space.obstacles = vec![upright((5.5, 6.0), (0.2, 12.0), (0.0, 9.0))];
    let space = space_of(&shut, &MarkerMap::default());
    assert!(way_within(&space, &at(2.0, 2.0, 5.0), &at(9.0, 2.0, 5.0), Demand::Clear).is_none());
    let to = at(2.0, 9.0, 5.0);
    assert_eq!(way_within(&space, &at(2.0, 2.0, 5.0), &to, Demand::Clear), Some(vec![to]));
    // Nobody knows where he is here.
    assert!(way(&space, &at(2.0, 2.0, 5.0), &at(14.0, 2.0, 5.0)).is_none());
}

#[test]
fn a_beam_is_flown_under_or_over_and_a_pad_by_the_wall_is_left() {
    let mut hall = settings();
    // From wall to wall, its lower face at 5.5 m: 4.5 m are low enough.
    hall.space.obstacles = vec![upright((8.0, 6.0), (0.5, 12.0), (5.2, 7.0))];
    let space = space_of(&hall, &marker_map(|_| true));
    let (from, to) = (at(3.0, 6.0, 5.0), at(13.0, 6.0, 5.0));
    let way = way_within(&space, &from, &to, Demand::Clear).expect("a way");
    assert!(way.len() >= 2 && way.iter().any(|corner| corner.place.coords.z < 4.8), "{way:?}");
    // From the floor, 30 cm beside the wall, where neither height nor distance are allowed.
    let pad = at(0.3, 6.0, 0.2);
    let way = way_within(&space, &pad, &to, Demand::Clear).expect("a way");
    assert!(space.clearance().is_clear(&way[0].place.coords), "{way:?}");
}
