//! What is wrong in a frame must be refused or do no harm.

use super::*;

/// How far the fix from faulty features may lie from that of the good ones, in its own σ.
const HARMLESS_SIGMAS: f64 = 3.0;

/// True if there was a fix; that it is harmless is asserted.
fn is_fixed_and_harmless(
    good: &[PointFeature],
    faulty: &[PointFeature],
    start: Start<'_>,
    name: &str,
) -> bool {
    let (camera, settings) = (distorted_camera(), settings());
    let reference = solve(&camera, good, Some(&truth()), &settings).expect("a fix");
    let fix = match solve_from(&camera, faulty, start, &settings) {
        Ok(fix) => fix,
        Err(refusal) => {
            println!("{name}: {refusal:?} of {} points from {start:?}", faulty.len());
            return false;
        }
    };
    let shift = error(&fix, &reference.hall_from_body);
    for k in 0..6 {
        let sigmas = shift[k].abs() / reference.pose_cov[(k, k)].sqrt();
        assert!(sigmas < HARMLESS_SIGMAS, "{name}, axis {k}: {sigmas} σ");
    }
    true
}

fn settings() -> Settings {
    Settings { corner_sigma_px: 0.3, max_position_sigma_m: 0.5 }
}

/// A prior as a filter has it: some centimetres and half a degree off.
fn prior(noise: &mut Noise) -> Transform<Hall, Body> {
    truth().perturbed(&(noise.normal3() * 0.05), &(noise.normal3() * 0.01))
}

/// Runs a fault on many frames, cold, with gravity and with a prior; how many of each are fixed.
fn tried(
    name: &str,
    runs: u64,
    fault: impl Fn(&mut Vec<PointFeature>, &mut Noise) -> Vec<PointFeature>,
) -> [u64; 3] {
    let mut n_fixed = [0; 3];
    for seed in 0..runs {
        let mut noise = SeedBook::new(seed).stream(name);
        let mut features = seen(&truth(), 0.3, &mut noise);
        let good = fault(&mut features, &mut noise);
        let prior = prior(&mut noise);
        let starts = [cold(None), cold(Some(gravity(&truth()))), Start::Prior(&prior)];
        for (n, start) in n_fixed.iter_mut().zip(starts) {
            *n += u64::from(is_fixed_and_harmless(&good, &features, start, name));
        }
    }
    n_fixed
}

/// The features without the four of one tag.
fn without(features: &[PointFeature], tag: usize) -> Vec<PointFeature> {
    [&features[..4 * tag], &features[4 * tag + 4..]].concat()
}

fn drawn_tag(features: &[PointFeature], noise: &mut Noise) -> usize {
    usize::try_from(noise.bits() % (features.len() as u64 / 4)).expect("small")
}

#[test]
fn a_wrong_id_is_refused_or_harmless() {
    let fixed = tried("wrong id", 60, |features, noise| {
        let tag = drawn_tag(features, noise);
        let good = without(features, tag);
        let other = (tag + 1) % (features.len() / 4);
        for corner in 0..4 {
            features[4 * tag + corner].place = features[4 * other + corner].place;
        }
        good
    });
    assert_eq!(fixed, [60; 3], "the other tags outvote it");
}

#[test]
fn swapped_corners_are_refused_or_harmless() {
    for (name, order) in [("rotated", [1, 2, 3, 0]), ("mirrored", [1, 0, 3, 2])] {
        let fixed = tried(name, 40, |features, noise| {
            let tag = drawn_tag(features, noise);
            let good = without(features, tag);
            let pixels = order.map(|k| features[4 * tag + k].pixel);
            for (feature, pixel) in features[4 * tag..].iter_mut().zip(pixels) {
                feature.pixel = pixel;
            }
            good
        });
        assert_eq!(fixed, [40; 3], "{name}: the other tags outvote it");
    }
}

#[test]
fn a_tag_that_was_moved_is_refused_or_harmless() {
    let fixed = tried("moved", 60, |features, noise| {
        let tag = drawn_tag(features, noise);
        let good = without(features, tag);
        let direction = noise.normal3().normalize() * 0.3;
        for feature in &mut features[4 * tag..4 * tag + 4] {
            feature.place = Point::from_coords(feature.place.coords + direction);
        }
        // Moved along the line of sight some corners hardly move in the picture: those may stay.
        good
    });
    assert!(fixed.iter().all(|&n| n >= 57), "{fixed:?}");
}

#[test]
fn outliers_in_three_of_ten_corners_are_refused_or_harmless() {
    let fixed = tried("outliers", 100, |features, noise| {
        let n_bad = features.len() * 3 / 10;
        let mut bad = vec![false; features.len()];
        while bad.iter().filter(|is_bad| **is_bad).count() < n_bad {
            let victim = usize::try_from(noise.bits() % bad.len() as u64).expect("small");
            bad[victim] = true;
        }
        let pairs = features.iter().zip(&bad);
        let good = pairs.filter(|(_, is_bad)| !**is_bad).map(|(feature, _)| *feature).collect();
        for (feature, _) in features.iter_mut().zip(&bad).filter(|(_, is_bad)| **is_bad) {
            let (sin, cos) = noise.between(0.0, std::f64::consts::TAU).sin_cos();
            feature.pixel += Vector2::new(cos, sin) * noise.between(8.0, 60.0);
        }
        good
    });
    println!(
        "fixed of 100 with 30 % outliers: cold {}, gravity {}, prior {}",
        fixed[0], fixed[1], fixed[2]
    );
    assert!(fixed.iter().all(|&n| n >= 90), "{fixed:?}");
}

/// One slanted tag far away: two poses explain it nearly as well.
fn one_far_tag() -> [Point<Hall>; 4] {
    // Its normal is 40° off the line of sight, sideways.
    let right =
        Vector3::new(0.5 * 40_f64.to_radians().sin(), -0.5 * 40_f64.to_radians().cos(), 0.0);
    let up = Vector3::new(0.0, 0.0, 0.5);
    let corner = Vector3::new(12.0, -0.5, 2.5);
    [corner, corner + right, corner + right + up, corner + up].map(Point::from_coords)
}

/// The same, leaning forward: its flip lies on its side by twice the slant.
fn one_leaning_tag() -> [Point<Hall>; 4] {
    let right = Vector3::new(0.0, -0.5, 0.0);
    let up = Vector3::new(-0.5 * 40_f64.to_radians().sin(), 0.0, 0.5 * 40_f64.to_radians().cos());
    let corner = Vector3::new(16.0, -0.5, 2.0);
    [corner, corner + right, corner + right + up, corner + up].map(Point::from_coords)
}

/// Of 200 frames of one tag: fixed on the right side, refused. Anything else fails.
fn flips(tag: [Point<Hall>; 4], start: impl Fn(&Transform<Hall, Body>) -> Start<'_>) -> (u32, u32) {
    let (camera, pose) = (distorted_camera(), truth());
    let settings = Settings { corner_sigma_px: 0.3, max_position_sigma_m: 10.0 };
    let (mut n_fixed, mut n_refused) = (0, 0);
    for seed in 0..200 {
        let mut noise = SeedBook::new(seed).stream("flip");
        let features = seen_tags(&camera, &[tag], &pose, (0.3, &mut noise));
        assert_eq!(features.len(), 4);
        match solve_from(&camera, &features, start(&pose), &settings) {
            Ok(fix) => {
                // A flip turns by some 80° and shifts by metres; far less of a turn is noise.
                let turned_rad = fix.hall_from_body.rotation.minus(&pose.rotation).norm();
                assert!(turned_rad < 0.35, "seed {seed}: {}", error(&fix, &pose));
                n_fixed += 1;
            }
            Err(refusal) => {
                assert_eq!(refusal, NoFix::NotObservable, "seed {seed}");
                n_refused += 1;
            }
        }
    }
    (n_fixed, n_refused)
}

#[test]
fn a_planar_flip_is_refused_unless_something_decides() {
    let (fixed, refused) = flips(one_far_tag(), |_| cold(None));
    println!("one far tag, cold: {fixed} fixed, {refused} refused");
    assert!(refused > 100, "{refused}");
    // The flip of this tag turns the body about the vertical and leans it by some degrees only:
    // gravity may decide, but not wrongly.
    let gravity_there = gravity(&truth());
    let (fixed, refused) = flips(one_far_tag(), |_| cold(Some(gravity_there)));
    assert_eq!(fixed + refused, 200);
    // The flip of this one lays the body on its side.
    let (_, refused) = flips(one_leaning_tag(), |_| cold(None));
    assert!(refused > 100, "{refused}");
    let (fixed, _) = flips(one_leaning_tag(), |_| cold(Some(gravity_there)));
    assert_eq!(fixed, 200, "gravity decides");
    // A prior is on one side.
    let (fixed, _) = flips(one_far_tag(), |pose| Start::Prior(pose));
    assert_eq!(fixed, 200, "the prior decides");
}

#[test]
fn gravity_refuses_a_body_that_lies_on_its_side() {
    // One near tag whose corners are counted from the wrong one: an exact pose, rolled by 90°.
    let tag = wall_tags()[1];
    let pose = truth().perturbed(&Vector3::new(6.0, 0.0, -1.0), &Vector3::zeros());
    let mut noise = SeedBook::new(2).stream("px");
    let mut features = seen_tags(&distorted_camera(), &[tag], &pose, (0.0, &mut noise));
    let pixels = [1, 2, 3, 0].map(|k: usize| features[k].pixel);
    for (feature, pixel) in features.iter_mut().zip(pixels) {
        feature.pixel = pixel;
    }
    let solve =
        |gravity| solve_from(&distorted_camera(), &features, cold(gravity), &Settings::default());
    let fix = solve(None).expect("the pixels alone cannot tell");
    assert!(error(&fix, &pose).fixed_rows::<3>(3).norm() > 1.5);
    assert_eq!(solve(Some(gravity(&pose))), Err(NoFix::BadResidual));
}
