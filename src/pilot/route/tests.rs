use super::*;
use crate::localization::marker_map::MarkerMap;
use crate::mapping::region::Rect;
use crate::mapping::solid::{self, Prism, Solid};
use crate::planning::space::SpaceSettings;
use crate::planning::trajectory::Limits;
use std::time::Duration;

const BOUNDS: Rect = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 12.0, y_max_m: 8.0 };

fn upright(centre: (f64, f64), size: (f64, f64)) -> Solid {
    let centre = Vector3::new(centre.0, centre.1, 5.0);
    Prism::turned_box(&centre, &Vector3::new(size.0, size.1, 10.0), 0.0).expect("a box").into()
}

fn route(obstacles: Vec<Solid>) -> Route {
    let settings = Settings {
        planner: PlannerKind::SquareWave,
        n_steps: 10,
        height_m: 5.0,
        yaw_rad: 0.0,
        bounds: BOUNDS,
        leg_spacing_m: 4.0,
        step_radius_m: 2.0,
        candidate_spacing_m: 1.0,
        nominal_height_m: 1.0,
        swath_half_angle_rad: 0.9,
        min_fix_quality: 0.0,
        limits: Limits::default(),
        space: SpaceSettings { obstacles, ..SpaceSettings::default() },
    };
    let free_space = FreeSpace::evaluate(&settings, &[], &MarkerMap::default(), 0.5);
    Route::new(settings, free_space)
}

/// Flies on for a minute and a half; where it was every 50 ms.
fn flown(route: &mut Route, is_survey: bool) -> Vec<Vector3<f64>> {
    let mut places = Vec::new();
    for step in 0..1800_u32 {
        let now = Stamp::ZERO.plus(Duration::from_millis(u64::from(50 * step)));
        route.advance(now);
        if is_survey {
            route.survey(now);
        }
        places.extend(route.knot_at(now).map(|knot| knot.position));
    }
    places
}

#[test]
fn the_way_home_leads_around_a_column_and_ends_there() {
    let column = upright((6.0, 4.0), (1.5, 1.5));
    let mut route = route(vec![column.clone()]);
    let (from, home) = (Vector3::new(2.0, 4.1, 5.0), Vector3::new(10.0, 3.9, 5.0));
    route.stand(&from, Stamp::ZERO);
    route.go_to(&home, Stamp::ZERO);
    let places = flown(&mut route, false);
    let last = places.last().expect("flown");
    assert!((last - home).norm() < 1e-6, "{last:?}");
    // Half a metre is planned; corners may be cut, never into the radius of the vehicle.
    let nearest = places.iter().map(|p| solid::distance_m(std::slice::from_ref(&column), p, 9.0));
    let nearest_m = nearest.fold(f64::INFINITY, f64::min);
    assert!((0.3..1.5).contains(&nearest_m), "{nearest_m}");
}

#[test]
fn without_a_way_it_stays_and_without_obstacles_it_flies_straight() {
    let walls = [((6.0, 4.0), (0.2, 40.0))].map(|(at, size)| upright(at, size));
    let mut shut = route(walls.to_vec());
    let (from, home) = (Vector3::new(2.0, 4.0, 5.0), Vector3::new(10.0, 6.0, 5.0));
    for (route, is_shut) in [(&mut shut, true), (&mut route(Vec::new()), false)] {
        route.stand(&from, Stamp::ZERO);
        route.go_to(&home, Stamp::ZERO);
        let places = flown(route, false);
        let last = places.last().expect("flown");
        assert!((last - if is_shut { from } else { home }).norm() < 1e-6, "{last:?}");
        assert_eq!(route.reached_end(Stamp::ZERO.plus(Duration::from_secs(90))).is_none(), is_shut);
        let line = (home - from).normalize();
        let off_m = places.iter().map(|p| (p - from - line * line.dot(&(p - from))).norm());
        assert!(off_m.fold(0.0, f64::max) < 1e-6);
    }
}

#[test]
fn legs_of_a_survey_go_around_what_stands_on_them() {
    let column = upright((6.0, 2.1), (0.5, 0.5));
    let mut route = route(vec![column.clone()]);
    let place = |x: f64, y: f64| Waypoint { place: Point::new(x, y, 5.0), yaw_rad: 0.0 };
    let wanted = [place(2.0, 2.0), place(10.0, 2.0), place(6.0, 2.1), place(10.0, 6.0)];
    route.ahead = wanted.into_iter().collect();
    route.steps_decided = route.ahead.len();
    route.stand(&Vector3::new(1.0, 1.0, 5.0), Stamp::ZERO);
    let places = flown(&mut route, true);
    let near = |waypoint: &Waypoint| {
        let to = |p: &Vector3<f64>| (p - waypoint.place.coords).norm();
        places.iter().map(to).fold(f64::INFINITY, f64::min)
    };
    // All but the one inside of the column.
    assert!(route.is_done() && near(&wanted[1]) < 0.2 && near(&wanted[3]) < 0.2);
    let nearest = places.iter().map(|p| solid::distance_m(std::slice::from_ref(&column), p, 9.0));
    let nearest_m = nearest.fold(f64::INFINITY, f64::min);
    assert!((0.3..0.8).contains(&nearest_m), "{nearest_m}");
}
