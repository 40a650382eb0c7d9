use super::*;
use std::f64::consts::PI;

const SQUARE: Region = Region::new(0.0, 0.0, 10.0, 10.0);

fn world_of(pitch_m: f64, height_m: impl Fn(f64, f64) -> f64) -> World {
    let terrain = HeightField::from_fn(&SQUARE, pitch_m, height_m).unwrap();
    World::assemble("test", terrain, Vec::new(), SeedBook::new(0))
}

#[test]
fn volume_under_a_plane_is_exact() {
    let world = world_of(0.1, |x, y| 0.2 * x + 0.1 * y + 0.5);
    // Area times the height in the middle.
    assert!((world.volume_m3() - 100.0 * 2.0).abs() < 1e-9);
    let part = Region::new(1.03, 2.0, 3.07, 2.55);
    let by_hand = 2.04 * 0.55 * (0.2 * 2.05 + 0.1 * 2.275 + 0.5);
    assert!((world.true_volume_m3(&part) - by_hand).abs() < 1e-9);
}

#[test]
fn volume_under_a_cone_meets_the_closed_form() {
    let (radius_m, peak_m) = (4.0_f64, 2.8_f64);
    let cone = |x: f64, y: f64| (peak_m * (1.0 - (x - 5.0).hypot(y - 5.0) / radius_m)).max(0.0);
    let closed_form = PI * radius_m * radius_m * peak_m / 3.0;
    // Bilinear sampling errs by pitch² × curvature at the toe and the tip: below 0.1 %.
    assert!((world_of(0.05, cone).volume_m3() / closed_form - 1.0).abs() < 1e-3);
}

#[test]
fn volume_under_a_paraboloid_meets_the_closed_form() {
    let (radius_m, peak_m) = (4.5_f64, 3.0_f64);
    let bowl = |x: f64, y: f64| {
        let ratio = (x - 5.0).hypot(y - 5.0) / radius_m;
        (peak_m * (1.0 - ratio * ratio)).max(0.0)
    };
    let closed_form = 0.5 * PI * radius_m * radius_m * peak_m;
    assert!((world_of(0.05, bowl).volume_m3() / closed_form - 1.0).abs() < 1e-3);
}

#[test]
fn inside_walls_are_no_material() {
    // 1 m of material everywhere; a wall 2 m high takes 0.3 m × 4 m of it away, a kerb of 0.4 m
    // takes only its own volume.
    let terrain = HeightField::from_fn(&SQUARE, 0.1, |_, _| 1.0).unwrap();
    let wall = Cuboid::over(&Region::new(2.0, 2.0, 2.3, 6.0), 0.0, 2.0);
    let kerb = Cuboid::over(&Region::new(5.0, 2.0, 5.5, 4.0), 0.0, 0.4);
    let world = World::assemble("walls", terrain, vec![wall, kerb], SeedBook::new(0));
    let by_hand = 100.0 - 0.3 * 4.0 * 1.0 - 0.5 * 2.0 * 0.4;
    assert!((world.volume_m3() - by_hand).abs() < 1e-9);
    assert!((world.height_at(2.1, 3.0) - 2.0).abs() < 1e-12);
    assert!((world.base_height(2.1, 3.0) - 2.0).abs() < 1e-12);
    assert!((world.height_at(5.2, 3.0) - 1.0).abs() < 1e-12);
    assert!(world.base_height(8.0, 3.0).abs() < 1e-12);
}

#[test]
fn volume_equals_a_brute_force_sum_of_heights_over_the_base() {
    let world = World::piles(0).unwrap();
    let step_m = 0.01;
    let mut sum_m = 0.0;
    for i in 0..2000 {
        for j in 0..2000 {
            let (x, y) = ((f64::from(i) + 0.5) * step_m, (f64::from(j) + 0.5) * step_m);
            sum_m += world.height_at(x, y) - world.base_height(x, y);
        }
    }
    let brute_m3 = sum_m * step_m * step_m;
    // The midpoint rule at 1 cm is good to a few 1e-5 here.
    assert!((world.volume_m3() / brute_m3 - 1.0).abs() < 2e-4, "{brute_m3}");
}

#[test]
fn alps_fill_their_relief_and_differ_by_seed() {
    for seed in 0..5 {
        let world = World::alps(seed).unwrap();
        let heights = world.terrain.heights_m();
        let mean_m = heights.iter().sum::<f64>() / heights.len() as f64;
        let lowest_m = heights.iter().copied().fold(f64::INFINITY, f64::min);
        assert!((1.4..2.0).contains(&mean_m), "seed {seed}: mean {mean_m}");
        assert!((2.8..=4.0).contains(&world.terrain.peak_m()), "{}", world.terrain.peak_m());
        assert!(lowest_m < 0.1);
        assert!((world.region.area_m2() - 400.0).abs() < 1e-9);
    }
    let volumes = [0, 1].map(|seed| World::alps(seed).unwrap().volume_m3());
    assert!((volumes[0] - volumes[1]).abs() > 0.1);
    assert!((volumes[0] - World::alps(0).unwrap().volume_m3()).abs() < 1e-12);
}

#[test]
fn heaps_lie_at_the_angle_of_repose() {
    for seed in 0..5 {
        let world = World::piles(seed).unwrap();
        assert!((1.5..4.0).contains(&world.terrain.peak_m()), "seed {seed}");
        // Straight flanks between 32° and 38°, with ridges of a few degrees: few cells are steeper.
        let pitch_m = world.terrain.pitch_m();
        let steep = world.terrain.heights_m().windows(2).filter(|pair| {
            let rise_m = (pair[1] - pair[0]).abs();
            rise_m > 48_f64.to_radians().tan() * pitch_m && pair[0].min(pair[1]) > 0.3
        });
        let n_high = world.terrain.heights_m().iter().filter(|h| **h > 0.3).count();
        assert!(steep.count() * 50 < n_high, "seed {seed}: too steep");
        let volume_m3 = world.volume_m3();
        assert!((60.0..400.0).contains(&volume_m3), "seed {seed}: {volume_m3} m³");
        // No material on the border: heaps stay off the aisle.
        for i in 0..200 {
            let along = f64::from(i) * 0.1;
            for (x, y) in [(0.0, along), (20.0, along), (along, 0.0), (along, 20.0)] {
                assert!(world.terrain.height_at(x, y) < 1e-9, "seed {seed} at {x}, {y}");
            }
        }
    }
}

#[test]
fn worlds_of_different_seeds_differ_in_volume_and_in_where_the_heaps_lie() {
    for build in [World::alps, World::piles] {
        let worlds: Vec<World> = (0..8).map(|seed| build(seed).unwrap()).collect();
        for (i, a) in worlds.iter().enumerate() {
            for b in &worlds[..i] {
                let heights = a.terrain.heights_m().iter().zip(b.terrain.heights_m());
                let n = a.terrain.heights_m().len() as f64;
                let mean_m = heights.map(|(a, b)| (a - b).abs()).sum::<f64>() / n;
                assert!(mean_m > 0.1, "{}: {mean_m} m apart on average", a.name);
            }
        }
        let volumes: Vec<f64> = worlds.iter().map(World::volume_m3).collect();
        let mean_m3 = volumes.iter().sum::<f64>() / 8.0;
        let var_m6 = volumes.iter().map(|v| (v - mean_m3).powi(2)).sum::<f64>() / 7.0;
        println!("{volumes:.1?}");
        assert!(var_m6.sqrt() > 0.02 * mean_m3, "{volumes:?}");
        let tops: Vec<[f64; 2]> = worlds.iter().map(top_m).collect();
        let n_new = tops.iter().enumerate().filter(|(i, top)| !tops[..*i].contains(top)).count();
        assert!(n_new > 6, "{tops:?}");
    }
}

/// Nodes along x.
fn n_cols(world: &World) -> usize {
    height_field::index_from(world.region.length_m() / world.terrain.pitch_m() + 0.5) + 1
}

/// Where the highest node lies, m.
fn top_m(world: &World) -> [f64; 2] {
    let heights = world.terrain.heights_m();
    let top = (0..heights.len()).max_by(|a, b| heights[*a].total_cmp(&heights[*b])).unwrap();
    let n_cols = n_cols(world);
    [(top % n_cols) as f64, (top / n_cols) as f64].map(|cells| cells * world.terrain.pitch_m())
}

/// Root mean square of the slope along x where material lies.
fn rms_slope(world: &World) -> f64 {
    let heights = world.terrain.heights_m();
    let n_cols = n_cols(world);
    let slopes: Vec<f64> = heights
        .chunks_exact(n_cols)
        .flat_map(|row| row.windows(2).filter(|pair| pair[0].min(pair[1]) > 0.3))
        .map(|pair| (pair[1] - pair[0]) / world.terrain.pitch_m())
        .collect();
    (slopes.iter().map(|s| s * s).sum::<f64>() / slopes.len() as f64).sqrt()
}

#[test]
fn twice_as_steep_doubles_the_slopes_and_keeps_the_relief() {
    let mean = |f: &dyn Fn(u64) -> f64| (0..6).map(f).sum::<f64>() / 6.0;
    let alps = |steepness| mean(&|seed| rms_slope(&World::steep_alps(seed, steepness).unwrap()));
    let ratio = alps(2.0) / alps(1.0);
    println!("alps: rms slope {:.3}, twice as steep {:.3}", alps(1.0), alps(2.0));
    assert!((ratio - 2.0).abs() < 0.15, "{ratio}");
    for seed in 0..6 {
        let steep = World::steep_alps(seed, 2.0).unwrap();
        assert!((2.8..=4.0).contains(&steep.terrain.peak_m()), "{}", steep.terrain.peak_m());
        let (usual, steep) = (World::piles(seed).unwrap(), World::steep_piles(seed, 2.0).unwrap());
        assert!(steep.terrain.peak_m() < 4.0);
        let ratio = rms_slope(&steep) / rms_slope(&usual);
        println!("piles {seed}: {ratio:.2} times the slope");
        assert!((1.6..2.2).contains(&ratio), "seed {seed}: {ratio}");
        let plain = World::steep_alps(seed, 1.0).unwrap();
        assert_eq!(plain.terrain.heights_m(), World::alps(seed).unwrap().terrain.heights_m());
    }
    assert!(World::steep_alps(0, 0.0).is_err() && World::steep_piles(0, -1.0).is_err());
}

#[test]
fn bays_hold_their_share_of_the_volume() {
    let world = World::piles(3).unwrap();
    let names: Vec<&str> = world.bays.iter().map(|bay| bay.name.as_str()).collect();
    assert_eq!(names, ["bay 1", "bay 2", "bay 3", "floor"]);
    for bay in &world.bays {
        let [low, _, high, _] = bay.outline_m[..] else { panic!("a rectangle") };
        let rectangle = Region::new(low[0], low[1], high[0], high[1]);
        let expected_m3 = world.true_volume_m3(&rectangle);
        assert!((world.bay_volume_m3(bay) - expected_m3).abs() < 1e-6, "{}", bay.name);
        assert!(expected_m3 > 5.0, "{}: {expected_m3} m³", bay.name);
    }
    // Nothing lies on the walls' footprints or behind them but what leans over the tops.
    let sum_m3: f64 = world.bays.iter().map(|bay| world.bay_volume_m3(bay)).sum();
    assert!(sum_m3 <= world.volume_m3() + 1e-6 && sum_m3 > 0.97 * world.volume_m3());
}

#[test]
fn volume_in_a_polygon_equals_a_brute_force_sum() {
    let world = World::piles(1).unwrap();
    // A concave arrow, clockwise, over a divider, two heaps and open floor.
    let outline_m = vec![[2.0, 1.0], [5.0, 12.0], [2.5, 18.8], [14.0, 14.0]];
    let bay = Bay { name: "arrow".to_owned(), outline_m: outline_m.clone() };
    let is_inside = |x: f64, y: f64| {
        // Crossings of a ray towards +x.
        let sides = (0..4).map(|i| (outline_m[i], outline_m[(i + 1) % 4]));
        let crossed = sides.filter(|(a, b)| {
            (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        });
        crossed.count() % 2 == 1
    };
    let step_m = 0.01;
    let (mut sum_m, mut n_inside) = (0.0, 0.0);
    for i in 0..2000 {
        for j in 0..2000 {
            let (x, y) = ((f64::from(i) + 0.5) * step_m, (f64::from(j) + 0.5) * step_m);
            if is_inside(x, y) {
                sum_m += world.height_at(x, y) - world.base_height(x, y);
                n_inside += 1.0;
            }
        }
    }
    assert!((bay.area_m2() / (n_inside * step_m * step_m) - 1.0).abs() < 1e-3);
    let brute_m3 = sum_m * step_m * step_m;
    // The sum counts 1 cm cells whole along 40 m of border: far below 0.1 % on average.
    assert!((world.bay_volume_m3(&bay) / brute_m3 - 1.0).abs() < 1e-3, "{brute_m3}");
}

#[test]
fn first_row_of_a_grid_file_is_north() {
    let text = "ncols 3\nnrows 2\nxllcorner 7\nyllcorner 9\ncellsize 10\n\
                NODATA_value -9999\n110 120 130\n100 100 140\n";
    let scale = GridScale { xy: 0.1, z: 0.01 };
    let world = World::from_esri_ascii("tiny", text, scale).unwrap();
    // Two cells of 1 m along x, one along y; heights over the lowest (100) in cm.
    assert_eq!(world.region, Region::new(0.0, 0.0, 2.0, 1.0));
    assert!((world.height_at(0.0, 1.0) - 0.1).abs() < 1e-12);
    assert!((world.height_at(2.0, 0.0) - 0.4).abs() < 1e-12);
    assert!((world.height_at(1.5, 0.5) - 0.225).abs() < 1e-12);
}

#[test]
fn broken_grid_files_are_refused_with_their_line() {
    let parse = |text: &str| {
        World::from_esri_ascii("broken", text, GridScale { xy: 1.0, z: 1.0 }).unwrap_err()
    };
    let head = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
    assert!(matches!(parse(""), WorldError::BadHeader { key: "ncols", .. }));
    assert!(matches!(parse("ncols 2\nnrows x\n"), WorldError::BadHeader { line: 2, .. }));
    assert!(matches!(parse("ncols -2\nnrows 2\n"), WorldError::BadHeader { .. }));
    assert!(matches!(
        parse(&format!("{head}1 2\n3 oops\n")),
        WorldError::BadHeight { line: 7, .. }
    ));
    assert!(matches!(
        parse(&format!("{head}1 2\n3\n")),
        WorldError::WrongCount { line: 7, found: 3, expected: 4 }
    ));
    assert!(matches!(
        parse(&format!("{head}1 2\n3 4 5\n")),
        WorldError::WrongCount { line: 7, found: 5, expected: 4 }
    ));
    assert!(matches!(
        parse(&format!("{head}NODATA_value -9\n1 2\n3 -9\n")),
        WorldError::NoData { line: 8, .. }
    ));
}

/// The Swiss Alps at 1:1000, where the shared data lie beside the repository.
pub(crate) fn real_landscape() -> Option<World> {
    let above = ["/../..", "/../../.."].map(|up| format!("{}{up}", env!("CARGO_MANIFEST_DIR")));
    let paths = above.map(|folder| format!("{folder}/shared/data/terrain/alps_15km_46m.asc"));
    let Some(text) = paths.iter().find_map(|path| std::fs::read_to_string(path).ok()) else {
        println!("none of {paths:?}: nothing to compare");
        return None;
    };
    let scale = GridScale { xy: 0.001, z: 0.001 };
    Some(World::from_esri_ascii("alps 1:1000", &text, scale).unwrap())
}

#[test]
fn real_landscape_has_the_published_size() {
    let Some(world) = real_landscape() else { return };
    // 344 × 333 cells of 46 m, centre to centre, and 3.2 km of relief.
    assert!((world.region.length_m() - 15.778).abs() < 1e-9);
    assert!((world.region.width_m() - 15.272).abs() < 1e-9);
    assert!((world.terrain.peak_m() - 3.2).abs() < 0.1, "{}", world.terrain.peak_m());
}

#[test]
fn tags_have_unique_ids_and_face_the_hall() {
    for world in [World::alps(0).unwrap(), World::piles(3).unwrap()] {
        let ids: std::collections::BTreeSet<u32> = world.tags.iter().map(|tag| tag.id).collect();
        assert_eq!(ids.len(), world.tags.len());
        // 36h11 has 587 markers.
        assert!(world.tags.iter().all(|tag| tag.id < 587));
        for tag in &world.tags {
            let [low_left, low_right, _, up_left] = tag.corners;
            let across = (low_right - low_left).coords;
            let upward = (up_left - low_left).coords;
            // Right × up points to whoever reads the marker.
            assert!((across.cross(&upward).normalize() - tag.normal.coords).norm() < 1e-9);
            assert!((across.norm() - tag.edge_m).abs() < 1e-9);
            assert!(upward.z > 0.0);
            let ahead = tag.centre() + tag.normal;
            assert!(world.hall.depth_m(&ahead.coords) > 0.3, "tag {} looks outside", tag.id);
            assert!(world.hall.depth_m(&tag.centre().coords).abs() < 1e-9);
        }
    }
}

#[test]
fn clearance_is_the_distance_to_the_nearest_solid() {
    let world = world_of(0.1, |_, _| 1.0);
    let clearance_m = |x, y, z| world.clearance_m(&Point::new(x, y, z), 3.0);
    assert!((clearance_m(5.0, 5.0, 1.8) - 0.8).abs() < 1e-9);
    assert!((clearance_m(5.0, 5.0, 9.5) - 0.5).abs() < 1e-9, "ceiling");
    assert!((clearance_m(-0.5, 5.0, 0.9) - 0.5).abs() < 1e-9, "cliff at the border");
    assert!(clearance_m(5.0, 5.0, 0.9).abs() < 1e-12, "inside the material");
    assert!(clearance_m(5.0, 5.0, 10.5).abs() < 1e-12, "above the ceiling");
}
