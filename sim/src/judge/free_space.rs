//! Did the vehicle stay where it could know its place, and clear of everything solid?
//!
//! ```text
//! C_free = { χ : q_pos(Σ^χ(χ)) > τ, distance to the nearest solid ≥ d }
//! q_pos  = 1/√tr(Σ^χ),   Σ^χ = σ² (JᵀJ)⁻¹
//! ```
//! - `J`: derivative of all corners in the true picture with respect to the pose, here by central
//!   differences of the simulated lens
//! - `σ`: the detector's true noise, px
//!
//! Source: Balula et al. 2023, section 3. Markers, walls between, lens and solids are the true
//! ones, so nothing is shared with the planners' own prediction.

use crate::camera::CameraModel;
use crate::world::World;
use nalgebra::{Matrix6, Vector2, Vector3, Vector6};
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};

/// The worth of one exact picture from a pose, 1/√(m² + rad²); 0 where it does not determine one.
#[must_use]
pub fn fix_quality(
    world: &World,
    camera: &CameraModel,
    hall_from_body: &Transform<Hall, Body>,
) -> f64 {
    let corners: Vec<Point<Hall>> =
        camera.view(world, hall_from_body).iter().flat_map(|seen| seen.tag.corners).collect();
    let Some(info) = information(camera, &corners, hall_from_body) else { return 0.0 };
    let Some(cov) = info.cholesky().map(|factor| factor.inverse()) else { return 0.0 };
    let sigma_px = camera.detector.pixel_sigma_px.max(LEAST_SIGMA_PX);
    let trace = sigma_px * sigma_px * cov.trace();
    if trace.is_finite() && trace > 0.0 { 1.0 / trace.sqrt() } else { 0.0 }
}

/// A detector without noise is still not believed any further, px.
const LEAST_SIGMA_PX: f64 = 0.02;
/// Step of the differences, m and rad.
const STEP: f64 = 1e-5;

/// The information of a picture: `JᵀJ`, px² per m² and rad².
fn information(
    camera: &CameraModel,
    corners: &[Point<Hall>],
    pose: &Transform<Hall, Body>,
) -> Option<Matrix6<f64>> {
    let project = |pose: &Transform<Hall, Body>, corner: &Point<Hall>| {
        let camera_from_hall = (*pose * camera.body_from_camera).inverse();
        camera.lens.project(&(camera_from_hall * *corner).coords).map(Vector2::from)
    };
    let mut info = Matrix6::zeros();
    for corner in corners {
        let mut rows = [Vector6::zeros(); 2];
        for k in 0..6 {
            let mut by = Vector6::zeros();
            by[k] = STEP;
            let moved = |by: Vector6<f64>| {
                pose.perturbed(
                    &Vector3::from(by.fixed_rows::<3>(0)),
                    &Vector3::from(by.fixed_rows::<3>(3)),
                )
            };
            let slope =
                (project(&moved(by), corner)? - project(&moved(-by), corner)?) / (2.0 * STEP);
            rows[0][k] = slope.x;
            rows[1][k] = slope.y;
        }
        info += rows[0] * rows[0].transpose() + rows[1] * rows[1].transpose();
    }
    Some(info)
}

/// What counts as free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeSpaceRule {
    /// τ: the quality of fix has to be above it.
    pub min_quality: f64,
    /// The middle of the body keeps this distance from everything solid, m.
    pub least_clearance_m: f64,
    /// So far beside its way a vehicle may be, because it does not fly it exactly, m.
    pub tolerance_m: f64,
}

/// Watches one survey.
///
/// A vehicle comes from its pad, which may lie outside; it is judged from the first moment inside.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSpaceJudge {
    rule: FreeSpaceRule,
    has_entered: bool,
    has_left: bool,
    least_clearance_m: f64,
}

impl FreeSpaceJudge {
    /// A judge who has not seen anything yet.
    #[must_use]
    pub const fn new(rule: FreeSpaceRule) -> Self {
        Self { rule, has_entered: false, has_left: false, least_clearance_m: f64::INFINITY }
    }

    /// Looks at the true place; attitude counts by its heading only.
    pub fn look(&mut self, world: &World, camera: &CameraModel, pose: &Transform<Hall, Body>) {
        let clearance_m = world.clearance_m(&pose.origin, CLEARANCE_REACH_M);
        let is_clear = clearance_m >= self.rule.least_clearance_m;
        if !self.has_entered {
            self.has_entered = is_clear && self.has_fix(world, camera, pose, [0.0, 0.0]);
            return;
        }
        self.least_clearance_m = self.least_clearance_m.min(clearance_m);
        let has_fix = || self.has_fix_nearby(world, camera, pose);
        self.has_left = self.has_left || !is_clear || !has_fix();
    }

    fn has_fix_nearby(
        &self,
        world: &World,
        camera: &CameraModel,
        pose: &Transform<Hall, Body>,
    ) -> bool {
        let by_m = self.rule.tolerance_m;
        [[0.0, 0.0], [by_m, 0.0], [-by_m, 0.0], [0.0, by_m], [0.0, -by_m]]
            .into_iter()
            .any(|offset_m| self.has_fix(world, camera, pose, offset_m))
    }

    fn has_fix(
        &self,
        world: &World,
        camera: &CameraModel,
        pose: &Transform<Hall, Body>,
        [x_m, y_m]: [f64; 2],
    ) -> bool {
        let place = Point::from_coords(pose.origin.coords + Vector3::new(x_m, y_m, 0.0));
        let level = Rotation::from_euler_rad(0.0, 0.0, pose.rotation.yaw_rad());
        fix_quality(world, camera, &Transform::new(level, place)) > self.rule.min_quality
    }

    /// It was inside, and then outside.
    #[must_use]
    pub const fn has_left(&self) -> bool {
        self.has_left
    }

    /// The smallest distance to anything solid since it was inside, m, as far as it was looked
    /// for; infinite before that.
    #[must_use]
    pub const fn least_clearance_m(&self) -> f64 {
        self.least_clearance_m
    }
}

/// Solids farther away are of no interest, m.
const CLEARANCE_REACH_M: f64 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn rule() -> FreeSpaceRule {
        FreeSpaceRule { min_quality: 8.0, least_clearance_m: 0.35, tolerance_m: 0.1 }
    }

    fn pose(x: f64, y: f64, z: f64, yaw_rad: f64) -> Transform<Hall, Body> {
        Transform::new(Rotation::from_euler_rad(0.0, 0.0, yaw_rad), Point::new(x, y, z))
    }

    #[test]
    fn half_the_noise_is_twice_the_quality() {
        let world = World::alps(3).unwrap();
        let camera = CameraModel::ahead();
        let mut sharper = camera.clone();
        sharper.detector.pixel_sigma_px *= 0.5;
        let at = pose(6.0, 9.0, 7.0, 0.2);
        let ratio = fix_quality(&world, &sharper, &at) / fix_quality(&world, &camera, &at);
        assert!((ratio - 2.0).abs() < 1e-9, "{ratio}");
    }

    #[test]
    fn one_marker_straight_ahead_is_worth_what_a_hand_calculation_says() {
        // A square of half edge a at distance d before a pinhole without distortion. For a fix of
        // the place alone, with the attitude known: du/dy = −f/d for each of four corners, so the
        // information about y is 4 f²/d² / σ². The rows of J must show that.
        let mut camera = CameraModel::ahead();
        camera.lens = crate::camera::Lens {
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            cx_px: 640.0,
            cy_px: 400.0,
            ..camera.lens
        };
        camera.body_from_camera = crate::camera::mounted(0.0, 0.0, 0.0, Point::origin());
        let (a, d) = (0.25, 5.0);
        let corners = [[-a, -a], [a, -a], [a, a], [-a, a]].map(|[y, z]| Point::new(d, y, z));
        let at = pose(0.0, 0.0, 0.0, 0.0);
        let info = information(&camera, &corners, &at).unwrap();
        let f = camera.lens.fx_px;
        // u = f (−y/x), v = f (−z/x): along y and z 4 f²/d², along x 2·4·f² a²/d⁴.
        assert!((info[(1, 1)] / (4.0 * f * f / (d * d)) - 1.0).abs() < 1e-6);
        assert!((info[(2, 2)] / (4.0 * f * f / (d * d)) - 1.0).abs() < 1e-6);
        assert!((info[(0, 0)] / (8.0 * f * f * a * a / d.powi(4)) - 1.0).abs() < 1e-6);
        // A turn about the line of sight moves each corner by a √2 f/d.
        assert!((info[(3, 3)] / (8.0 * f * f * a * a / (d * d)) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_place_without_markers_in_view_is_worth_nothing_and_leaving_for_it_counts() {
        let mut world = World::alps(0).unwrap();
        let camera = CameraModel::ahead();
        let inside = pose(5.0, 10.0, 7.0, 0.0);
        assert!(fix_quality(&world, &camera, &inside) > 8.0);
        let mut judge = FreeSpaceJudge::new(rule());
        // Before it was inside, nothing counts.
        judge.look(&world, &camera, &pose(5.0, 10.0, 9.9, 0.0));
        assert!(!judge.has_left());
        judge.look(&world, &camera, &inside);
        judge.look(&world, &camera, &pose(6.0, 10.0, 7.0, 0.0));
        assert!(!judge.has_left());
        world.tags.clear();
        assert!(fix_quality(&world, &camera, &inside).abs() < f64::EPSILON);
        judge.look(&world, &camera, &inside);
        assert!(judge.has_left());
    }

    #[test]
    fn coming_too_close_to_something_solid_counts() {
        let world = World::piles(1).unwrap();
        let camera = CameraModel::ahead();
        let mut judge = FreeSpaceJudge::new(rule());
        judge.look(&world, &camera, &pose(8.0, 10.0, 7.0, 0.0));
        judge.look(&world, &camera, &pose(8.0, 10.0, 9.5, 0.0));
        assert!(!judge.has_left() && (judge.least_clearance_m() - 0.5).abs() < 1e-9);
        // The ceiling is at 10 m.
        judge.look(&world, &camera, &pose(8.0, 10.0, 9.7, 0.0));
        assert!(judge.has_left());
    }
}
