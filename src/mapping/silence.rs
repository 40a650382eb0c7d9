//! Beams without an echo, which passed over ground as well.
//!
//! ```text
//!   LiDAR ●──────┐ reach
//!         ╲ ╲ no echo
//!          ╲   ╲________________   the ground here is below the lowest silent ray,
//!     ______╲        ?             or it would have answered
//!       seen
//! ```
//! Ground behind a crest or far away is often seen by no ray that ends on something behind it. What lies high there would
//! have answered; so what stays silent is low, and a field that does not know that takes it to be too high: by 0.1 to 0.8 m
//! in the far corners of the simulated alps.
//!
//! Silence can have other causes, so it counts only
//! - where neighbouring beams are silent too: single ones get lost everywhere,
//! - up to the [`Reach`] within which known ground has answered in this flight,
//! - where the ray meets neither known ground nor the floor before that: else it was lost.
//!
//! All of it is judged anew in every solve, by the newest surface: what is lost shows when its ground is known.
//! Checked: `only_runs_of_silent_beams_count`, `rays_that_would_have_met_known_ground_are_lost`,
//! `rays_that_graze_known_ground_say_nothing`, `silence_over_hidden_ground_lowers_its_ceiling` of the mapper,
//! `ground_that_stays_silent_shortens_the_reach`, and by surveys of fading and dark ground in the simulator.

use super::datum::Linearization;
use super::footprint::{Footprint, Patch};
use super::reach::Reach;
use crate::geometry::{Hall, Point};
use crate::messages::{Beam, Scan};
use nalgebra::Vector3;
use std::sync::Arc;

/// A beam counts as silent if it stands in the middle of so many silent ones.
const RUN: usize = 5;
/// Rays of a turn that point less than this apart tell the same, rad: half a cell at the usual reach.
const APART_RAD: f64 = 0.02;
/// A ray that passes less than this below the known surface, m, may have passed over it, or not: crests
/// lie between nodes, poses are off by centimetres. It says nothing.
const BELOW_M: f64 = 0.1;
/// Nearer than this a LiDAR is silent by itself, m.
const TOO_NEAR_M: f64 = 1.0;

/// Neighbouring beams of a turn without an echo.
///
/// Single precision holds 8 µm at 100 m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SilentRay {
    /// Where one of them would have ended at most, in the hall, m.
    pub to_m: [f32; 3],
    /// Number of beams.
    pub n_beams: u16,
}

/// Rays of one turn that met nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeRays {
    /// Which of the turns it was.
    pub turn_idx: usize,
    /// Where they began, in the hall, m.
    pub from_m: Vector3<f64>,
    /// How far they are free, in the hall, m.
    pub to_m: Vec<Vector3<f64>>,
}

/// The beams in the middle of silent ones, in their order.
pub fn silent_beams(scan: &Scan) -> impl Iterator<Item = &Beam> {
    let is_silent = |beam: &Beam| beam.range_m <= 0.0;
    let runs = scan.beams.windows(RUN);
    runs.filter(move |run| run.iter().all(is_silent)).map(|run| &run[RUN / 2])
}

/// Gathers silent beams that end there, in their order, `length_m` long.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "rounded to single precision on purpose")]
pub fn gather_silent(ends: &[Point<Hall>], length_m: f64) -> Vec<SilentRay> {
    let mut rays: Vec<SilentRay> = Vec::new();
    for end in ends.iter().map(|end| end.coords) {
        let is_beside = |ray: &&mut SilentRay| {
            (end - place(ray.to_m)).norm() < APART_RAD * length_m && ray.n_beams < u16::MAX
        };
        match rays.last_mut().filter(is_beside) {
            Some(ray) => ray.n_beams += 1,
            None => rays.push(SilentRay { to_m: end.map(|c| c as f32).into(), n_beams: 1 }),
        }
    }
    rays
}

/// What no ground lies below, m over the hall floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// Under each cell of the grid.
    pub of_cells_m: Vec<f64>,
    /// Beside the grid.
    pub elsewhere_m: f64,
}

/// The silent rays of all turns that are known to have met nothing, as far as that is known; none before
/// there is a surface to judge them by.
#[must_use]
pub fn free_rays(turns: &[Arc<Footprint>], at: &Linearization<'_>, floor: &Floor) -> Vec<FreeRays> {
    let Some(known) = Known::new(at, floor) else { return Vec::new() };
    let judged: Vec<JudgedTurn<'_>> =
        turns.iter().enumerate().filter_map(|turn| JudgedTurn::new(turn, &known)).collect();
    let mut reaches = vec![Reach::default(); at.lidars.len()];
    for turn in &judged {
        turn.tell(&mut reaches[turn.footprint.lidar_idx]);
    }
    let reaches_m: Vec<Option<f64>> = reaches.iter().map(Reach::range_m).collect();
    let free = judged.iter().filter_map(|turn| {
        let reach_m = reaches_m[turn.footprint.lidar_idx]?;
        let to_m: Vec<_> = turn.free_ends(reach_m).collect();
        let free = FreeRays { turn_idx: turn.turn_idx, from_m: turn.lidar_m, to_m };
        (!free.to_m.is_empty()).then_some(free)
    });
    free.collect()
}

/// A turn whose silent rays were followed.
struct JudgedTurn<'a> {
    turn_idx: usize,
    footprint: &'a Footprint,
    lidar_m: Vector3<f64>,
    /// By silent ray, where it met the ground.
    met: Vec<Option<Met>>,
}

/// Where a ray passed below known ground or the floor.
#[derive(Debug, Clone, Copy)]
struct Met {
    /// At first.
    range_m: f64,
    /// Where it certainly met what is measured: that tells how far ground answers.
    lost_at_m: Option<f64>,
}

impl<'a> JudgedTurn<'a> {
    fn new((turn_idx, footprint): (usize, &'a Arc<Footprint>), known: &Known<'_>) -> Option<Self> {
        let lidar = known.at.lidars.get(footprint.lidar_idx)?;
        let lidar_m = (footprint.hall_from_body * lidar.body_from_lidar.origin).coords;
        let met = |ray: &SilentRay| known.meets(&lidar_m, &place(ray.to_m));
        Some(Self { turn_idx, footprint, lidar_m, met: footprint.silent.iter().map(met).collect() })
    }

    /// What the turn tells of how far ground answers.
    fn tell(&self, reach: &mut Reach) {
        for patch in &self.footprint.patches {
            reach.take_echoes((Patch::place(patch) - self.lidar_m).norm(), patch.n_beams.into());
        }
        for (ray, met) in std::iter::zip(&self.footprint.silent, &self.met) {
            if let Some(range_m) = met.and_then(|met| met.lost_at_m).filter(|at| *at > TOO_NEAR_M) {
                reach.take_lost(range_m, ray.n_beams.into());
            }
        }
    }

    /// The ends of rays that met nothing within the reach.
    fn free_ends(&self, reach_m: f64) -> impl Iterator<Item = Vector3<f64>> {
        let rays = std::iter::zip(&self.footprint.silent, &self.met);
        let free = rays.filter(move |(_, met)| met.is_none_or(|met| met.range_m > reach_m));
        free.map(move |(ray, _)| {
            let whole_m = place(ray.to_m) - self.lidar_m;
            self.lidar_m + whole_m * (reach_m / whole_m.norm()).min(1.0)
        })
    }
}

/// The ground that rays are judged by.
struct Known<'a> {
    at: &'a Linearization<'a>,
    floor: &'a Floor,
    /// Nothing known is higher, m.
    top_m: f64,
}

impl<'a> Known<'a> {
    fn new(at: &'a Linearization<'a>, floor: &'a Floor) -> Option<Self> {
        let known = std::iter::zip(at.heights_m?, at.is_known).filter(|(_, is_known)| **is_known);
        let heights_m = known.map(|(height_m, _)| height_m).chain(&floor.of_cells_m);
        let top_m = heights_m.copied().fold(floor.elsewhere_m, f64::max);
        Some(Self { at, floor, top_m })
    }

    /// Follows a ray in steps of a cell.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "rays are some hundred cells long at most"
    )]
    fn meets(&self, from_m: &Vector3<f64>, to_m: &Vector3<f64>) -> Option<Met> {
        let whole_m = to_m - from_m;
        let length_m = whole_m.norm();
        let n_steps = (length_m / self.at.lattice.spacing_m()).ceil().max(1.0);
        // Above all that is known nothing is met.
        let above = ((from_m.z - self.top_m) / (from_m.z - to_m.z)).clamp(0.0, 1.0);
        let first = if to_m.z < from_m.z { (above * n_steps).floor() } else { 0.0 };
        let mut before: Option<(f64, f64)> = None;
        let mut below_from_m: Option<f64> = None;
        let mut met: Option<Met> = None;
        for step in first as usize..=n_steps as usize {
            let range_m = length_m * (step as f64 / n_steps);
            let p = from_m + whole_m * (step as f64 / n_steps);
            let (ground_m, is_measured) = self.ground(p.x, p.y);
            let over_m = p.z - ground_m;
            if over_m < 0.0 {
                // Between two steps rays and ground are straight.
                let back = before.map_or(0.0, |(_, was_over_m)| over_m / (over_m - was_over_m));
                let step_m = before.map_or(0.0, |(was_at_m, _)| range_m - was_at_m);
                let from_m = *below_from_m.get_or_insert(range_m - back * step_m);
                let met = met.get_or_insert(Met { range_m: from_m, lost_at_m: None });
                if over_m < -BELOW_M {
                    met.lost_at_m = is_measured.then_some(from_m);
                    break;
                }
            } else {
                below_from_m = None;
            }
            before = Some((range_m, over_m));
        }
        met
    }

    /// The height of what a ray would meet at a place, m, and if it is measured there.
    fn ground(&self, x_m: f64, y_m: f64) -> (f64, bool) {
        let lattice = self.at.lattice;
        let cell = lattice.grid().cell_at(x_m, y_m);
        let row = lattice.row_at(x_m, y_m);
        let surface_m = row.and_then(|row| self.at.known_surface_m(&row));
        let floor_m = cell.map_or(self.floor.elsewhere_m, |cell| self.floor.of_cells_m[cell]);
        (surface_m.unwrap_or(floor_m), cell.is_some())
    }
}

fn place(place_m: [f32; 3]) -> Vector3<f64> {
    Vector3::from(place_m).map(f64::from)
}

#[cfg(test)]
mod tests;
