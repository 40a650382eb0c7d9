use super::super::base::Plane;
use super::super::polygon::Place;
use super::super::surveyed_base::SurveyedBase;
use super::super::triangulated_base::TriangulatedBase;
use super::*;
use crate::messages::HeightMap;
use crate::time::Stamp;

const BOUNDS: Rect = Rect { x_min_m: -2.0, y_min_m: 1.0, x_max_m: 8.0, y_max_m: 7.0 };

fn region(bays: Vec<Bay>) -> Region {
    Region { bounds: BOUNDS, exclusions: Vec::new(), exclusion_margin_m: 0.0, bays }
}

fn bay(name: &str, corners: &[Place], base: BaseSurface) -> Bay {
    let outline = Polygon::new(corners).expect("simple");
    Bay { name: name.to_owned(), outline, base, density: None }
}

/// An L that is not aligned with cells: 5.3 × 1.1 below and 1.7 × 3.2 above its left end.
const L: [Place; 6] = [(-1.1, 1.4), (4.2, 1.4), (4.2, 2.5), (0.6, 2.5), (0.6, 5.7), (-1.1, 5.7)];
const L_AREA_M2: f64 = 5.3 * 1.1 + 1.7 * 3.2;
/// ∫x and ∫y over the L, m³: areas times the middles of its two rectangles.
const L_MOMENTS_M3: Place =
    (5.3 * 1.1 * 1.55 + 1.7 * 3.2 * -0.25, 5.3 * 1.1 * 1.95 + 1.7 * 3.2 * 4.1);

fn plane() -> Plane {
    Plane {
        pivot_m: (1.0, 2.0),
        height_m: 0.4,
        slope: (0.05, -0.08),
        sigma_m: 0.01,
        slope_sigma: 0.002,
    }
}

#[test]
fn a_prism_over_a_level_has_its_area_times_its_height() {
    let base = BaseSurface::Level { height_m: 0.25, sigma_m: 0.02 };
    let region = region(vec![bay("A", &L, base)]);
    let grid = region.grid(0.23);
    let on_grid = &region.bays_on(&grid, &BaseSurface::level(0.0))[0];
    assert!((on_grid.base.area_m2() - L_AREA_M2).abs() < 1e-12);
    let volume_m3 = on_grid.base.volume_m3(&vec![1.5; grid.n_cells()]);
    assert!((volume_m3 - 1.25 * L_AREA_M2).abs() < 1e-12);
    let [(dv_dc, sigma)] = on_grid.base.errors[..] else { unreachable!("one error: the level") };
    assert!((dv_dc + L_AREA_M2).abs() < 1e-12 && (sigma - 0.02).abs() < 1e-15);
}

#[test]
fn a_level_surface_over_a_tilted_plane_is_exact() {
    let region = region(vec![bay("A", &L, BaseSurface::Plane(plane()))]);
    let grid = region.grid(0.37);
    let on_grid = &region.bays_on(&grid, &BaseSurface::level(0.0))[0];
    let volume_m3 = on_grid.base.volume_m3(&vec![2.0; grid.n_cells()]);
    // ∫ (2 − 0.4 − 0.05 (x − 1) + 0.08 (y − 2)) dA
    let moment = (L_MOMENTS_M3.0 - L_AREA_M2, L_MOMENTS_M3.1 - 2.0 * L_AREA_M2);
    let expected = 1.6 * L_AREA_M2 - 0.05 * moment.0 + 0.08 * moment.1;
    assert!((volume_m3 - expected).abs() < 1e-11, "{volume_m3} {expected}");
    let errors = [(-L_AREA_M2, 0.01), (-moment.0, 0.002), (-moment.1, 0.002)];
    for (ours, by_hand) in on_grid.base.errors.iter().zip(errors) {
        assert!((ours.0 - by_hand.0).abs() < 1e-11 && (ours.1 - by_hand.1).abs() < 1e-15);
    }
}

#[test]
fn a_heap_as_a_triangulated_base_has_the_volume_of_its_pyramid() {
    // The bare floor is itself a pyramid of 1.5 m over a square of 4 m, measured at five points.
    let corners: [Place; 4] = [(0.0, 2.0), (4.0, 2.0), (4.0, 6.0), (0.0, 6.0)];
    let mut points: Vec<[f64; 3]> = corners.iter().map(|&(x, y)| [x, y, 0.0]).collect();
    points.push([2.0, 4.0, 1.5]);
    let triangles = TriangulatedBase::new(points, 0.0, 0.01).expect("triangles");
    let region = region(vec![bay("A", &corners, BaseSurface::Triangulated(triangles))]);
    let grid = region.grid(0.05);
    let on_grid = &region.bays_on(&grid, &BaseSurface::level(0.0))[0];
    let volume_m3 = on_grid.base.volume_m3(&vec![1.5; grid.n_cells()]);
    // A box of 24 m³ without a pyramid of 8 m³. Folds inside a cell cost less than its square.
    assert!((volume_m3 - 16.0).abs() < 16.0 * 0.05_f64.powi(2), "{volume_m3}");
    // The tip carries a third of every triangle, so of the whole; a corner a third of two.
    let [_, corner, .., tip] = on_grid.base.errors[..] else { unreachable!("six errors") };
    assert!((tip.0 + 16.0 / 3.0).abs() < 0.02, "{tip:?}");
    assert!((corner.0 + 8.0 / 3.0).abs() < 0.02, "{corner:?}");
}

#[test]
fn an_unchanged_surface_over_its_own_survey_holds_nothing() {
    let region_without = region(Vec::new());
    let grid = region_without.grid(0.37);
    let mean_m: Vec<f64> =
        (0_u32..).take(grid.n_cells()).map(|i| 0.5 + (f64::from(i) * 0.7).sin()).collect();
    let map = HeightMap {
        at: Stamp::ZERO,
        grid,
        mean_m: mean_m.clone(),
        sigma_m: vec![0.03; grid.n_cells()],
        disturbed_cells: Vec::new(),
    };
    let survey = SurveyedBase::from_map(&map, 0.01).expect("a base");
    let region = region(vec![bay("A", &L, BaseSurface::Survey(survey))]);
    let on_grid = &region.bays_on(&grid, &BaseSurface::level(0.0))[0];
    assert!(on_grid.base.volume_m3(&mean_m).abs() < 1e-12);
    let squares: f64 = on_grid.base.cell_areas_m2.iter().map(|w| (w * 0.03).powi(2)).sum();
    let cells = on_grid.base.errors[1];
    assert!((cells.0 * cells.1 + squares.sqrt()).abs() < 1e-12);
}

#[test]
fn base_errors_match_moved_bases() {
    let points = |shift: [f64; 4]| {
        vec![
            [-1.5, 1.2, 0.1 + shift[0]],
            [4.5, 1.1, 0.2 + shift[1]],
            [4.4, 5.9, -0.1 + shift[2]],
            [-1.3, 5.8, 0.05 + shift[3]],
        ]
    };
    let volume_of = |base: BaseSurface| {
        let region = region(vec![bay("A", &L, base)]);
        let grid = region.grid(0.31);
        let on_grid = region.bays_on(&grid, &BaseSurface::level(0.0)).remove(0);
        (on_grid.base.volume_m3(&vec![1.0; grid.n_cells()]), on_grid.base.errors)
    };
    let triangles = |shift| {
        volume_of(BaseSurface::Triangulated(
            TriangulatedBase::new(points(shift), 0.02, 0.01).expect("triangles"),
        ))
    };
    let (volume_m3, errors) = triangles([0.0; 4]);
    for k in 0..4 {
        let mut shift = [0.0; 4];
        shift[k] = 0.1;
        let moved = triangles(shift).0;
        assert!(((moved - volume_m3) / 0.1 - errors[k + 1].0).abs() < 1e-10, "point {k}");
    }
    let (volume_m3, errors) = volume_of(BaseSurface::Plane(plane()));
    let moved = |change: fn(&mut Plane)| {
        let mut plane = plane();
        change(&mut plane);
        (volume_of(BaseSurface::Plane(plane)).0 - volume_m3) / 0.1
    };
    let by_hand =
        [moved(|p| p.height_m += 0.1), moved(|p| p.slope.0 += 0.1), moved(|p| p.slope.1 += 0.1)];
    for (ours, moved) in errors.iter().zip(by_hand) {
        assert!((ours.0 - moved).abs() < 1e-9);
    }
}

#[test]
fn exclusions_leave_holes_and_separate() {
    let mut region = region(vec![bay("A", &L, BaseSurface::level(0.0))]);
    // A beam on the slant through the lower leg; its part inside is a parallelogram 1.1 high.
    let beam = Polygon::new(&[(2.0, 0.0), (2.3, 0.0), (3.3, 4.0), (3.0, 4.0)]).expect("simple");
    region.exclusions.push(super::super::region::Footprint::Polygon(beam));
    let grid = region.grid(0.25);
    let on_grid = &region.bays_on(&grid, &BaseSurface::level(0.0))[0];
    assert!((on_grid.base.area_m2() - (L_AREA_M2 - 0.3 * 1.1)).abs() < 1e-12);
    assert!(region.separates((1.5, 2.0), (3.5, 2.0)));
    assert!(!region.separates((1.5, 2.0), (2.3, 2.2)), "short of the beam");
    assert!(!region.accepts(2.6, 2.0, 0.0) && region.accepts(2.2, 2.0, 0.0));
}

#[test]
fn bays_that_do_not_fit_are_refused_with_the_area() {
    let floor = || BaseSurface::level(0.0);
    let left: [Place; 4] = [(-2.0, 1.0), (3.0, 1.0), (3.0, 7.0), (-2.0, 7.0)];
    let right: [Place; 4] = [(3.0, 1.0), (8.0, 1.0), (8.0, 7.0), (3.0, 7.0)];
    let grid = region(Vec::new()).grid(0.25);
    let check = |bays| region(bays).check_bays(&grid);
    assert_eq!(check(vec![bay("A", &left, floor()), bay("B", &right, floor())]), Ok(()));
    let same = check(vec![bay("A", &left, floor()), bay("A", &right, floor())]);
    assert_eq!(same, Err(BayError::SameName { name: "A".to_owned() }));
    let Err(BayError::Overlap { overlap_m2, .. }) =
        check(vec![bay("A", &left, floor()), bay("L", &L, floor())])
    else {
        unreachable!("they overlap")
    };
    // The L without what lies right of x = 3: 1.2 × 1.1.
    assert!((overlap_m2 - (L_AREA_M2 - 1.32)).abs() < 1e-12);
    let out: [Place; 3] = [(7.0, 2.0), (9.0, 2.0), (7.0, 4.0)];
    let error = check(vec![bay("C", &out, floor())]).unwrap_err();
    // The tip of the triangle beyond x = 8: 1 × 1 / 2.
    assert_eq!(error.to_string(), "bay \"C\" reaches out of the region by 0.500 m²");

    let mut walled = region(vec![bay("A", &left, floor())]);
    walled.exclusions.push(BOUNDS.into());
    assert_eq!(walled.check_bays(&grid), Err(BayError::Empty { name: "A".to_owned() }));
    let small = GridGeometry { n_cols: 12, ..grid };
    let n = small.n_cells();
    let survey = SurveyedBase::new(small, vec![0.0; n], vec![0.0; n], 0.0).expect("a base");
    let error = check(vec![bay("A", &left, BaseSurface::Survey(survey))]).unwrap_err();
    assert!(matches!(error, BayError::BaseMissing { x_m, .. } if x_m > 1.0), "{error}");
}

#[test]
fn the_hall_is_the_sum_of_its_bays_and_a_common_base_moves_all_of_it() {
    let left: [Place; 4] = [(-2.0, 1.0), (1.0, 1.0), (1.0, 7.0), (-2.0, 7.0)];
    let middle: [Place; 4] = [(1.0, 1.0), (4.0, 1.0), (4.0, 7.0), (1.0, 7.0)];
    let right: [Place; 4] = [(4.0, 1.0), (8.0, 1.0), (8.0, 7.0), (4.0, 7.0)];
    let floor = BaseSurface::Level { height_m: 0.1, sigma_m: 0.02 };
    let region = region(vec![
        bay("A", &left, floor.clone()),
        bay("B", &middle, BaseSurface::Plane(plane())),
        bay("C", &right, floor),
    ]);
    let grid = region.grid(0.25);
    let bases = region.whole_and_bays_on(&grid, &BaseSurface::level(0.0));
    let names: Vec<&str> = bases.iter().map(|bay| bay.name.as_str()).collect();
    assert_eq!(names, [WHOLE_REGION, "A", "B", "C"]);
    let surface_m = vec![1.3; grid.n_cells()];
    let volumes: Vec<f64> = bases.iter().map(|bay| bay.base.volume_m3(&surface_m)).collect();
    assert!((volumes[0] - volumes[1..].iter().sum::<f64>()).abs() < 1e-10);
    // A and C, 18 and 24 m², stand on one floor with one error; B has three of its own.
    let errors = &bases[0].base.errors;
    assert_eq!(errors.len(), 4);
    assert!((errors[0].0 + 42.0).abs() < 1e-10 && (errors[0].1 - 0.02).abs() < 1e-15);
    assert_eq!(errors[1..], bases[2].base.errors[..]);
}

#[test]
fn without_bays_the_region_is_one() {
    let region = region(Vec::new());
    let grid = region.grid(0.25);
    let bays = region.bays_on(&grid, &BaseSurface::level(0.5));
    assert_eq!((bays.len(), bays[0].name.as_str()), (1, WHOLE_REGION));
    assert!((bays[0].base.volume_m3(&vec![1.5; grid.n_cells()]) - 60.0).abs() < 1e-10);
}
