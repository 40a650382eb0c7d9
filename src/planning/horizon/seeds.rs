//! Paths to begin with.

use super::path::Path;
use super::scene::Scene;
use crate::geometry::Point;
use crate::mapping::region::Rect;
use crate::planning::Waypoint;
use crate::units::wrapped_rad;
use std::f64::consts::{FRAC_PI_2, PI};

/// Paths that go into the local search.
const N_BEST: usize = 4;
/// Legs of the square waves.
const MOST_LEGS: u32 = 5;
/// Legs of those that are looked at in flight.
const MOST_LEGS_AGAIN: u32 = 3;
/// Places in a line at which paths turn on the spot, and of those that are looked at in flight.
const MOST_TURNS: u32 = 4;
const MOST_TURNS_AGAIN: u32 = 3;
/// Where these lines lie, as shares of the extent across.
const TURN_LINES: [f64; 3] = [0.3, 0.5, 0.7];
/// The scan plane sweeps over all around in half a turn; a little less, for which way round must not be left to rounding.
const HALF_TURN_RAD: f64 = 0.97 * PI;
/// Margins at the ends of the legs, as shares of the extent.
const MARGINS: [f64; 3] = [0.0, 0.15, 0.3];
/// Single legs lead to a grid of this many places each way.
const N_PLACES: u32 = 5;
/// Turns on the way there, which neighbouring places share out, rad.
const TURNS_RAD: [[f64; 2]; 2] = [[0.0, FRAC_PI_2], [-FRAC_PI_2, 0.95 * PI]];

/// The best square waves, single legs and turns in a line of all.
pub(super) fn best_of_all(scene: &mut Scene<'_>) -> Vec<Path> {
    let mut best = Vec::new();
    let legs = single_legs(scene);
    keep_shortest_parts(scene, legs, &mut best);
    let waves = square_waves(scene, MOST_LEGS, &MARGINS);
    keep_shortest_parts(scene, waves, &mut best);
    let turns = turns_in_line(scene, MOST_TURNS);
    keep_shortest_parts(scene, turns, &mut best);
    best
}

/// The best of the square waves.
pub(super) fn best_square_wave(scene: &mut Scene<'_>) -> Option<Path> {
    let mut best = Vec::new();
    let waves = square_waves(scene, MOST_LEGS, &MARGINS);
    keep_shortest_parts(scene, waves, &mut best);
    best.into_iter().next()
}

/// The rest of the present plan, and single legs in case that something new came up; while little is known, turns in a
/// line and short square waves as well.
pub(super) fn around_present(scene: &mut Scene<'_>, current: &[Waypoint]) -> Vec<Path> {
    let mut best = Vec::new();
    // Ways around something may have come in since it was made.
    let current = &current[..current.len().min(scene.request.n_waypoints)];
    let corners = corners_of(&scene.start, current);
    for k in 1..=corners.len() {
        if let Some(path) = scene.path(corners[..k].to_vec(), None) {
            keep(&mut best, path);
        }
    }
    for waypoints in single_legs(scene) {
        let worst = worst_score(&best);
        if let Some(path) = scene.path_below(worst, waypoints, None) {
            keep(&mut best, path);
        }
    }
    if scene.is_far_from_target() {
        let turns = turns_in_line(scene, MOST_TURNS_AGAIN);
        keep_shortest_parts(scene, turns, &mut best);
        let waves = square_waves(scene, MOST_LEGS_AGAIN, &MARGINS[1..]);
        keep_shortest_parts(scene, waves, &mut best);
    }
    best
}

/// Keeps the best among these paths and those kept before, each up to where it is enough.
fn keep_shortest_parts(scene: &mut Scene<'_>, paths: Vec<Vec<Waypoint>>, best: &mut Vec<Path>) {
    for waypoints in paths {
        if let Some(path) = shortest_part(scene, waypoints, best) {
            keep(best, path);
        }
    }
}

fn keep(best: &mut Vec<Path>, path: Path) {
    let at = best.partition_point(|kept| kept.score <= path.score);
    best.insert(at, path);
    best.truncate(N_BEST);
}

/// What a path must score less than to be kept.
fn worst_score(best: &[Path]) -> f64 {
    best.get(N_BEST - 1).map_or(f64::INFINITY, |path| path.score)
}

/// As many of the waypoints as may be flown; `None` without one.
fn within_reach(scene: &Scene<'_>, mut waypoints: Vec<Waypoint>) -> Option<Vec<Waypoint>> {
    while !scene.is_within_reach(&waypoints, waypoints.last()?) {
        waypoints.pop();
    }
    Some(waypoints)
}

/// The path up to the waypoint from which on more does not pay; `None` if it cannot be among the best.
fn shortest_part(scene: &mut Scene<'_>, waypoints: Vec<Waypoint>, best: &[Path]) -> Option<Path> {
    let waypoints = within_reach(scene, waypoints)?;
    let worst = worst_score(best);
    if scene.cost_m(&waypoints[..waypoints.len().min(2)]) >= worst {
        return None;
    }
    let waypoints = scene.joined(&waypoints);
    // Ways around are longer.
    let waypoints = within_reach(scene, waypoints)?;
    let whole = scene.path(waypoints, None)?;
    if !scene.is_enough(whole.sigma_m3) {
        return Some(whole);
    }
    // σ falls along the path: the first leg at whose end it is enough.
    let (mut low, mut high) = (0, whole.legs.len());
    while high - low > 1 {
        if scene.cost_m(&whole.waypoints[..=low]) >= worst {
            return None;
        }
        let middle = usize::midpoint(low, high);
        let sigma_m3 = scene.sigma_m3(&whole.legs[..middle])?;
        if scene.is_enough(sigma_m3) { high = middle } else { low = middle }
    }
    scene.path(whole.waypoints[..high].to_vec(), Some(&whole))
}

fn square_waves(scene: &Scene<'_>, most_legs: u32, margins: &[f64]) -> Vec<Vec<Waypoint>> {
    let mut waves = Vec::new();
    for n_legs in 1..=most_legs {
        for &margin in margins {
            for corner in 0..4 {
                for is_along_x in [true, false] {
                    let shape = Shape { n_legs, margin, corner, is_along_x };
                    waves.push(shape.waypoints(scene));
                }
            }
        }
    }
    waves
}

/// One square wave.
struct Shape {
    n_legs: u32,
    /// Share of the extent left out at both ends of the legs.
    margin: f64,
    /// Bit 0: from the far end of the legs; bit 1: from the last leg.
    corner: u8,
    is_along_x: bool,
}

impl Shape {
    fn waypoints(&self, scene: &Scene<'_>) -> Vec<Waypoint> {
        let settings = &scene.request.settings;
        let Rect { x_min_m, y_min_m, x_max_m, y_max_m } = settings.bounds;
        let (along, across) = if self.is_along_x {
            ((x_min_m, x_max_m), (y_min_m, y_max_m))
        } else {
            ((y_min_m, y_max_m), (x_min_m, x_max_m))
        };
        let margin_m = self.margin * (along.1 - along.0);
        let ends = (along.0 + margin_m, along.1 - margin_m);
        let spacing_m = (across.1 - across.0) / f64::from(self.n_legs);
        let mut waypoints = Vec::new();
        let mut yaw_rad = scene.start.yaw_rad;
        for leg in 0..self.n_legs {
            let nth = if self.corner & 2 == 0 { leg } else { self.n_legs - 1 - leg };
            let at_m = across.0 + (f64::from(nth) + 0.5) * spacing_m;
            let is_backwards = (leg % 2 == 1) != (self.corner & 1 == 1);
            let (first, last) = if is_backwards { (ends.1, ends.0) } else { ends };
            // The scan plane stands across the leg; which way the body looks does not matter.
            let leg_yaw_rad = if self.is_along_x { 0.0 } else { FRAC_PI_2 };
            yaw_rad = nearest_heading(leg_yaw_rad, yaw_rad);
            for along_m in [first, last] {
                let (x, y) = if self.is_along_x { (along_m, at_m) } else { (at_m, along_m) };
                let place = Point::new(x, y, settings.height_m);
                waypoints.push(Waypoint { place, yaw_rad });
            }
        }
        waypoints
    }
}

/// Along the middle of the hall or beside it, turning on the spot at places at equal distances.
fn turns_in_line(scene: &Scene<'_>, most_places: u32) -> Vec<Vec<Waypoint>> {
    let mut lines = Vec::new();
    for n_places in 1..=most_places {
        for across_share in TURN_LINES {
            for is_along_x in [true, false] {
                for is_backwards in [false, true] {
                    if n_places == 1 && is_backwards {
                        continue;
                    }
                    let line = TurnLine { n_places, across_share, is_along_x, is_backwards };
                    lines.push(line.waypoints(scene));
                }
            }
        }
    }
    lines
}

/// Places in a line.
struct TurnLine {
    n_places: u32,
    across_share: f64,
    is_along_x: bool,
    is_backwards: bool,
}

impl TurnLine {
    fn waypoints(&self, scene: &Scene<'_>) -> Vec<Waypoint> {
        let settings = &scene.request.settings;
        let Rect { x_min_m, y_min_m, x_max_m, y_max_m } = settings.bounds;
        let across_share = self.across_share;
        let mut waypoints = Vec::new();
        let mut yaw_rad = scene.start.yaw_rad;
        for k in 0..self.n_places {
            let nth = if self.is_backwards { self.n_places - 1 - k } else { k };
            let along_share = (f64::from(nth) + 0.5) / f64::from(self.n_places);
            let (x_share, y_share) = if self.is_along_x {
                (along_share, across_share)
            } else {
                (across_share, along_share)
            };
            let x_m = x_min_m + x_share * (x_max_m - x_min_m);
            let y_m = y_min_m + y_share * (y_max_m - y_min_m);
            let place = Point::new(x_m, y_m, settings.height_m);
            let line_yaw_rad = if self.is_along_x { 0.0 } else { FRAC_PI_2 };
            yaw_rad = nearest_heading(line_yaw_rad, yaw_rad);
            waypoints.push(Waypoint { place, yaw_rad });
            yaw_rad = wrapped_rad(yaw_rad + HALF_TURN_RAD);
            waypoints.push(Waypoint { place, yaw_rad });
        }
        waypoints
    }
}

/// The heading, or its opposite, whichever is nearer to `present_rad`.
fn nearest_heading(yaw_rad: f64, present_rad: f64) -> f64 {
    let turn_rad = wrapped_rad(yaw_rad - present_rad);
    let is_opposite = turn_rad.abs() > FRAC_PI_2 + 1e-9;
    wrapped_rad(if is_opposite { yaw_rad + PI } else { yaw_rad })
}

/// Straight to each place, or as far as it may go, with half of the headings there.
fn single_legs(scene: &Scene<'_>) -> Vec<Vec<Waypoint>> {
    let settings = &scene.request.settings;
    let b = settings.bounds;
    let mut legs = Vec::new();
    for i in 0..N_PLACES {
        for j in 0..N_PLACES {
            let is_even = (i + j) % 2 == 0;
            let share = |k: u32| (f64::from(k) + 0.5) / f64::from(N_PLACES);
            let place = Point::new(
                b.x_min_m + share(i) * (b.x_max_m - b.x_min_m),
                b.y_min_m + share(j) * (b.y_max_m - b.y_min_m),
                settings.height_m,
            );
            for turn_rad in if is_even { TURNS_RAD[0] } else { TURNS_RAD[1] } {
                let yaw_rad = wrapped_rad(scene.start.yaw_rad + turn_rad);
                let as_far_as_may_be = scene.within_steps(&Waypoint { place, yaw_rad });
                legs.push(vec![Waypoint { yaw_rad, ..as_far_as_may_be }]);
            }
        }
    }
    legs
}

/// The waypoints at which a path turns: those between lie on straight legs.
fn corners_of(start: &Waypoint, waypoints: &[Waypoint]) -> Vec<Waypoint> {
    let mut corners: Vec<Waypoint> = Vec::new();
    for (k, waypoint) in waypoints.iter().enumerate() {
        let Some(next) = waypoints.get(k + 1) else {
            corners.push(*waypoint);
            break;
        };
        let from = corners.last().unwrap_or(start);
        let (way_m, rest_m) = (from.distance_m(waypoint), waypoint.distance_m(next));
        let share = if way_m + rest_m > 0.0 { way_m / (way_m + rest_m) } else { 0.0 };
        let between = from.towards(next, share);
        let is_straight = between.distance_m(waypoint) < 0.02
            && wrapped_rad(between.yaw_rad - waypoint.yaw_rad).abs() < 0.02;
        if !is_straight {
            corners.push(*waypoint);
        }
    }
    corners
}
