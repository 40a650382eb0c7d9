//! Local search over the waypoints of a path: move, turn, insert, delete, reverse, swap.

use super::path::Path;
use super::scene::Scene;
use crate::geometry::Point;
use crate::planning::Waypoint;
use crate::stats::{Noise, SeedBook};
use crate::units::wrapped_rad;

/// Most waypoints at which a path turns.
const MOST_WAYPOINTS: usize = 14;

/// The best path that is found from these, looking at `n_paths` more; never worse than the best of
/// them. None without a start.
pub(super) fn improve(scene: &mut Scene<'_>, starts: Vec<Path>, n_paths: usize) -> Option<Path> {
    let mut noise = SeedBook::new(scene.request.settings.seed).stream("planning.horizon");
    let n_starts = starts.len().max(1);
    // Each for itself first, then the best of them.
    let share = n_paths / (2 * n_starts);
    let mut best: Option<Path> = None;
    for start in starts {
        let found = climb(scene, start, share, &mut noise);
        if best.as_ref().is_none_or(|best| found.score < best.score) {
            best = Some(found);
        }
    }
    best.map(|best| climb(scene, best, n_paths / 2, &mut noise))
}

/// Takes every change that makes the path better.
fn climb(scene: &mut Scene<'_>, mut best: Path, n_paths: usize, noise: &mut Noise) -> Path {
    for k in 0..n_paths {
        // Wide steps first.
        #[expect(clippy::cast_precision_loss, reason = "thousands of paths")]
        let scale = 1.0 - 0.85 * k as f64 / n_paths.max(1) as f64;
        let changed = change(scene, &best.waypoints, scale, noise);
        if changed.len() > MOST_WAYPOINTS || changed == best.waypoints {
            continue;
        }
        // A longer path that sees everything is worth no more than this.
        if scene.score(scene.cost_m(&changed), 0.0) >= best.score {
            continue;
        }
        if let Some(path) = scene.path_below(best.score, changed, Some(&best)) {
            best = path;
        }
    }
    best
}

/// One random change.
fn change(
    scene: &Scene<'_>,
    waypoints: &[Waypoint],
    scale: f64,
    noise: &mut Noise,
) -> Vec<Waypoint> {
    let mut changed = waypoints.to_vec();
    let n = changed.len();
    let at = pick(n, noise);
    let kind = noise.uniform();
    if kind < HEIGHT_SHARE && scene.has_heights() {
        climbed(scene, &mut changed[at..], scale, noise);
    } else if kind < 0.40 {
        changed[at] = moved(scene, &changed[at], scale, noise);
    } else if kind < 0.55 {
        changed[at].yaw_rad = wrapped_rad(changed[at].yaw_rad + 1.2 * scale * noise.normal());
    } else if kind < 0.65 {
        changed[at] = moved(scene, &changed[at], scale, noise);
        changed[at].yaw_rad = wrapped_rad(changed[at].yaw_rad + 0.8 * scale * noise.normal());
    } else if kind < 0.75 {
        let before = if at == 0 { scene.start } else { changed[at - 1] };
        let between = before.towards(&changed[at], noise.between(0.2, 0.8));
        changed.insert(at, moved(scene, &between, scale, noise));
    } else if kind < 0.80 {
        let last = changed[n - 1];
        changed.push(moved(scene, &last, 2.0 * scale, noise));
    } else if kind < 0.88 && n > 1 {
        changed.remove(at);
    } else if kind < 0.93 {
        // The last leg ends earlier.
        let before = if n == 1 { scene.start } else { changed[n - 2] };
        changed[n - 1] = before.towards(&changed[n - 1], noise.between(0.5, 1.0));
    } else {
        let other = pick(n, noise);
        let (low, high) = (at.min(other), at.max(other));
        if kind < 0.97 {
            changed[low..=high].reverse();
        } else {
            changed.swap(low, high);
        }
    }
    changed
}

/// Every how many changes one of the height, where there is room for it.
const HEIGHT_SHARE: f64 = 0.08;

/// One waypoint or all from there on at another height.
fn climbed(scene: &Scene<'_>, waypoints: &mut [Waypoint], scale: f64, noise: &mut Noise) {
    let (low_m, high_m) = scene.heights_m();
    let by_m = 0.5 * scale * (high_m - low_m) * noise.normal();
    let n_changed = if noise.uniform() < 0.5 { 1 } else { waypoints.len() };
    for waypoint in &mut waypoints[..n_changed] {
        let z_m = &mut waypoint.place.coords.z;
        *z_m = (*z_m + by_m).clamp(low_m, high_m);
    }
}

/// A number below n.
#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a path has few waypoints"
)]
fn pick(n: usize, noise: &mut Noise) -> usize {
    ((noise.uniform() * n as f64) as usize).min(n.saturating_sub(1))
}

/// The waypoint somewhere near, inside the bounds.
fn moved(scene: &Scene<'_>, waypoint: &Waypoint, scale: f64, noise: &mut Noise) -> Waypoint {
    let b = scene.request.settings.bounds;
    let reach_m = 0.18 * scale * (b.x_max_m - b.x_min_m).max(b.y_max_m - b.y_min_m);
    let p = waypoint.place.coords;
    let place = Point::new(
        (p.x + reach_m * noise.normal()).clamp(b.x_min_m, b.x_max_m),
        (p.y + reach_m * noise.normal()).clamp(b.y_min_m, b.y_max_m),
        p.z,
    );
    Waypoint { place, ..*waypoint }
}
