//! The wall in the scans of one distance.

use super::body::Sector;
use super::{Position, Refusal, count};
use std::f64::consts::{PI, TAU};

/// A wall is looked at so far to both sides of square on, rad: there an error of the direction
/// changes the ranges little.
const HALF_WINDOW_RAD: f64 = 0.26;
/// Directions that are tried, rad.
const TRIAL_STEP_RAD: f64 = TAU / 360.0;
/// The wall may be off the tape by this, and by this share of the distance: a bias, and a slant.
const TOLERANCE: (f64, f64) = (0.12, 0.03);
/// So much of the window must be wall.
const LEAST_SHARE: f64 = 0.6;
/// Two walls differ by this at least, and a named one lies within this, rad.
const APART_RAD: f64 = 0.5;
const NEAR_RAD: f64 = 0.6;
/// Fewer beams on a wall say nothing.
const LEAST_BEAMS: usize = 100;
const ROUNDS: usize = 8;
/// Beyond this many σ a beam has met something else.
const GATE_SIGMAS: f64 = 4.0;
/// Between the two halves of a recording the wall may move by this, m, and by this many σ.
const STILL: (f64, f64) = (0.002, 5.0);

/// A wall as the sensor sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wall {
    /// Square on, m.
    pub(super) distance_m: f64,
    /// Its σ from the noise alone, m.
    pub(super) sigma_m: f64,
    /// Where square on is, rad.
    pub(super) direction_rad: f64,
    /// Standard deviation of one range, m.
    pub(super) noise_m: f64,
    /// Beams on it, and their share of the beams towards it.
    pub(super) n_beams: usize,
    pub(super) share: f64,
}

/// A beam: direction and range.
type Ray = (f64, f64);

/// The wall nearest to the taped distance.
pub(super) fn find(
    position: &Position,
    body: &[Sector],
    towards_rad: Option<f64>,
) -> Result<Wall, Refusal> {
    let taped_m = position.taped_m;
    let beams = position.scans.iter().flat_map(|scan| &scan.beams);
    let rays: Vec<Ray> = beams.map(|b| (f64::from(b.angle_rad), f64::from(b.range_m))).collect();
    let n_beams = rays.iter().filter(|ray| ray.1 > 0.0).count();
    if n_beams < LEAST_BEAMS {
        return Err(Refusal::TooFew { taped_m, n_beams, least: LEAST_BEAMS });
    }
    let is_free = |ray: &&Ray| !body.iter().any(|sector| sector.holds(ray.0));
    let free: Vec<Ray> = rays.iter().filter(is_free).copied().collect();
    let tolerance_m = TOLERANCE.0.max(TOLERANCE.1 * taped_m);
    let wall = only_wall(&free, taped_m, tolerance_m, towards_rad)?;
    if wall.n_beams < LEAST_BEAMS {
        return Err(Refusal::TooFew { taped_m, n_beams: wall.n_beams, least: LEAST_BEAMS });
    }
    still(&free, &wall, taped_m, tolerance_m)?;
    Ok(wall)
}

fn off_rad(a: f64, b: f64) -> f64 {
    (a - b + PI).rem_euclid(TAU) - PI
}

/// Share of the beams in the window around a direction that lie on a wall at this distance.
fn share(rays: &[Ray], direction_rad: f64, distance_m: f64, tolerance_m: f64) -> f64 {
    let (mut n, mut n_on) = (0, 0);
    for &(angle_rad, range_m) in rays {
        let off = off_rad(angle_rad, direction_rad);
        if off.abs() < HALF_WINDOW_RAD {
            n += 1;
            n_on += usize::from((range_m * off.cos() - distance_m).abs() < tolerance_m);
        }
    }
    if n < LEAST_BEAMS / 2 { 0.0 } else { count(n_on) / count(n) }
}

/// The wall that stands square on at the taped distance.
///
/// Near a wall many directions show it within the tolerance; a fit from each leads to the same.
fn only_wall(
    rays: &[Ray],
    taped_m: f64,
    tolerance_m: f64,
    towards_rad: Option<f64>,
) -> Result<Wall, Refusal> {
    let trials = (0_u32..360).map(|k| f64::from(k) * TRIAL_STEP_RAD - PI);
    let is_asked = |at: &f64| towards_rad.is_none_or(|to| off_rad(*at, to).abs() < NEAR_RAD);
    let mut walls: Vec<Wall> = Vec::new();
    for at in trials.filter(is_asked) {
        if share(rays, at, taped_m, tolerance_m) < LEAST_SHARE {
            continue;
        }
        let wall = fitted(rays, at, taped_m, tolerance_m);
        let is_at = |wall: &Wall| {
            (wall.distance_m - taped_m).abs() < tolerance_m && wall.share >= LEAST_SHARE
        };
        let Some(wall) = wall.filter(is_at) else { continue };
        let is_same =
            |w: &&mut Wall| off_rad(w.direction_rad, wall.direction_rad).abs() < APART_RAD;
        match walls.iter_mut().find(is_same) {
            Some(known) if wall.n_beams > known.n_beams => *known = wall,
            Some(_) => {}
            None => walls.push(wall),
        }
    }
    match walls[..] {
        [wall] => Ok(wall),
        [first, second, ..] => Err(Refusal::TwoWalls {
            taped_m,
            first_deg: first.direction_rad.to_degrees(),
            second_deg: second.direction_rad.to_degrees(),
        }),
        [] => {
            let nearest_m = nearest_wall(rays, taped_m);
            Err(Refusal::NoWall { taped_m, tolerance_m, nearest_m })
        }
    }
}

/// The distance, other than the taped, at which most of some window is a wall.
fn nearest_wall(rays: &[Ray], taped_m: f64) -> Option<f64> {
    let distances = (1..=80).map(|k| 0.1 * f64::from(k));
    let is_wall = |m: &f64| {
        (0_u32..72)
            .any(|k| share(rays, f64::from(k) * 5.0 * TRIAL_STEP_RAD, *m, 0.06) > LEAST_SHARE)
    };
    distances.filter(is_wall).min_by(|a, b| (a - taped_m).abs().total_cmp(&(b - taped_m).abs()))
}

/// Direction and distance by least squares, again and again with what lies on the wall.
///
/// ```text
/// r(a) = D/cos(a − φ),   ∂r/∂D = 1/cos,   ∂r/∂φ = −D sin/cos²
/// ```
fn fitted(rays: &[Ray], direction_rad: f64, distance_m: f64, tolerance_m: f64) -> Option<Wall> {
    let (mut phi, mut d) = (direction_rad, distance_m);
    let (mut gate_m, mut wall) = (tolerance_m, None);
    for _ in 0..ROUNDS {
        let (mut n_towards, mut n, mut squares) = (0, 0, 0.0);
        let (mut jtj, mut jtr) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
        for &(angle_rad, range_m) in rays {
            let off = off_rad(angle_rad, phi);
            if off.abs() > HALF_WINDOW_RAD {
                continue;
            }
            n_towards += 1;
            let left_m = range_m - d / off.cos();
            if left_m.abs() < gate_m {
                let row =
                    nalgebra::Vector2::new(1.0 / off.cos(), -d * off.sin() / off.cos().powi(2));
                jtj += row * row.transpose();
                jtr += row * left_m;
                squares += left_m * left_m;
                n += 1;
            }
        }
        let cov = jtj.try_inverse()?;
        let step = cov * jtr;
        // Of the residuals as they are after the step.
        let rest = (squares - jtr.dot(&step)).max(0.0) / count(n.max(3) - 2);
        let noise_m = rest.sqrt();
        (d, phi) = (d + step[0], phi + step[1]);
        wall = Some(Wall {
            distance_m: d,
            sigma_m: cov[(0, 0)].sqrt() * noise_m,
            direction_rad: off_rad(phi, 0.0),
            noise_m,
            n_beams: n,
            share: count(n) / count(n_towards.max(1)),
        });
        gate_m = (GATE_SIGMAS * noise_m).clamp(0.004, tolerance_m);
    }
    wall
}

/// Refuses a wall that moved while it was recorded.
fn still(rays: &[Ray], wall: &Wall, taped_m: f64, tolerance_m: f64) -> Result<(), Refusal> {
    let half = |rays: &[Ray]| fitted(rays, wall.direction_rad, wall.distance_m, tolerance_m);
    let (first, second) = rays.split_at(rays.len() / 2);
    if let (Some(first), Some(second)) = (half(first), half(second)) {
        let moved_m = (first.distance_m - second.distance_m).abs();
        let by_chance_m = STILL.1 * first.sigma_m.hypot(second.sigma_m);
        if moved_m > STILL.0.max(by_chance_m) {
            return Err(Refusal::Moved { taped_m, moved_mm: 1e3 * moved_m });
        }
    }
    Ok(())
}
