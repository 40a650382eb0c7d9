//! What scans on a way that is only thought of would see.
//!
//! ```text
//!        ┌─ scan plane, level body
//!   ─────●───── flight          every ray stands for the ground between it and its neighbour,
//!      ╱ │ ╲                    swept from one scan to the next:  dA = |Δp × u| dg
//!    ╱   │   ╲
//!  ━━━━━━━━━━━━━ h0
//! ```
//! - `dg`: distance of neighbouring rays on the ground, m; `u`: direction of the scan line there
//! - `Δp`: shift of the ray's end since the scan before, by flight and by turning, m
//!
//! Without a map the surface is flat at the nominal height, and a share of the rays ends on a nearer
//! slope. For slopes of Gaussian height with rms slope w, under a ray that falls by μ per metre:
//!
//! ```text
//! p = (1 − ½ erfc v)/(1 + Λ),   v = μ/(√2 w),   Λ = ½ (exp(−v²)/(√π v) − erfc v)
//! ```
//! Source: Smith 1967, eq. (21) and (24). Checked: `shadowing_matches_its_integral`.

use super::Waypoint;
use super::free_space::FreeSpace;
use super::height_view::seen_ratio;
use super::space::SpaceSettings;
use crate::mapping::KnownHeights;
use crate::mapping::belief::{Chance, CoarseField, Sightings, height_and_tilt_cov};
use crate::mapping::polygon::Polygon;
use crate::mapping::projection::LidarMount;
use crate::mapping::solid::{self, Solid};
use crate::units::wrapped_rad;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Neighbouring rays are this far apart on the ground under the flight, m.
const RAY_SPACING_M: f64 = 0.9;
/// Scans are thought of this often along a way, m, and at this angle when turning, rad.
const SCAN_SPACING_M: f64 = 0.9;
const TURN_SPACING_RAD: f64 = 0.15;
/// The pose's error stays the same over this much of a way, m.
const WINDOW_M: f64 = 2.0;
/// A scan line covers at least this much of the ground across itself, m.
const LEAST_SWEEP_M: f64 = 0.02;
/// Rays flatter than this see nothing that can be counted on: fall per metre of ground.
const LEAST_FALL: f64 = 0.3;

/// The rays of a scan, and what they are worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    rays: Vec<Ray>,
    /// Where they start in body axes, m.
    origin_m: Vector3<f64>,
    /// Level of the flat surface, m.
    nominal_height_m: f64,
    min_range_m: f64,
    max_range_m: f64,
    /// Variance of the filter's pose over that of one fix.
    fix_var_share: f64,
    /// What stands in the way of rays beside the material.
    obstacles: Vec<Solid>,
    /// The walls, if a ray inside can meet them before the ground.
    walls: Option<Polygon>,
}

/// One ray of the scan, per metre that it falls.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ray {
    /// Where it goes in body axes, no unit.
    ahead: Vector2<f64>,
    /// Ground between neighbouring rays, no unit.
    ground: f64,
    /// Direction of the scan line on the ground in body axes.
    line: Vector2<f64>,
    /// Share of flat ground at the end that is seen.
    seen_ratio: f64,
}

impl Sight {
    /// The rays of this LiDAR on a level body.
    #[must_use]
    pub fn new(
        lidar: &LidarMount,
        nominal_drop_m: f64,
        nominal_height_m: f64,
        slope_sigma: f64,
        fix_var_share: f64,
    ) -> Self {
        let spacing = RAY_SPACING_M / nominal_drop_m.max(0.5);
        Self {
            rays: rays(lidar, spacing, slope_sigma),
            origin_m: lidar.body_from_lidar.origin.coords,
            nominal_height_m,
            min_range_m: lidar.min_range_m,
            max_range_m: lidar.max_range_m,
            fix_var_share,
            obstacles: Vec::new(),
            walls: None,
        }
    }

    /// The same among obstacles and walls.
    #[must_use]
    pub fn among(self, space: &SpaceSettings) -> Self {
        // Inside of a convex outline nothing of it is between two places.
        let walls = space.walls.clone().filter(|walls| !walls.is_convex());
        Self { obstacles: space.obstacles.clone(), walls, ..self }
    }

    /// What a vehicle sees on its way from one waypoint to the next; nothing where it would not know
    /// where it is.
    #[must_use]
    pub fn on_way(
        &self,
        field: &CoarseField,
        free_space: &FreeSpace,
        heights: Option<&KnownHeights>,
        (from, to): (&Waypoint, &Waypoint),
    ) -> Sightings {
        let mut seen = field.nothing_seen();
        let turn_rad = wrapped_rad(to.yaw_rad - from.yaw_rad);
        let way_m = from.distance_m(to);
        let n_scans =
            (way_m / SCAN_SPACING_M).max(turn_rad.abs() / TURN_SPACING_RAD).ceil().max(1.0);
        let windows_per_scan = (way_m / WINDOW_M).ceil().max(1.0) / n_scans;
        let mut before = self.ends(from);
        let (mut k, mut n_windows) = (1.0, 0.0);
        while k <= n_scans {
            let share = k / n_scans;
            let at = from.towards(to, share);
            let now = self.ends(&at);
            let is_new_window = n_windows <= (k - 1.0) * windows_per_scan;
            let fix_cov = free_space.fix_cov(&at);
            if let (true, Some(cov)) = (is_new_window, &fix_cov) {
                let rotation = at.level_pose().rotation.matrix();
                let cov = height_and_tilt_cov(&(cov * self.fix_var_share), &rotation);
                seen.windows.push(field.window(&cov));
                n_windows += 1.0;
            }
            if fix_cov.is_some() && !seen.windows.is_empty() {
                self.add_scan(&mut seen, field, heights, (&before, &now), &at);
            }
            before = now;
            k += 1.0;
        }
        seen
    }

    /// Where the rays of a scan end on the flat surface, x and y, m.
    fn ends(&self, at: &Waypoint) -> ScanLine {
        let (sin, cos) = at.yaw_rad.sin_cos();
        let turn = (sin, cos);
        let arm = turned(&self.origin_m.xy(), turn);
        let origin = at.place.coords + Vector3::new(arm.x, arm.y, self.origin_m.z);
        let drop_m = (origin.z - self.nominal_height_m).max(0.0);
        let end = |ray: &Ray| origin.xy() + turned(&ray.ahead, turn) * drop_m;
        let ends = self.rays.iter().map(end).collect();
        ScanLine { origin, drop_m, turn, ends }
    }

    fn add_scan(
        &self,
        seen: &mut Sightings,
        field: &CoarseField,
        heights: Option<&KnownHeights>,
        (before, now): (&ScanLine, &ScanLine),
        at: &Waypoint,
    ) {
        for (i, ray) in self.rays.iter().enumerate() {
            let end = now.ends[i];
            let at_end = heights.and_then(|h| Some((h, h.grid.cell_at(end.x, end.y)?)));
            let ground_m = at_end.map_or(self.nominal_height_m, |(h, cell)| h.height_m[cell]);
            let range_m = (Vector3::new(end.x, end.y, ground_m) - now.origin).norm();
            if !(self.min_range_m..=self.max_range_m).contains(&range_m) {
                continue;
            }
            let Some(row) = field.lattice().row_at(end.x, end.y) else { continue };
            // A cell above the ground: what it lies on does not hide it.
            let above_m = at_end.map_or(ground_m, |(h, _)| ground_m + h.grid.cell_m);
            if self.is_blocked(&now.origin, &Vector3::new(end.x, end.y, above_m)) {
                continue;
            }
            let line = turned(&ray.line, now.turn);
            let shift = end - before.ends[i];
            let sweep_m = (shift.x * line.y - shift.y * line.x).abs().max(LEAST_SWEEP_M);
            let area_m2 = sweep_m * ray.ground * now.drop_m;
            let arm = end - at.place.coords.xy();
            let is_known = at_end.is_some_and(|(heights, cell)| heights.is_known[cell]);
            let chance = if is_known {
                // Whether it could be seen again from here makes little difference: the ray is not followed.
                Chance { open: 1.0, high: 1.0 }
            } else {
                let high = heights.map_or(1.0, |heights| seen_ratio(heights, &now.origin, &end));
                Chance { open: ray.seen_ratio, high }
            };
            let info_per_area = field.info_per_area_seen_with(chance.open * chance.high);
            seen.add(&row, info_per_area * area_m2, (arm.x, arm.y));
            if !is_known {
                seen.look(&row, area_m2, chance);
            }
        }
    }
}

impl Sight {
    /// True if something solid stands between.
    fn is_blocked(&self, origin: &Vector3<f64>, target: &Vector3<f64>) -> bool {
        let is_walled = |walls: &Polygon| {
            walls.border_distance_of_line_m((origin.x, origin.y), (target.x, target.y)) <= 0.0
        };
        solid::blocks_sight(&self.obstacles, origin, target)
            || self.walls.as_ref().is_some_and(is_walled)
    }
}

/// A vector of the body in the axes of the hall.
fn turned(v: &Vector2<f64>, (sin, cos): (f64, f64)) -> Vector2<f64> {
    Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
}

/// One scan on the flat surface.
struct ScanLine {
    origin: Vector3<f64>,
    drop_m: f64,
    /// sin and cos of the heading.
    turn: (f64, f64),
    ends: Vec<Vector2<f64>>,
}

/// The rays at equal distances on level ground, both ways from straight down.
fn rays(lidar: &LidarMount, spacing: f64, slope_sigma: f64) -> Vec<Ray> {
    const FINE_RAD: f64 = 0.002;
    let axes: Matrix3<f64> = lidar.body_from_lidar.rotation.matrix();
    let end = |angle_rad: f64| {
        let along = axes * Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0);
        let fall = -along.z;
        let ground = along.xy().norm();
        (fall > LEAST_FALL * ground && fall > 0.0 && !lidar.is_blind(angle_rad))
            .then(|| along.xy() / fall)
    };
    let mut rays = Vec::new();
    let mut last: Option<Vector2<f64>> = None;
    let mut angle_rad = -std::f64::consts::PI;
    while angle_rad < std::f64::consts::PI {
        if let Some(ahead) = end(angle_rad) {
            let step = last.map_or(spacing, |last| (ahead - last).norm());
            if step >= spacing {
                let next = end(angle_rad + FINE_RAD).unwrap_or(ahead);
                let line = (next - ahead).try_normalize(1e-12).unwrap_or_else(Vector2::zeros);
                let fall = 1.0 / ahead.norm().max(1e-6);
                let ground = step.min(2.0 * spacing);
                let seen_ratio = shadowing(fall, slope_sigma);
                rays.push(Ray { ahead, ground, line, seen_ratio });
                last = Some(ahead);
            }
        } else {
            last = None;
        }
        angle_rad += FINE_RAD;
    }
    rays
}

/// Share of a rough surface that a ray sees: it falls by `fall` per metre of ground.
#[must_use]
pub fn shadowing(fall: f64, slope_sigma: f64) -> f64 {
    if slope_sigma <= 0.0 {
        return 1.0;
    }
    let v = fall / (std::f64::consts::SQRT_2 * slope_sigma);
    let tail = libm::erfc(v);
    let lambda = 0.5 * ((-v * v).exp() / (std::f64::consts::PI.sqrt() * v) - tail);
    (1.0 - 0.5 * tail) / (1.0 + lambda.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Point, Rotation, Transform};
    use crate::mapping::matern_field::Prior;
    use crate::mapping::region::{Rect, Region};

    #[test]
    fn the_range_ends_at_the_ground_of_the_map() {
        let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 20.0, y_max_m: 10.0 };
        let region =
            Region { bounds, exclusions: Vec::new(), exclusion_margin_m: 0.0, bays: Vec::new() };
        let grid = region.grid(0.5);
        let prior = Prior { range_m: 5.0, sigma_m: 1.0, mean_m: 3.0, mean_sigma_m: 1.0 };
        let areas_m2 = vec![grid.cell_area_m2(); grid.n_cells()];
        let field = CoarseField::new(&region, grid, &areas_m2, prior).expect("a prior");
        let lidar = LidarMount {
            body_from_lidar: Transform::new(
                Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
                Point::origin(),
            ),
            range_sigma_m: 0.01,
            angle_sigma_rad: 0.002,
            min_range_m: 0.1,
            max_range_m: 8.0,
            blind_sectors_rad: Vec::new(),
        };
        // 10 m over the floor, 7 m over the nominal level.
        let sight = Sight::new(&lidar, 7.0, 3.0, 0.6, 0.1);
        let at = |x_m| Waypoint { place: Point::new(x_m, 5.0, 10.0), yaw_rad: 0.0 };
        let seen_nodes = |ground_m: f64| {
            let heights_m = vec![ground_m; grid.n_cells()];
            let heights = KnownHeights::new(grid, heights_m, vec![true; grid.n_cells()], 1.0);
            let mut seen = field.nothing_seen();
            let (from, to) = (at(9.0), at(9.9));
            sight.add_scan(
                &mut seen,
                &field,
                Some(&heights),
                (&sight.ends(&from), &sight.ends(&to)),
                &to,
            );
            let lattice = field.lattice();
            (0..lattice.n_nodes()).filter(|node| seen.info.n_hits(*node) > 0.0).count()
        };
        assert_eq!(seen_nodes(1.0), 0, "the ground lies 9 m below, the LiDAR reaches 8 m");
        let (far, near) = (seen_nodes(3.0), seen_nodes(6.0));
        assert!(far > 0 && near > far, "{far} nodes from 7 m, {near} from 4 m");
    }

    #[test]
    fn shadowing_matches_its_integral() {
        // Λ is the mean of (q − μ)/μ over the slopes q > μ that face away, Smith's eq. (17); here by
        // midpoints over a Gaussian of slopes.
        for (fall, w) in [(0.3, 0.6), (0.55, 0.6), (1.2, 0.4), (2.0, 0.9)] {
            let (mut lambda, mut below) = (0.0, 0.0);
            let n = 200_000;
            for k in 0..n {
                let q: f64 = -8.0 * w + 16.0 * w * (f64::from(k) + 0.5) / f64::from(n);
                let p = (-q * q / (2.0 * w * w)).exp() / (w * std::f64::consts::TAU.sqrt());
                let dq = 16.0 * w / f64::from(n);
                if q > fall {
                    lambda += (q - fall) / fall * p * dq;
                } else {
                    below += p * dq;
                }
            }
            let by_integral = below / (1.0 + lambda);
            assert!((shadowing(fall, w) - by_integral).abs() < 1e-4, "fall {fall}, slopes {w}");
        }
        assert!((shadowing(0.5, 0.0) - 1.0).abs() < 1e-12);
    }
}
