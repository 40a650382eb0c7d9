use super::*;
use crate::geometry::{Point, Rotation, Transform};
use crate::mapping::kalman_grid::{self, KalmanGrid};
use crate::mapping::polygon::Polygon;
use crate::mapping::projection::LidarMount;
use crate::mapping::region::Rect;
use crate::mapping::solid::Prism;
use crate::messages::GridGeometry;
use crate::planning::free_space::tests::{marker_map, settings, space_of};
use crate::planning::planner::Belief;
use crate::planning::{PlannerKind, Settings};
use std::sync::Arc;

/// From (3 m, 2 m) in a hall with a wall across it at y = 6 m that leaves a gap for x > 11 m.
fn request() -> PlanRequest {
    let mut settings = Settings { planner: PlannerKind::External, n_steps: 20, ..settings() };
    let wall = Rect { x_min_m: 0.0, y_min_m: 5.8, x_max_m: 11.0, y_max_m: 6.2 };
    settings.space.obstacles = vec![Prism::new(Polygon::from(wall), (0.0, 7.0)).into()];
    let geometry = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 1.0, n_cols: 16, n_rows: 12 };
    PlanRequest {
        n_waypoints: settings.n_steps,
        pending: vec![at(3.0, 2.0)],
        current: Vec::new(),
        longest_m: Some(60.0),
        over_home: Some(Point::new(3.0, 2.0, settings.height_m)),
        free_space: Arc::new(space_of(&settings, &marker_map(|_| true))),
        lidar: LidarMount {
            body_from_lidar: Transform::new(Rotation::identity(), Point::origin()),
            range_sigma_m: 0.012,
            angle_sigma_rad: 0.002,
            min_range_m: 0.15,
            max_range_m: 12.0,
            blind_sectors_rad: Vec::new(),
        },
        belief: Belief::Grid {
            cells: Box::new(KalmanGrid::new(geometry, kalman_grid::Settings::default())),
            areas_m2: vec![1.0; 192].into(),
        },
        volume_m3: 192.0,
        constant_var_m6: 0.0,
        accounted: None,
        settings,
    }
}

fn at(x: f64, y: f64) -> Waypoint {
    Waypoint { place: Point::new(x, y, 5.0), yaw_rad: 0.2 }
}

fn of(waypoints: &[Waypoint]) -> Proposal {
    Proposal { waypoints: waypoints.to_vec(), is_complete: false }
}

#[test]
fn a_good_answer_becomes_free_steps_in_its_order() {
    let request = request();
    let plan = admitted(&request, &of(&[at(8.0, 2.0), at(8.0, 4.0)])).expect("free");
    // 5 m in steps of 2 m at most are three, 2 m are one.
    let xy: Vec<(f64, f64)> =
        plan.waypoints.iter().map(|w| (w.place.coords.x, w.place.coords.y)).collect();
    assert_eq!(xy.len(), 4);
    assert!((xy[0].0 - (3.0 + 5.0 / 3.0)).abs() < 1e-12 && xy[2..] == [(8.0, 2.0), (8.0, 4.0)]);
    assert_eq!((plan.end, plan.prediction), (PlanEnd::Open, None));
    let all = Proposal { waypoints: Vec::new(), is_complete: true };
    assert_eq!(admitted(&request, &all), Ok(Plan::nothing(PlanEnd::Complete)));
}

#[test]
fn what_stands_between_is_led_around_and_every_step_is_free() {
    let request = request();
    let plan = admitted(&request, &of(&[at(3.0, 10.0)])).expect("a way through the gap");
    let mut from = request.pending[0];
    let mut east_m: f64 = 0.0;
    for to in &plan.waypoints {
        assert!(request.free_space.is_way_free(&from, to), "{from:?} to {to:?}");
        east_m = east_m.max(to.place.coords.x);
        from = *to;
    }
    // Around the end of the wall, the vehicle's radius and the margin away.
    assert!(east_m > 11.5 - 1e-9, "{east_m} m");
    assert_eq!(plan.waypoints.last(), Some(&at(3.0, 10.0)));
}

#[test]
fn nothing_of_a_bad_answer_is_flown() {
    let request = request();
    let refused = |proposal: &Proposal| admitted(&request, proposal).expect_err("bad");
    let good = at(8.0, 2.0);
    for broken in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(refused(&of(&[good, at(broken, 2.0)])), Refusal::NotFinite { index: 1 });
        let turned = Waypoint { yaw_rad: broken, ..good };
        assert_eq!(refused(&of(&[turned])), Refusal::NotFinite { index: 0 });
    }
    // Outside, far outside, in the wall, in the floor, in the ceiling.
    let low = Waypoint { place: Point::new(8.0, 2.0, 0.1), yaw_rad: 0.0 };
    let high = Waypoint { place: Point::new(8.0, 2.0, 6.9), yaw_rad: 0.0 };
    for bad in [at(-1.0, 2.0), at(1e300, 2.0), at(5.0, 6.0), low, high] {
        assert_eq!(refused(&of(&[good, bad])), Refusal::NotFree { index: 1 }, "{bad:?}");
    }
    assert_eq!(refused(&of(&[])), Refusal::Nothing);
    assert_eq!(refused(&of(&[good; 21])), Refusal::TooMany { got: 21, most: 20 });
    // Few corners, but too many steps.
    let far = [at(13.0, 2.0), at(3.0, 2.0), at(13.0, 2.0), at(3.0, 2.0), at(13.0, 2.0)];
    assert!(matches!(refused(&of(&far)), Refusal::TooMany { got: 25, most: 20 }));
    let short = PlanRequest { longest_m: Some(9.9), ..request.clone() };
    let refusal = admitted(&short, &of(&[good])).expect_err("5 m there and 5 m home");
    assert!(matches!(refusal, Refusal::TooLong { needed_m, .. } if (needed_m - 10.0).abs() < 1e-9));
}

#[test]
fn a_heading_may_count_whole_turns() {
    let turned = Waypoint { yaw_rad: 0.2 + 6.0 * std::f64::consts::PI, ..at(5.0, 2.0) };
    let plan = admitted(&request(), &of(&[turned])).expect("free");
    assert!((plan.waypoints[0].yaw_rad - 0.2).abs() < 1e-12);
}
