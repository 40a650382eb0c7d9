use super::*;
use crate::mapping::region::Rect;
use crate::mapping::solid::{Prism, Solid};
use crate::planning::space::Fence;
use crate::stats::SeedBook;
use crate::time::Stamp;

fn square(from: f64, to: f64) -> Polygon {
    Polygon::from(Rect { x_min_m: from, y_min_m: from, x_max_m: to, y_max_m: to })
}

fn column() -> Solid {
    let corners = [(4.8, 4.8), (5.2, 4.8), (5.2, 5.2), (4.8, 5.2)];
    Prism::new(Polygon::new(&corners).expect("simple"), (0.0, 9.0)).into()
}

/// A hall of 10 m × 10 m × 9 m with a column in the middle; 0.5 m are kept off everything.
fn settings() -> SpaceSettings {
    SpaceSettings {
        walls: Some(square(0.0, 10.0)),
        ceiling_m: Some(9.0),
        obstacles: vec![column()],
        highest_surface_m: Some(3.0),
        ..SpaceSettings::default()
    }
}

fn clearance(settings: SpaceSettings) -> Clearance {
    Clearance::new(Arc::new(settings))
}

fn at(x: f64, y: f64, z: f64) -> Vector3<f64> {
    Vector3::new(x, y, z)
}

#[test]
fn every_limit_holds_to_the_centimetre() {
    let hall = clearance(settings());
    for (free, shut) in [
        (at(0.5, 5.0, 6.0), at(0.49, 5.0, 6.0)),
        (at(3.0, 9.5, 6.0), at(3.0, 9.51, 6.0)),
        (at(3.0, 5.0, 8.5), at(3.0, 5.0, 8.51)),
        (at(3.0, 5.0, 3.5), at(3.0, 5.0, 3.49)),
        (at(4.3, 5.0, 6.0), at(4.31, 5.0, 6.0)),
        // The column's corner is round: 0.5 m along its diagonal.
        (at(5.2 + 0.3536, 5.2 + 0.3536, 6.0), at(5.2 + 0.3528, 5.2 + 0.3528, 6.0)),
    ] {
        assert!(hall.is_clear(&free) && !hall.is_clear(&shut), "{free:?} {shut:?}");
    }
    assert!(!hall.is_clear(&at(-3.0, 5.0, 6.0)) && !hall.is_clear(&at(5.0, 5.0, 6.0)));
}

#[test]
fn a_way_is_clear_where_all_of_its_places_are() {
    let mut noise = SeedBook::new(21).stream("clearance");
    // An L, so that ways between clear places can leave the walls.
    let corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0)];
    let corner_hall = SpaceSettings {
        walls: Some(Polygon::new(&corners).expect("simple")),
        obstacles: Vec::new(),
        ..settings()
    };
    for hall in [clearance(settings()), clearance(corner_hall)] {
        let mut n_clear = 0;
        for _ in 0..600 {
            let mut place = || {
                let mut along = |low: f64, high: f64| noise.between(low, high);
                at(along(0.0, 10.0), along(0.0, 10.0), along(3.0, 9.0))
            };
            let (a, b) = (place(), place());
            let is_clear = hall.is_way_clear(&a, &b);
            let short_m = |k: u32| {
                let p = a.lerp(&b, f64::from(k) / 500.0);
                let short = hall.shortfall(&p, &p);
                short.around_m.max(short.below_m)
            };
            let worst_m = (0..=500).map(short_m).fold(0.0, f64::max);
            // Between two looks, 3 cm apart, at most half of that may be missed.
            let all_m = hall.shortfall(&a, &b);
            let missing_m = all_m.around_m.max(all_m.below_m);
            let is_same = if missing_m.is_finite() {
                (-1e-9..0.016).contains(&(missing_m - worst_m))
            } else {
                worst_m > 0.45
            };
            assert!(is_same, "{a:?} {b:?} {missing_m} {worst_m}");
            n_clear += u32::from(is_clear);
        }
        assert!(n_clear > 20, "{n_clear} clear ways");
    }
}

#[test]
fn thin_obstacles_are_not_stepped_over() {
    let wire = Prism::turned_box(&at(5.0, 2.0, 6.0), &at(0.002, 0.002, 4.0), 0.3).expect("a box");
    let hall = clearance(SpaceSettings { obstacles: vec![wire.into()], ..settings() });
    assert!(!hall.is_way_clear(&at(1.0, 2.0, 6.0), &at(9.0, 2.0, 6.0)));
    assert!(!hall.is_way_clear(&at(1.0, 1.6, 6.0), &at(9.0, 2.3, 6.0)));
    assert!(hall.is_way_clear(&at(1.0, 2.51, 6.0), &at(9.0, 2.51, 6.0)));
}

#[test]
fn the_fence_holds_for_the_origin_of_the_body() {
    let fence = Fence { outline: Some(square(2.0, 8.0)), min_height_m: 4.0, max_height_m: 7.0 };
    let hall = clearance(SpaceSettings { fence: Some(fence), ..settings() });
    assert!(hall.is_clear(&at(2.01, 2.01, 4.0)) && hall.is_clear(&at(7.9, 3.0, 7.0)));
    assert!(!hall.is_clear(&at(1.99, 3.0, 5.0)) && !hall.is_clear(&at(3.0, 3.0, 3.9)));
    assert!(!hall.is_way_clear(&at(3.0, 3.0, 5.0), &at(3.0, 3.0, 7.1)));
    let short = hall.shortfall(&at(1.0, 3.0, 5.0), &at(1.0, 3.0, 5.0));
    assert!((short.around_m - 1.0).abs() < 1e-12 && short.below_m == 0.0);
}

#[test]
fn a_map_lowers_the_surface_and_its_peaks_are_kept_off() {
    let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 40, n_rows: 40 };
    let mut map = HeightMap {
        at: Stamp::ZERO,
        grid,
        mean_m: vec![0.2; grid.n_cells()],
        sigma_m: vec![0.1; grid.n_cells()],
        disturbed_cells: Vec::new(),
    };
    // A peak of 2.5 ± 0.1 m around (2.1, 2.1), and a corner that nobody has seen.
    map.mean_m[grid.cell_at(2.1, 2.1).expect("inside")] = 2.5;
    for x in 0..8 {
        for y in 0..8 {
            map.sigma_m[grid.index(39 - x, 39 - y)] = 3.0;
        }
    }
    let before = clearance(settings());
    let hall = before.with_surface(&map);
    // h + 3σ + radius + clearance = 0.5 + 0.5 m.
    assert!(hall.is_clear(&at(7.0, 3.0, 1.01)) && !hall.is_clear(&at(7.0, 3.0, 0.99)));
    assert!(!before.is_clear(&at(7.0, 3.0, 1.01)));
    assert!(!hall.is_clear(&at(2.1, 2.1, 3.29)) && hall.is_clear(&at(2.1, 2.1, 3.31)));
    // Unseen ground counts as the highest pile, not as 0.2 + 9 m.
    assert!(!hall.is_clear(&at(9.2, 9.2, 3.49)) && hall.is_clear(&at(9.2, 9.2, 3.5)));
    // Every way that passes within the radius of the peak's cell below its clearance is refused;
    // ways two cells and more further out are not.
    let mut noise = SeedBook::new(4).stream("peak");
    let (mut n_near, mut n_far) = (0, 0);
    for _ in 0..4000 {
        let z = noise.between(1.2, 3.2);
        let (a, b) = (at(noise.between(0.6, 4.0), 0.6, z), at(noise.between(0.6, 4.0), 4.0, z));
        let cell = Polygon::from(Rect { x_min_m: 2.0, y_min_m: 2.0, x_max_m: 2.25, y_max_m: 2.25 });
        let n = 400;
        let passes_m = (0..=n)
            .map(|k| a.lerp(&b, f64::from(k) / f64::from(n)))
            .map(|p| cell.distance_m(p.x, p.y))
            .fold(f64::INFINITY, f64::min);
        let is_clear = hall.is_way_clear(&a, &b);
        if passes_m < 0.3 {
            assert!(!is_clear, "{a:?} {b:?} passes at {passes_m} m");
            n_near += 1;
        } else if passes_m > 0.3 + 2.5 * 0.25 {
            assert!(is_clear, "{a:?} {b:?} passes at {passes_m} m");
            n_far += 1;
        }
    }
    assert!(n_near > 100 && n_far > 100, "{n_near} {n_far}");
}
