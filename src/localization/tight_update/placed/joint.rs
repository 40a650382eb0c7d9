//! The poses that the places of a frame see, before and after their points are heard.
//!
//! `A` is block diagonal but for twelve directions, `D_t = I + σ² Sᵀ Λ_t S` and `B_t = σ Λ_t S`:
//!
//! ```text
//! A = D + Wᵀ Λ W − Wᵀ B − Bᵀ W,   Λ = Σ Λ_t,   W = [L | σ H E_1 … σ H E_n],   B = [0 | B_1 … B_n]
//! ```
//! So `A z = Wᵀ η + b` is solved through `c = W z` and its multiplier λ, six numbers each:
//!
//! ```text
//! Π = L Lᵀ + Σ W_t D_t⁻¹ W_tᵀ,   M = I − Σ W_t D_t⁻¹ B_tᵀ,   Λ̃ = Λ − Σ B_t D_t⁻¹ B_tᵀ
//! g = L b_0 + Σ W_t D_t⁻¹ b_t,   β = η + Σ B_t D_t⁻¹ b_t
//! (Λ̃ + Mᵀ Π⁻¹ M) c = β + Mᵀ Π⁻¹ g,   λ = Π⁻¹ (M c − g)
//! z_0 = b_0 + Lᵀ λ,   z_t = D_t⁻¹ (b_t + B_tᵀ c + W_tᵀ λ)
//! ```
//! - `Λ̃`: what the points say of the pose where nothing is known of their places
//! - `Λ̃ + Mᵀ Π⁻¹ M`: inverse of the covariance of `c` after the update
//!
//! The cost grows with the number of places, not with its cube.

use super::super::Information;
use crate::localization::filter::FilterState;
use crate::localization::place_errors::{PlaceErrors, Share};
use nalgebra::{
    Cholesky, Const, Matrix3, Matrix3x6, Matrix6, Matrix6x3, SMatrix, Vector3, Vector6,
};

/// A matrix with the rows of a pose.
type PoseRows<const N: usize> = SMatrix<f64, 6, N>;

/// What is believed of the poses that the places of a frame see.
pub(in crate::localization) struct JointPrior {
    sigma_m: f64,
    /// Factor of the covariance of `c'`.
    L: Matrix6<f64>,
    /// `cov(z_0, e)`, 6×15.
    z0_by_error: PoseRows<15>,
    /// Number in the marker map and `cov(e, z_t) = σ E_t` of each place.
    places: Vec<(usize, Share)>,
    /// Covariance of `c`, 6×6.
    pub(in crate::localization) cov: Matrix6<f64>,
}

/// What is believed with the points of a frame.
pub(in crate::localization) struct JointPosterior<'a> {
    prior: &'a JointPrior,
    places: Vec<Place>,
    Pi: Cholesky<f64, Const<6>>,
    M: Matrix6<f64>,
    /// `Mᵀ Π⁻¹`
    M_by_Pi: Matrix6<f64>,
    /// Of the inverse of the covariance of `c`.
    X: Cholesky<f64, Const<6>>,
    c: Vector6<f64>,
    /// |ẑ|²
    pub(super) squares: f64,
}

/// One place in a posterior.
struct Place {
    D_inverse: Matrix3<f64>,
    B: Matrix6x3<f64>,
    z: Vector3<f64>,
}

impl JointPrior {
    /// For the places (distinct numbers in the marker map) that a frame shows; `None` where the
    /// covariance is not positive definite.
    pub(in crate::localization) fn new(
        state: &FilterState,
        errors: &PlaceErrors,
        motion: &Vector6<f64>,
        capture_sigma_s: f64,
        places: &[usize],
    ) -> Option<Self> {
        let sigma_m = errors.sigma_m();
        let rest = state.P + errors.cov_without(places);
        let own =
            rest.fixed_view::<6, 6>(0, 0) + motion * motion.transpose() * capture_sigma_s.powi(2);
        let L = own.cholesky()?.l();
        // cov(e, z_0) = cov(e, c') L⁻ᵀ, row by row.
        let z0_by_error = L.solve_lower_triangular(&rest.fixed_rows::<6>(0).into_owned())?;
        let places: Vec<(usize, Share)> =
            places.iter().map(|place| (*place, errors.share(*place) * sigma_m)).collect();
        let cov = places.iter().fold(own, |sum, (_, C)| {
            let W = C.fixed_rows::<6>(0);
            sum + W * W.transpose()
        });
        Some(Self { sigma_m, L, z0_by_error, places, cov: symmetric(&cov) })
    }

    /// `W_t`, 6×3.
    fn W(&self, k: usize) -> Matrix6x3<f64> {
        self.places[k].1.fixed_rows::<6>(0).into_owned()
    }

    /// Covariance of the pose that the k-th place sees, 6×6.
    pub(in crate::localization) fn view_cov(&self, k: usize) -> Matrix6<f64> {
        let mut cov = self.cov;
        let pull = self.W(k) * self.sigma_m;
        let mut columns = cov.fixed_columns_mut::<3>(0);
        columns -= pull;
        let mut rows = cov.fixed_rows_mut::<3>(0);
        rows -= pull.transpose();
        let mut own = cov.fixed_view_mut::<3, 3>(0, 0);
        own += Matrix3::from_diagonal_element(self.sigma_m.powi(2));
        symmetric(&cov)
    }

    /// With what the points of each place say; `None` where that has no factor.
    pub(in crate::localization) fn posterior(
        &self,
        said: &[Information],
    ) -> Option<JointPosterior<'_>> {
        let mut Pi = self.L * self.L.transpose();
        let mut M = Matrix6::identity();
        let mut Lambda = Matrix6::zeros();
        let (mut beta, mut g) = (Vector6::zeros(), Vector6::zeros());
        let mut places = Vec::with_capacity(said.len());
        for (k, said) in said.iter().enumerate() {
            let (B, W) = (said.Lambda.fixed_columns::<3>(0) * self.sigma_m, self.W(k));
            let D = Matrix3::identity() + B.fixed_rows::<3>(0) * self.sigma_m;
            let D_inverse = symmetric(&D).cholesky()?.inverse();
            let by_W = W * D_inverse;
            let by_B = B * D_inverse;
            let b = said.eta.fixed_rows::<3>(0) * -self.sigma_m;
            Pi += by_W * W.transpose();
            M -= by_W * B.transpose();
            Lambda += said.Lambda - by_B * B.transpose();
            beta += said.eta + by_B * b;
            g += by_W * b;
            places.push(Place { D_inverse, B, z: b });
        }
        let Pi = symmetric(&Pi).cholesky()?;
        let M_by_Pi = Pi.solve(&M).transpose();
        let X = symmetric(&(Lambda + M_by_Pi * M)).cholesky()?;
        let mut posterior =
            JointPosterior { prior: self, places, Pi, M, M_by_Pi, X, c: beta, squares: 0.0 };
        let (c, lambda) = posterior.solve(&beta, &g);
        posterior.c = c;
        posterior.squares = self.L.tr_mul(&lambda).norm_squared();
        for (k, place) in posterior.places.iter_mut().enumerate() {
            place.z = place.follow(&place.z, &self.W(k), &c, &lambda);
            posterior.squares += place.z.norm_squared();
        }
        Some(posterior)
    }
}

impl Place {
    /// `D_t⁻¹ (b_t + B_tᵀ c + W_tᵀ λ)`
    fn follow<const N: usize>(
        &self,
        b: &SMatrix<f64, 3, N>,
        W: &Matrix6x3<f64>,
        c: &PoseRows<N>,
        lambda: &PoseRows<N>,
    ) -> SMatrix<f64, 3, N> {
        self.D_inverse * (b + self.B.tr_mul(c) + W.tr_mul(lambda))
    }
}

impl JointPosterior<'_> {
    /// `c` and λ.
    fn solve<const N: usize>(
        &self,
        beta: &PoseRows<N>,
        g: &PoseRows<N>,
    ) -> (PoseRows<N>, PoseRows<N>) {
        let c = self.X.solve(&(beta + self.M_by_Pi * g));
        let lambda = self.Pi.solve(&(self.M * c - g));
        (c, lambda)
    }

    /// ĉ
    pub(super) const fn shift(&self) -> Vector6<f64> {
        self.c
    }

    /// Covariance of `c`, 6×6.
    pub(super) fn cov(&self) -> Matrix6<f64> {
        symmetric(&self.X.inverse())
    }

    /// d̂ of the k-th place.
    pub(in crate::localization) fn view(&self, k: usize) -> Vector6<f64> {
        let mut d = self.c;
        let mut position = d.fixed_rows_mut::<3>(0);
        position -= self.places[k].z * self.prior.sigma_m;
        d
    }

    pub(super) fn views(&self) -> Vec<Vector6<f64>> {
        (0..self.places.len()).map(|k| self.view(k)).collect()
    }

    /// Covariance of the pose that the k-th place sees, 6×6.
    pub(super) fn view_cov(&self, k: usize) -> Matrix6<f64> {
        let (place, W, sigma_m) = (&self.places[k], self.prior.W(k), self.prior.sigma_m);
        let mut b = Matrix3x6::zeros();
        b.fixed_columns_mut::<3>(0).fill_diagonal(-sigma_m);
        let by_b = place.D_inverse * b;
        let beta = Matrix6::identity() + place.B * by_b;
        let (mut cov, lambda) = self.solve(&beta, &(W * by_b));
        let z = place.follow(&b, &W, &cov, &lambda);
        let mut position = cov.fixed_rows_mut::<3>(0);
        position -= z * sigma_m;
        symmetric(&cov)
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
        let C = self.view_cov(k);
        let M = (Matrix6::identity() - C * said.Lambda).try_inverse()?;
        let d = M * (self.view(k) - C * said.eta);
        Some((d, symmetric(&(M * C))))
    }

    /// `G_t` of the places in their order, 15×6: `A⁻¹ Cᵀ` gives all of them.
    pub(super) fn gains(&self) -> impl Iterator<Item = SMatrix<f64, 15, 6>> {
        let prior = self.prior;
        let mut beta = PoseRows::<15>::zeros();
        let mut g = prior.L * prior.z0_by_error;
        for (k, place) in self.places.iter().enumerate() {
            let by_b = place.D_inverse * prior.places[k].1.transpose();
            beta += place.B * by_b;
            g += prior.W(k) * by_b;
        }
        let (c, lambda) = self.solve(&beta, &g);
        self.places.iter().enumerate().map(move |(k, place)| {
            let b = prior.places[k].1.transpose();
            let z = place.follow(&b, &prior.W(k), &c, &lambda);
            let mut G = c;
            let mut position = G.fixed_rows_mut::<3>(0);
            position -= z * prior.sigma_m;
            G.transpose()
        })
    }

    /// Number of the k-th place in the marker map.
    pub(super) fn place_idx(&self, k: usize) -> usize {
        self.prior.places[k].0
    }
}

fn symmetric<const N: usize>(M: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (M + M.transpose()) * 0.5
}
