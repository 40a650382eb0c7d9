//! The paper's planner: the feasible waypoint within a radius that leaves the smallest σ^V.
//!
//! ```text
//! χ_{k+1} = argmin { σ^V after the scans on the way to χ : |χ − χ_k| ≤ R, χ ∈ C_free }
//! ```
//! Scans are predicted on a flat surface at the nominal height h0, without shadows, level, at
//! fixed height and heading; the belief is the height grid's own update law. With
//! [`super::Settings::sees_shadows`], which is not the paper's, known ground hides what is behind it.
//!
//! Source: Balula et al. 2023, section 5. Printed as arg max; minimising is meant. One step only:
//! where no single step sees new ground it wanders.

use super::Waypoint;
use super::free_space::Site;
use super::height_view::seen_ratio;
use super::planner::{Belief, Plan, PlanEnd, PlanRequest, Planner};
use crate::geometry::{Direction, Point};
use crate::mapping::KnownHeights;
use crate::mapping::kalman_grid::KalmanGrid;
use crate::mapping::projection::project;
use crate::messages::Beam;
use nalgebra::Matrix6;

/// The paper's planner.
#[derive(Debug, Clone, Copy)]
pub struct Greedy;

impl Planner for Greedy {
    /// One waypoint, or none if nothing feasible is in reach.
    fn plan(&self, request: &PlanRequest) -> Plan {
        let chosen = match &request.belief {
            Belief::Grid { cells, areas_m2 } => {
                let heights = request.settings.sees_shadows.then(|| cells.known_heights());
                Choice { request, areas_m2, heights }.best(cells)
            }
            Belief::Field { .. } => None,
        };
        chosen.map_or(Plan::nothing(PlanEnd::NothingFree), |waypoint| Plan {
            waypoints: vec![waypoint],
            end: PlanEnd::Open,
            prediction: None,
        })
    }
}

/// The choice of one waypoint.
struct Choice<'a> {
    request: &'a PlanRequest,
    areas_m2: &'a [f64],
    /// What hides what; `None` for the paper's flat surface.
    heights: Option<KnownHeights>,
}

/// Scans are predicted this far apart along the way, m.
const SCAN_SPACING_M: f64 = 0.5;
/// Beams of a predicted scan are this far apart, rad.
const BEAM_SPACING_RAD: f64 = 0.06;

impl Choice<'_> {
    /// The best next waypoint from the last pending one; `None` if nothing feasible is in reach.
    fn best(&self, cells: &KalmanGrid) -> Option<Waypoint> {
        let from = *self.request.pending.last()?;
        let mut belief = cells.clone();
        for pair in self.request.pending.windows(2) {
            self.observe_way(&mut belief, &pair[0], &pair[1]);
        }
        let candidates = self.candidates(&from);
        // Outside of the lattice's reach (over the pad) the way in comes first.
        let candidates = if candidates.is_empty() { self.entrance(&from) } else { candidates };
        candidates
            .into_iter()
            .map(|site| {
                let mut after = belief.clone();
                self.observe_way(&mut after, &from, &site.waypoint);
                (self.volume_var(&after), site.waypoint)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, waypoint)| waypoint)
    }

    /// Feasible places within R, the present one left out.
    fn candidates(&self, from: &Waypoint) -> Vec<&Site> {
        let radius_m = self.request.settings.step_radius_m + 1e-9;
        let nearest_m = 0.5 * self.request.settings.candidate_spacing_m;
        let is_in_reach =
            |site: &&Site| (nearest_m..=radius_m).contains(&site.waypoint.distance_m(from));
        self.request.free_space.feasible().filter(is_in_reach).collect()
    }

    /// The nearest feasible place, if the present one is outside of all.
    fn entrance(&self, from: &Waypoint) -> Vec<&Site> {
        let distance_m = |site: &&Site| site.waypoint.distance_m(from);
        let nearest = self
            .request
            .free_space
            .feasible()
            .min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        nearest.into_iter().filter(|site| distance_m(site) > 1e-3).collect()
    }

    /// Σ A² σ² over the cells, the printed variance of the volume.
    fn volume_var(&self, belief: &KalmanGrid) -> f64 {
        std::iter::zip(self.areas_m2.iter(), belief.var_m2())
            .map(|(area, var)| area * area * var)
            .sum()
    }

    /// Updates the belief by the scans from `a` (left out) to `b`; without a fix there, nothing is
    /// learned.
    fn observe_way(&self, belief: &mut KalmanGrid, a: &Waypoint, b: &Waypoint) {
        let Some(fix_cov) = self.request.free_space.nearest(b).and_then(|site| site.fix_cov) else {
            return;
        };
        let way_m = a.distance_m(b);
        let n_scans = (way_m / SCAN_SPACING_M).ceil().max(1.0);
        let mut k = 1.0;
        while k <= n_scans {
            let coords = a.place.coords.lerp(&b.place.coords, k / n_scans);
            let waypoint = Waypoint { place: Point::from_coords(coords), ..*b };
            self.observe_from(belief, &waypoint, &fix_cov);
            k += 1.0;
        }
    }

    /// One predicted scan: the beams that meet the nominal surface inside the swath.
    fn observe_from(&self, belief: &mut KalmanGrid, from: &Waypoint, fix_cov: &Matrix6<f64>) {
        let pose = from.level_pose();
        let sensor = pose * self.request.lidar.body_from_lidar;
        let drop_m = sensor.origin.coords.z - self.request.settings.nominal_height_m;
        let least_cos = self.request.settings.swath_half_angle_rad.cos();
        let mut angle_rad = -std::f64::consts::PI;
        while angle_rad < std::f64::consts::PI {
            let along = sensor.rotation * Direction::new(angle_rad.cos(), angle_rad.sin(), 0.0);
            let down = -along.coords.z;
            let range_m = drop_m / down;
            let returns = down >= least_cos
                && (self.request.lidar.min_range_m..=self.request.lidar.max_range_m)
                    .contains(&range_m)
                && !self.request.lidar.is_blind(angle_rad)
                && self.heights.as_ref().is_none_or(|heights| {
                    let origin = sensor.origin.coords;
                    let end = (origin + along.coords * range_m).xy();
                    seen_ratio(heights, &origin, &end) > 0.5
                });
            if returns {
                #[expect(clippy::cast_possible_truncation, reason = "beams are single precision")]
                let beam = Beam {
                    offset_ns: 0,
                    angle_rad: angle_rad as f32,
                    range_m: range_m as f32,
                    intensity: 0,
                };
                belief.insert(&project(&self.request.lidar, &beam, &pose, fix_cov), |_| true);
            }
            angle_rad += BEAM_SPACING_RAD;
        }
    }
}

#[cfg(test)]
mod tests;
