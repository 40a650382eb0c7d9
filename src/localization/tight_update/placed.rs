//! The tight update from tags that may hang beside their mapped places.
//!
//! A tag that is displaced by τ looks as if the camera were displaced by −τ. So each place `t` of a
//! frame sees a pose of its own, and all of them follow from few unknowns that are independent:
//!
//! ```text
//! d_t = c − S τ_t = B_t y,   y = (c', τ_1 … τ_n),   B_t = [I₆ | H E_1 … H E_t − S … H E_n]
//! c' ~ N(0, H (P + Σ_unseen σ² E Eᵀ) Hᵀ + σ_t² m mᵀ),   τ ~ N(0, σ² I₃)
//! η_t = Λ_t d_t + noise,   noise ~ N(0, Λ_t)
//! ```
//! - `c`: shift of the pose as in the module above; `S = [I₃; 0]`, `H = [I₆ 0]`
//! - `E_t`: what `τ_t` did to the state's error so far, 15×3 (see `place_errors`)
//!
//! With the prior's factor `y = L z` and `W_t = B_t L` the unknowns are found from one positive
//! definite matrix without an eigenvalue below 1, and the state follows them:
//!
//! ```text
//! A = I + Σ W_tᵀ Λ_t W_t,   ẑ = A⁻¹ Σ W_tᵀ η_t,   ê = C A⁻¹ Σ W_tᵀ η_t = Σ G_t η_t,   C = cov(e, z)
//! U = Σ G_t Λ_t,   P⁺ = (I − U H) P (I − U H)ᵀ + Σ G_t Λ_t G_tᵀ + σ_t² U m mᵀ Uᵀ
//! E_t⁺ = (I − U H) E_t + G_t Λ_t S
//! ```
//! This is the gain of the filter that also estimated the places, but the places stay as surveyed.
//! `A` is never written out: see `joint`.
//! Checked: `joint_update_equals_the_dense_consider_filter`.

mod joint;

pub(in crate::localization) use self::joint::{JointPosterior, JointPrior};

use super::{
    Frame, Information, MAX_PASSES, Residual, SETTLED_M, SETTLED_RAD, Sighting, TightOutcome,
    Viewpoint, collect,
};
use crate::localization::filter::{Covariance, FilterState, Gain};
use crate::localization::place_errors::Share;
use crate::stats::chi2_gate_99;
use nalgebra::{Matrix2, Matrix6, SMatrix, Vector6};

/// The points of a frame place by place, in their order.
fn groups(frame: &Frame) -> Vec<&[Sighting]> {
    frame.points.chunk_by(|a, b| a.place_idx == b.place_idx).collect()
}

/// `rᵀ S⁻¹ r` of one point with S = I + J C Jᵀ.
pub(in crate::localization) fn distance2(C: &Matrix6<f64>, residual: &Residual) -> f64 {
    let S = Matrix2::identity() + residual.J * C * residual.J.transpose();
    S.cholesky().map_or(f64::MAX, |S| residual.r.dot(&S.solve(&residual.r)))
}

/// Where the passes ended: what the points of each place say, with η brought back to the prior.
struct Settled<'a> {
    posterior: JointPosterior<'a>,
    said: Vec<Information>,
}

fn settle<'a>(frame: &Frame, view: &Viewpoint, prior: &'a JointPrior) -> Option<Settled<'a>> {
    let groups = groups(frame);
    let still = Vector6::zeros();
    let mut said: Vec<Information> = groups
        .iter()
        .enumerate()
        .map(|(k, points)| {
            let cov = prior.view_cov(k);
            collect(frame, points, view, &still, |residual| distance2(&cov, residual))
        })
        .collect();
    let mut d = vec![still; groups.len()];
    let mut posterior = prior.posterior(&said)?;
    for _ in 1..MAX_PASSES {
        let next = posterior.views();
        let mut steps = next.iter().zip(&d).map(|(next, d)| next - d);
        let is_small = |step: Vector6<f64>| {
            step.fixed_rows::<3>(0).norm() < SETTLED_M
                && step.fixed_rows::<3>(3).norm() < SETTLED_RAD
        };
        let is_settled = steps.all(is_small);
        let n_points = |said: &[Information]| said.iter().map(|one| one.n_points).sum::<usize>();
        let n_before = n_points(&said);
        said = groups
            .iter()
            .zip(&next)
            .map(|(points, d)| {
                let seen = collect(frame, points, view, d, |residual| residual.r.norm_squared());
                Information { eta: seen.eta + seen.Lambda * d, ..seen }
            })
            .collect();
        d = next;
        posterior = prior.posterior(&said)?;
        if is_settled && n_points(&said) == n_before {
            break;
        }
    }
    Some(Settled { posterior, said })
}

/// Fuses the points of a frame where they agree with the state and the survey of their places.
pub(super) fn fuse(
    state: &mut FilterState,
    view: &Viewpoint,
    frame: &Frame,
    outcome: &mut TightOutcome,
) -> Option<Gain> {
    let motion = view.motion();
    let places: Vec<usize> =
        groups(frame).iter().filter_map(|points| points.first()).map(|p| p.place_idx).collect();
    let errors = state.places.as_deref()?;
    let prior = JointPrior::new(state, errors, &motion, frame.capture_sigma_s, &places)?;
    let Settled { mut posterior, mut said } = settle(frame, view, &prior)?;
    let n_used = said.iter().map(|one| one.n_points).sum();
    let squares: f64 = said.iter().map(|one| one.squares).sum();
    outcome.n_used = n_used;
    outcome.nis_gate = chi2_gate_99(2 * n_used);
    let mut left = squares;
    // Points that disagree among each other are worse than they were said to be.
    if squares > outcome.nis_gate {
        #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
        let excess = squares / (2 * n_used.max(1)) as f64;
        outcome.sigma_factor = excess.sqrt();
        said = said.iter().map(|one| one.scaled(1.0 / excess)).collect();
        posterior = prior.posterior(&said)?;
        left = squares / excess;
    }
    outcome.shift = posterior.shift();
    outcome.shift_cov = prior.cov - posterior.cov();
    outcome.nis = left + posterior.squares;
    let is_agreed = 2 * n_used > frame.points.len() && outcome.nis <= outcome.nis_gate;
    is_agreed.then(|| apply(state, &posterior, &motion, frame.capture_sigma_s, &said))
}

/// The update itself.
fn apply(
    state: &mut FilterState,
    posterior: &JointPosterior<'_>,
    motion: &Vector6<f64>,
    capture_sigma_s: f64,
    said: &[Information],
) -> Gain {
    let mut U = SMatrix::<f64, 15, 6>::zeros();
    let mut noise = Covariance::zeros();
    let mut error = SMatrix::<f64, 15, 1>::zeros();
    let mut shares: Vec<(usize, Share)> = Vec::with_capacity(said.len());
    for (k, (said, G)) in said.iter().zip(posterior.gains()).enumerate() {
        let by_pose = G * said.Lambda;
        U += by_pose;
        noise += by_pose * G.transpose();
        error += G * said.eta;
        shares.push((posterior.place_idx(k), by_pose.fixed_columns::<3>(0).into_owned()));
    }
    let by_time = U * motion * capture_sigma_s;
    noise += by_time * by_time.transpose();
    let gain = Gain { first: 0, U };
    state.absorb_parts(&gain, &noise, &error);
    if let Some(places) = &mut state.places {
        places.add(&shares);
    }
    gain
}

#[cfg(test)]
mod tests;
