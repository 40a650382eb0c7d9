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
/// A ray meets the ground when it is this much below the known surface, m: a crest between two nodes
/// is not a matter of nodes.
const BELOW_M: f64 = 0.1;

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

/// The silent rays of all turns that are known to have met nothing, as far as that is known; none before
/// there is a surface to judge them by. No ground lies lower than `floor_m`.
#[must_use]
pub fn free_rays(turns: &[Arc<Footprint>], at: &Linearization<'_>, floor_m: f64) -> Vec<FreeRays> {
    let judged = turns.iter().filter_map(|turn| JudgedTurn::new(turn, at, floor_m));
    let judged: Vec<JudgedTurn<'_>> = judged.collect();
    let mut reaches = vec![Reach::default(); at.lidars.len()];
    for turn in &judged {
        turn.tell(&mut reaches[turn.footprint.lidar_idx]);
    }
    let reaches_m: Vec<Option<f64>> = reaches.iter().map(Reach::range_m).collect();
    let free = judged.iter().filter_map(|turn| {
        let reach_m = reaches_m[turn.footprint.lidar_idx]?;
        let to_m: Vec<_> = turn.free_ends(reach_m).collect();
        (!to_m.is_empty()).then_some(FreeRays { from_m: turn.lidar_m, to_m })
    });
    free.collect()
}

/// A turn whose silent rays were followed.
struct JudgedTurn<'a> {
    footprint: &'a Footprint,
    lidar_m: Vector3<f64>,
    /// By silent ray, where it would have met the ground.
    met: Vec<Option<Met>>,
}

#[derive(Debug, Clone, Copy)]
struct Met {
    range_m: f64,
    /// Within what is measured, where it tells how far ground answers.
    is_inside: bool,
}

impl<'a> JudgedTurn<'a> {
    fn new(footprint: &'a Footprint, at: &Linearization<'_>, floor_m: f64) -> Option<Self> {
        at.heights_m?;
        let lidar = at.lidars.get(footprint.lidar_idx)?;
        let lidar_m = (footprint.hall_from_body * lidar.body_from_lidar.origin).coords;
        let met = |ray: &SilentRay| meets(&lidar_m, &place(ray.to_m), at, floor_m);
        Some(Self { footprint, lidar_m, met: footprint.silent.iter().map(met).collect() })
    }

    /// What the turn tells of how far ground answers.
    fn tell(&self, reach: &mut Reach) {
        for patch in &self.footprint.patches {
            reach.take_echoes((Patch::place(patch) - self.lidar_m).norm(), patch.n_beams.into());
        }
        for (ray, met) in std::iter::zip(&self.footprint.silent, &self.met) {
            if let Some(met) = met.filter(|met| met.is_inside) {
                reach.take_lost(met.range_m, ray.n_beams.into());
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

/// Where a ray first passes below known ground or the floor.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rays are some hundred cells long at most"
)]
fn meets(
    from_m: &Vector3<f64>,
    to_m: &Vector3<f64>,
    at: &Linearization<'_>,
    floor_m: f64,
) -> Option<Met> {
    let whole_m = to_m - from_m;
    let n_steps = (whole_m.norm() / at.lattice.spacing_m()).ceil() as usize;
    (1..=n_steps).find_map(|step| {
        let along_m = whole_m * (step as f64 / n_steps as f64);
        let p = from_m + along_m;
        let row = at.lattice.row_at(p.x, p.y);
        let ground_m = row.as_ref().and_then(|row| at.known_surface_m(row));
        (p.z < ground_m.unwrap_or(floor_m) - BELOW_M)
            .then(|| Met { range_m: along_m.norm(), is_inside: row.is_some() })
    })
}

fn place(place_m: [f32; 3]) -> Vector3<f64> {
    Vector3::from(place_m).map(f64::from)
}

#[cfg(test)]
mod tests;
