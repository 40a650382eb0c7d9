use super::*;
use crate::planning::Waypoint;
use crate::time::Stamp;
use std::cell::RefCell;
use std::time::Duration;

fn waypoint(x: f64, y: f64, yaw_rad: f64) -> Waypoint {
    Waypoint { place: Point::new(x, y, 7.0), yaw_rad }
}

fn at_rest(x: f64, y: f64) -> Knot {
    Knot::at_rest(Vector3::new(x, y, 7.0), 0.0)
}

fn through(waypoints: &[Waypoint]) -> Trajectory {
    Trajectory::through(Stamp::ZERO, &at_rest(0.0, 0.0), waypoints, &Limits::default())
        .expect("from rest")
}

fn after(seconds: f64) -> Stamp<crate::time::Mono> {
    Stamp::ZERO.plus(Duration::from_secs_f64(seconds))
}

/// The least-snap curve from rest to rest is 35τ⁴ − 84τ⁵ + 70τ⁶ − 20τ⁷: its largest derivatives
/// are 35/16, 7.5132, 52.5 and 840.
fn rest_to_rest_s(way: f64, bounds: [f64; 4]) -> f64 {
    let [v, a, j, s] = bounds;
    (35.0 / 16.0 * way / v)
        .max((7.5132 * way / a).sqrt())
        .max((52.5 * way / j).cbrt())
        .max((840.0 * way / s).powf(0.25))
}

#[test]
fn from_rest_to_rest_takes_the_time_of_the_closed_form() {
    let usual = Limits::default();
    let bounds = |l: &Limits| [l.speed_mps, l.accel_mps2, l.jerk_mps3, l.snap_mps4];
    let slow = Limits { speed_mps: 0.3, accel_mps2: 3.0, ..usual };
    let soft = Limits { jerk_mps3: 0.5, ..usual };
    let softest = Limits { snap_mps4: 2.0, ..usual };
    // No ramps: the leg is shorter than two of them.
    for (limits, way_m) in [(usual, 0.02), (usual, 1.3), (slow, 0.09), (soft, 1.0), (softest, 1.0)]
    {
        let to = [waypoint(0.6 * way_m, -0.8 * way_m, 0.0)];
        let flown = Trajectory::through(Stamp::ZERO, &at_rest(0.0, 0.0), &to, &limits);
        let took_s = flown.expect("from rest").duration_s();
        let shortest_s = rest_to_rest_s(way_m, bounds(&limits));
        assert!((took_s / shortest_s - 1.0).abs() < 2e-3, "{took_s} instead of {shortest_s}");
    }
    // A turn on the spot of 3 rad, the short way over ±π.
    let from = Knot::at_rest(Vector3::zeros(), 2.0);
    let to = Waypoint { place: Point::origin(), yaw_rad: 5.0 - std::f64::consts::TAU };
    let flown = Trajectory::through(Stamp::ZERO, &from, &[to], &usual).expect("from rest");
    let shortest_s = rest_to_rest_s(
        3.0,
        [usual.yaw_rate_radps, usual.yaw_accel_radps2, f64::INFINITY, f64::INFINITY],
    );
    assert!((flown.duration_s() / shortest_s - 1.0).abs() < 2e-3);
    let half = flown.setpoint_at(after(0.5 * flown.duration_s()));
    assert!((half.yaw_rad - wrapped_rad(3.5)).abs() < 1e-6, "{}", half.yaw_rad);
    assert!(half.yaw_rate_radps > 0.5 * usual.yaw_rate_radps);
}

#[test]
fn a_long_straight_is_flown_at_the_largest_speed() {
    let flown = through(&[waypoint(20.0, 0.0, 0.0)]);
    // Two ramps of mean speed 1 m/s and 15/16 · 4/2 m, 5 % longer, and the rest at 2 m/s.
    let ramp_m = 0.9375 * 4.0 / 2.0 / 0.95;
    let expected_s = 2.0 * ramp_m + (20.0 - 2.0 * ramp_m) / 2.0;
    assert!(flown.duration_s() < expected_s * 1.001, "{} s", flown.duration_s());
    assert!((flown.knot_at(after(6.0)).velocity.x - 2.0).abs() < 1e-9);
    assert!(flown.departure_m() < 2e-3);
}

#[test]
fn the_present_motion_ends_where_the_waypoints_end() {
    let waypoints = [waypoint(2.0, 0.0, 0.0), waypoint(2.0, 0.0, 0.0), waypoint(2.0, 3.0, 1.0)];
    let flown = through(&waypoints);
    assert_eq!(flown.n_waypoints(), 3);
    assert_eq!(flown.n_reached(Stamp::ZERO), 0);
    let late = flown.end_at().plus(Duration::from_secs(1));
    assert!(flown.is_over(late) && flown.n_reached(late) == 3);
    let rest = flown.knot_at(late);
    assert!(rest.is_at_rest() && (rest.position - Vector3::new(2.0, 3.0, 7.0)).norm() < 1e-9);
}

#[test]
fn the_departure_is_that_of_the_sampled_curve() {
    let waypoints = [waypoint(2.0, 0.0, 0.0), waypoint(2.0, 2.0, 0.0), waypoint(4.0, 2.0, 0.0)];
    let corners =
        [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (4.0, 2.0)].map(|(x, y)| Vector3::new(x, y, 7.0));
    let flown = through(&waypoints);
    let from_line = |p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>| {
        let u = (b - a).normalize();
        ((p - a) - u * u.dot(&(p - a))).norm()
    };
    let sampled = (0..4000).map(|k| after(flown.duration_s() * f64::from(k) / 4000.0)).map(|at| {
        let k = flown.n_reached(at).min(2);
        from_line(&flown.knot_at(at).position, &corners[k], &corners[k + 1])
    });
    let sampled_m = sampled.fold(0.0, f64::max);
    let told_m = flown.departure_m();
    assert!(sampled_m > 0.1, "no turn without a swing: {sampled_m} m");
    assert!((sampled_m..sampled_m + 1.5e-3).contains(&told_m), "{told_m} is not {sampled_m}");
}

#[test]
fn a_curve_that_is_not_free_is_drawn_to_the_straight_legs() {
    let waypoints = [waypoint(2.0, 0.0, 0.0), waypoint(2.0, 2.0, 0.0), waypoint(4.0, 2.0, 0.0)];
    let asked = RefCell::new(Vec::new());
    let walled = |half_width_m: f64| {
        let asked = &asked;
        move |p: &Point<Hall>, _: f64| {
            asked.borrow_mut().push(p.coords);
            let (x, y) = (p.coords.x, p.coords.y);
            let near =
                |v: f64, low: f64, high: f64| v > low - half_width_m && v < high + half_width_m;
            (near(x, 0.0, 2.0) && near(y, 0.0, 0.0))
                || (near(x, 2.0, 2.0) && near(y, 0.0, 2.0))
                || (near(x, 2.0, 4.0) && near(y, 2.0, 2.0))
        }
    };
    let plan = |half_width_m: f64| {
        let is_free = walled(half_width_m);
        let corridor = Corridor { is_free: &is_free, spacing_m: 0.05 };
        let from = at_rest(0.0, 0.0);
        Trajectory::through_free(Stamp::ZERO, &from, &waypoints, &Limits::default(), &corridor)
    };
    let wide = plan(5.0).expect("free");
    assert_eq!(wide, through(&waypoints));
    for pair in asked.take().windows(2) {
        // Where one leg ends and the next begins the same place is asked twice.
        assert!((pair[1] - pair[0]).norm() <= 0.05 + 1e-9);
    }
    let (tight, tightest) = (plan(0.1).expect("slower"), plan(0.01).expect("straight"));
    assert!(wide.duration_s() < tight.duration_s() && tight.duration_s() < tightest.duration_s());
    assert!(wide.departure_m() > 0.1 && tight.departure_m() < 0.1);
    assert!(tightest.departure_m() < 0.01);
    let blocked = |p: &Point<Hall>, _: f64| p.coords.y < 1.0 || p.coords.y > 1.2;
    let corridor = Corridor { is_free: &blocked, spacing_m: 0.05 };
    let limits = Limits::default();
    let none =
        Trajectory::through_free(Stamp::ZERO, &at_rest(0.0, 0.0), &waypoints, &limits, &corridor);
    assert_eq!(none, Err(NoWay::Blocked { waypoint: 1 }));
}

#[test]
fn an_emergency_stop_begins_at_once_and_is_shorter() {
    let limits = Limits::default();
    let flown = through(&[waypoint(4.0, 0.0, 0.0), waypoint(8.0, 1.0, 0.0)]);
    for tenths in 1..30 {
        let at = after(0.1 * f64::from(tenths));
        let here = flown.knot_at(at);
        let hard = Trajectory::emergency_stop(at, &here, &limits);
        let begun = hard.knot_at(at);
        assert!((begun.velocity - here.velocity).norm() + (begun.accel - here.accel).norm() < 1e-9);
        assert!((begun.jerk - here.jerk).norm() < 1e-8);
        let soft = flown.braked(at, &limits);
        assert!(hard.duration_s() < soft.duration_s() + 1e-9, "after {tenths} tenths");
        let way_m = |stop: &Trajectory| (stop.end().position - here.position).norm();
        assert!(way_m(&hard) <= way_m(&soft) + 1e-9);
    }
    // From 2 m/s, at 3 m/s²: 1.875 · 2/3 s, to the step of the search.
    let cruising = Knot::steady(Vector3::zeros(), Vector3::new(0.0, -2.0, 0.0), 0.3);
    let hard = Trajectory::emergency_stop(Stamp::ZERO, &cruising, &limits);
    assert!((1.25..1.25 * 1.07).contains(&hard.duration_s()), "{} s", hard.duration_s());
}
