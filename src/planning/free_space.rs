//! Where the vehicle may be: clear of everything solid, and with markers enough to know where it
//! is.
//!
//! ```text
//! C_free = { χ : q_pos(Σ^χ(χ)) > τ  and  χ is clear },   q_pos = 1/√tr(Σ^χ)
//! ```
//! The quality stands on a 4-D grid over x, y, z and heading ([`QualityGrid`], which says how it is
//! interpolated), level attitude; [`Clearance`] judges the geometry, without any grid.
//!
//! The candidate sites of the paper's planner are a lattice of their own at the height and heading
//! of the survey, evaluated directly.
//! Source of `q_pos` and `C_free`: Balula et al. 2023, section 3.

use super::clearance::Clearance;
use super::grid_axis::Axis;
use super::quality_grid::{Axes, QualityGrid, Sensing};
use super::{Settings, Waypoint};
use crate::geometry::{Body, Hall, Point, Transform};
use crate::localization::camera_model::CameraModel;
use crate::localization::marker_map::MarkerMap;
use crate::localization::vision_fix::q_pos;
use crate::messages::HeightMap;
use crate::units::wrapped_rad;
use nalgebra::{Matrix6, Vector2, Vector3};
use std::sync::Arc;

/// One candidate place with what a fix from there would be worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Site {
    /// Where, and the heading there.
    pub waypoint: Waypoint,
    /// Covariance of one fix from there, 6×6; `None` where a fix is not observable.
    pub fix_cov: Option<Matrix6<f64>>,
    /// Nothing solid is too near.
    pub is_clear: bool,
}

impl Site {
    /// `q_pos`; 0 where a fix is not observable.
    #[must_use]
    pub fn quality(&self) -> f64 {
        self.fix_cov.as_ref().map_or(0.0, q_pos)
    }
}

/// Where the vehicle may be. Clones share what is evaluated already.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSpace {
    sites: Arc<[Site]>,
    min_quality: f64,
    clearance: Clearance,
    quality: Arc<QualityGrid>,
}

/// What a detector can still read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Legibility {
    /// Shortest edge of a tag in the image, px.
    pub min_edge_px: f64,
    /// Largest angle between the tag's normal and the line of sight, rad.
    pub max_obliquity_rad: f64,
    /// Distance to the border of the image, px.
    pub margin_px: f64,
}

impl Default for Legibility {
    fn default() -> Self {
        Self { min_edge_px: 16.0, max_obliquity_rad: 1.22, margin_px: 4.0 }
    }
}

impl FreeSpace {
    /// Evaluates the candidate sites; the grid is evaluated where it is asked.
    ///
    /// Every camera contributes its corners; information of several cameras adds.
    #[must_use]
    pub fn evaluate(
        settings: &Settings,
        cameras: &[CameraModel],
        map: &MarkerMap,
        corner_sigma_px: f64,
    ) -> Self {
        let space = &settings.space;
        let sensing = Sensing {
            obstacles: space.obstacles.clone(),
            walls: space.walls.clone(),
            vehicle_radius_m: space.vehicle_radius_m,
            ..Sensing::open(cameras, map, corner_sigma_px)
        };
        let clearance = Clearance::new(Arc::new(space.clone()));
        let sites = lattice(settings)
            .map(|waypoint| Site {
                waypoint,
                fix_cov: sensing.fix_cov(&waypoint.level_pose()),
                is_clear: clearance.is_clear(&waypoint.place.coords),
            })
            .collect();
        let quality = Arc::new(QualityGrid::new(sensing, axes(settings)));
        Self { sites, min_quality: settings.min_fix_quality, clearance, quality }
    }

    /// The same space over the surface that a map shows, h + 3σ, instead of the highest level that
    /// any pile may have.
    #[must_use]
    pub fn with_surface(&self, map: &HeightMap) -> Self {
        Self { clearance: self.clearance.with_surface(map), ..self.clone() }
    }

    /// The candidate sites where a fix is good enough and nothing solid is too near.
    pub fn feasible(&self) -> impl Iterator<Item = &Site> {
        self.sites.iter().filter(|site| self.is_feasible(site))
    }

    /// True if the fix there is good enough and nothing solid is too near.
    #[must_use]
    pub fn is_feasible(&self, site: &Site) -> bool {
        site.is_clear && site.quality() > self.min_quality
    }

    /// The candidate site that is nearest to a point.
    #[must_use]
    pub fn nearest(&self, waypoint: &Waypoint) -> Option<&Site> {
        let distance_m = |site: &&Site| site.waypoint.distance_m(waypoint);
        self.sites.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
    }

    /// True if the vehicle may be there and knows where it is: clear, and a fix good enough from
    /// every node of the grid around.
    ///
    /// Cost: about a microsecond once the nodes around are evaluated; up to 16 evaluations of a fix
    /// before. [`QualityGrid::fill`] evaluates all.
    #[must_use]
    pub fn is_free(&self, waypoint: &Waypoint) -> bool {
        self.clearance.is_clear(&waypoint.place.coords)
            && self.quality.is_better(waypoint, self.min_quality)
    }

    /// True if the straight way between two waypoints is free, turning evenly the shorter way.
    ///
    /// Nothing solid is stepped over: clearance is judged along the whole way. The quality of a fix
    /// is looked at [`LOOKS_PER_NODE`] times between two nodes of the grid.
    #[must_use]
    pub fn is_way_free(&self, from: &Waypoint, to: &Waypoint) -> bool {
        self.clearance.is_way_clear(&from.place.coords, &to.place.coords)
            && self.has_fix_along(from, to)
    }

    /// True if the fix is good enough along the whole straight way, whatever stands there.
    #[must_use]
    pub fn has_fix_along(&self, from: &Waypoint, to: &Waypoint) -> bool {
        let axes = self.quality.axes();
        let turn_rad = wrapped_rad(to.yaw_rad - from.yaw_rad);
        let along = (to.place - from.place).coords;
        let in_nodes =
            Vector3::new(along.x / axes.x.step, along.y / axes.y.step, along.z / axes.z.step);
        let turned_nodes = turn_rad / Axis::turn(axes.n_headings).step;
        let n_looks = (LOOKS_PER_NODE * in_nodes.norm().max(turned_nodes.abs())).ceil().max(1.0);
        std::iter::successors(Some(0.0), |k| (*k < n_looks).then_some(k + 1.0)).all(|k| {
            let share = k / n_looks;
            let waypoint = Waypoint {
                place: Point::from_coords(from.place.coords + along * share),
                yaw_rad: from.yaw_rad + turn_rad * share,
            };
            self.quality.is_better(&waypoint, self.min_quality)
        })
    }

    /// Covariance of one fix from a waypoint, 6×6, interpolated between the nodes of the grid;
    /// `None` where one of those has no fix, or outside of the grid.
    #[must_use]
    pub fn fix_cov(&self, waypoint: &Waypoint) -> Option<Matrix6<f64>> {
        self.quality.fix_cov(waypoint)
    }

    /// The geometry.
    #[must_use]
    pub const fn clearance(&self) -> &Clearance {
        &self.clearance
    }

    /// The grid of the quality of a fix.
    #[must_use]
    pub fn quality(&self) -> &QualityGrid {
        &self.quality
    }

    /// τ: the quality that a fix needs.
    #[must_use]
    pub const fn min_quality(&self) -> f64 {
        self.min_quality
    }
}

/// How often the quality along a way is looked at between two nodes.
pub const LOOKS_PER_NODE: f64 = 4.0;
/// Without walls or a fence the grid reaches this far around the bounds of the waypoints, m.
const AROUND_BOUNDS_M: f64 = 2.0;

/// The grid over everything that may be flown through, with nodes at the lattice's corner and at the
/// height and heading of the survey.
fn axes(settings: &Settings) -> Axes {
    let (space, b) = (&settings.space, &settings.bounds);
    let fence = space.fence.as_ref();
    let outline = space.walls.as_ref().or(fence.and_then(|fence| fence.outline.as_ref()));
    let (x_m, y_m) = match outline.map(|outline| outline.bounds()) {
        Some(plan) => ((plan.x_min_m, plan.x_max_m), (plan.y_min_m, plan.y_max_m)),
        None => (
            (b.x_min_m - AROUND_BOUNDS_M, b.x_max_m + AROUND_BOUNDS_M),
            (b.y_min_m - AROUND_BOUNDS_M, b.y_max_m + AROUND_BOUNDS_M),
        ),
    };
    let keep_off_m = space.vehicle_radius_m + space.margin_m;
    let over_piles_m = space.vehicle_radius_m + space.surface_clearance_m;
    let low_m = space.highest_surface_m.map_or(settings.height_m, |top_m| top_m + over_piles_m);
    let high_m = space.ceiling_m.map_or(f64::INFINITY, |ceiling_m| ceiling_m - keep_off_m);
    let high_m = fence.map_or(high_m, |fence| high_m.min(fence.max_height_m));
    let high_m = if high_m.is_finite() { high_m } else { settings.height_m };
    let z = Axis::through(settings.height_m, space.height_step_m, (low_m, high_m));
    Axes {
        x: Axis::through(b.x_min_m, space.grid_m, x_m),
        y: Axis::through(b.y_min_m, space.grid_m, y_m),
        z,
        n_headings: space.n_headings,
        first_yaw_rad: settings.yaw_rad,
        survey_height: z.nearest(settings.height_m),
    }
}

/// Places at equal distance over the bounds, their border included.
fn lattice(settings: &Settings) -> impl Iterator<Item = Waypoint> + '_ {
    let b = settings.bounds;
    let axis = |from_m: f64, to_m: f64| {
        let count = ((to_m - from_m) / settings.candidate_spacing_m).round().max(1.0);
        let step_m = (to_m - from_m) / count;
        std::iter::successors(Some(0.0), move |k| (*k < count).then_some(k + 1.0))
            .map(move |k| from_m + k * step_m)
    };
    axis(b.y_min_m, b.y_max_m).flat_map(move |y| {
        axis(b.x_min_m, b.x_max_m).map(move |x| Waypoint {
            place: Point::new(x, y, settings.height_m),
            yaw_rad: settings.yaw_rad,
        })
    })
}

/// True if a detector could read the tag from this pose; walls between are not considered.
#[must_use]
pub fn is_legible(
    camera: &CameraModel,
    corners: &[Point<Hall>; 4],
    hall_from_body: &Transform<Hall, Body>,
    legibility: &Legibility,
) -> bool {
    let hall_from_camera = *hall_from_body * camera.body_from_camera;
    let right = (corners[1] - corners[0]).coords;
    let normal = right.cross(&(corners[3] - corners[0]).coords);
    let sight = (hall_from_camera.origin - corners[0]).coords;
    let cos_obliquity = normal.dot(&sight) / (normal.norm() * sight.norm());
    if cos_obliquity.is_nan() || cos_obliquity < legibility.max_obliquity_rad.cos() {
        return false;
    }
    let camera_from_hall = hall_from_camera.inverse();
    let pixels: Option<Vec<Vector2<f64>>> = corners
        .iter()
        .map(|corner| {
            let (pixel, _) = camera.project(&(camera_from_hall * *corner))?;
            camera.contains(&pixel, legibility.margin_px).then_some(pixel)
        })
        .collect();
    pixels.is_some_and(|p| (0..4).all(|k| (p[k] - p[(k + 1) % 4]).norm() >= legibility.min_edge_px))
}

#[cfg(test)]
pub(super) mod tests;
