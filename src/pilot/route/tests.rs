use super::super::survey_plan::PlanFacts;
use super::*;
use crate::localization::marker_map::MarkerMap;
use crate::mapping::region::Rect;
use crate::mapping::solid::{self, Prism, Solid};
use crate::mapping::{Mapper, Method, settings_over};
use crate::messages::{VolumeAccount, VolumeBudget, VolumeEstimate, VolumeShares};
use crate::planning::PlannerKind;
use crate::planning::free_space::FreeSpace;
use crate::planning::planner::PlanEnd;
use crate::planning::space::SpaceSettings;
use nalgebra::Vector3;
use std::time::Duration;

const BOUNDS: Rect = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 12.0, y_max_m: 8.0 };

fn upright(centre: (f64, f64), size: (f64, f64)) -> Solid {
    let centre = Vector3::new(centre.0, centre.1, 5.0);
    Prism::turned_box(&centre, &Vector3::new(size.0, size.1, 10.0), 0.0).expect("a box").into()
}

fn mapper() -> Mapper {
    Mapper::new(settings_over(Method::KalmanGrid, BOUNDS))
}

/// Over a hall in which every place is good enough for a fix, but for these.
fn route(obstacles: Vec<Solid>) -> Route {
    let settings = Settings {
        planner: PlannerKind::Horizon,
        target_ratio: Some(0.01),
        height_m: 5.0,
        min_fix_quality: 0.0,
        space: SpaceSettings { obstacles, ..SpaceSettings::default() },
        ..Settings::over(BOUNDS)
    };
    let free_space = FreeSpace::evaluate(&settings, &[], &MarkerMap::default(), 0.5);
    Route::new(SurveyPlan::new(settings, free_space, &mapper()))
}

fn at(place: &Vector3<f64>) -> Waypoint {
    Waypoint { place: Point::from_coords(*place), yaw_rad: 0.0 }
}

/// Asks for a plan from the corner, if one is due.
fn asks(route: &mut Route) -> bool {
    let from = at(&Vector3::new(1.0, 1.0, 5.0));
    let facts = PlanFacts { from, whole: None, reach_m: None, over_home: None, now: Stamp::ZERO };
    let lidar = settings_over(Method::KalmanGrid, BOUNDS).lidar;
    route.plan.plan_due(&facts, &mapper(), &lidar).is_some()
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
        places.extend(route.path().trajectory().map(|path| path.knot_at(now).position));
    }
    places
}

#[test]
fn the_way_home_leads_around_a_column_and_ends_there() {
    let column = upright((6.0, 4.0), (1.5, 1.5));
    let mut route = route(vec![column.clone()]);
    let (from, home) = (Vector3::new(2.0, 4.1, 5.0), Vector3::new(10.0, 3.9, 5.0));
    route.path_mut().stand(&at(&from), Stamp::ZERO);
    route.go_to(at(&home), Stamp::ZERO);
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
        route.path_mut().stand(&at(&from), Stamp::ZERO);
        route.go_to(at(&home), Stamp::ZERO);
        let places = flown(route, false);
        let last = places.last().expect("flown");
        assert!((last - if is_shut { from } else { home }).norm() < 1e-6, "{last:?}");
        let end = route.path().reached_end(Stamp::ZERO.plus(Duration::from_secs(90)));
        assert!(end.is_some_and(|end| (end.position - last).norm() < 1e-9));
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
    route.path_mut().stand(&at(&Vector3::new(1.0, 1.0, 5.0)), Stamp::ZERO);
    assert!(asks(&mut route));
    let plan = Plan { waypoints: wanted.to_vec(), end: PlanEnd::Complete, prediction: None };
    assert!(route.on_plan(&plan, Stamp::ZERO));
    let places = flown(&mut route, true);
    let near = |waypoint: &Waypoint| {
        let to = |p: &Vector3<f64>| (p - waypoint.place.coords).norm();
        places.iter().map(to).fold(f64::INFINITY, f64::min)
    };
    // All but the one inside of the column.
    assert!(route.plan.is_done() && near(&wanted[1]) < 0.2 && near(&wanted[3]) < 0.2);
    let nearest = places.iter().map(|p| solid::distance_m(std::slice::from_ref(&column), p, 9.0));
    let nearest_m = nearest.fold(f64::INFINITY, f64::min);
    assert!((0.3..0.8).contains(&nearest_m), "{nearest_m}");
}

#[test]
fn a_plan_that_comes_after_the_target_is_reached_is_not_flown() {
    let mut route = route(Vec::new());
    route.path_mut().stand(&at(&Vector3::new(1.0, 1.0, 5.0)), Stamp::ZERO);
    let place = |x: f64| at(&Vector3::new(x, 1.0, 5.0));
    let open = Plan { waypoints: vec![place(3.0)], end: PlanEnd::Open, prediction: None };
    assert!(asks(&mut route) && route.on_plan(&open, Stamp::ZERO));
    assert!(flown(&mut route, true).last().is_some_and(|last| (last.x - 3.0).abs() < 1e-6));
    // The next search is under way when the account comes.
    assert!(asks(&mut route));
    let sure = VolumeAccount {
        name: "hall".to_owned(),
        estimate: VolumeEstimate {
            at: Stamp::ZERO,
            volume_m3: 100.0,
            sigma_m3: 0.9,
            coverage_ratio: 1.0,
        },
        mass: None,
        budget: VolumeBudget::default(),
        shares: VolumeShares::default(),
    };
    assert!(route.plan.stops_at_target(&sure));
    for end in [PlanEnd::Open, PlanEnd::Target] {
        let waypoints = if end == PlanEnd::Open { vec![place(5.0)] } else { Vec::new() };
        assert!(!route.on_plan(&Plan { waypoints, end, prediction: None }, Stamp::ZERO));
        assert!(route.plan.is_complete() && !route.plan.awaits_account());
    }
    assert!(!asks(&mut route));
}

#[test]
fn a_search_that_takes_long_is_not_asked_for_less_often() {
    let mut route = route(Vec::new());
    let plan = |numbers: std::ops::Range<u32>| Plan {
        waypoints: numbers.map(|k| at(&Vector3::new(f64::from(k), 1.0, 5.0))).collect(),
        end: PlanEnd::Open,
        prediction: None,
    };
    assert!(asks(&mut route) && route.on_plan(&plan(1..7), Stamp::ZERO));
    route.plan.reach(1);
    assert!(!asks(&mut route));
    route.plan.reach(1);
    assert!(asks(&mut route));
    // It comes a waypoint later, and goes on behind the fourth.
    route.plan.reach(1);
    assert!(route.on_plan(&plan(5..9), Stamp::ZERO));
    route.plan.reach(1);
    assert!(asks(&mut route), "two waypoints after the last was asked for");
}
