//! What a planner believes of the volume: the map's data on a coarse lattice, where the effect of
//! flights that are only thought of can be computed a thousand times in a second.
//!
//! ```text
//! Q = Q0 + Σ_seen a aᵀ ι dA,   q = Q⁻¹ w
//! (σ^V)² = wᵀ q + Σ_k s_kᵀ P_k s_k + Σ_j s² (A_j e_j)² + Σ_p (S_p² − (Σ_{j∈p} u_j √v_j q_j)₊)₊ + ρ Σ_p Σ_{r≠p} S_p S_r + c
//! s_k = Σ_{i∈k} ι_i a_iᵀ q ∂z_i/∂(z, θ_x, θ_y),   S_p = Σ_{j∈p} u_j σ_j √v_j
//! ```
//! - `ι`: information about the coarse field per area that was seen, 1/m⁴: seen ground counts
//!   once, however many beams hit it, but for what the noise of the beams leaves
//! - `k`: stretch of a flight over which the pose's error stays the same; `P_k` its covariance
//! - `A_j`: area around node j that no beam has hit, m²; `e_j`: the share of it that looks leave (`looks`), holes too small for
//!   the lattice, whose mean height differs by `s` from what the nodes around say
//! - `p`, `r`: patches that are off as a whole, and correlated by ρ ([`super::unseen_patch`]), each with its area `u_j` and σ at node j; `v_j`: the
//!   share of its variance that looks leave. They are what looks leave of the map's own (`open_patch`); without a map, they are
//!   made of the nodes around which most stays unseen, with σ by the distance to the others
//! - `c`: what no flight changes (calibration, base), m⁶
//!
//! Checked: `coarse_variance_matches_dense_algebra`, `a_patch_of_the_map_is_off_as_a_whole_until_it_is_looked_at`,
//! `crests_are_others_for_each_look_and_depth_is_the_same_for_all`.

mod looks;
mod open_patch;

pub use looks::Chance;

use super::field_map::SolveField;
use super::grid_map::SolveGrid;
use super::matern_field::{FieldError, Functional, Information, Lattice, Prior, Row};
use super::matern_kernel::matern_of;
use super::region::Region;
use super::surface_work::SolveSurface;
use super::unseen_patch::{Ground, UnseenGround, VarBesideSeen};
use crate::messages::GridGeometry;
use crate::time::{Mono, Stamp};
use looks::{Looks, Rest};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};
use open_patch::OpenPatches;
use std::sync::Arc;
use std::time::Duration;

/// The coarse lattice with the sum that is the volume.
#[derive(Debug)]
pub struct CoarseField {
    functional: Functional,
    prior: Prior,
    /// σ² of what the coarse field cannot follow inside one cell of the map, m².
    sub_var_m2: f64,
    /// s²: variance of the mean height of a hole as large as a cell of the lattice, given its corners, m².
    hole_var_m2: f64,
    /// How uncertain patches of unseen ground are; `None` if they are not off as a whole.
    var_beside: Option<VarBesideSeen>,
    /// Information per area that halves the variance of a hidden cell of the lattice, 1/m⁴.
    doubt_info_per_area: f64,
    /// Cells of the map.
    fine: GridGeometry,
    /// Area that counts, m².
    area_m2: f64,
}

impl PartialEq for CoarseField {
    fn eq(&self, other: &Self) -> bool {
        self.prior == other.prior
            && self.fine == other.fine
            && self.functional.lattice() == other.functional.lattice()
            && self.functional.weights() == other.functional.weights()
    }
}

/// A stretch of flight over which the pose's error stays the same.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseWindow {
    /// Σ a ι ∂z/∂c for height, tilt about x, tilt about y of the hall, node by node.
    moments: [Vec<f64>; 3],
    /// Covariance of these three errors, m and rad.
    cov: Matrix3<f64>,
}

/// What a flight or a part of it sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Sightings {
    /// What it says about the field.
    pub info: Information,
    /// What its pose errors do.
    pub windows: Vec<PoseWindow>,
    /// Area seen around each node, m².
    seen_m2: Vec<f64>,
    /// What was looked at around each node.
    looks: Looks,
    /// The patches of unseen ground that a map has; `None` if no map says where they are.
    patches: Option<OpenPatches>,
}

/// What is seen neither by now nor by looks.
struct Unseen {
    /// Area around each node that is not known to be seen, m².
    open_m2: Vec<f64>,
    /// What looks leave of it.
    rests: Vec<Rest>,
}

/// How uncertain the volume is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeVar {
    /// By ground that was not or thinly seen, m⁶.
    pub field_m6: f64,
    /// By the pose, m⁶.
    pub pose_m6: f64,
    /// By holes smaller than the lattice shows, m⁶.
    pub holes_m6: f64,
    /// By patches of unseen ground that are off as a whole, beyond what the field has for them, m⁶.
    pub patches_m6: f64,
}

/// Nodes along the longer side of the region at most.
const MOST_CELLS: f64 = 36.0;
/// Cells per practical range: half the length scale ρ/2.
const CELLS_PER_RANGE: f64 = 4.0;
/// Share of σ² that one seen cell of the map leaves open about the coarse field.
///
/// Neighbouring cells are seen together, so this is the error of an area's mean rather than of a
/// point; chosen so that predictions meet the accounts of flights.
const SUB_VAR_SHARE: f64 = 0.01;
/// σ of ground that may hide, over σ: there is known ground around it.
const HIDDEN_SIGMA_SHARE: f64 = 0.5;
/// Errors of the pose stay the same for about this long.
const WINDOW: Duration = Duration::from_secs(1);

impl CoarseField {
    /// The lattice over a region whose map has the cells `fine`, of which `cell_areas_m2` count.
    ///
    /// # Errors
    /// [`FieldError`] for a prior that is none.
    pub fn new(
        region: &Region,
        fine: GridGeometry,
        cell_areas_m2: &[f64],
        prior: Prior,
    ) -> Result<Self, FieldError> {
        let (width_m, depth_m) = region.bounds.size_m();
        let (longest_m, shortest_m) = (width_m.max(depth_m), width_m.min(depth_m));
        let spacing_m = (prior.range_m / CELLS_PER_RANGE)
            .max(longest_m / MOST_CELLS)
            .min(shortest_m / 3.0)
            .max(fine.cell_m);
        let coarse = region.grid(spacing_m);
        let lattice = Lattice::covering(&coarse, prior.padding_m(), |a, b| region.separates(a, b));
        let mut w = vec![0.0; lattice.n_nodes()];
        let mut area_m2 = 0.0;
        for (cell, cell_area_m2) in cell_areas_m2.iter().enumerate().filter(|(_, a)| **a > 0.0) {
            let (x, y) = fine.centre_m(cell);
            let Some(row) = lattice.row_at(x, y) else { continue };
            area_m2 += cell_area_m2;
            for (node, weight) in std::iter::zip(row.nodes, row.weights) {
                w[node as usize] += weight * cell_area_m2;
            }
        }
        Ok(Self {
            functional: Functional::new(&Arc::new(lattice), &prior, w)?,
            sub_var_m2: SUB_VAR_SHARE * prior.sigma_m.powi(2),
            doubt_info_per_area: 1.0 / (HIDDEN_SIGMA_SHARE * prior.sigma_m * spacing_m).powi(2),
            hole_var_m2: hole_var_share(&prior, spacing_m) * prior.sigma_m.powi(2),
            var_beside: Some(VarBesideSeen::new(&prior, spacing_m)),
            prior,
            fine,
            area_m2,
        })
    }

    /// The same for accounts that do not know of patches: those of the paper's grid.
    #[must_use]
    pub fn without_patches(self) -> Self {
        Self { var_beside: None, ..self }
    }

    /// The nodes.
    #[must_use]
    pub fn lattice(&self) -> &Lattice {
        self.functional.lattice()
    }

    /// Area that counts, m².
    #[must_use]
    pub const fn area_m2(&self) -> f64 {
        self.area_m2
    }

    /// Expected height of the surface before anything is seen, m.
    #[must_use]
    pub const fn mean_height_m(&self) -> f64 {
        self.prior.mean_m
    }

    /// ι: information per area seen, 1/m⁴.
    #[must_use]
    pub fn info_per_area(&self) -> f64 {
        1.0 / (self.sub_var_m2 * self.fine.cell_area_m2())
    }

    /// Information per area of ground that is seen with this probability only, 1/m⁴: on average `1 − p`
    /// of the variance stays, as after a datum of information p/((1 − p) s²) on a cell of the lattice.
    ///
    /// However often a doubtful ray is counted, it never makes ground as sure as seeing it does.
    #[must_use]
    pub fn info_per_area_seen_with(&self, probability: f64) -> f64 {
        let sure = self.info_per_area();
        let doubtful = probability / (1.0 - probability).max(0.0) * self.doubt_info_per_area;
        if doubtful < sure { doubtful } else { sure }
    }

    /// Nothing seen.
    #[must_use]
    pub fn nothing_seen(&self) -> Sightings {
        Sightings {
            info: Information::new(self.lattice()),
            windows: Vec::new(),
            seen_m2: vec![0.0; self.lattice().n_nodes()],
            looks: Looks::none(self.lattice().n_nodes()),
            patches: None,
        }
    }

    /// What the map knows, or knew at an earlier instant; the cells of the paper's grid keep no past.
    #[must_use]
    pub fn seen(&self, surface: &SolveSurface, until: Option<Stamp<Mono>>) -> Sightings {
        match surface {
            SolveSurface::MaternField(work) => self.seen_by_turns(work, until),
            SolveSurface::KalmanGrid(work) => self.seen_by_cells(work),
        }
    }

    /// Every cell is worth what its patches are worth together, and no more than seeing it is.
    fn seen_by_turns(&self, work: &SolveField, until: Option<Stamp<Mono>>) -> Sightings {
        let mut cell_info = vec![0.0; self.fine.n_cells()];
        work.for_each_patch(until, |_, patch, info| {
            let place = patch.place();
            if let Some(cell) = self.fine.cell_at(place.x, place.y) {
                cell_info[cell] += info;
            }
        });
        let mut seen = self.nothing_seen();
        let mut window_ends_at = None;
        work.for_each_patch(until, |footprint, patch, info| {
            if window_ends_at.is_none_or(|end| footprint.error.at >= end) {
                window_ends_at = Some(footprint.error.at.plus(WINDOW));
                let pose_cov = footprint.error.cov.fixed_view::<6, 6>(0, 0).into_owned();
                let rotation = footprint.hall_from_body.rotation.matrix();
                seen.windows.push(self.window(&height_and_tilt_cov(&pose_cov, &rotation)));
            }
            let place = patch.place();
            let cell = self.fine.cell_at(place.x, place.y);
            let Some((cell, row)) = cell.zip(self.lattice().row_at(place.x, place.y)) else {
                return;
            };
            let info = info / (1.0 + cell_info[cell] * self.sub_var_m2);
            let arm = footprint.hall_from_body.rotation.matrix() * patch.arm();
            seen.add(&row, info, (arm.x, arm.y));
        });
        let is_hit: Vec<bool> = cell_info.iter().map(|info| *info > 0.0).collect();
        let hit = is_hit.iter().enumerate().filter(|(_, is_hit)| **is_hit);
        self.count_cells(&mut seen, hit.map(|(cell, _)| cell));
        if let (Some(var_beside), Some(patches)) = (&self.var_beside, work.open_patches(&is_hit)) {
            let w_m2 = self.functional.weights();
            seen.patches = Some(OpenPatches::new(self.lattice(), w_m2, &patches, var_beside));
        }
        seen
    }

    /// Counts cells of the map as seen, once each.
    fn count_cells(&self, seen: &mut Sightings, cells: impl Iterator<Item = usize>) {
        for cell in cells {
            let (x, y) = self.fine.centre_m(cell);
            if let Some(row) = self.lattice().row_at(x, y) {
                seen.count(&row, self.fine.cell_area_m2());
            }
        }
    }

    /// Every cell of the paper's grid as a datum of its own.
    fn seen_by_cells(&self, work: &SolveGrid) -> Sightings {
        let mut seen = self.nothing_seen();
        let prior_info = work.prior_sigma_m().powi(-2);
        for (cell, var_m2) in work.cell_var_m2().iter().enumerate() {
            let info = 1.0 / var_m2 - prior_info;
            let (x, y) = self.fine.centre_m(cell);
            if let (true, Some(row)) = (info > 1e-9, self.lattice().row_at(x, y)) {
                seen.info.add(&row, 0.0, info / (1.0 + info * self.sub_var_m2));
                seen.count(&row, self.fine.cell_area_m2());
            }
        }
        seen
    }

    /// An empty stretch with this covariance of height (m), tilt about x and about y (rad).
    #[must_use]
    pub fn window(&self, cov: &Matrix3<f64>) -> PoseWindow {
        let n = self.lattice().n_nodes();
        PoseWindow { moments: std::array::from_fn(|_| vec![0.0; n]), cov: *cov }
    }

    /// The variance of the volume after all these.
    ///
    /// # Errors
    /// [`FieldError`] from the factor.
    pub fn volume_var(&self, parts: &[&Sightings]) -> Result<VolumeVar, FieldError> {
        let Some((first, others)) = parts.split_first() else {
            return self.volume_var(&[&self.nothing_seen()]);
        };
        let mut info = first.info.clone();
        for part in others {
            info.merge(&part.info)?;
        }
        let given = self.functional.given(&info)?;
        let pose_m6 = parts
            .iter()
            .flat_map(|part| &part.windows)
            .map(|window| window.volume_var(&given.q))
            .sum();
        let unseen = self.unseen(parts);
        Ok(VolumeVar {
            field_m6: given.var,
            pose_m6,
            holes_m6: self.holes_m6(&unseen),
            patches_m6: self.patches_m6(parts, &unseen, &given.q),
        })
    }

    /// The variance of the volume after all these is not less, m⁶; much faster to be had than it.
    ///
    /// What the field has for a patch is a part of what it has for all, if no height goes against the volume; that some
    /// do a little is neglected.
    #[must_use]
    pub fn least_volume_var_m6(&self, parts: &[&Sightings]) -> f64 {
        let unseen = self.unseen(parts);
        let without_field = vec![0.0; self.lattice().n_nodes()];
        self.holes_m6(&unseen) + self.patches_m6(parts, &unseen, &without_field)
    }

    fn unseen(&self, parts: &[&Sightings]) -> Unseen {
        let open_m2 = self.open_m2(parts);
        let looks = || parts.iter().map(|part| &part.looks);
        let mut scratch = Vec::new();
        let rests = std::iter::zip(0.., &open_m2)
            .map(|(node, open_m2)| Rest::of(looks(), node, *open_m2, &mut scratch))
            .collect();
        Unseen { open_m2, rests }
    }

    /// What patches add beyond what the field with this adjoint has for them.
    fn patches_m6(&self, parts: &[&Sightings], unseen: &Unseen, q_m2: &[f64]) -> f64 {
        let Some(var_beside) = &self.var_beside else { return 0.0 };
        match parts.iter().find_map(|part| part.patches.as_ref()) {
            Some(patches) => patches.surplus_m6(self.lattice(), var_beside, &unseen.rests, q_m2),
            None => self.drawn_patches_m6(var_beside, unseen, q_m2),
        }
    }

    /// Area around each node that is not known to be seen, m².
    fn open_m2(&self, parts: &[&Sightings]) -> Vec<f64> {
        let mut open_m2 = self.functional.weights().to_vec();
        for part in parts {
            open_m2.iter_mut().zip(&part.seen_m2).for_each(|(open, seen)| *open -= seen);
        }
        open_m2.iter_mut().for_each(|open_m2| *open_m2 = open_m2.max(0.0));
        open_m2
    }

    /// The same where no map says where patches are: they are made of the nodes that looks leave.
    fn drawn_patches_m6(
        &self,
        var_beside: &VarBesideSeen,
        Unseen { open_m2, rests }: &Unseen,
        q_m2: &[f64],
    ) -> f64 {
        let (lattice, whole_m2) = (self.lattice(), self.functional.weights());
        let var_shares: Vec<f64> = rests.iter().map(|rest| rest.var_share).collect();
        let ground_at = |node: usize| {
            let is_core = whole_m2[node] > 0.0
                && open_m2[node] > looks::UNSEEN_SHARE * whole_m2[node]
                && var_shares[node] > 0.0;
            if is_core { Ground::Core } else { Ground::Known }
        };
        let ground: Vec<Ground> = (0..lattice.n_nodes()).map(ground_at).collect();
        let is_seen: Vec<bool> = std::iter::zip(&ground, whole_m2)
            .map(|(ground, whole_m2)| *ground == Ground::Known && *whole_m2 > 0.0)
            .collect();
        let unseen = UnseenGround::new(lattice, &ground, var_beside.on(lattice, &is_seen));
        let areas_m2: Vec<f64> = std::iter::zip(open_m2, &var_shares)
            .map(|(open_m2, var_share)| open_m2 * var_share.sqrt())
            .collect();
        unseen.surplus_m6(&areas_m2, q_m2).iter().sum()
    }

    fn holes_m6(&self, Unseen { open_m2, rests }: &Unseen) -> f64 {
        let holes_m2 =
            std::iter::zip(open_m2, rests).map(|(open_m2, rest)| open_m2 * rest.area_share);
        self.hole_var_m2 * holes_m2.map(|hole_m2| hole_m2.powi(2)).sum::<f64>()
    }
}

impl VolumeVar {
    /// (σ^V)², m⁶.
    #[must_use]
    pub fn total_m6(&self) -> f64 {
        self.field_m6 + self.pose_m6 + self.holes_m6 + self.patches_m6
    }
}

impl Sightings {
    /// Looks at unknown ground of this area, m².
    pub fn look(&mut self, row: &Row, area_m2: f64, chance: Chance) {
        self.looks.push(row, area_m2, chance);
    }

    /// Counts an area as seen, m², whatever it says.
    fn count(&mut self, row: &Row, area_m2: f64) {
        for (node, weight) in std::iter::zip(row.nodes, row.weights) {
            self.seen_m2[node as usize] += weight * area_m2;
        }
    }

    /// Adds a datum of the newest window: information 1/R, and where it lies from the body in the
    /// axes of the hall, m.
    pub fn add(&mut self, row: &Row, info_per_m2: f64, (arm_x_m, arm_y_m): (f64, f64)) {
        if !self.info.add(row, 0.0, info_per_m2) {
            return;
        }
        let Some(window) = self.windows.last_mut() else { return };
        // δz = δp_z + θ_x y − θ_y x
        for (moments, by) in window.moments.iter_mut().zip([1.0, arm_y_m, -arm_x_m]) {
            for (node, weight) in std::iter::zip(row.nodes, row.weights) {
                moments[node as usize] += weight * info_per_m2 * by;
            }
        }
    }
}

impl PoseWindow {
    /// sᵀ P s, m⁶.
    fn volume_var(&self, q: &[f64]) -> f64 {
        let s = Vector3::from_fn(|c, _| {
            std::iter::zip(&self.moments[c], q).map(|(m, q)| m * q).sum::<f64>()
        });
        s.dot(&(self.cov * s)).max(0.0)
    }
}

/// Covariance of height and the tilts about x and y of the hall from that of a pose: position in
/// hall axes, attitude in the axes of a body with this rotation.
#[must_use]
pub fn height_and_tilt_cov(pose_cov: &Matrix6<f64>, hall_from_body: &Matrix3<f64>) -> Matrix3<f64> {
    let mut by = SMatrix::<f64, 3, 6>::zeros();
    by[(0, 2)] = 1.0;
    by.fixed_view_mut::<1, 3>(1, 3).copy_from(&hall_from_body.row(0));
    by.fixed_view_mut::<1, 3>(2, 3).copy_from(&hall_from_body.row(1));
    by * pose_cov * by.transpose()
}

/// Variance of the field in the middle of a square whose corners are known, over σ²; half of that for
/// its mean, which is nearer to them.
fn hole_var_share(prior: &Prior, spacing_m: f64) -> f64 {
    let correlation = |distance_m: f64| matern_of(1.0, prior.kappa_per_m() * distance_m);
    let diagonal_m = std::f64::consts::SQRT_2 * spacing_m;
    let to_corner = correlation(0.5 * diagonal_m);
    let between = 1.0 + 2.0 * correlation(spacing_m) + correlation(diagonal_m);
    // Ordinary weights are equal by symmetry: 1 − kᵀ C⁻¹ k.
    0.5 * (1.0 - 4.0 * to_corner * to_corner / between)
}

#[cfg(test)]
mod tests;
