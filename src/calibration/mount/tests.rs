//! Beams of a LiDAR that is mounted otherwise than configured, in a room whose faces they meet exactly.

use super::*;
use crate::calibration::planes;
use crate::geometry::{Point, Rotation};
use crate::mapping::polygon::Polygon;
use crate::stats::{Noise, SeedBook};
use std::f64::consts::{FRAC_PI_2, TAU};

fn nominal() -> LidarMount {
    LidarMount {
        body_from_lidar: Transform::new(
            Rotation::from_euler_rad(0.0, FRAC_PI_2, 0.0),
            Point::new(0.08, 0.0, -0.06),
        ),
        range_sigma_m: 0.012,
        angle_sigma_rad: 0.0017,
        min_range_m: 0.15,
        max_range_m: 12.0,
        blind_sectors_rad: vec![(2.1, 3.2), (-3.2, -2.1)],
    }
}

fn before() -> Before {
    Before {
        lidar: nominal(),
        position_sigma_m: 0.01,
        rotation_sigma_rad: 0.5_f64.to_radians(),
        range_bias_sigma_m: 0.002,
        clock_sigma_s: 0.05,
    }
}

fn room() -> Vec<Plane> {
    let corners = [(0.0, 0.0), (14.0, 0.0), (14.0, 12.0), (0.0, 12.0)];
    let walls = Polygon::new(&corners).expect("a rectangle");
    planes::Hall {
        floor_m: (0.0, 0.001),
        walls: Some((walls, 0.002)),
        ceiling_m: None,
        material: None,
        material_height_m: 0.0,
    }
    .planes()
}

/// Range along a ray to the nearest face of the room in front of it, m.
fn ray_range_m(from: &Vector3<f64>, along: &Vector3<f64>) -> f64 {
    let to = |start: f64, speed: f64, low: f64, high: f64| {
        let end = if speed > 0.0 { high } else { low };
        if speed.abs() < 1e-12 { f64::INFINITY } else { (end - start) / speed }
    };
    let x = to(from.x, along.x, 0.0, 14.0);
    let y = to(from.y, along.y, 0.0, 12.0);
    let z = to(from.z, along.z, 0.0, 1e9);
    x.min(y).min(z)
}

/// The stamps come this late, s.
const LATE_S: f64 = 0.004;
/// Turns per second.
const TURNS_HZ: f64 = 10.0;

/// A flight of `n_turns` with headings from `yaw_rad`, its poses wrong by slow errors of a few millimetres.
fn flight(
    truth: &Transform<Body, Lidar>,
    n_turns: u32,
    yaw_rad: impl Fn(f64) -> f64,
    noise: &mut Noise,
) -> Vec<PlacedTurn> {
    let pose_sigma = (0.003, 0.0005);
    let mut slow = Vector6::zeros();
    let at = |share: f64| {
        let place =
            Point::new(7.0 + 4.0 * (TAU * share).sin(), 6.0 + 3.0 * (2.0 * TAU * share).cos(), 3.0);
        let attitude = Rotation::from_euler_rad(
            0.03 * (40.0 * share).sin(),
            0.03 * (31.0 * share).cos(),
            yaw_rad(share),
        );
        Transform::<Hall, Body>::new(attitude, place)
    };
    let share_of_s = TURNS_HZ / f64::from(n_turns);
    (0..n_turns)
        .map(|turn| {
            let share = f64::from(turn) / f64::from(n_turns);
            // Stamped now, measured a little before.
            let (stamped, pose) = (at(share), at(share - LATE_S * share_of_s));
            let ahead = at(share + 1e-3 * share_of_s);
            let velocity_mps = (ahead.origin - stamped.origin).coords * 1e3;
            let rate_radps = ahead.rotation.minus(&stamped.rotation) * 1e3;
            // Errors that last some turns.
            let fresh = Vector6::from_fn(|k, _| {
                if k < 3 { pose_sigma.0 * noise.normal() } else { pose_sigma.1 * noise.normal() }
            });
            slow = slow * 0.8 + fresh * 0.6;
            let believed = stamped.perturbed(
                &slow.fixed_rows::<3>(0).into_owned(),
                &slow.fixed_rows::<3>(3).into_owned(),
            );
            let hall_from_lidar = pose * *truth;
            let beams = (0..120).map(|k| {
                let angle_rad = f64::from(k) * TAU / 120.0 - 3.1;
                let (sin, cos) = (angle_rad + 0.0017 * noise.normal()).sin_cos();
                let along = hall_from_lidar.rotation.matrix() * Vector3::new(cos, sin, 0.0);
                let range_m = ray_range_m(&hall_from_lidar.origin.coords, &along);
                PlacedBeam {
                    hall_from_body: believed,
                    angle_rad,
                    range_m: range_m + 0.012 * noise.normal(),
                }
            });
            PlacedTurn {
                velocity_mps,
                rate_radps,
                pose_cov: Matrix6::from_diagonal(&Vector6::new(
                    9e-6, 9e-6, 9e-6, 2.5e-7, 2.5e-7, 2.5e-7,
                )),
                beams: beams.collect(),
            }
        })
        .collect()
}

fn wrong_by() -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(0.012, -0.02, 0.008), Vector3::new(0.9, -0.7, 0.5).map(f64::to_radians))
}

#[test]
fn a_turning_flight_shows_the_whole_mounting() {
    let (shift_m, turn_rad) = wrong_by();
    let truth = nominal().body_from_lidar.perturbed(&shift_m, &turn_rad);
    let mut z = Vec::new();
    for seed in 0..6 {
        let mut noise = SeedBook::new(seed).stream("mount");
        let turns = flight(&truth, 400, |share| 4.0 * TAU * share, &mut noise);
        let found = calibrate(&turns, &room(), &before(), &Limits::default()).expect("found");
        for (axis, Found { change, sigma, is_seen, halves_z }) in found.axes.iter().enumerate() {
            let expected = if axis < 3 { shift_m[axis] } else { turn_rad[axis - 3] };
            let limit = if axis < 3 { 0.005 } else { 0.1_f64.to_radians() };
            assert!(is_seen, "seed {seed}, {}: ± {sigma}", AXES[axis]);
            assert!((change - expected).abs() < limit, "seed {seed}, {}: {change}", AXES[axis]);
            assert!(halves_z.abs() < 3.5, "seed {seed}, {}: {halves_z}", AXES[axis]);
            z.push((change - expected) / sigma);
        }
        let clock = found.clock_offset_s;
        let off_s = clock.change - LATE_S;
        assert!(clock.is_seen && off_s.abs() < 3.5 * clock.sigma, "seed {seed}: {clock:?}");
        z.push(off_s / clock.sigma);
        assert!(found.faces.iter().all(|face| face.n_beams > 100), "{:?}", found.faces);
    }
    // The stated σ are the scatter: 42 numbers, a factor of 1.6 either way.
    let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
    assert!((0.6..1.6).contains(&rms), "rms z {rms}: {z:?}");
}

#[test]
fn what_one_heading_does_not_show_is_left_and_named() {
    let (shift_m, turn_rad) = wrong_by();
    let truth = nominal().body_from_lidar.perturbed(&shift_m, &turn_rad);
    let mut noise = SeedBook::new(1).stream("mount");
    let turns = flight(&truth, 400, |_| 0.0, &mut noise);
    let found = calibrate(&turns, &room(), &before(), &Limits::default()).expect("found");
    // The scan plane stands across the flight: nothing says where along it the LiDAR sits.
    assert!(!found.axes[0].is_seen, "{:?}", found.axes[0]);
    assert!(found.axes[0].change.abs() < 1e-15 && (found.axes[0].sigma - 0.01).abs() < 1e-15);
    // How far it leans about its own axis is plain.
    assert!(found.axes[5].is_seen, "{:?}", found.axes[5]);
    assert!((found.axes[5].change - turn_rad.z).abs() < 0.1_f64.to_radians());
}

#[test]
fn a_floor_of_unknown_level_hides_the_height() {
    let (shift_m, turn_rad) = wrong_by();
    let truth = nominal().body_from_lidar.perturbed(&shift_m, &turn_rad);
    let mut noise = SeedBook::new(2).stream("mount");
    let turns = flight(&truth, 400, |share| 4.0 * TAU * share, &mut noise);
    let mut faces = room();
    faces[0].sigma_m = 0.02;
    let found = calibrate(&turns, &faces, &before(), &Limits::default()).expect("found");
    assert!(!found.axes[2].is_seen, "{:?}", found.axes[2]);
    assert!(found.axes[0].is_seen && found.axes[1].is_seen, "{:?}", found.axes);
}

#[test]
fn no_walls_in_sight_is_an_error() {
    let found = calibrate(&[], &room(), &before(), &Limits::default());
    assert_eq!(found.unwrap_err(), CalibrationError::TooFew { n_beams: 0 });
}

/// The LiDAR slips half-way: by 15 mm along the body, and about its own axis. A large slip makes the σ of that axis so
/// large that it would pass for one that was not seen.
#[test]
fn a_mounting_that_slips_in_flight_contradicts_itself_where_it_slipped() {
    let (shift_m, turn_rad) = wrong_by();
    let truth = nominal().body_from_lidar.perturbed(&shift_m, &turn_rad);
    for (seed, slip_deg) in [(0, 0.4), (1, 0.8), (2, 0.8), (3, 1.2_f64)] {
        let slip = Vector3::new(0.0, 0.0, slip_deg.to_radians());
        let slipped = truth.perturbed(&Vector3::new(0.015, 0.0, 0.0), &slip);
        let mut noise = SeedBook::new(seed).stream("slip");
        let yaw = |share: f64| 8.0 * TAU * share;
        let mut turns = flight(&truth, 400, yaw, &mut noise);
        let later = flight(&slipped, 400, yaw, &mut noise);
        turns.splice(200.., later.into_iter().skip(200));
        let found = calibrate(&turns, &room(), &before(), &Limits::default()).expect("found");
        let z = found.axes.map(|axis| axis.halves_z);
        println!("seed {seed}, {slip_deg}°: {z:.1?}, seen {:?}", found.axes.map(|a| a.is_seen));
        assert!(found.axes[5].contradicts_itself(), "seed {seed}, {slip_deg}°: {z:?}");
    }
}

#[test]
fn halves_that_hardly_agree_widen_what_is_claimed() {
    let found = |halves_z, is_seen| Found { change: 0.01, sigma: 0.002, is_seen, halves_z };
    for (halves_z, sigma, contradicts) in [
        (0.3, 0.002, false),
        (-1.9, 0.002, false),
        (2.5, 0.0025, false),
        (-3.0, 0.003, false),
        (3.1, 0.0031, true),
        (-4.0, 0.004, true),
    ] {
        let axis = found(halves_z, true);
        assert!((axis.sigma_by_halves() - sigma).abs() < 1e-15, "{halves_z}");
        assert_eq!(axis.contradicts_itself(), contradicts, "{halves_z}");
    }
    // What was not seen stays as configured, and so does its σ; that halves are far apart can be why.
    let unseen = found(7.0, false);
    assert!(unseen.contradicts_itself() && (unseen.sigma_by_halves() - 0.002).abs() < 1e-15);
}
