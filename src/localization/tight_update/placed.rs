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
//! - `E_t`: what τ_t did to the state's error so far, 15×3 (see `place_errors`)
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
//! The cost grows with the cube of the tags in a frame: 30 tags are a matrix of 96 rows.
//! Checked: `joint_update_equals_the_dense_consider_filter`.

use super::{
    Frame, Information, MAX_PASSES, Residual, SETTLED_M, SETTLED_RAD, Sighting, TightOutcome,
    Viewpoint, collect,
};
use crate::localization::filter::{Covariance, FilterState, Gain};
use crate::localization::place_errors::{PlaceErrors, Share};
use crate::stats::chi2_gate_99;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix2, Matrix6, Matrix6x3, SMatrix, Vector6};

/// The points of a frame place by place, in their order.
fn groups(frame: &Frame) -> Vec<&[Sighting]> {
    frame.points.chunk_by(|a, b| a.place_idx == b.place_idx).collect()
}

/// What is believed of the poses that the places of a frame see.
pub(in crate::localization) struct JointPrior {
    places: Vec<usize>,
    sigma_m: f64,
    /// `B_0 L` with the τ_t of no place taken off, 6×m.
    W: DMatrix<f64>,
    /// `C`, 15×m.
    C: DMatrix<f64>,
    /// Covariance of `c`, 6×6.
    pub(in crate::localization) cov: Matrix6<f64>,
}

/// What is believed with the points of a frame.
pub(in crate::localization) struct JointPosterior<'a> {
    prior: &'a JointPrior,
    A: Cholesky<f64, Dyn>,
    z: DVector<f64>,
}

impl JointPrior {
    /// For the places (distinct numbers in the marker map) that a frame shows; `None` where the
    /// covariance is not positive definite.
    pub(in crate::localization) fn new(
        state: &FilterState,
        errors: &PlaceErrors,
        motion: &Vector6<f64>,
        capture_sigma_s: f64,
        places: Vec<usize>,
    ) -> Option<Self> {
        let sigma_m = errors.sigma_m();
        let rest = state.P + errors.cov_without(&places);
        let own =
            rest.fixed_view::<6, 6>(0, 0) + motion * motion.transpose() * capture_sigma_s.powi(2);
        let L = own.cholesky()?.l();
        let m = 6 + 3 * places.len();
        let (mut W, mut C) = (DMatrix::zeros(6, m), DMatrix::zeros(15, m));
        W.fixed_view_mut::<6, 6>(0, 0).copy_from(&L);
        // cov(e, z) = cov(e, c') L⁻ᵀ, row by row.
        let by_c = L.solve_lower_triangular(&rest.fixed_rows::<6>(0).into_owned())?;
        C.fixed_view_mut::<15, 6>(0, 0).copy_from(&by_c.transpose());
        for (k, place) in places.iter().enumerate() {
            let E = errors.share(*place) * sigma_m;
            W.fixed_view_mut::<6, 3>(0, block(k)).copy_from(&E.fixed_rows::<6>(0));
            C.fixed_view_mut::<15, 3>(0, block(k)).copy_from(&E);
        }
        let cov = fixed(&(&W * W.transpose()));
        Some(Self { places, sigma_m, W, C, cov })
    }

    /// `W_t` of the k-th place.
    fn W_of(&self, k: usize) -> DMatrix<f64> {
        let mut W = self.W.clone();
        for axis in 0..3 {
            W[(axis, block(k) + axis)] -= self.sigma_m;
        }
        W
    }

    /// Covariance of the pose that the k-th place sees, 6×6.
    pub(in crate::localization) fn view_cov(&self, k: usize) -> Matrix6<f64> {
        let W = self.W_of(k);
        fixed(&(&W * W.transpose()))
    }

    /// With what the points of each place say.
    pub(in crate::localization) fn posterior(
        &self,
        said: &[Information],
    ) -> Option<JointPosterior<'_>> {
        let W = self.W.transpose();
        let all = said.iter().fold(Information::none(), |sum, one| sum.plus(one));
        let mut A = DMatrix::identity(W.nrows(), W.nrows()) + &W * all.Lambda * &self.W;
        let mut eta = &W * all.eta;
        for (k, said) in said.iter().enumerate() {
            let by_place: Matrix6x3<f64> = said.Lambda.fixed_columns::<3>(0) * self.sigma_m;
            let pull = &W * by_place;
            let mut columns = A.columns_mut(block(k), 3);
            columns -= &pull;
            let mut rows = A.rows_mut(block(k), 3);
            rows -= pull.transpose();
            let mut own = A.fixed_view_mut::<3, 3>(block(k), block(k));
            own += by_place.fixed_rows::<3>(0) * self.sigma_m;
            let mut own = eta.fixed_rows_mut::<3>(block(k));
            own -= said.eta.fixed_rows::<3>(0) * self.sigma_m;
        }
        let A = ((&A + A.transpose()) * 0.5).cholesky()?;
        let z = A.solve(&eta);
        Some(JointPosterior { prior: self, A, z })
    }
}

impl JointPosterior<'_> {
    /// ĉ
    fn shift(&self) -> Vector6<f64> {
        Vector6::from_iterator((&self.prior.W * &self.z).iter().copied())
    }

    /// d̂ of the k-th place.
    pub(in crate::localization) fn view(&self, k: usize) -> Vector6<f64> {
        let mut d = self.shift();
        for axis in 0..3 {
            d[axis] -= self.prior.sigma_m * self.z[block(k) + axis];
        }
        d
    }

    fn views(&self) -> Vec<Vector6<f64>> {
        (0..self.prior.places.len()).map(|k| self.view(k)).collect()
    }

    /// Covariance of `W_t z`, 6×6.
    fn cov_through(&self, W: &DMatrix<f64>) -> Matrix6<f64> {
        fixed(&(W * self.A.solve(&W.transpose())))
    }

    /// d̂ of the k-th place and its covariance, without what its own points `said`.
    ///
    /// ```text
    /// M = (I − C_k Λ_k)⁻¹,   C₋ = M C_k,   d̂₋ = M (d̂_k − C_k η_k)
    /// ```
    pub(in crate::localization) fn view_without(
        &self,
        k: usize,
        said: &Information,
    ) -> Option<(Vector6<f64>, Matrix6<f64>)> {
        let C = self.cov_through(&self.prior.W_of(k));
        let M = (Matrix6::identity() - C * said.Lambda).try_inverse()?;
        let without = M * C;
        let d = M * (self.view(k) - C * said.eta);
        Some((d, (without + without.transpose()) * 0.5))
    }
}

/// First column of the k-th place.
const fn block(k: usize) -> usize {
    6 + 3 * k
}

fn fixed(M: &DMatrix<f64>) -> Matrix6<f64> {
    let M = M.fixed_view::<6, 6>(0, 0).into_owned();
    (M + M.transpose()) * 0.5
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
        let steps = next.iter().zip(&d).map(|(next, d)| next - d);
        let is_small = |step: Vector6<f64>| {
            step.fixed_rows::<3>(0).norm() < SETTLED_M
                && step.fixed_rows::<3>(3).norm() < SETTLED_RAD
        };
        let is_settled = steps.fold(true, |all, step| all && is_small(step));
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
    errors: &PlaceErrors,
    view: &Viewpoint,
    frame: &Frame,
    outcome: &mut TightOutcome,
) -> Option<Gain> {
    let motion = view.motion();
    let places =
        groups(frame).iter().filter_map(|points| points.first()).map(|p| p.place_idx).collect();
    let prior = JointPrior::new(state, errors, &motion, frame.capture_sigma_s, places)?;
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
    outcome.shift_cov = prior.cov - posterior.cov_through(&prior.W);
    outcome.nis = left + posterior.z.norm_squared();
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
    let prior = posterior.prior;
    // C A⁻¹, 15×m, and G_t without the part of its own place.
    let by_z = posterior.A.solve(&prior.C.transpose()).transpose();
    let mut G_0 = SMatrix::<f64, 15, 6>::zeros();
    G_0.copy_from(&(&by_z * prior.W.transpose()));
    let mut U = SMatrix::<f64, 15, 6>::zeros();
    let mut noise = Covariance::zeros();
    let mut error = SMatrix::<f64, 15, 1>::zeros();
    let mut shares: Vec<(usize, Share)> = Vec::with_capacity(said.len());
    for (k, said) in said.iter().enumerate() {
        let mut G = G_0;
        let mut position = G.fixed_columns_mut::<3>(0);
        position -= by_z.fixed_view::<15, 3>(0, block(k)) * prior.sigma_m;
        let by_pose = G * said.Lambda;
        U += by_pose;
        noise += by_pose * G.transpose();
        error += G * said.eta;
        shares.push((prior.places[k], by_pose.fixed_columns::<3>(0).into_owned()));
    }
    let by_time = U * motion * capture_sigma_s;
    noise += by_time * by_time.transpose();
    let gain = Gain { first: 0, U };
    state.absorb_parts(&gain, &noise, &error);
    if let Some(places) = &mut state.places {
        places.add(shares.into_iter());
    }
    gain
}

#[cfg(test)]
mod tests;
