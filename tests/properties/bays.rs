//! Bays of any outline lose no ground and count none twice.

use proptest::prelude::{ProptestConfig, Strategy, any, prop, prop_assert, proptest};
use stockpilot::mapping::base::{BaseSurface, Plane};
use stockpilot::mapping::bay::Bay;
use stockpilot::mapping::polygon::{Place, Polygon};
use stockpilot::mapping::region::{Footprint, Rect, Region};

const BOUNDS: Rect = Rect { x_min_m: -7.3, y_min_m: 11.2, x_max_m: 4.9, y_max_m: 21.8 };

fn bay(name: &str, corners: &[Place]) -> Bay {
    let outline = Polygon::new(corners).expect("simple");
    Bay { name: name.to_owned(), outline, base: BaseSurface::level(0.0), density: None }
}

fn region(bays: Vec<Bay>, exclusions: Vec<Footprint>) -> Region {
    Region { bounds: BOUNDS, exclusions, exclusion_margin_m: 0.0, bays }
}

/// Corners around a centre at any distances: concave in general, never self-intersecting.
fn star() -> impl Strategy<Value = Vec<Place>> {
    let radii = prop::collection::vec(0.3_f64..4.5, 3..14);
    (-2.5_f64..0.3, 16.0_f64..17.0, radii, 0.0_f64..6.2).prop_map(|(x, y, radii, turn)| {
        let n = radii.len() as f64;
        let corner = |(k, radius): (usize, &f64)| {
            let angle = turn + std::f64::consts::TAU * k as f64 / n;
            (x + radius * angle.cos(), y + radius * angle.sin())
        };
        radii.iter().enumerate().map(corner).collect()
    })
}

/// Area and first moments by Green's theorem over the corners.
fn shoelace(corners: &[Place]) -> (f64, f64, f64) {
    let next = corners.iter().cycle().skip(1);
    std::iter::zip(corners, next).fold((0.0, 0.0, 0.0), |(area, mx, my), (a, b)| {
        let cross = a.0 * b.1 - b.0 * a.1;
        (area + cross / 2.0, mx + cross * (a.0 + b.0) / 6.0, my + cross * (a.1 + b.1) / 6.0)
    })
}

fn areas_m2(region: &Region, cell_m: f64) -> Vec<f64> {
    let grid = region.grid(cell_m);
    let bays = region.bays_on(&grid, &BaseSurface::level(0.0));
    bays.iter().map(|bay| bay.base.area_m2()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn bays_add_up_to_their_polygons(
        corners in star(),
        is_clockwise in any::<bool>(),
        cell_m in 0.11_f64..1.3,
    ) {
        let mut corners = corners;
        let (area_m2, moment_x, moment_y) = shoelace(&corners);
        if is_clockwise {
            corners.reverse();
        }
        // Over the plane z = x: the volume of the level 0 is the negative moment.
        for (slope, moment) in [((1.0, 0.0), moment_x), ((0.0, 1.0), moment_y)] {
            let plane = Plane {
                pivot_m: (0.0, 0.0),
                height_m: 0.0,
                slope,
                sigma_m: 0.0,
                slope_sigma: 0.0,
            };
            let mut bay = bay("A", &corners);
            bay.base = BaseSurface::Plane(plane);
            let region = region(vec![bay], vec![]);
            let grid = region.grid(cell_m);
            let on_grid = region.bays_on(&grid, &BaseSurface::level(0.0)).remove(0);
            prop_assert!((on_grid.base.area_m2() - area_m2).abs() < 1e-9 * area_m2);
            let volume_m3 = on_grid.base.volume_m3(&vec![0.0; grid.n_cells()]);
            prop_assert!((volume_m3 + moment).abs() < 1e-8, "{} {}", volume_m3, moment);
        }
    }

    #[test]
    fn neighbours_share_the_ground_between_them(
        cuts in prop::collection::vec(-5.0_f64..3.0, 2..7),
        cell_m in 0.2_f64..0.9,
    ) {
        // A crooked border from the front to the back of the region.
        let n = cuts.len() as f64 - 1.0;
        let at = |k: usize| BOUNDS.y_min_m + (BOUNDS.y_max_m - BOUNDS.y_min_m) * k as f64 / n;
        let border: Vec<Place> = cuts.iter().enumerate().map(|(k, x)| (*x, at(k))).collect();
        let side = |x: f64| {
            let mut corners = border.clone();
            corners.extend([(x, BOUNDS.y_max_m), (x, BOUNDS.y_min_m)]);
            corners
        };
        let region = region(
            vec![bay("left", &side(BOUNDS.x_min_m)), bay("right", &side(BOUNDS.x_max_m))],
            vec![],
        );
        let grid = region.grid(cell_m);
        region.check_bays(&grid).expect("neighbours fit");
        let bays = region.bays_on(&grid, &BaseSurface::level(0.0));
        let whole = region.cell_areas_m2(&grid);
        for (cell, expected) in whole.iter().enumerate() {
            let sum = bays[0].base.cell_areas_m2[cell] + bays[1].base.cell_areas_m2[cell];
            prop_assert!((sum - expected).abs() < 1e-11, "cell {}: {} {}", cell, sum, expected);
        }
    }

    #[test]
    fn an_exclusion_takes_exactly_its_share(
        outline in star(),
        machine in star(),
        beam in star(),
        cell_m in 0.2_f64..0.9,
    ) {
        // |A − M| − |A − M − B| = |B − M| − |B − M − A|, and |A| − |A − M| = |M| − |M − A|: both
        // sides are the same intersection, seen from either polygon.
        let polygon = |corners: &[Place]| Footprint::Polygon(Polygon::new(corners).expect("simple"));
        let left = |corners: &[Place], exclusions: &[&[Place]]| {
            let exclusions = exclusions.iter().map(|corners| polygon(corners)).collect();
            areas_m2(&region(vec![bay("A", corners)], exclusions), cell_m)[0]
        };
        let (whole, both) = (left(&outline, &[]), left(&outline, &[&machine, &beam]));
        let without_machine = left(&outline, &[&machine]);
        let beam_alone = left(&beam, &[&machine]) - left(&beam, &[&machine, &outline]);
        prop_assert!((without_machine - both - beam_alone).abs() < 1e-9);
        let machine_in = left(&machine, &[]) - left(&machine, &[&outline]);
        prop_assert!((whole - without_machine - machine_in).abs() < 1e-9);
    }

    #[test]
    fn cells_have_the_share_that_points_find(
        outline in star(),
        machine in star(),
        column in 0.0_f64..1.0,
        row in 0.0_f64..1.0,
    ) {
        let machine = Footprint::Polygon(Polygon::new(&machine).expect("simple"));
        let region = region(vec![bay("A", &outline)], vec![machine]);
        let grid = region.grid(0.5);
        let on_grid = region.bays_on(&grid, &BaseSurface::level(0.0)).remove(0);
        let (x, y) = (-7.0 + 11.5 * column, 11.5 + 10.0 * row);
        let cell = grid.cell_at(x, y).expect("a premise of the test");
        let (x, y) = grid.centre_m(cell);
        let polygon = Polygon::new(&outline).expect("simple");
        let n = 100;
        let offset = |k: i32| ((f64::from(k) + 0.5) / f64::from(n) - 0.5) * 0.5;
        let count = (0..n * n)
            .map(|k| (x + offset(k % n), y + offset(k / n)))
            .filter(|(x, y)| polygon.contains(*x, *y) && region.accepts(*x, *y, 0.0))
            .count();
        let area_m2 = 0.25 * count as f64 / f64::from(n * n);
        // Half a row of points along each border, of which a cell has a few.
        prop_assert!((on_grid.base.cell_areas_m2[cell] - area_m2).abs() < 0.25 * 3.0 / 100.0);
    }
}
