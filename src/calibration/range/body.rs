//! Where the sensor sees the vehicle that carries it: what stays where it is while the wall comes and goes.

use super::Position;
use std::f64::consts::{PI, TAU};

/// Directions are judged one by one in steps of 1°.
const N_BINS: usize = 360;
/// Nothing of the vehicle is farther from the sensor, m.
const MAX_BODY_M: f64 = 0.6;
/// A part of the vehicle stays within this, m.
const STEADY_M: f64 = 0.04;
/// So many beams of a direction must meet it at every distance.
const LEAST_SHARE: f64 = 0.3;
/// The vehicle must have moved by this before anything is called its own, m.
const LEAST_MOVE_M: f64 = 0.3;
/// A beam has a width, and a part swings: so much is added to both sides, in bins.
const MARGIN_BINS: usize = 2;
/// Free directions this narrow between two parts are closed, in bins.
const BRIDGE_BINS: usize = 3;

/// Directions in which the sensor sees the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sector {
    /// From this direction, from x of the LiDAR towards y, rad, in [−π, π] …
    pub from_rad: f64,
    /// … to this one, not smaller.
    pub to_rad: f64,
    /// The nearest that was seen in it, m.
    pub nearest_m: f64,
}

impl Sector {
    /// True for directions inside.
    #[must_use]
    pub fn holds(&self, angle_rad: f64) -> bool {
        let wrapped = (angle_rad + PI).rem_euclid(TAU) - PI;
        (self.from_rad..=self.to_rad).contains(&wrapped)
    }
}

/// What is seen in one direction from one place.
#[derive(Debug, Clone, Default)]
struct Bin {
    near_m: Vec<f64>,
    n: usize,
}

/// The sectors; `None` if the taped distances are too alike to tell the vehicle from the hall.
pub(super) fn sectors(positions: &[Position]) -> Option<Vec<Sector>> {
    let taped = || positions.iter().map(|position| position.taped_m);
    let moved_m = taped().fold(f64::NEG_INFINITY, f64::max) - taped().fold(f64::INFINITY, f64::min);
    if moved_m < LEAST_MOVE_M {
        return None;
    }
    let seen: Vec<Vec<Bin>> = positions.iter().map(bins).collect();
    let own: Vec<Option<f64>> = (0..N_BINS)
        .map(|k| steady_m(&seen.iter().map(|bins| &bins[k]).collect::<Vec<_>>()))
        .collect();
    Some(merged(&own))
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "0 to 359"
)]
fn bins(position: &Position) -> Vec<Bin> {
    let mut bins = vec![Bin::default(); N_BINS];
    for beam in position.scans.iter().flat_map(|scan| &scan.beams) {
        let turned = (f64::from(beam.angle_rad) + PI).rem_euclid(TAU) / TAU * N_BINS as f64;
        let bin = &mut bins[(turned as usize).min(N_BINS - 1)];
        bin.n += 1;
        let range_m = f64::from(beam.range_m);
        if range_m > 0.0 && range_m < MAX_BODY_M {
            bin.near_m.push(range_m);
        }
    }
    for bin in &mut bins {
        bin.near_m.sort_by(f64::total_cmp);
    }
    bins
}

/// Nearest distance of what stays in a direction at all places.
#[expect(clippy::cast_precision_loss, reason = "counts of beams")]
fn steady_m(bins: &[&Bin]) -> Option<f64> {
    let is_seen = bins
        .iter()
        .all(|bin| !bin.near_m.is_empty() && bin.near_m.len() as f64 >= LEAST_SHARE * bin.n as f64);
    if !is_seen {
        return None;
    }
    let middles = || bins.iter().map(|bin| bin.near_m[bin.near_m.len() / 2]);
    let spread_m =
        middles().fold(f64::NEG_INFINITY, f64::max) - middles().fold(f64::INFINITY, f64::min);
    let nearest_m = bins.iter().map(|bin| bin.near_m[0]).fold(f64::INFINITY, f64::min);
    (spread_m < STEADY_M).then_some(nearest_m)
}

/// Runs of directions, wider by the margin, cut at ±180°.
#[expect(clippy::cast_precision_loss, reason = "0 to 360")]
fn merged(own: &[Option<f64>]) -> Vec<Sector> {
    let mut closed = vec![false; N_BINS];
    for k in (0..N_BINS).filter(|k| own[*k].is_some()) {
        for step in 0..=2 * MARGIN_BINS {
            closed[(k + N_BINS + step - MARGIN_BINS) % N_BINS] = true;
        }
    }
    bridge(&mut closed);
    let angle_rad = |k: usize| k as f64 / N_BINS as f64 * TAU - PI;
    let mut sectors = Vec::new();
    let mut k = 0;
    while k < N_BINS {
        let from = k;
        while k < N_BINS && closed[k] {
            k += 1;
        }
        if k > from {
            // A sector that is only the margin of one beyond ±180° has its nearest there.
            let around =
                (from + N_BINS - MARGIN_BINS..k + N_BINS + MARGIN_BINS).map(|k| k % N_BINS);
            let nearest_m = around.filter_map(|k| own[k]).fold(f64::INFINITY, f64::min);
            sectors.push(Sector { from_rad: angle_rad(from), to_rad: angle_rad(k), nearest_m });
        }
        k += 1;
    }
    sectors
}

/// Closes narrow free directions between two parts.
fn bridge(closed: &mut [bool]) {
    let before = closed.to_vec();
    for (k, bin) in closed.iter_mut().enumerate() {
        let is_near = |forward: bool| {
            (1..=BRIDGE_BINS)
                .any(|step| before[if forward { k + step } else { k + N_BINS - step } % N_BINS])
        };
        *bin |= is_near(true) && is_near(false);
    }
}
