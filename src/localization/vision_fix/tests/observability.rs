//! Where the points leave something free, there is no covariance.

use super::*;

fn features_of(places: &[Point<Hall>]) -> Vec<PointFeature> {
    places
        .iter()
        .map(|place| PointFeature {
            place: *place,
            pixel: pixel_of(&distorted_camera(), &truth(), place).expect("in view"),
        })
        .collect()
}

fn refusals(places: &[Point<Hall>]) -> [Option<NoFix>; 2] {
    let features = features_of(places);
    let settings = Settings { corner_sigma_px: 0.5, max_position_sigma_m: 1e9 };
    [Start::Prior(&truth()), cold(None)]
        .map(|start| solve_from(&distorted_camera(), &features, start, &settings).err())
}

const UNOBSERVABLE: [Option<NoFix>; 2] = [Some(NoFix::NotObservable); 2];

#[test]
fn no_points_three_points_and_repeated_points_are_not_enough() {
    let none = solve(&distorted_camera(), &[], None, &Settings::default());
    assert_eq!(none, Err(NoFix::NoKnownTag));
    let tag = wall_tags()[1];
    assert_eq!(refusals(&tag[..3]), UNOBSERVABLE);
    let few = [tag[0], tag[0], tag[1], tag[1]];
    assert_eq!(refusals(&few), UNOBSERVABLE);
}

#[test]
fn points_on_a_line_are_not_observable() {
    let line: Vec<Point<Hall>> = (0..9)
        .map(|k| f64::from(k) * 0.5)
        .map(|s| Point::new(9.0 + 0.2 * s, -2.0 + s, 3.0 + 0.3 * s))
        .collect();
    assert_eq!(refusals(&line), UNOBSERVABLE);
    // A millimetre beside the line is no more than noise.
    let mut bent = line;
    for (k, place) in bent.iter_mut().enumerate() {
        place.coords.z += if k % 2 == 0 { 1e-3 } else { -1e-3 };
    }
    assert_eq!(refusals(&bent), UNOBSERVABLE);
}

#[test]
fn a_plane_seen_from_its_edge_is_not_observable() {
    // All points in a plane through the camera: one line of pixels.
    let camera_m = (truth() * distorted_camera().body_from_camera).origin.coords;
    let up = Vector3::new(0.02, 0.1, 1.0).normalize();
    let places: Vec<Point<Hall>> = [(8.0, -1.5), (9.0, 0.5), (7.0, -0.3), (11.0, 2.0), (6.0, 1.0)]
        .map(|(x, y): (f64, f64)| {
            let flat = Vector3::new(x, y, 0.0);
            Point::from_coords(camera_m + flat - up * (flat.dot(&up) / up.dot(&up)))
        })
        .to_vec();
    assert_eq!(refusals(&places), UNOBSERVABLE);
}

#[test]
fn a_fix_less_certain_than_allowed_is_not_observable() {
    let features = features_of(&wall_tags()[1]);
    let at_most = |max_position_sigma_m| Settings { corner_sigma_px: 0.5, max_position_sigma_m };
    let fix = solve(&distorted_camera(), &features, Some(&truth()), &at_most(10.0)).expect("a fix");
    let sigma_m = (0..3).map(|k| fix.pose_cov[(k, k)].sqrt()).fold(0.0, f64::max);
    let refused = solve(&distorted_camera(), &features, Some(&truth()), &at_most(0.99 * sigma_m));
    assert_eq!(refused, Err(NoFix::NotObservable));
}

#[test]
fn a_prior_that_leads_nowhere_gives_no_fix() {
    let features = seen(&truth(), 0.0, &mut SeedBook::new(1).stream("px"));
    let looking_back = truth().perturbed(&Vector3::zeros(), &Vector3::new(0.0, 0.0, 3.1));
    let lost = solve(&distorted_camera(), &features, Some(&looking_back), &Settings::default());
    assert!(lost.is_err());
}
