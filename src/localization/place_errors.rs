//! What misplaced tags do to the error of the state: constant errors that no frame averages out.
//!
//! A tag that hangs τ beside its mapped place is wrong by the same τ in every frame. So τ is
//! carried along as it was surveyed and never estimated (a consider state):
//!
//! ```text
//! e = e_rest + Σ_t E_t τ_t,   τ_t ~ N(0, σ² I₃),   cov(e) = P + Σ_t σ² E_t E_tᵀ
//! E ← Φ E                     over an inertial step
//! E_t ← (I − U H) E_t + V_t   by an update whose measurement answers τ_t with V_t
//! ```
//! - `τ_t`: true minus mapped place of a tag (or of a point that belongs to none), hall axes, m, 3
//! - `E_t`: what it does to the error (true minus believed) of the state, 15×3
//!
//! P keeps what is independent of the map; the budget of a volume counts the E apart from it.
//! Source: Schmidt 1966, "Application of state-space methods to navigation problems".
//! Checked: `joint_update_equals_the_dense_consider_filter`,
//! `place_errors_equal_those_of_a_filter_in_a_moved_map`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::filter::{Covariance, Gain};
use super::propagation::Transition;
use crate::messages::TagSensitivity;
use crate::messages::state::SIZE;
use nalgebra::{Matrix6, Matrix6x3, SMatrix};
use std::sync::Arc;

/// What the place of one tag does to the error of the state, 15×3.
pub(super) type Share = SMatrix<f64, SIZE, 3>;

/// A place that moves the pose by less than this share of its own error is not worth listing.
const LEAST_SHARE: f64 = 1e-4;

/// The shares of all places that were ever used.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaceErrors {
    sigma_m: f64,
    /// How the error went on since the shares were written down.
    since: Covariance,
    then: Arc<Shares>,
}

/// The shares after an update that used tags.
#[derive(Debug, Clone, PartialEq)]
struct Shares {
    /// In the order of the numbers of the places in the marker map.
    by_place: Vec<(usize, Share)>,
    /// Σ σ² E Eᵀ
    cov: Covariance,
}

impl PlaceErrors {
    /// No share yet of places that each axis may be off by `sigma_m` (m); `None` for a map without
    /// errors.
    #[must_use]
    pub fn new(sigma_m: f64) -> Option<Box<Self>> {
        let then = Arc::new(Shares { by_place: Vec::new(), cov: Covariance::zeros() });
        (sigma_m > 0.0).then(|| Box::new(Self { sigma_m, since: Covariance::identity(), then }))
    }

    /// The shares of a state that was just put onto a fix.
    pub(super) fn of_fix(sigma_m: f64, by_place: &[TagSensitivity]) -> Option<Box<Self>> {
        let mut errors = Self::new(sigma_m)?;
        let share = |tag: &TagSensitivity| {
            let mut E = Share::zeros();
            E.fixed_rows_mut::<6>(0).copy_from(&tag.pose_by_place);
            (tag.tag_idx, E)
        };
        errors.add(&by_place.iter().map(share).collect::<Vec<_>>());
        Some(errors)
    }

    /// σ of a place, each axis, m.
    pub(super) const fn sigma_m(&self) -> f64 {
        self.sigma_m
    }

    /// After an inertial step.
    pub(super) fn stepped(&self, step: &Transition) -> Self {
        Self { since: step.times(&self.since), then: Arc::clone(&self.then), ..*self }
    }

    /// `E ← (I − U H) E` of all places.
    pub(super) fn apply(&mut self, gain: &Gain) {
        gain.apply(&mut self.since);
    }

    /// `E_t ← E_t + V_t` of some places.
    pub(super) fn add(&mut self, shares: &[(usize, Share)]) {
        let before = &self.then.by_place;
        let mut by_place = Vec::with_capacity(before.len() + shares.len());
        by_place.extend(before.iter().map(|(place, E)| (*place, self.since * E)));
        for &(place_idx, V) in shares {
            match by_place.binary_search_by_key(&place_idx, |(place, _)| *place) {
                Ok(at) => by_place[at].1 += V,
                Err(at) => by_place.insert(at, (place_idx, V)),
            }
        }
        let cov = self.cov_of(by_place.iter().map(|(_, E)| E));
        self.then = Arc::new(Shares { by_place, cov });
        self.since = Covariance::identity();
    }

    /// `E_t` of one place.
    pub(super) fn share(&self, place_idx: usize) -> Share {
        let by_place = &self.then.by_place;
        let at = by_place.binary_search_by_key(&place_idx, |(place, _)| *place);
        at.map_or_else(|_| Share::zeros(), |at| self.since * by_place[at].1)
    }

    /// Σ σ² E Eᵀ over all places.
    pub(super) fn cov(&self) -> Covariance {
        self.carried(&self.then.cov)
    }

    /// The first six columns of the same.
    pub(super) fn cov_with_pose(&self) -> SMatrix<f64, SIZE, 6> {
        self.since * (self.then.cov * self.since.fixed_rows::<6>(0).transpose())
    }

    /// The pose's part of the same, 6×6.
    pub(super) fn pose_cov(&self) -> Matrix6<f64> {
        let half = self.then.cov * self.since.fixed_rows::<6>(0).transpose();
        let cov = self.since.fixed_rows::<6>(0) * half;
        (cov + cov.transpose()) * 0.5
    }

    /// Σ σ² E Eᵀ over all places but these.
    pub(super) fn cov_without(&self, places: &[usize]) -> Covariance {
        let others = self.then.by_place.iter().filter(|(place, _)| !places.contains(place));
        self.carried(&self.cov_of(others.map(|(_, E)| E)))
    }

    /// A covariance from when the shares were written down.
    fn carried(&self, then: &Covariance) -> Covariance {
        let cov = self.since * then * self.since.transpose();
        (cov + cov.transpose()) * 0.5
    }

    /// True if no share is NaN or infinite.
    pub(super) fn is_finite(&self) -> bool {
        self.since.iter().chain(&self.then.cov).all(|c| c.is_finite())
    }

    fn cov_of<'a>(&self, shares: impl Iterator<Item = &'a Share>) -> Covariance {
        let var_m2 = self.sigma_m * self.sigma_m;
        let mut cov = Covariance::zeros();
        shares.for_each(|E| cov.gemm(var_m2, E, &E.transpose(), 1.0));
        cov
    }

    /// The pose's part of all shares that say anything.
    pub(super) fn sensitivities(&self) -> Vec<TagSensitivity> {
        let pose_part = |&(tag_idx, E): &(usize, Share)| {
            let pose_by_place: Matrix6x3<f64> = self.since.fixed_rows::<6>(0) * E;
            TagSensitivity { tag_idx, pose_by_place }
        };
        let all = self.then.by_place.iter().map(pose_part);
        all.filter(|tag| tag.pose_by_place.amax() >= LEAST_SHARE).collect()
    }
}
