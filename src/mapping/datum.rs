//! One patch as a datum of the field: its row, its variance, and what every error source does to
//! the height it reports.
//!
//! ```text
//! g = (−∂h/∂x, −∂h/∂y, 1),   δz = g·δhit
//! R = [gᵀ(J_α σ_α² J_αᵀ + J_d σ_d² J_dᵀ) g]/n + σ_ε² + σ_r²(Σ_xx + Σ_yy) + gᵀ J_χ Σ^χ J_χᵀ g
//! weight = 1/(σ_d²/n + m σ_ε² + σ_r²(Σ_xx + Σ_yy) + Σ_zz)
//! ```
//! The weight is not 1/R, on purpose. What the nodes cannot show of a square is common to all `m`
//! patches in it, so together they are worth one `σ_ε²`; independent ones would let squares that
//! were seen often outvote their neighbours. And weights that knew the slope g would prefer level
//! crests to flanks. Either makes rough ground look higher than it is.
//!
//! - `g`: how the reported height answers a shift of the hit, from the newest surface
//! - `n`: beams of the patch; `σ_ε`: roughness below the cell size (the nugget), m
//! - `σ_r`: slope that the surface does not resolve, `2 σ_ε/cell`; `σ_t` before there is a surface
//! - the height is that of the hit less a part of what may hide in hollows ([`super::roughness`])
//! - a beam that points elsewhere than it says sinks below the ground on average, however its error is
//!   distributed about zero: by `σ_α²(ρ/2 + (gᵀJ_α)²/ρ)`, which is put back; `ρ = −gᵀray` is the height of the
//!   LiDAR over the plane of the ground at the hit, m. By a tenth of a millimetre where beams graze, but alike everywhere
//! - `Σ^χ`: covariance of the pose error, 6×6; `Σ_xx + Σ_yy`: horizontal variance of the hit, m²
//!
//! Checked: `derivatives_match_moved_hits`, `sinking_matches_beams_cast_on_a_plane`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::footprint::{Footprint, Patch};
use super::matern_field::{Lattice, Row};
use super::projection::LidarMount;
use super::roughness::{POINT_PER_PATCH, hidden_from_all_sides_m};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// The newest surface: where slopes come from, and what outliers are judged against.
#[derive(Debug, Clone, Copy)]
pub struct Linearization<'a> {
    /// The nodes.
    pub lattice: &'a Lattice,
    /// Height of every node, m; `None` before the first solution.
    pub heights_m: Option<&'a [f64]>,
    /// Nodes that rest on data: outliers are judged against these alone. Empty before the first
    /// solution.
    pub is_known: &'a [bool],
    /// How many patches each square has, by its south-west node.
    pub n_patches: &'a [u32],
    /// The mounted LiDAR of each vehicle, by [`Footprint::lidar_idx`].
    pub lidars: &'a [LidarMount],
    /// Roughness below the cell size `σ_ε`, m.
    pub roughness_m: f64,
    /// How far the patches of a square scatter about each other, m: 0 before anything is known.
    pub scatter_m: f64,
    /// Standard deviation `σ_t` of the slope before anything is known.
    pub slope_sigma: f64,
    /// Share of what may hide in hollows that is taken off.
    pub occlusion_share: f64,
}

/// A turn of the scanner with what its patches share.
#[derive(Debug, Clone)]
pub struct Turn<'a> {
    pose_cov: Matrix6<f64>,
    R: Matrix3<f64>,
    /// Offset of the LiDAR in body axes, m, and its axes there.
    lidar_origin_m: Vector3<f64>,
    lidar_axes: Matrix3<f64>,
    lidar: &'a LidarMount,
    at: Linearization<'a>,
}

/// A patch as a datum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Datum {
    /// Bilinear weights.
    pub row: Row,
    /// The height it reports, corrected for hidden hollows, m.
    pub height_m: f64,
    /// What hides in hollows at most, m: the derivative of the reported height by the share of it
    /// that does.
    pub hidden_m: f64,
    /// Variance of range and angle, averaged over the beams, m².
    pub sensor_var_m2: f64,
    /// Variance of slopes that the nodes cannot show, at the hit's horizontal error, m².
    pub slope_var_m2: f64,
    /// Variance of heights that the nodes cannot show, common to all patches of the square, m².
    pub roughness_var_m2: f64,
    /// Variance by the pose, m².
    pub pose_var_m2: f64,
    /// Derivative by the pose: position (hall axes), attitude (body axes).
    pub by_pose: Vector6<f64>,
    /// Derivative by the LiDAR's mounting: position (body axes), rotation (LiDAR axes).
    pub by_mount: Vector6<f64>,
    /// Derivative by the range, no unit.
    pub by_range: f64,
    /// Distance from LiDAR to hit, m.
    pub range_m: f64,
    /// Its information in the solution, 1/m².
    pub weight_per_m2: f64,
}

/// Steeper ground than this is a wall's edge in the grid, not a slope.
const MAX_SLOPE: f64 = 2.0;
/// `(σ_α tan)²` of the incidence up to which its second order says enough: 87° for 0.3°.
const MAX_GRAZING: f64 = 0.01;
/// A hit this far from the surface is none of it, in σ …
const GATE_SIGMAS: f64 = 6.0;
/// … and in cells, for the surface is not smooth below the cell size.
const GATE_CELLS: f64 = 1.5;

impl<'a> Turn<'a> {
    /// What the patches of a footprint share; `None` if the LiDAR that took it is not known.
    #[must_use]
    pub fn new(footprint: &Footprint, at: Linearization<'a>) -> Option<Self> {
        let lidar = at.lidars.get(footprint.lidar_idx)?;
        Some(Self {
            pose_cov: footprint.error.cov.fixed_view::<6, 6>(0, 0).into_owned(),
            R: footprint.hall_from_body.rotation.matrix(),
            lidar_origin_m: lidar.body_from_lidar.origin.coords,
            lidar_axes: lidar.body_from_lidar.rotation.matrix(),
            lidar,
            at,
        })
    }

    /// The patch as a datum; `None` outside of the nodes, and if anything of it is not finite.
    #[must_use]
    pub fn datum(&self, patch: &Patch) -> Option<Datum> {
        let place = patch.place();
        let row = self.at.lattice.row_at(place.x, place.y)?;
        let g = self.at.answer_to_shift(&row);
        let g_body = self.R.transpose() * g;
        let g_lidar = self.lidar_axes.transpose() * g_body;
        let arm = patch.arm();
        let ray = self.lidar_axes.transpose() * (arm - self.lidar_origin_m);
        let range_m = ray.norm().max(1e-6);
        let along = ray / range_m;
        let by_range = g_lidar.dot(&along);
        // The beam turns about z of the LiDAR.
        let by_angle = g_lidar.dot(&Vector3::z().cross(&ray));
        let by_attitude = arm.cross(&g_body);
        let by_pose = stacked(&g, &by_attitude);
        let pose_var_m2 = by_pose.dot(&(self.pose_cov * by_pose));
        // −g·along is the beam's descent towards the surface, per metre of range.
        let level = (self.R * (self.lidar_axes * along)).xy().norm();
        let hidden_m = hidden_from_all_sides_m(
            POINT_PER_PATCH * self.at.scatter_m,
            self.at.lattice.spacing_m(),
            -by_range / level.max(1e-9),
        );
        let lidar = self.lidar;
        let sensor_var_m2 =
            (by_range * lidar.range_sigma_m).powi(2) + (by_angle * lidar.angle_sigma_rad).powi(2);
        let horizontal_var_m2 = self.pose_cov[(0, 0)]
            + self.pose_cov[(1, 1)]
            + (range_m * lidar.angle_sigma_rad).powi(2);
        let n_beams = f64::from(patch.n_beams);
        let slope_var_m2 = self.at.residual_slope_var() * horizontal_var_m2;
        let roughness_var_m2 = self.at.roughness_m.powi(2);
        let weight_var_m2 = lidar.range_sigma_m.powi(2) / n_beams
            + self.at.n_patches(&row) * roughness_var_m2
            + slope_var_m2
            + self.pose_cov[(2, 2)].max(0.0);
        let datum = Datum {
            row,
            height_m: place.z + sunk_m(-by_range * range_m, by_angle, lidar.angle_sigma_rad)
                - self.at.occlusion_share * hidden_m,
            hidden_m,
            sensor_var_m2: sensor_var_m2 / n_beams,
            slope_var_m2,
            roughness_var_m2,
            pose_var_m2,
            by_pose,
            by_mount: stacked(&g_body, &ray.cross(&g_lidar)),
            by_range,
            range_m,
            weight_per_m2: 1.0 / weight_var_m2,
        };
        // A pose that is not a number would pass the gates, which compare.
        (datum.var_m2().is_finite() && weight_var_m2.is_finite()).then_some(datum)
    }
}

impl Linearization<'_> {
    /// g: how the reported height answers a shift of the hit.
    fn answer_to_shift(&self, row: &Row) -> Vector3<f64> {
        let slope = self.heights_m.map_or([0.0; 2], |h| self.slope_at(row, h));
        let [x, y] = slope.map(|s| s.clamp(-MAX_SLOPE, MAX_SLOPE));
        Vector3::new(-x, -y, 1.0)
    }

    /// Slope of the bilinear surface at the row's point along x and y; edges of the square that end
    /// in a node without weight (behind a wall) do not count.
    fn slope_at(&self, row: &Row, heights_m: &[f64]) -> [f64; 2] {
        const EDGES: [[(usize, usize); 2]; 2] = [[(0, 1), (2, 3)], [(0, 2), (1, 3)]];
        EDGES.map(|edges| {
            let (mut rise_m, mut weight) = (0.0, 0.0);
            for (a, b) in edges {
                if row.weights[a] > 0.0 && row.weights[b] > 0.0 {
                    let w = row.weights[a] + row.weights[b];
                    let height_m = |k: usize| heights_m[row.nodes[k] as usize];
                    rise_m += w * (height_m(b) - height_m(a));
                    weight += w;
                }
            }
            if weight > 0.0 { rise_m / (weight * self.lattice.spacing_m()) } else { 0.0 }
        })
    }

    fn n_patches(&self, row: &Row) -> f64 {
        self.n_patches.get(row.nodes[0] as usize).map_or(1.0, |n| f64::from((*n).max(1)))
    }

    fn residual_slope_var(&self) -> f64 {
        if self.heights_m.is_none() {
            return self.slope_sigma.powi(2);
        }
        (2.0 * self.roughness_m / self.lattice.spacing_m()).powi(2)
    }

    /// How sharply a ray is a ceiling of the ground at a node so many steps beside it, m: roughness, and slopes over the
    /// steps and the half cell by which it passes beside its own node.
    #[must_use]
    pub fn ceiling_softness_m(&self, steps: u32) -> f64 {
        let aside_m = self.lattice.spacing_m() * (1.0 / 12.0 + f64::from(steps).powi(2)).sqrt();
        self.roughness_m.hypot(self.slope_sigma * aside_m)
    }

    /// Height of the surface at a row's point, m; `None` where it does not rest on data alone.
    #[must_use]
    pub fn known_surface_m(&self, row: &Row) -> Option<f64> {
        let heights_m = self.heights_m?;
        let is_known = |node: u32| self.is_known.get(node as usize).is_some_and(|known| *known);
        std::iter::zip(row.nodes, row.weights)
            .all(|(node, weight)| weight <= 0.0 || is_known(node))
            .then(|| row.value(heights_m))
    }

    /// True if the datum can be of the surface.
    #[must_use]
    pub fn believes(&self, datum: &Datum) -> bool {
        let Some(surface_m) = self.known_surface_m(&datum.row) else { return true };
        let gate_m =
            (GATE_SIGMAS * datum.var_m2().sqrt()).max(GATE_CELLS * self.lattice.spacing_m());
        (datum.height_m - surface_m).abs() <= gate_m
    }
}

impl Datum {
    /// R: its variance by itself, m².
    #[must_use]
    pub fn var_m2(&self) -> f64 {
        self.sensor_var_m2 + self.slope_var_m2 + self.roughness_var_m2 + self.pose_var_m2
    }
}

/// How far hits lie below the ground on average because beams point elsewhere than they say, m: their
/// range answers the angle by `r'' = r(1 + 2 (by_angle/ρ)²)`.
fn sunk_m(over_ground_m: f64, by_angle_m: f64, angle_sigma_rad: f64) -> f64 {
    if over_ground_m <= 0.0 {
        return 0.0;
    }
    let var = angle_sigma_rad.powi(2);
    let grazing = (by_angle_m / over_ground_m).powi(2) * var;
    over_ground_m * (0.5 * var + grazing.min(MAX_GRAZING))
}

fn stacked(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}

#[cfg(test)]
mod tests;
