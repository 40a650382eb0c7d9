//! The baseline: parallel legs at equal distance, joined at their ends.
//!
//! ```text
//!   y ▲  ┌───────────────▶      legs run along x, because the scan plane stands across x
//!     │  └───────────────┐      at the survey's heading
//!     │  ────────────────┘
//!     └──▶ x
//! ```

use super::horizon::best_square_wave;
use super::planner::{Plan, PlanEnd, PlanRequest, Planner};
use super::{Settings, Waypoint};
use crate::geometry::Point;

/// The baseline as a planner.
#[derive(Debug, Clone, Copy)]
pub struct SquareWave;

/// Distance of the legs where neither a distance nor a target is configured, m: from two legs every
/// hollow is seen from either side.
const LEG_SPACING_M: f64 = 5.0;

impl Planner for SquareWave {
    /// The whole square wave: of the configured spacing, or if a target is to be reached the one with
    /// the spacing, direction, margins and corner that are predicted to serve best.
    fn plan(&self, request: &PlanRequest) -> Plan {
        let settings = &request.settings;
        let whole_hall_m = settings.target_ratio.is_none().then_some(LEG_SPACING_M);
        let (wave, prediction) = match settings.leg_spacing_m.or(whole_hall_m) {
            Some(spacing_m) => (waypoints(settings, spacing_m), None),
            None => match best_square_wave(request) {
                Some((corners, prediction)) => {
                    (in_steps(&corners, request.n_waypoints), Some(prediction))
                }
                None => return Plan::nothing(PlanEnd::NothingFree),
            },
        };
        let is_free = |waypoint: &Waypoint| request.free_space.is_free(waypoint);
        let waypoints: Vec<Waypoint> = wave.into_iter().filter(is_free).collect();
        Plan { waypoints, end: PlanEnd::Complete, prediction }
    }
}

/// The waypoints of a square wave over the bounds, `n_steps` of them at nearly equal distance
/// along the path, corners included.
#[must_use]
pub fn waypoints(settings: &Settings, leg_spacing_m: f64) -> Vec<Waypoint> {
    in_steps(&corners(settings, leg_spacing_m), settings.n_steps)
}

/// `n_steps` waypoints at nearly equal distance along a path, its corners included.
fn in_steps(corners: &[Waypoint], n_steps: usize) -> Vec<Waypoint> {
    let edges: Vec<f64> = corners.windows(2).map(|pair| pair[0].distance_m(&pair[1])).collect();
    let steps = share_steps(&edges, n_steps.saturating_sub(1));
    let mut waypoints: Vec<Waypoint> = corners.first().copied().into_iter().collect();
    for (pair, n) in corners.windows(2).zip(steps) {
        for k in 1..=n {
            let ratio = f64::from(k) / f64::from(n);
            let coords = pair[0].place.coords.lerp(&pair[1].place.coords, ratio);
            waypoints.push(Waypoint { place: Point::from_coords(coords), ..pair[1] });
        }
    }
    waypoints
}

/// Ends of the legs, in the order of flight, from the corner nearest to the hall's origin.
fn corners(settings: &Settings, leg_spacing_m: f64) -> Vec<Waypoint> {
    let b = settings.bounds;
    let (_, depth_m) = b.size_m();
    let n_legs = (depth_m / leg_spacing_m).ceil().max(1.0);
    let spacing_m = depth_m / n_legs;
    let leg_indices = std::iter::successors(Some(0.0), |k| (k + 1.0 < n_legs).then_some(k + 1.0));
    let mut corners = Vec::new();
    for k in leg_indices {
        let y = b.y_min_m + (k + 0.5) * spacing_m;
        let mut ends = [b.x_min_m, b.x_max_m];
        if corners.len() % 4 == 2 {
            ends.reverse();
        }
        corners.extend(ends.map(|x| Waypoint {
            place: Point::new(x, y, settings.height_m),
            yaw_rad: settings.yaw_rad,
        }));
    }
    corners
}

/// Splits `total` steps over the edges by length, at least one each, by largest remainder.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "step counts are small and positive"
)]
fn share_steps(edges_m: &[f64], total: usize) -> Vec<u32> {
    let length_m: f64 = edges_m.iter().sum();
    let ideal: Vec<f64> = edges_m.iter().map(|e| e / length_m * total as f64).collect();
    let mut steps: Vec<u32> = ideal.iter().map(|s| (s.floor() as u32).max(1)).collect();
    let mut by_remainder: Vec<usize> = (0..edges_m.len()).collect();
    by_remainder.sort_by(|&a, &b| {
        let remainder = |k: usize| ideal[k] - f64::from(steps[k]);
        remainder(b).total_cmp(&remainder(a))
    });
    let given: u32 = steps.iter().sum();
    let missing = total.saturating_sub(given as usize);
    for &edge in by_remainder.iter().cycle().take(missing) {
        steps[edge] += 1;
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::region::Rect;

    fn settings() -> Settings {
        Settings::over(Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 20.0, y_max_m: 20.0 })
    }

    #[test]
    fn fifty_steps_cover_four_legs() {
        let waypoints = waypoints(&settings(), 5.0);
        assert_eq!(waypoints.len(), 50);
        let ys: std::collections::BTreeSet<i64> = waypoints
            .iter()
            .filter(|w| w.place.coords.x < 1e-9 || w.place.coords.x > 20.0 - 1e-9)
            .map(|w| {
                #[expect(clippy::cast_possible_truncation, reason = "test")]
                let tenths = (w.place.coords.y * 10.0).round() as i64;
                tenths
            })
            .collect();
        // Legs at 2.5, 7.5, 12.5, 17.5 m.
        assert!([25, 75, 125, 175].iter().all(|y| ys.contains(y)));
        let longest =
            waypoints.windows(2).map(|pair| pair[0].distance_m(&pair[1])).fold(0.0, f64::max);
        // 95 m over 49 steps are 1.94 m; whole steps per edge stretch it a little.
        assert!(longest < 2.6, "longest step {longest} m");
    }

    #[test]
    fn one_narrow_hall_needs_one_leg() {
        let mut narrow = settings();
        narrow.bounds.y_max_m = 3.0;
        assert!(waypoints(&narrow, 5.0).iter().all(|w| (w.place.coords.y - 1.5).abs() < 1e-12));
    }
}
