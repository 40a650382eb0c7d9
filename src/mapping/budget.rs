//! The uncertainty of a volume, source by source, through the adjoint of the field.
//!
//! The estimate is linear in its data, so every error source enters through the derivative of the
//! volume by each datum:
//!
//! ```text
//! q = Q⁻¹ w,   k_i = weight_i a_iᵀ q = ∂V/∂z_i
//!
//! prior            q_xᵀ Q₀ q_x
//! beams            Σ_i k_i² R_white,i
//! roughness        σ_ε² Σ_squares (Σ_{i in square} k_i)²
//! pose             Σ_k s_kᵀ P_k (2 r_k − s_k),   s_k = Σ_{i∈k} k_i ∂z_i/∂χ,   r_k = s_k + A_{k+1}ᵀ r_{k+1}
//! constant c       (σ_c Σ_i k_i ∂z_i/∂c)²
//! tag t            |σ_m Σ_k E_{k,t}ᵀ s_k|²,   E_{k,t} = ∂χ_k/∂m_t
//! marker datum     |σ_0 Σ_t Σ_k E_{k,t}ᵀ s_k|²
//! ```
//! - `w`: area of each node that counts, m²; `a_i`: row of datum i
//! - `P_k`, `A_k`: covariance and transition of the error state at turn k, 15×15
//!
//! The errors of the pose at two turns j > k share `A_j … A_{k+1} P_k`; the sum over all pairs,
//! taken backwards, needs one vector `r`.
//! The datum is an error that all tags of the map share, as when the whole map lies 2 mm too low in the
//! frame that bases and bays are given in; a turn of the map as a whole is not among the sources.
//! Checked: `constant_sources_match_the_map_solved_again`, `white_sources_match_the_scatter_of_noisy_flights`,
//! `a_marker_map_that_is_off_as_a_whole_moves_the_volume_as_its_row_says`,
//! `chained_pose_errors_match_the_joint_covariance`.

use super::datum::{Datum, Linearization, Turn};
use super::footprint::Footprint;
use super::roughness::OCCLUSION_SHARE;
use crate::messages::state::SIZE;
use crate::messages::{BudgetRow, BudgetSource, SharedSensitivity, VolumeBudget};
use nalgebra::{SMatrix, SVector, Vector3, Vector6};
use std::sync::Arc;

/// Standard deviations of errors that stay the same for a whole flight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CalibrationSigmas {
    /// Every range is off by the same distance, m.
    pub range_bias_m: f64,
    /// Every range is off by the same share of itself, no unit.
    pub range_scale: f64,
    /// Place of the LiDAR on the body, per axis, m.
    pub mount_position_m: f64,
    /// Rotation of the LiDAR on the body, per axis, rad.
    pub mount_rotation_rad: f64,
    /// Clock of the LiDAR against the clock of the pose, s.
    pub clock_offset_s: f64,
    /// Place of each tag in the marker map, per axis, m.
    pub tag_place_m: f64,
    /// Place of the marker map as a whole, per axis, m; 0 if bases and bays are given by the markers.
    pub tag_datum_m: f64,
}

/// Sums over the turns, for one volume.
#[derive(Debug, Clone)]
struct Sums {
    beam_var_m6: f64,
    slope_var_m6: f64,
    /// Σ k of the patches in each square, by its south-west node.
    squares: Vec<f64>,
    roughness_var_m2: f64,
    pose_var_m6: f64,
    /// r of the turn after the one at hand.
    r_next: SVector<f64, SIZE>,
    /// By [`Footprint::lidar_idx`].
    occlusion: f64,
    lidars: Vec<LidarSums>,
    tags: Vec<Vector3<f64>>,
}

/// What belongs to one LiDAR on its vehicle.
#[derive(Debug, Clone, Copy, Default)]
struct LidarSums {
    mount: Vector6<f64>,
    range_bias: f64,
    range_scale: f64,
    clock_offset: f64,
}

/// What the data contribute to the variance of volumes whose adjoints are `q_m2`, in their order.
///
/// `q_m2[v][node]` is the derivative of volume v by an information-weighted height at the node.
#[must_use]
pub fn data_budgets(
    footprints: &[Arc<Footprint>],
    at: &Linearization<'_>,
    q_m2: &[&[f64]],
    sigmas: &CalibrationSigmas,
) -> Vec<VolumeBudget> {
    let mut sums = vec![Sums::new(at.lattice.n_nodes()); q_m2.len()];
    let mut transition_to_next = SMatrix::<f64, SIZE, SIZE>::zeros();
    for footprint in footprints.iter().rev() {
        let s = add_turn(footprint, at, q_m2, &mut sums);
        for (sums, s) in sums.iter_mut().zip(s) {
            sums.end_turn(footprint, &s, &transition_to_next);
        }
        transition_to_next = footprint.error.from_previous;
    }
    sums.iter().map(|sums| sums.budget(sigmas)).collect()
}

/// Adds the patches of a turn; s of every volume.
fn add_turn(
    footprint: &Footprint,
    at: &Linearization<'_>,
    q_m2: &[&[f64]],
    sums: &mut [Sums],
) -> Vec<Vector6<f64>> {
    let mut s = vec![Vector6::zeros(); q_m2.len()];
    let Some(turn) = Turn::new(footprint, *at) else { return s };
    for patch in &footprint.patches {
        let Some(datum) = turn.datum(patch).filter(|datum| at.believes(datum)) else { continue };
        for (q, (sums, s)) in q_m2.iter().zip(sums.iter_mut().zip(&mut s)) {
            let k = datum.row.value(q) * datum.weight_per_m2;
            *s += datum.by_pose * k;
            sums.add(footprint.lidar_idx, &datum, k);
        }
    }
    s
}

impl Sums {
    fn new(n_nodes: usize) -> Self {
        Self {
            beam_var_m6: 0.0,
            slope_var_m6: 0.0,
            squares: vec![0.0; n_nodes],
            roughness_var_m2: 0.0,
            pose_var_m6: 0.0,
            r_next: SVector::zeros(),
            occlusion: 0.0,
            lidars: Vec::new(),
            tags: Vec::new(),
        }
    }

    fn lidar(&mut self, lidar_idx: usize) -> &mut LidarSums {
        let n = self.lidars.len().max(lidar_idx + 1);
        self.lidars.resize(n, LidarSums::default());
        &mut self.lidars[lidar_idx]
    }

    fn add(&mut self, lidar_idx: usize, datum: &Datum, k: f64) {
        self.beam_var_m6 += k * k * datum.sensor_var_m2;
        self.slope_var_m6 += k * k * datum.slope_var_m2;
        self.squares[datum.row.nodes[0] as usize] += k;
        self.roughness_var_m2 = datum.roughness_var_m2;
        self.occlusion += datum.hidden_m * k;
        let lidar = self.lidar(lidar_idx);
        lidar.mount += datum.by_mount * k;
        lidar.range_bias += datum.by_range * k;
        lidar.range_scale += datum.by_range * datum.range_m * k;
    }

    /// Everything that follows from s of one turn.
    fn end_turn(
        &mut self,
        footprint: &Footprint,
        s_pose: &Vector6<f64>,
        transition_to_next: &SMatrix<f64, SIZE, SIZE>,
    ) {
        let error = &footprint.error;
        let mut s = SVector::<f64, SIZE>::zeros();
        s.fixed_rows_mut::<6>(0).copy_from(s_pose);
        let r = s + transition_to_next.tr_mul(&self.r_next);
        self.pose_var_m6 += s.dot(&(error.cov * (r * 2.0 - s)));
        self.r_next = r;
        let (v, rate) = (error.velocity_mps, error.rate_radps);
        let motion = Vector6::new(v.x, v.y, v.z, rate.x, rate.y, rate.z);
        self.lidar(footprint.lidar_idx).clock_offset += s_pose.dot(&motion);
        for tag in &error.tags {
            if self.tags.len() <= tag.tag_idx {
                self.tags.resize(tag.tag_idx + 1, Vector3::zeros());
            }
            self.tags[tag.tag_idx] += tag.pose_by_place.cast::<f64>().tr_mul(s_pose);
        }
    }

    /// The constant sources: derivative of the volume and σ, component by component.
    fn shared(&self, sigmas: &CalibrationSigmas) -> Vec<SharedSensitivity> {
        let one = |source, component, dv_dc: f64, sigma| SharedSensitivity {
            source,
            component,
            dv_dc,
            sigma,
        };
        let mount_sigma =
            |c| if c < 3 { sigmas.mount_position_m } else { sigmas.mount_rotation_rad };
        let of_lidar = |(idx, sums): (usize, &LidarSums)| {
            let mount = sums.mount;
            let axis = |c| one(BudgetSource::LidarMounting, 6 * idx + c, mount[c], mount_sigma(c));
            let rest = [
                one(BudgetSource::RangeBias, idx, sums.range_bias, sigmas.range_bias_m),
                one(BudgetSource::RangeScale, idx, sums.range_scale, sigmas.range_scale),
                one(BudgetSource::ClockOffset, idx, sums.clock_offset, sigmas.clock_offset_s),
            ];
            (0..6).map(axis).chain(rest).collect::<Vec<_>>()
        };
        let lidars = self.lidars.iter().enumerate().flat_map(of_lidar);
        let ground = one(BudgetSource::Occlusion, 0, self.occlusion, OCCLUSION_SHARE.1);
        // First, for flights see different numbers of tags; and not at all without a σ.
        let whole_map: Vector3<f64> = self.tags.iter().sum();
        let has_datum = sigmas.tag_datum_m > 0.0;
        let datum = whole_map.iter().filter(|_| has_datum).map(|by| (*by, sigmas.tag_datum_m));
        let tags = self.tags.iter().flatten().map(|by| (*by, sigmas.tag_place_m));
        let tags = datum.chain(tags).enumerate().map(|(component, (dv_dc, sigma))| {
            one(BudgetSource::MarkerMap, component, dv_dc, sigma)
        });
        lidars.chain([ground]).chain(tags).collect()
    }

    /// What the nodes cannot show: heights common to a square, slopes of every patch by itself.
    fn roughness_var_m6(&self) -> f64 {
        let squares_m4: f64 = self.squares.iter().map(|k| k * k).sum();
        self.slope_var_m6 + self.roughness_var_m2 * squares_m4
    }

    fn budget(&self, sigmas: &CalibrationSigmas) -> VolumeBudget {
        let shared = self.shared(sigmas);
        let row = |source, var_m6: f64| BudgetRow { source, var_m6: var_m6.max(0.0) };
        let constant = |source| {
            let of_source = shared.iter().filter(|s| s.source == source);
            row(source, of_source.map(|s| (s.dv_dc * s.sigma).powi(2)).sum())
        };
        let rows = vec![
            row(BudgetSource::BeamNoise, self.beam_var_m6),
            row(BudgetSource::Roughness, self.roughness_var_m6()),
            row(BudgetSource::Pose, self.pose_var_m6),
            constant(BudgetSource::LidarMounting),
            constant(BudgetSource::RangeBias),
            constant(BudgetSource::RangeScale),
            constant(BudgetSource::ClockOffset),
            constant(BudgetSource::MarkerMap),
            constant(BudgetSource::Occlusion),
        ];
        VolumeBudget { rows, shared }
    }
}

#[cfg(test)]
mod tests;
