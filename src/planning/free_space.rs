//! Where the vehicle may be: inside the bounds, and with markers enough to know where it is.
//!
//! ```text
//! C_free = { χ : q_pos(Σ^χ(χ)) > τ },   q_pos = 1/√tr(Σ^χ)
//! ```
//! evaluated on a lattice at the flight's height and heading, level attitude.
//! Source: Balula et al. 2023, section 3.

use super::{Settings, Waypoint};
use crate::geometry::{Body, Hall, Point, Transform};
use crate::localization::camera_model::CameraModel;
use crate::localization::marker_map::MarkerMap;
use crate::localization::vision_fix::{predicted_cov, q_pos};
use nalgebra::{Matrix6, Vector2};

/// One candidate place with what a fix from there would be worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Site {
    /// Where, and the heading there.
    pub waypoint: Waypoint,
    /// Covariance of one fix from there, 6×6; `None` where a fix is not observable.
    pub fix_cov: Option<Matrix6<f64>>,
}

impl Site {
    /// `q_pos`; 0 where a fix is not observable.
    #[must_use]
    pub fn quality(&self) -> f64 {
        self.fix_cov.as_ref().map_or(0.0, q_pos)
    }
}

/// The lattice of candidate waypoints with their quality of fix.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSpace {
    sites: Vec<Site>,
    min_quality: f64,
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
    /// Evaluates the lattice.
    ///
    /// Every camera contributes its corners; information of several cameras adds.
    #[must_use]
    pub fn evaluate(
        settings: &Settings,
        cameras: &[CameraModel],
        map: &MarkerMap,
        corner_sigma_px: f64,
    ) -> Self {
        let sites = lattice(settings)
            .map(|waypoint| {
                let pose = waypoint.level_pose();
                Site { waypoint, fix_cov: fix_cov(cameras, map, &pose, corner_sigma_px) }
            })
            .collect();
        Self { sites, min_quality: settings.min_fix_quality }
    }

    /// The places where a fix is good enough.
    pub fn feasible(&self) -> impl Iterator<Item = &Site> {
        self.sites.iter().filter(|site| self.is_feasible(site))
    }

    /// True if the fix there is good enough.
    #[must_use]
    pub fn is_feasible(&self, site: &Site) -> bool {
        site.quality() > self.min_quality
    }

    /// The place of the lattice that is nearest to a point.
    #[must_use]
    pub fn nearest(&self, waypoint: &Waypoint) -> Option<&Site> {
        let distance_m = |site: &&Site| site.waypoint.distance_m(waypoint);
        self.sites.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
    }

    /// True if the vehicle may be there and knows where it is.
    #[must_use]
    pub fn is_free(&self, waypoint: &Waypoint) -> bool {
        self.nearest(waypoint).is_some_and(|site| self.is_feasible(site))
    }

    /// True if the straight way between two waypoints is free, looked at every `WAY_SPACING_M`.
    #[must_use]
    pub fn is_way_free(&self, from: &Waypoint, to: &Waypoint) -> bool {
        let n_parts = (from.distance_m(to) / WAY_SPACING_M).ceil().max(1.0);
        std::iter::successors(Some(0.0), |k| (*k < n_parts).then_some(k + 1.0)).all(|k| {
            let coords = from.place.coords.lerp(&to.place.coords, k / n_parts);
            self.is_free(&Waypoint { place: Point::from_coords(coords), ..*to })
        })
    }
}

/// Ways are looked at this often, m.
const WAY_SPACING_M: f64 = 0.25;

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

fn fix_cov(
    cameras: &[CameraModel],
    map: &MarkerMap,
    pose: &Transform<Hall, Body>,
    corner_sigma_px: f64,
) -> Option<Matrix6<f64>> {
    let info = cameras
        .iter()
        .filter_map(|camera| {
            let corners: Vec<Point<Hall>> = map
                .iter()
                .filter(|(_, _, corners)| is_legible(camera, corners, pose, &Legibility::default()))
                .flat_map(|(_, _, corners)| *corners)
                .collect();
            predicted_cov(camera, &corners, pose, corner_sigma_px)?.cholesky()
        })
        .map(|cov| cov.inverse())
        .sum::<Matrix6<f64>>();
    info.cholesky().map(|c| c.inverse())
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
