use super::*;
use crate::geometry::{Camera, Rotation};
use crate::localization::camera_model::Lens;
use crate::localization::vision_fix::predicted_cov;
use crate::mapping::polygon::Polygon;
use crate::mapping::region::Rect;
use crate::mapping::solid::{Prism, Solid};
use crate::messages::TagFamily;
use crate::planning::space::SpaceSettings;
use crate::planning::what_if::{Layout, candidates};
use crate::stats::SeedBook;
use nalgebra::Vector3;
use std::time::Duration;

/// A hall of 16 m × 12 m × 7 m.
pub(in crate::planning) fn walls() -> Polygon {
    Polygon::from(Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 16.0, y_max_m: 12.0 })
}

/// Looks forward and a little down.
pub(in crate::planning) fn camera() -> CameraModel {
    let quarter = std::f64::consts::FRAC_PI_2;
    CameraModel {
        width_px: 1280,
        height_px: 800,
        fx_px: 640.0,
        fy_px: 640.0,
        cx_px: 640.0,
        cy_px: 400.0,
        lens: Lens::pinhole(),
        readout: Duration::ZERO,
        body_from_camera: Transform::new(
            Rotation::<Body, Camera>::from_euler_rad(-quarter - 0.15, 0.0, -quarter),
            Point::new(0.1, 0.0, -0.02),
        ),
    }
}

/// Tags of 0.6 m on the walls that `hangs` names by the direction that they face.
pub(in crate::planning) fn marker_map(hangs: impl Fn(&Vector3<f64>) -> bool) -> MarkerMap {
    let layout = Layout { spacing_m: 1.7, rows_m: (1.0, 6.5), edge_m: 0.6 };
    let mut map = MarkerMap::default();
    let all = candidates(&walls(), &layout, &[]);
    for (id, tag) in all.iter().filter(|tag| hangs(&tag.facing)).enumerate() {
        let id = u32::try_from(id).expect("few");
        map.insert(TagFamily::Tag36h11, id, tag.corners).expect("a square");
    }
    map
}

pub(in crate::planning) fn settings() -> Settings {
    Settings {
        n_steps: 10,
        height_m: 5.0,
        yaw_rad: 0.2,
        nominal_height_m: 1.0,
        swath_half_angle_rad: 0.9,
        min_fix_quality: 20.0,
        space: SpaceSettings {
            walls: Some(walls()),
            ceiling_m: Some(7.0),
            highest_surface_m: Some(2.0),
            ..SpaceSettings::default()
        },
        ..Settings::over(Rect { x_min_m: 1.5, y_min_m: 1.0, x_max_m: 14.5, y_max_m: 11.0 })
    }
}

pub(in crate::planning) fn space_of(settings: &Settings, map: &MarkerMap) -> FreeSpace {
    FreeSpace::evaluate(settings, &[camera()], map, 0.4)
}

fn at(x: f64, y: f64, z: f64, yaw_rad: f64) -> Waypoint {
    Waypoint { place: Point::new(x, y, z), yaw_rad }
}

/// A fix as it would be without any grid, by one camera, without anything in the way.
fn direct_cov(map: &MarkerMap, waypoint: &Waypoint) -> Option<Matrix6<f64>> {
    let (camera, pose) = (camera(), waypoint.level_pose());
    let legible = map
        .iter()
        .filter(|(_, _, corners)| is_legible(&camera, corners, &pose, &Legibility::default()));
    let corners: Vec<Point<Hall>> = legible.flat_map(|(_, _, corners)| *corners).collect();
    predicted_cov(&camera, &corners, &pose, 0.4)
}

#[test]
fn nodes_are_direct_evaluations_and_places_between_are_near_them() {
    let map = marker_map(|_| true);
    let settings = settings();
    let space = space_of(&settings, &map);
    let axes = *space.quality().axes();
    assert_eq!((axes.x.n, axes.y.n, axes.z.n, axes.n_headings), (16, 13, 4, 8));
    let mut noise = SeedBook::new(2).stream("nodes");
    for _ in 0..60 {
        let n_nodes = u64::try_from(axes.n_nodes()).expect("few");
        let node = usize::try_from(noise.bits() % n_nodes).expect("few");
        let waypoint = axes.waypoint(node);
        if !space.clearance().is_clear(&waypoint.place.coords) {
            continue;
        }
        let (ours, direct) = (space.fix_cov(&waypoint), direct_cov(&map, &waypoint));
        match (ours, direct) {
            (Some(a), Some(b)) => assert!((a - b).norm() <= 1e-9 * b.norm(), "{waypoint:?}"),
            (a, b) => assert_eq!(a.is_some(), b.is_some(), "{waypoint:?}"),
        }
    }
    // Anywhere: what counts as free nearly always has the quality that it needs, because the worst
    // node around counts; and the interpolated σ is the direct one within a third, mostly.
    let (mut n_free, mut n_wrong, mut n_near, mut n_cov) = (0, 0, 0, 0);
    for _ in 0..1500 {
        let waypoint = at(
            noise.between(0.6, 15.4),
            noise.between(0.6, 11.4),
            noise.between(2.6, 6.4),
            noise.between(-7.0, 7.0),
        );
        let direct = direct_cov(&map, &waypoint);
        if space.is_free(&waypoint) {
            n_free += 1;
            n_wrong += u32::from(direct.as_ref().map_or(0.0, q_pos) <= settings.min_fix_quality);
        }
        if let (Some(ours), Some(direct)) = (space.fix_cov(&waypoint), direct) {
            n_cov += 1;
            n_near += u32::from((ours.trace() / direct.trace()).ln().abs() < 2.0 * 1.34_f64.ln());
        }
    }
    println!("{n_free} free, {n_wrong} of them wrong; {n_near} of {n_cov} σ near");
    assert!(n_free > 150 && f64::from(n_wrong) < 0.03 * f64::from(n_free), "{n_free} {n_wrong}");
    assert!(n_cov > 500 && f64::from(n_near) > 0.7 * f64::from(n_cov), "{n_near} {n_cov}");
}

#[test]
fn headings_wrap_and_ways_turn_the_shorter_side() {
    let map = marker_map(|_| true);
    let space = space_of(&settings(), &map);
    let turn = std::f64::consts::TAU;
    for yaw_rad in [0.3, 2.9, -3.1, 6.1] {
        let (here, there) = (at(7.3, 5.2, 4.4, yaw_rad), at(7.3, 5.2, 4.4, yaw_rad - 2.0 * turn));
        let (a, b) = (space.fix_cov(&here).expect("a fix"), space.fix_cov(&there).expect("a fix"));
        assert!((a - b).norm() < 1e-9 * a.norm());
        assert_eq!(space.is_free(&here), space.is_free(&there));
    }
    // Without tags ahead along +y: turning from 3.0 to −3.0 rad passes −x, not +x or y.
    let map = marker_map(|facing| facing.x > 0.5);
    let space = space_of(&settings(), &map);
    let (from, to) = (at(8.0, 6.0, 5.0, 3.0), at(8.0, 6.0, 5.0, -3.0));
    assert!(space.is_free(&from) && space.is_free(&to));
    assert!(space.is_way_free(&from, &to));
    assert!(!space.is_free(&at(8.0, 6.0, 5.0, 0.2)));
}

#[test]
fn who_evaluates_a_node_and_when_changes_nothing() {
    let map = marker_map(|facing| facing.x < 0.5);
    let mut small = settings();
    small.space.grid_m = 4.0;
    small.space.height_step_m = 2.0;
    let (lazy, filled) = (space_of(&small, &map), space_of(&small, &map));
    (0..2).rev().for_each(|part| filled.quality().fill(part, 2));
    assert_eq!(lazy, filled);
    for node in 0..lazy.quality().axes().n_nodes() {
        let waypoint = lazy.quality().axes().waypoint(node);
        assert_eq!(lazy.fix_cov(&waypoint), filled.fix_cov(&waypoint));
    }
}

#[test]
fn candidate_sites_stay_the_lattice_and_obstacles_only_shut_them() {
    let map = marker_map(|_| true);
    let open = space_of(&settings(), &map);
    let mut blocked = settings();
    let column = [(6.3, 4.8), (6.7, 4.8), (6.7, 5.2), (6.3, 5.2)];
    let column = Prism::new(Polygon::new(&column).expect("simple"), (0.0, 7.0));
    blocked.space.obstacles = vec![Solid::from(column)];
    let blocked = space_of(&blocked, &map);
    assert_eq!((open.sites.len(), blocked.sites.len()), (14 * 11, 14 * 11));
    for (site, shut) in std::iter::zip(open.sites.iter(), blocked.sites.iter()) {
        assert_eq!(site.waypoint, shut.waypoint);
        let place = site.waypoint.place.coords;
        let away_m = (place.xy() - Vector2::new(6.5, 5.0)).abs() - Vector2::repeat(0.2);
        let away_m = away_m.sup(&Vector2::zeros()).norm();
        assert_eq!(shut.is_clear, away_m >= 0.5, "{place:?}");
        // The direct value, whatever grid there is; behind the column at most as good.
        let direct = direct_cov(&map, &site.waypoint);
        assert_eq!(site.fix_cov.is_some(), direct.is_some());
        assert!(shut.quality() <= site.quality() * (1.0 + 1e-9));
    }
    // Right behind the column some tags are hidden.
    let behind =
        |space: &FreeSpace| space.fix_cov(&at(5.5, 5.0, 5.0, 0.2)).as_ref().map_or(0.0, q_pos);
    assert!(behind(&blocked) < behind(&open), "{} {}", behind(&blocked), behind(&open));
    assert!(!blocked.is_way_free(&at(4.5, 5.0, 5.0, 0.2), &at(8.5, 5.0, 5.0, 0.2)));
}
