//! Segments through waypoints: which way and how fast each is passed.
//!
//! A waypoint is passed along the mean direction of its legs, with an acceleration into the turn
//! and no jerk; a place on a straight line without either.
//!
//! ```text
//! direction  u ∝ d_out u_in + d_in u_out            the shorter leg counts more
//! bend       κ = (u_out − u_in)/½(d_in + d_out)     a = γ κ v²
//! speed      v ≤ v_max cos(β/2)                     β: angle of the turn; more than 150° stops
//!            γ |κ| v² ≤ 0.9 a_max
//! ramp       |v₁² − v₀²| 15/16 ≤ a_max d            along a straight leg of length d,
//!            |v₁ − v₀| (v₀+v₁)² 5√3/6 ≤ j_max d²    a quintic change of speed: mean speed
//!            |v₁ − v₀| (v₀+v₁)³ 15/2 ≤ s_max d³     (v₀+v₁)/2, duration 2d/(v₀+v₁)
//! ```
//! Long legs are flown as ramp, cruise, ramp. The speeds from these rules are where the search
//! begins: then every segment gets its own shortest duration, speeds fall where none exists, and
//! rise where two neighbouring segments together become shorter.

use super::segment::Segment;
use super::{Knot, Limits, SAME};
use crate::planning::Waypoint;
use crate::units::wrapped_rad;
use nalgebra::Vector3;

/// Waypoints looked at. The last of them counts as a stop, so fewer would only fly slower: 24 m of
/// 2 m steps brake from 6 m/s at 2 m/s².
pub(super) const LOOK_AHEAD: usize = 12;
/// Share of the bounds that the rules for straight legs count on: turns need some too.
const RAMP_SHARE: f64 = 0.95;
/// Factors by which a speed falls while a segment cannot be flown, until it stops.
const SLOWER: f64 = 0.7;
const MAX_SLOWER: u32 = 5;
/// γ: acceleration at a waypoint over that of even turning; flown times are flat between 1.8 and
/// 2.3, and 10 % longer at 0.
const BEND_SHARE: f64 = 2.0;
/// Share of the acceleration's bound that a turn may need at its waypoint.
const TURN_SHARE: f64 = 0.9;
/// Segments tried before a course counts as impossible.
const MAX_TRIALS: usize = 150;
/// Waypoints whose speed is improved, and the factors that are tried.
const IMPROVED: usize = 4;
const FACTORS: [f64; 3] = [1.3, 1.1, 0.85];

/// One segment, and how many waypoints are reached at its end.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Leg {
    pub(super) segment: Segment,
    pub(super) n_reached: usize,
}

/// A place on the way.
#[derive(Debug, Clone, Copy)]
struct Stage {
    place: Vector3<f64>,
    yaw_rad: f64,
    direction: Vector3<f64>,
    /// Change of direction over the way, 1/m: κ.
    bend_per_m: Vector3<f64>,
    /// Passage by the rules, m/s.
    ruled_mps: f64,
    /// Present choice, m/s.
    speed_mps: f64,
    n_slower: u32,
    n_reached: usize,
}

impl Stage {
    fn at(place: Vector3<f64>, yaw_rad: f64) -> Self {
        Self {
            place,
            yaw_rad,
            direction: Vector3::zeros(),
            bend_per_m: Vector3::zeros(),
            ruled_mps: 0.0,
            speed_mps: 0.0,
            n_slower: 0,
            n_reached: 0,
        }
    }

    fn knot(&self) -> Knot {
        let velocity = self.direction * self.speed_mps;
        let accel = self.bend_per_m * (BEND_SHARE * self.speed_mps.powi(2));
        Knot { accel, ..Knot::steady(self.place, velocity, self.yaw_rad) }
    }

    /// False if it is a stop already.
    fn slow_down(&mut self) -> bool {
        if self.speed_mps <= 0.0 {
            return false;
        }
        self.n_slower += 1;
        self.speed_mps = if self.n_slower > MAX_SLOWER { 0.0 } else { self.speed_mps * SLOWER };
        true
    }
}

/// How corners are passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Manner<'a> {
    /// Share of the usual speed at each waypoint; 1 beyond the end of the list.
    pub(super) shares: &'a [f64],
}

/// The segments from a state through the waypoints to rest at the last one (or the last one looked
/// at); `None` if the state leaves no way within the limits.
///
/// The first number is how many waypoints are reached at once.
pub(super) fn legs(
    start: &Knot,
    waypoints: &[Waypoint],
    limits: &Limits,
    manner: Manner<'_>,
) -> Option<(usize, Vec<Leg>)> {
    let (n_here, mut stages) = stages(start, waypoints, limits);
    if stages.is_empty() && !start.is_at_rest() {
        return None;
    }
    set_caps(start, &mut stages, limits, manner);
    smooth_speeds(start.velocity.norm(), start.position, &mut stages, limits);
    let mut segments = joined(start, &mut stages, limits)?;
    improve(start, &mut stages, &mut segments, limits);
    let legs = segments.into_iter().zip(&stages);
    Some((n_here, legs.map(|(segment, s)| Leg { segment, n_reached: s.n_reached }).collect()))
}

/// Distance of a ramp between standing and the speed limit on a straight leg, m.
fn ramp_m(limits: &Limits) -> f64 {
    let v = limits.speed_mps;
    let by_accel = 0.9375 * v.powi(2) / limits.accel_mps2;
    let by_jerk = (1.4434 * v.powi(3) / limits.jerk_mps3).sqrt();
    let by_snap = (7.5 * v.powi(4) / limits.snap_mps4).cbrt();
    // A little longer than the rule for speeds wants it, so that rounding cannot miss the limit.
    1.001 * by_accel.max(by_jerk).max(by_snap) / RAMP_SHARE
}

/// Waypoints without repetition, and ramps on long legs.
fn stages(start: &Knot, waypoints: &[Waypoint], limits: &Limits) -> (usize, Vec<Stage>) {
    let ramp_m = ramp_m(limits);
    let mut stages: Vec<Stage> = Vec::with_capacity(waypoints.len() + 4);
    let mut n_here = 0;
    let (mut place, mut yaw_rad) = (start.position, start.yaw.angle_rad);
    for (n_before, waypoint) in waypoints.iter().take(LOOK_AHEAD).enumerate() {
        let (next, turn_rad) = (waypoint.place.coords, wrapped_rad(waypoint.yaw_rad - yaw_rad));
        let way_m = (next - place).norm();
        let n_reached = n_before + 1;
        let is_same = way_m < SAME && turn_rad.abs() < SAME;
        match stages.last_mut() {
            Some(last) if is_same => {
                last.n_reached = n_reached;
                continue;
            }
            // Already there; a moving start needs a way, so the last one is not skipped then.
            None if is_same && (start.is_at_rest() || n_reached < waypoints.len()) => {
                n_here = n_reached;
                continue;
            }
            Some(_) | None => {}
        }
        let yaw_after = yaw_rad + turn_rad;
        if way_m >= 2.0 * ramp_m {
            let share = ramp_m / way_m;
            // The heading turns in the longest of the three parts.
            let is_early = share > 1.0 / 3.0;
            let at_ramp = if is_early { yaw_after } else { yaw_rad };
            stages.push(Stage::at(place.lerp(&next, share), at_ramp));
            stages.push(Stage::at(place.lerp(&next, 1.0 - share), yaw_after));
        }
        stages.push(Stage { n_reached, ..Stage::at(next, yaw_after) });
        (place, yaw_rad) = (next, yaw_after);
    }
    // Ramps have reached what was reached before them.
    let mut n_reached = n_here;
    for stage in &mut stages {
        n_reached = n_reached.max(stage.n_reached);
        stage.n_reached = n_reached;
    }
    (n_here, stages)
}

fn set_caps(start: &Knot, stages: &mut [Stage], limits: &Limits, manner: Manner<'_>) {
    let mut before = (start.position, start.yaw.angle_rad);
    for k in 0..stages.len() {
        let here = stages[k];
        let n_before = if k == 0 { 0 } else { stages[k - 1].n_reached };
        let is_waypoint = here.n_reached > n_before;
        let share = if is_waypoint {
            manner.shares.get(here.n_reached.saturating_sub(1)).copied().unwrap_or(1.0)
        } else {
            1.0
        };
        if let Some(after) = stages.get(k + 1).copied() {
            let passage = Passage::new(&before.0, &here.place, &after.place, limits);
            let turn_in = turning_mps(&before.0, &here.place, here.yaw_rad - before.1, limits);
            let turn_out =
                turning_mps(&here.place, &after.place, after.yaw_rad - here.yaw_rad, limits);
            stages[k].direction = passage.direction;
            stages[k].bend_per_m = passage.bend_per_m;
            stages[k].speed_mps = share * passage.cap_mps.min(turn_in).min(turn_out);
        }
        before = (here.place, here.yaw_rad);
    }
}

/// How a place between two others is passed.
struct Passage {
    direction: Vector3<f64>,
    bend_per_m: Vector3<f64>,
    cap_mps: f64,
}

impl Passage {
    const STOP: Self = Self { direction: ZERO, bend_per_m: ZERO, cap_mps: 0.0 };

    fn new(
        before: &Vector3<f64>,
        here: &Vector3<f64>,
        after: &Vector3<f64>,
        limits: &Limits,
    ) -> Self {
        let (way_in, way_out) = (here - before, after - here);
        let (d_in, d_out) = (way_in.norm(), way_out.norm());
        if d_in < SAME || d_out < SAME {
            return Self::STOP;
        }
        let (u_in, u_out) = (way_in / d_in, way_out / d_out);
        let cos_turn = u_in.dot(&u_out);
        let direction = (u_in * d_out + u_out * d_in).try_normalize(SAME);
        let Some(direction) = direction.filter(|_| cos_turn > COS_STOP) else {
            return Self::STOP;
        };
        let bend_per_m = (u_out - u_in) / (0.5 * (d_in + d_out));
        let by_turn = limits.speed_mps * (0.5 * (1.0 + cos_turn)).sqrt();
        let by_accel = TURN_SHARE * limits.accel_mps2 / (BEND_SHARE * bend_per_m.norm());
        Self { direction, bend_per_m, cap_mps: by_turn.min(by_accel.sqrt()) }
    }
}

const ZERO: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);
/// cos 150°.
const COS_STOP: f64 = -0.866;

/// Speed on a leg at which its turn of the heading fits, a septic from rest to rest: peak rate
/// 35/16 of the mean, peak acceleration 7.5132 Δ/T².
fn turning_mps(from: &Vector3<f64>, to: &Vector3<f64>, turn_rad: f64, limits: &Limits) -> f64 {
    let turn_rad = turn_rad.abs();
    let least_s = (35.0 / 16.0 * turn_rad / limits.yaw_rate_radps)
        .max((7.5132 * turn_rad / limits.yaw_accel_radps2).sqrt());
    if least_s > 0.0 { (to - from).norm() / least_s } else { f64::INFINITY }
}

/// Lowers speeds until every leg, taken as straight, can be ramped.
fn smooth_speeds(start_mps: f64, start: Vector3<f64>, stages: &mut [Stage], limits: &Limits) {
    for k in (1..stages.len()).rev() {
        let d = (stages[k].place - stages[k - 1].place).norm();
        stages[k - 1].speed_mps =
            ramped_mps(stages[k].speed_mps, stages[k - 1].speed_mps, d, limits);
    }
    let mut before = (start_mps, start);
    for stage in stages {
        let d = (stage.place - before.1).norm();
        stage.ruled_mps = ramped_mps(before.0, stage.speed_mps, d, limits);
        stage.speed_mps = stage.ruled_mps;
        before = (stage.speed_mps, stage.place);
    }
}

/// The largest speed up to `wanted_mps` that a straight ramp of length `d` joins to `other_mps`.
fn ramped_mps(other_mps: f64, wanted_mps: f64, d: f64, limits: &Limits) -> f64 {
    let fits = |v: f64| {
        let (change, sum) = ((v - other_mps).abs(), v + other_mps);
        0.9375 * change * sum <= RAMP_SHARE * limits.accel_mps2 * d
            && 1.4434 * change * sum.powi(2) <= RAMP_SHARE * limits.jerk_mps3 * d.powi(2)
            && 7.5 * change * sum.powi(3) <= RAMP_SHARE * limits.snap_mps4 * d.powi(3)
    };
    if wanted_mps <= other_mps || fits(wanted_mps) {
        return wanted_mps;
    }
    let (mut low, mut high) = (other_mps, wanted_mps);
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        if fits(middle) { low = middle } else { high = middle }
    }
    low
}

/// One segment to each stage; slows stages down where there is none.
fn joined(start: &Knot, stages: &mut [Stage], limits: &Limits) -> Option<Vec<Segment>> {
    let mut segments: Vec<Segment> = Vec::with_capacity(stages.len());
    for _ in 0..MAX_TRIALS {
        let k = segments.len();
        if k == stages.len() {
            return Some(segments);
        }
        let from = if k == 0 { *start } else { stages[k - 1].knot() };
        if let Some(segment) = Segment::fastest(&from, &stages[k].knot(), limits) {
            segments.push(segment);
            continue;
        }
        let stop = Stage { speed_mps: 0.0, ..stages[k] };
        if stages[k].speed_mps > 0.0 && Segment::fastest(&from, &stop.knot(), limits).is_some() {
            stages[k].slow_down();
            continue;
        }
        // Too fast to stop there: the place before must be passed slower.
        if k == 0 || !stages[k - 1].slow_down() {
            return None;
        }
        // What follows gets another chance.
        (stages[k].speed_mps, stages[k].n_slower) = (stages[k].ruled_mps, 0);
        segments.pop();
    }
    None
}

/// Tries other speeds at the first stages: two neighbouring segments together shall be shorter.
fn improve(start: &Knot, stages: &mut [Stage], segments: &mut [Segment], limits: &Limits) {
    let n_inner = stages.len().saturating_sub(1).min(IMPROVED);
    for k in 0..n_inner {
        let from = if k == 0 { *start } else { stages[k - 1].knot() };
        let to = stages[k + 1].knot();
        let usual_mps = stages[k].speed_mps;
        for factor in FACTORS {
            let tried =
                Stage { speed_mps: (usual_mps * factor).min(limits.speed_mps), ..stages[k] };
            if tried.speed_mps <= 0.0 || (tried.speed_mps - stages[k].speed_mps).abs() < 1e-3 {
                continue;
            }
            let via = tried.knot();
            let before_s = segments[k].duration_s() + segments[k + 1].duration_s();
            let pair = Segment::fastest(&from, &via, limits)
                .filter(|first| first.duration_s() < before_s)
                .and_then(|first| Some((first, Segment::fastest(&via, &to, limits)?)));
            if let Some((first, second)) =
                pair.filter(|(a, b)| a.duration_s() + b.duration_s() < before_s)
            {
                (segments[k], segments[k + 1]) = (first, second);
                stages[k].speed_mps = tried.speed_mps;
            }
        }
    }
}
