use super::*;
use crate::geometry::{Camera, Rotation};
use crate::localization::camera_model::Lens;
use crate::localization::vision_fix::Reprojector;
use crate::stats::{Noise, SeedBook};

fn camera() -> CameraModel {
    CameraModel {
        width_px: 1280,
        height_px: 800,
        fx_px: 640.0,
        fy_px: 642.0,
        cx_px: 641.0,
        cy_px: 398.0,
        lens: Lens::radial_tangential([-0.05, 0.01], [0.0004, -0.0003]),
        readout: std::time::Duration::ZERO,
        body_from_camera: Transform::new(
            Rotation::<Body, Camera>::from_euler_rad(-1.5, 0.05, -1.6),
            Point::new(0.1, 0.02, 0.03),
        ),
    }
}

/// Tags on two walls at a right angle, x = 10 and y = 8, edges of 0.4 m.
fn tags() -> Vec<Transform<Hall, Tag>> {
    let pose = |right: Vector3<f64>, place: Vector3<f64>| {
        let up = Vector3::z();
        let axes = Matrix3::from_columns(&[right, up, right.cross(&up)]);
        Transform::new(Rotation::from_matrix(&axes), Point::from_coords(place))
    };
    let mut tags = Vec::new();
    for (i, z) in [1.0, 2.5, 4.0].into_iter().enumerate() {
        for k in 0..4 {
            let along = 0.8 + 1.9 * f64::from(k) + 0.1 * i as f64;
            tags.push(pose(-Vector3::y(), Vector3::new(10.0, along, z)));
            tags.push(pose(Vector3::x(), Vector3::new(along, 8.0, z + 0.2)));
        }
    }
    tags
}

/// A walk along a diagonal with turns of the head; each frame sees what is in the picture.
fn survey(noise: &mut Noise, sigma_px: f64) -> (Survey, Vec<Transform<Hall, Tag>>) {
    let (camera, truth) = (camera(), tags());
    let mut views = Vec::new();
    for step in 0..60 {
        let at = f64::from(step) / 60.0;
        let yaw = 0.2 + 1.4 * (0.5 - 0.5 * (9.0 * at).cos());
        let body = Transform::<Hall, Body>::new(
            Rotation::from_euler_rad(0.03 * (7.0 * at).sin(), 0.02, yaw),
            Point::new(1.0 + 5.0 * at, 1.0 + 3.0 * (5.0 * at).sin().abs(), 1.2 + at),
        );
        let reprojector = Reprojector::new(&camera, &body);
        let sight = |(tag, pose): (usize, &Transform<Hall, Tag>)| {
            let mut corners_px = [[0.0; 2]; 4];
            for (corner, pixel) in corners_in_tag(0.4).iter().zip(&mut corners_px) {
                let (seen, _) = reprojector.reproject(&(*pose * *corner))?;
                if !camera.contains(&seen, 2.0) {
                    return None;
                }
                *pixel = [seen.x + sigma_px * noise.normal(), seen.y + sigma_px * noise.normal()];
            }
            Some(Sighting { tag, corners_px })
        };
        let sightings: Vec<Sighting> = truth.iter().enumerate().filter_map(sight).collect();
        views.push(View { camera: 0, sightings });
    }
    let known = |tag: usize| KnownTag { tag, hall_from_tag: truth[tag], corner_sigma_m: 0.002 };
    let survey = Survey {
        cameras: vec![camera],
        edges_m: vec![0.4; truth.len()],
        views,
        known: vec![known(0), known(7), known(20)],
        tapes: vec![],
        corner_sigma_px: sigma_px.max(0.01),
        scale_sigma: 0.003,
    };
    (survey, truth)
}

/// Every derivative against central differences, at poses that are turned about all axes.
#[test]
fn adjustment_jacobian_matches_central_difference() {
    let (survey, truth) = survey(&mut SeedBook::new(4).stream("pixels"), 0.5);
    let bodies = start::located(&survey).unwrap().bodies;
    let tilted = |t: &Transform<Hall, Tag>| {
        Some(t.perturbed(&Vector3::new(0.02, -0.01, 0.03), &Vector3::new(0.1, -0.07, 0.05)))
    };
    let located =
        start::Located { tags: truth.iter().map(tilted).collect(), bodies, edge_factor: 1.0 };
    let problem = Problem::new(&survey, located.clone());
    let residual = |tags: &[Option<Transform<Hall, Tag>>],
                    v: usize,
                    body: Transform<Hall, Body>,
                    tag: usize,
                    k: usize,
                    scale: f64| {
        let mut survey = survey.clone();
        survey.edges_m.iter_mut().for_each(|edge_m| *edge_m *= scale.exp());
        let located = start::Located { tags: tags.to_vec(), ..located.clone() };
        let problem = Problem::new(&survey, located);
        let view = &survey.views[v];
        let sighting = view.sightings.iter().find(|s| s.tag == tag).unwrap();
        let reprojector = Reprojector::new(&survey.cameras[0], &body);
        problem.corner(&reprojector, tag, k, sighting.corners_px[k]).unwrap().residual_px
    };
    const H: f64 = 1e-6;
    let mut n_checked = 0;
    for v in [3, 22, 41] {
        let body = located.bodies[v].unwrap();
        let tag = survey.views[v].sightings[0].tag;
        let reprojector = Reprojector::new(&survey.cameras[0], &body);
        for k in 0..4 {
            let corner =
                problem.corner(&reprojector, tag, k, survey.views[v].sightings[0].corners_px[k]);
            let corner = corner.unwrap();
            for axis in 0..6 {
                let step = |h: f64| {
                    let mut d = [Vector3::zeros(), Vector3::zeros()];
                    d[axis / 3][axis % 3] = h;
                    d
                };
                let with_body = |h: f64| {
                    let [m, rad] = step(h);
                    residual(&located.tags, v, body.perturbed(&m, &rad), tag, k, 0.0)
                };
                let with_tag = |h: f64| {
                    let [m, rad] = step(h);
                    let mut tags = located.tags.clone();
                    tags[tag] = tags[tag].map(|pose| pose.perturbed(&m, &rad));
                    residual(&tags, v, body, tag, k, 0.0)
                };
                // Residuals fall where pixels rise.
                let by_body = (with_body(-H) - with_body(H)) / (2.0 * H);
                let by_tag = (with_tag(-H) - with_tag(H)) / (2.0 * H);
                assert!((by_body - corner.by_body.column(axis)).norm() < 1e-4, "{v} {k} {axis}");
                assert!((by_tag - corner.by_tag.column(axis)).norm() < 1e-4, "{v} {k} {axis}");
                n_checked += 1;
            }
            let with_scale = |h: f64| residual(&located.tags, v, body, tag, k, h);
            let by_scale = (with_scale(-H) - with_scale(H)) / (2.0 * H);
            assert!((by_scale - corner.by_scale).norm() < 1e-4);
        }
    }
    assert_eq!(n_checked, 72);
}

#[test]
fn without_noise_the_truth_comes_back() {
    let (survey, truth) = survey(&mut SeedBook::new(1).stream("pixels"), 0.0);
    let map = adjust(&survey).unwrap();
    for (tag, truth) in map.tags.iter().zip(&truth) {
        let off = (tag.unwrap().origin - truth.origin).coords.norm();
        assert!(off < 1e-6, "{off} m");
    }
    assert_eq!(map.n_outliers, 0);
}

/// Positions in their own covariance: 3 degrees of freedom each, so the mean of the normalised squares is 3
/// over many noises; tags of one survey are correlated, surveys are not.
#[test]
fn every_tag_is_found_within_what_is_claimed() {
    let (mut sum, mut n, mut n_within) = (0.0, 0.0, 0.0);
    for seed in 0..12 {
        let (mut survey, truth) = survey(&mut SeedBook::new(seed).stream("pixels"), 0.3);
        // Known places are as wrong as they say.
        let mut noise = SeedBook::new(seed).stream("known");
        for known in &mut survey.known {
            let sigma_m = known.corner_sigma_m;
            let turn = noise.normal3() * (sigma_m / 0.4);
            known.hall_from_tag =
                known.hall_from_tag.perturbed(&(noise.normal3() * (0.5 * sigma_m)), &turn);
        }
        let factor = (0.003 * noise.normal()).exp();
        survey.edges_m.iter_mut().for_each(|edge_m| *edge_m *= factor);
        let map = adjust(&survey).unwrap();
        assert!((0.8..1.25).contains(&map.variance_factor), "{}", map.variance_factor);
        for (tag, truth) in truth.iter().enumerate() {
            let off = (map.tags[tag].unwrap().origin - truth.origin).coords;
            let cov = map.pose_cov(tag).unwrap().fixed_view::<3, 3>(0, 0).into_owned();
            sum += off.dot(&(cov.try_inverse().unwrap() * off));
            n += 1.0;
            n_within +=
                (0..3).filter(|k| off[*k].abs() < 2.0 * cov[(*k, *k)].sqrt()).count() as f64;
        }
    }
    println!("NEES {:.2} of 3, {:.3} of the axes within 2σ", sum / n, n_within / (3.0 * n));
    // Twelve surveys: the band is that of a χ² with about 12 · 9 degrees of freedom, not 12 · 24 · 3.
    assert!((2.0..4.2).contains(&(sum / n)), "{}", sum / n);
    assert!(n_within / (3.0 * n) > 0.9);
}

#[test]
fn wrong_corners_are_left_out_and_a_tape_holds_the_scale() {
    let (mut survey, truth) = survey(&mut SeedBook::new(7).stream("pixels"), 0.3);
    let mut noise = SeedBook::new(7).stream("outliers");
    let mut wrong_views = Vec::new();
    for (v, view) in survey.views.iter_mut().enumerate() {
        for sighting in &mut view.sightings {
            if noise.chance(0.02) {
                sighting.corners_px[1][0] += 15.0;
                wrong_views.push(v);
            }
        }
    }
    // The printer has shrunk all sheets by 1 %, only one tag is known, and a tape goes across.
    survey.edges_m.iter_mut().for_each(|edge_m| *edge_m *= 1.01);
    survey.known.truncate(1);
    survey.scale_sigma = 0.02;
    let (a, b) = (0, 23);
    let loose = adjust(&survey).unwrap();
    let distance_m = (truth[a].origin - truth[b].origin).coords.norm();
    survey.tapes = vec![Tape { tags: [a, b], distance_m, sigma_m: 0.002 }];
    let held = adjust(&survey).unwrap();
    let (far_m, sigma_m) = held.distance([a, b]).unwrap();
    assert!((far_m - distance_m).abs() < 3.0 * sigma_m && sigma_m < 0.0025);
    assert!(loose.distance([a, b]).unwrap().1 > 5.0 * sigma_m);
    assert!((held.edge_factor - 1.0 / 1.01).abs() < 3.0 * held.edge_factor_sigma);
    // A frame that a wrong corner spoils as a whole is not used at all.
    let n_wrong = wrong_views.iter().filter(|v| held.bodies[**v].is_some()).count();
    assert!(n_wrong > 0 && held.n_outliers >= n_wrong, "{} of {n_wrong}", held.n_outliers);
    assert!(held.n_outliers < n_wrong + 20);
}

#[test]
fn what_is_tied_to_nothing_is_left_open_and_nothing_known_is_refused() {
    let (mut survey, _) = survey(&mut SeedBook::new(2).stream("pixels"), 0.3);
    survey.edges_m.push(0.4);
    let map = adjust(&survey).unwrap();
    assert!(map.tags[24].is_none() && map.pose_cov(24).is_none());
    survey.known.clear();
    assert_eq!(adjust(&survey), Err(AdjustError::NothingKnown));
}

#[test]
fn a_pose_makes_its_corners_and_corners_their_pose() {
    let pose = Transform::<Hall, Tag>::new(
        Rotation::from_euler_rad(0.4, -0.2, 2.0),
        Point::new(3.0, 1.0, 2.0),
    );
    let again = pose_of_corners(&corners_in_tag(0.3).map(|corner| pose * corner));
    assert!((again.origin - pose.origin).coords.norm() < 1e-12);
    assert!(again.rotation.minus(&pose.rotation).norm() < 1e-12);
}

/// A small share of everything that goes wrong with tags: two names exchanged in a frame, corners
/// in another order, a tag mirrored about the line of sight; and the largest picture of one tag
/// bears another's name. The same survey by plain least squares is off by more than ten times as much.
#[test]
fn wrong_names_swapped_corners_and_mirrored_tags_change_nothing() {
    for seed in 20..23 {
        println!("seed {seed}");
        let (mut survey, truth) = survey(&mut SeedBook::new(seed).stream("pixels"), 0.3);
        let n_wrong = spoil(&mut survey, &mut SeedBook::new(seed).stream("wrong"));
        let map = adjust(&survey).unwrap();
        let worst = |tags: &[Option<Transform<Hall, Tag>>]| {
            let off = |(tag, truth): (&Option<Transform<Hall, Tag>>, &Transform<Hall, Tag>)| {
                (tag.unwrap().origin - truth.origin).coords.norm()
            };
            tags.iter().zip(&truth).map(off).fold(0.0, f64::max)
        };
        for (tag, truth) in truth.iter().enumerate() {
            let off = map.tags[tag].unwrap().origin - truth.origin;
            let cov = map.pose_cov(tag).unwrap();
            for axis in 0..3 {
                // All of 24 tags, three axes, three seeds: 4σ happens by chance in 1 of 70 runs.
                let sigmas = off.coords[axis].abs() / cov[(axis, axis)].sqrt();
                assert!(sigmas < 4.0, "tag {tag} axis {axis}: {sigmas} σ, {off:?}");
            }
        }
        assert!(map.n_outliers > 2 * n_wrong, "{} of {n_wrong}", map.n_outliers);
        assert!((0.8..1.3).contains(&map.variance_factor), "{}", map.variance_factor);

        // The same from the best of starts, but each corner counts fully.
        let located = start::Located {
            tags: truth.iter().copied().map(Some).collect(),
            bodies: map.bodies.clone(),
            edge_factor: 1.0,
        };
        let mut plain = Problem::new(&survey, located);
        plain.is_robust = false;
        minimized(&mut plain, FINE_GAIN).unwrap();
        let (robust_m, plain_m) = (worst(&map.tags), worst(plain.tags()));
        println!("worst tag {robust_m:.4} m, by plain least squares {plain_m:.4} m");
        assert!(plain_m > 10.0 * robust_m, "{plain_m} {robust_m}");
    }
}

/// Spoils 6 % of the sightings and the best picture of tag 5; gives how many.
fn spoil(survey: &mut Survey, noise: &mut Noise) -> usize {
    let mut n_wrong = 0;
    for view in &mut survey.views {
        for i in 0..view.sightings.len() {
            if !noise.chance(0.06) {
                continue;
            }
            let other = (i + 1) % view.sightings.len();
            let corners_px = view.sightings[i].corners_px;
            match noise.bits() % 3 {
                0 if other != i => {
                    let wrong = view.sightings[other].corners_px;
                    view.sightings[i].corners_px = wrong;
                    view.sightings[other].corners_px = corners_px;
                    n_wrong += 1;
                }
                1 => view.sightings[i].corners_px.rotate_left(1),
                _ => view.sightings[i].corners_px = corners_px.map(|px| px).map_mirrored(),
            }
            n_wrong += 1;
        }
    }
    let size_px = |view: &View| {
        let of = |s: &Sighting| {
            let [a, c] = [s.corners_px[0], s.corners_px[2]];
            (a[0] - c[0]).hypot(a[1] - c[1])
        };
        view.sightings.iter().filter(|s| s.tag == 5).map(of).fold(0.0, f64::max)
    };
    let best = survey.views.iter_mut().max_by(|a, b| size_px(a).total_cmp(&size_px(b))).unwrap();
    let victim = best.sightings.iter_mut().find(|s| s.tag == 5).unwrap();
    victim.corners_px = victim.corners_px.map(|[x, y]| [x - 150.0, y + 90.0]);
    n_wrong + 1
}

/// The picture of a tag that is mirrored about the line of sight: as large and in the same place,
/// but what was near is far.
trait Mirrored {
    fn map_mirrored(self) -> Self;
}

impl Mirrored for [[f64; 2]; 4] {
    fn map_mirrored(self) -> Self {
        let middle = self.iter().fold([0.0; 2], |m, c| [m[0] + 0.25 * c[0], m[1] + 0.25 * c[1]]);
        // The perspective part of the outline turns around: opposite corners exchange their distances.
        [2, 3, 0, 1].map(|opposite: usize| {
            let c = self[opposite];
            [2.0 * middle[0] - c[0], 2.0 * middle[1] - c[1]]
        })
    }
}
