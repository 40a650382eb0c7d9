//! Points that belong to no tag.

use super::*;

fn fix_from(places: &[Vector3<f64>], sigma_px: f64, start: Start<'_>) -> Result<FixOutcome, NoFix> {
    let mut noise = SeedBook::new(31).stream("px");
    let features: Vec<PointFeature> = places
        .iter()
        .map(|&place| {
            let place = Point::from_coords(place);
            let pixel = pixel_of(&distorted_camera(), &truth(), &place).expect("in view");
            let blur = Vector2::new(noise.normal(), noise.normal()) * sigma_px;
            PointFeature { place, pixel: pixel + blur }
        })
        .collect();
    solve_from(&distorted_camera(), &features, start, &Settings::default())
}

fn scattered() -> Vec<Vector3<f64>> {
    [
        (9.0, -2.0, 3.0),
        (6.0, 1.0, 2.6),
        (10.0, 2.5, 5.4),
        (5.0, -1.0, 3.9),
        (7.5, 0.4, 5.0),
        (8.2, -2.2, 4.9),
        (5.5, 1.2, 3.8),
    ]
    .map(|(x, y, z)| Vector3::new(x, y, z))
    .to_vec()
}

fn on_a_wall() -> Vec<Vector3<f64>> {
    [(-2.0, 2.0), (1.0, 2.4), (2.2, 4.9), (-1.4, 5.2), (0.1, 3.1)]
        .map(|(y, z)| Vector3::new(8.0 + 0.3 * y, y, z))
        .to_vec()
}

fn is_within_4_sigma(fix: &FixOutcome) -> bool {
    let e = error(fix, &truth());
    (0..6).all(|k| e[k].abs() < 4.0 * fix.pose_cov[(k, k)].sqrt())
}

#[test]
fn scattered_points_give_a_pose_from_nothing() {
    let fix = fix_from(&scattered(), 0.0, cold(None)).expect("a fix");
    assert!(error(&fix, &truth()).norm() < 1e-6);
    let fix = fix_from(&scattered(), 0.4, cold(None)).expect("a fix");
    assert!(is_within_4_sigma(&fix), "{}", error(&fix, &truth()));
    // Five that do not lie in a plane need a prior.
    assert_eq!(fix_from(&scattered()[..5], 0.0, cold(None)), Err(NoFix::NotObservable));
    let fix = fix_from(&scattered()[..5], 0.0, Start::Prior(&truth())).expect("a fix");
    assert!(error(&fix, &truth()).norm() < 1e-6);
}

#[test]
fn points_on_a_wall_give_a_pose_from_nothing() {
    let fix = fix_from(&on_a_wall(), 0.0, cold(None)).expect("a fix");
    assert!(error(&fix, &truth()).norm() < 1e-6);
    let fix = fix_from(&on_a_wall(), 0.4, cold(Some(gravity(&truth())))).expect("a fix");
    assert!(is_within_4_sigma(&fix), "{}", error(&fix, &truth()));
}

#[test]
fn points_sharpen_what_tags_say() {
    let tag: Vec<Vector3<f64>> = wall_tags()[1].map(|corner| corner.coords * 0.6).to_vec();
    let alone = fix_from(&tag, 0.0, Start::Prior(&truth())).expect("a fix");
    let both = [tag, scattered()].concat();
    let fix = fix_from(&both, 0.4, cold(None)).expect("a fix");
    assert!(is_within_4_sigma(&fix));
    assert!(fix.q_position > 3.0 * alone.q_position);
    // A tag is found among the points wherever it stands.
    let behind = [scattered(), wall_tags()[1].map(|corner| corner.coords).to_vec()].concat();
    assert!(error(&fix_from(&behind, 0.0, cold(None)).expect("a fix"), &truth()).norm() < 1e-6);
}

#[test]
fn features_of_a_frame_are_its_mapped_tags_and_points_each_once() {
    let mut map = map_of(&wall_tags());
    let lamp = Point::new(3.0, 1.0, 6.0);
    map.insert_point(3, lamp).expect("a point");
    map.insert_point(4, lamp).expect("a point");
    let tag = |id, first: f64| TagDetection {
        id,
        family: TagFamily::Tag36h11,
        corners_px: [[first, 1.0], [2.0, 1.0], [2.0, 0.0], [1.0, 0.0]],
        decision_margin: 50.0,
    };
    let point = |id, u| PointDetection { id, pixel_px: [u, 7.0] };
    let frame = TagDetections {
        captured_at: Stamp::ZERO,
        received_at: Stamp::ZERO,
        camera: CameraId(0),
        tags: vec![tag(11, 1.0), tag(12, 5.0), tag(12, 6.0), tag(77, 1.0)],
        points: vec![point(3, 20.0), point(4, 30.0), point(4, 31.0), point(9, 40.0)],
    };
    let features = frame_features(&map, &frame);
    assert_eq!(features.len(), 5);
    assert_eq!(features[0].place, wall_tags()[1][0]);
    assert_eq!(features[4], PointFeature { place: lamp, pixel: Vector2::new(20.0, 7.0) });
}
