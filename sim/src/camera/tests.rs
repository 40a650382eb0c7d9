use super::*;
use crate::world::{Cuboid, HeightField, Region, World};
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Point, Rotation, Transform};
use stockpilot::messages::TagDetections;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

fn at(x: f64, y: f64, z: f64) -> Transform<Hall, Body> {
    Transform::new(Rotation::identity(), Point::new(x, y, z))
}

fn after_ms(ms: u64) -> Stamp<Mono> {
    Stamp::ZERO.plus(Duration::from_millis(ms))
}

fn plain_lens() -> Lens {
    Lens { cx_px: 640.0, cy_px: 400.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, ..Lens::wide() }
}

#[test]
fn mounting_points_ahead_and_down() {
    let level = mounted(0.0, 0.0, 0.0, Point::origin());
    let axis =
        |mount: Transform<Body, _>, x, y, z| (mount.rotation * Direction::new(x, y, z)).coords;
    assert!((axis(level, 0.0, 0.0, 1.0) - Vector3::x()).norm() < 1e-12, "optical axis ahead");
    assert!((axis(level, 1.0, 0.0, 0.0) + Vector3::y()).norm() < 1e-12, "u to the right");
    assert!((axis(level, 0.0, 1.0, 0.0) + Vector3::z()).norm() < 1e-12, "v down");
    let pitched = mounted(0.0, 0.2, 0.0, Point::origin());
    let expected = Vector3::new(0.2_f64.cos(), 0.0, -0.2_f64.sin());
    assert!((axis(pitched, 0.0, 0.0, 1.0) - expected).norm() < 1e-12, "positive pitch looks down");
}

#[test]
fn lens_agrees_with_a_calculation_by_hand() {
    let straight = plain_lens().project(&Vector3::new(0.5, -0.25, 2.0)).unwrap();
    assert!((straight[0] - 800.0).abs() < 1e-9 && (straight[1] - 320.0).abs() < 1e-9);
    let lens = Lens { k1: -0.1, k2: 0.02, p1: 0.001, p2: -0.002, ..plain_lens() };
    // x = 0.5, y = 0.25, r² = 0.3125, q = 1 − 0.03125 + 0.001953125 = 0.970703125
    // x′ = 0.4853515625 + 0.00025 − 0.002·0.8125 = 0.4839765625
    // y′ = 0.24267578125 + 0.001·0.4375 − 0.0005 = 0.24261328125
    let bent = lens.project(&Vector3::new(1.0, 0.5, 2.0)).unwrap();
    assert!((bent[0] - (640.0 + 640.0 * 0.483_976_562_5)).abs() < 1e-9);
    assert!((bent[1] - (400.0 + 640.0 * 0.242_613_281_25)).abs() < 1e-9);
    assert!(lens.project(&Vector3::new(0.0, 0.0, -1.0)).is_none());
    assert!(lens.project(&Vector3::new(5.0, 0.0, 1.0)).is_none());
}

#[test]
fn corners_appear_in_the_order_of_the_detector() {
    let world = World::alps(0).unwrap();
    let view = CameraModel::ahead().view(&world, &at(8.0, 10.0, 7.0)).len();
    assert!(view > 4);
    for seen in CameraModel::ahead().view(&world, &at(8.0, 10.0, 7.0)) {
        let [low_left, low_right, up_right, up_left] = seen.corners_px;
        // v grows downwards.
        assert!(low_left[1] > up_left[1] && low_right[1] > up_right[1]);
        assert!(low_left[0] < low_right[0] && up_left[0] < up_right[0]);
    }
}

/// Every kind of hall, some with several seeds.
fn halls() -> Vec<World> {
    let seeded = (0..4).flat_map(|seed| [World::alps(seed).unwrap(), World::piles(seed).unwrap()]);
    seeded.chain(crate::world::tests::real_landscape()).collect()
}

#[test]
fn enough_tags_are_seen_from_everywhere_in_the_region() {
    let camera = CameraModel::ahead();
    for world in halls() {
        let Region { x_min_m, y_min_m, .. } = world.region;
        for i in 0..=40 {
            for j in 0..=40 {
                let x = x_min_m + f64::from(i) / 40.0 * world.region.length_m();
                let y = y_min_m + f64::from(j) / 40.0 * world.region.width_m();
                let n_seen = camera.view(&world, &at(x, y, 7.0)).len();
                assert!(n_seen >= 4, "{} at {x}, {y}: {n_seen}", world.name);
            }
        }
    }
}

#[test]
fn enough_tags_are_seen_from_the_pad_and_on_the_climb() {
    let camera = CameraModel::ahead();
    let awkward = [World::columns(1, 1.0), World::l_hall(2, 1.0), World::poor_fix(3, 1.0)];
    for world in halls().into_iter().chain(awkward.map(Result::unwrap)) {
        let pad = world.pad.position.coords;
        for step in 0..=35 {
            let z = 0.05 + 0.2 * f64::from(step);
            let n_seen = camera.view(&world, &at(pad.x, pad.y, z)).len();
            assert!(n_seen >= 4, "{} at {z} m: {n_seen}", world.name);
        }
    }
}

#[test]
fn walls_and_slant_hide_tags() {
    let region = Region::new(0.0, 0.0, 10.0, 10.0);
    let floor = || HeightField::from_fn(&region, 0.1, |_, _| 0.0).unwrap();
    let screen = Cuboid::over(&Region::new(6.0, -1.9, 6.2, 11.9), 0.0, 9.9);
    let open = World::assemble("open", floor(), Vec::new(), SeedBook::new(0));
    let closed = World::assemble("closed", floor(), vec![screen], SeedBook::new(0));
    let camera = CameraModel::ahead();
    let is_beyond = |seen: &SeenTag<'_>| seen.tag.centre().coords.x > 6.3;
    assert!(camera.view(&open, &at(2.0, 5.0, 6.0)).iter().any(is_beyond));
    assert!(!camera.view(&closed, &at(2.0, 5.0, 6.0)).iter().any(is_beyond));
    for seen in camera.view(&open, &at(2.0, 5.0, 6.0)) {
        let to_camera = Vector3::new(2.1, 5.0, 6.03) - seen.tag.centre().coords;
        let slant = to_camera.angle(&seen.tag.normal.coords);
        assert!(slant <= 75_f64.to_radians() && seen.edge_px >= 14.0);
    }
}

fn frames(model: CameraModel, seconds: u64) -> Vec<TagDetections> {
    let world = World::alps(0).unwrap();
    let mut camera = CameraSimulator::new(model, SeedBook::new(5), Stamp::ZERO);
    (0..=seconds * 100)
        .flat_map(|step| camera.advance(&world, after_ms(step * 10), |_| at(6.0, 10.0, 7.0)))
        .collect()
}

#[test]
fn frames_arrive_late_and_sometimes_out_of_order() {
    let frames = frames(CameraModel::ahead(), 20);
    // 20 Hz for 20 s; the last ones are still under way.
    assert!((396..=401).contains(&frames.len()), "{}", frames.len());
    for frame in &frames {
        let late_s = frame.received_at.seconds_since(frame.captured_at);
        assert!((0.03..=0.15).contains(&late_s), "{late_s}");
    }
    assert!(frames.windows(2).all(|pair| pair[0].received_at <= pair[1].received_at));
    let n_overtaken =
        frames.windows(2).filter(|pair| pair[0].captured_at > pair[1].captured_at).count();
    assert!((10..200).contains(&n_overtaken), "{n_overtaken}");
}

#[test]
fn noise_outliers_and_misses_have_their_stated_rates() {
    let mut model = CameraModel::ahead();
    model.detector.outlier_ratio = 0.02;
    let world = World::alps(0).unwrap();
    let exact = model.view(&world, &at(6.0, 10.0, 7.0));
    let frames = frames(model.clone(), 20);
    let (mut n_tags, mut n_outliers, mut squares, mut n_coordinates) = (0.0, 0.0, 0.0, 0.0);
    for detection in frames.iter().flat_map(|frame| &frame.tags) {
        let seen = exact.iter().find(|seen| seen.tag.id == detection.id).unwrap();
        let pairs = detection.corners_px.iter().flatten().zip(seen.corners_px.iter().flatten());
        let errors: Vec<f64> = pairs.map(|(noisy, exact)| noisy - exact).collect();
        n_tags += 1.0;
        if errors.iter().any(|e| e.abs() > 2.5) {
            n_outliers += 1.0;
        } else {
            squares += errors.iter().map(|e| e * e).sum::<f64>();
            n_coordinates += 8.0;
        }
    }
    let n_possible = (frames.len() * exact.len()) as f64;
    assert!(n_possible > 4000.0);
    // Four standard errors of each share and of the deviation.
    assert!((1.0 - n_tags / n_possible - 0.02_f64).abs() < 0.009, "{}", n_tags / n_possible);
    assert!((n_outliers / n_tags - 0.02_f64).abs() < 0.009, "{}", n_outliers / n_tags);
    assert!(((squares / n_coordinates).sqrt() - 0.3_f64).abs() < 0.005);
}

#[test]
fn line_is_json_with_the_agreed_fields() {
    let frame = &frames(CameraModel::ahead(), 1)[3];
    let line = detections_line(frame).unwrap();
    let value: serde_json::Value = serde_json::from_str(&line).unwrap();
    assert!(!line.contains('\n'));
    assert_eq!(value["captured_at_ns"], frame.captured_at.nanos());
    assert_eq!(value["clock"], "mono");
    assert_eq!(value["camera"], 0);
    assert_eq!(value["tags"].as_array().unwrap().len(), frame.tags.len());
    assert_eq!(value["tags"][0]["family"], "36h11");
    assert_eq!(value["tags"][0]["corners_px"][2][1], frame.tags[0].corners_px[2][1]);
    assert_eq!(value["tags"][0]["id"], frame.tags[0].id);
}
