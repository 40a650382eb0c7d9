//! The tight update: every corner of a frame speaks for itself.
//!
//! A corner measures the pose `c` at the true exposure, which an uncertain capture time shifts
//! along the motion `m = (v, ω)`:
//!
//! ```text
//! r_i = J_i c + n_i,   c = δχ + m s,   n ~ N(0, I),   s ~ N(0, σ_t²)
//! Λ = Σ w J_iᵀ J_i,    η = Σ w J_iᵀ r_i,    P̃ = P₆₆ + σ_t² m mᵀ
//! G = P_:6 (I + Λ P̃)⁻¹,   e = G η,   U = G Λ
//! P⁺ = (I − U H) P (I − U H)ᵀ + G (Λ + σ_t² Λ m mᵀ Λ) Gᵀ,   H = [I₆ 0]
//! ```
//! - `r_i`: pixel seen minus pixel expected over σ of a corner; `J_i`: its derivative, 2×6
//! - `Λ`, `η`: what all corners say together, 6×6 and 6; 2N rows need not be stacked
//!
//! This is the update with all rows stacked: P̃ (I + Λ P̃)⁻¹ = (P̃⁻¹ + Λ)⁻¹, and cov(δ, c) = `P_:6`.
//! Λ may be singular: one tag, or half of one, still says what it can. With P̃ = L Lᵀ the inverse
//! is L⁻ᵀ (I + Lᵀ Λ L)⁻¹ Lᵀ, whose middle has no eigenvalue below 1.
//!
//! The update is iterated: at `χ ⊞ c` the corners are projected again, and
//! `η ← Σ w Jᵀ r + Λ c` (Bell and Cathey 1993). Corners outside of χ² with 2 degrees of freedom at
//! 99.9 % against S = I + J P̃ Jᵀ, later against what is left after the update, are left out; those
//! beyond 99 % weigh less (Huber). So a good corner is lost once in a thousand, and gross errors
//! have no say. If the corners left disagree among each other by more than they may, their σ is
//! widened until they do not.
//!
//! A rolling shutter moves each corner's pose by velocity and rate times its row's offset. The
//! errors of both are left out there: 0.05 m/s over 10 ms is half a millimetre.
//! Where tags may hang beside their mapped places: `placed`.
//! Checked: `compressed_update_equals_the_stacked_one`, `tests/consistency`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

pub(super) mod placed;

use super::camera_model::CameraModel;
use super::filter::{FilterState, Gain};
use crate::geometry::{Body, Hall, Point, Transform, exp_so3, right_jacobian_so3, skew};
use crate::stats::chi2_gate_99;
use nalgebra::{
    Cholesky, Const, Matrix2, Matrix2x6, Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6,
};
use std::sync::Arc;

/// The 99.9 % quantile of χ² with 2 degrees of freedom, −2 ln 0.001.
const POINT_GATE: f64 = 13.8155;
/// Corners beyond the 99 % quantile, √9.2103 σ, weigh as much as one there.
const HUBER_SIGMAS: f64 = 3.0349;
/// The first pass stands at the prior; the others correct its linearisation.
const MAX_PASSES: usize = 6;
/// A pass that moves the pose by less is the last: a hundredth of a good fix, m and rad.
const SETTLED_M: f64 = 1e-4;
const SETTLED_RAD: f64 = 2e-5;

/// One mapped point and where it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Its place in the hall.
    pub place: Point<Hall>,
    /// Where it was seen, px.
    pub pixel: Vector2<f64>,
    /// When its row was exposed, relative to the frame's stamp, s.
    pub offset_s: f64,
    /// The surveyed place that it hangs on, by its number in the marker map: the corners of a tag
    /// share one, and follow each other in a frame.
    pub place_idx: usize,
}

/// The mapped points of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The camera that saw them.
    pub camera: Arc<CameraModel>,
    /// What it saw.
    pub points: Vec<Sighting>,
    /// Standard deviation of a point in the image, px.
    pub corner_sigma_px: f64,
    /// Standard deviation of the capture time, s.
    pub capture_sigma_s: f64,
}

/// What a frame did to the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TightOutcome {
    /// True if the state was changed.
    pub is_fused: bool,
    /// Points in the frame.
    pub n_points: usize,
    /// Points that passed their gates.
    pub n_used: usize,
    /// ĉ: where the points, weighed against the state, see the pose: position in hall axes (m),
    /// attitude in body axes (rad).
    pub shift: Vector6<f64>,
    /// Covariance that ĉ should have, 6×6: what the points took off P̃.
    pub shift_cov: Matrix6<f64>,
    /// Normalised innovation squared of all points used, with 2 degrees of freedom each.
    pub nis: f64,
    /// The bound it had to keep.
    pub nis_gate: f64,
    /// By how much the points' σ was widened; 1 if they agree.
    pub sigma_factor: f64,
}

/// A pose in motion: where points are projected from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Viewpoint {
    pub(super) hall_from_body: Transform<Hall, Body>,
    pub(super) velocity_mps: Vector3<f64>,
    pub(super) rate_radps: Vector3<f64>,
}

impl Viewpoint {
    pub(super) fn of(state: &FilterState, rate_radps: &Vector3<f64>) -> Self {
        Self {
            hall_from_body: state.hall_from_body,
            velocity_mps: state.velocity_mps,
            rate_radps: *rate_radps,
        }
    }

    /// m: the derivative of the pose by time.
    pub(super) fn motion(&self) -> Vector6<f64> {
        let (v, w) = (self.velocity_mps, self.rate_radps);
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }

    fn shifted(&self, c: &Vector6<f64>) -> Self {
        let (dp, dr) = (c.fixed_rows::<3>(0).into_owned(), c.fixed_rows::<3>(3).into_owned());
        Self { hall_from_body: self.hall_from_body.perturbed(&dp, &dr), ..*self }
    }
}

/// One point against one viewpoint, in σ.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual {
    pub(super) r: Vector2<f64>,
    pub(super) J: Matrix2x6<f64>,
}

/// Projects the points of a frame; what they share is computed once.
pub(super) struct Projector<'a> {
    frame: &'a Frame,
    view: Viewpoint,
    R_bh: Matrix3<f64>,
    R_cb: Matrix3<f64>,
    /// Origin of the camera on the body.
    lever: Vector3<f64>,
}

impl<'a> Projector<'a> {
    pub(super) fn new(frame: &'a Frame, view: &Viewpoint) -> Self {
        let mount = &frame.camera.body_from_camera;
        Self {
            frame,
            view: *view,
            R_bh: view.hall_from_body.rotation.matrix().transpose(),
            R_cb: mount.rotation.matrix().transpose(),
            lever: mount.origin.coords,
        }
    }

    /// Residual and derivative of one point; `None` if the viewpoint does not see it.
    ///
    /// ```text
    /// p_b = exp(−ω τ) Rᵀ (P − p − v τ),   ∂p_b/∂p = −exp(−ω τ) Rᵀ,   ∂p_b/∂θ = p_b^ exp(−ω τ)
    /// ```
    /// - `τ`: the row's offset from the frame's stamp, s
    pub(super) fn residual(&self, point: &Sighting) -> Option<Residual> {
        let mut from_hall = point.place.coords - self.view.hall_from_body.origin.coords;
        let (mut R_bh, mut turned) = (self.R_bh, None);
        if point.offset_s != 0.0 {
            from_hall -= self.view.velocity_mps * point.offset_s;
            let turn = exp_so3(&(self.view.rate_radps * -point.offset_s));
            let E = turn.to_rotation_matrix().into_inner();
            R_bh = E * R_bh;
            turned = Some(E);
        }
        let p_body = R_bh * from_hall;
        let p_camera = Point::from_coords(self.R_cb * (p_body - self.lever));
        let (pixel, by_p_camera) = self.frame.camera.project(&p_camera)?;
        let by_p_body = by_p_camera * self.R_cb / self.frame.corner_sigma_px;
        let mut by_attitude = by_p_body * skew(&p_body);
        if let Some(E) = turned {
            by_attitude *= E;
        }
        let mut J = Matrix2x6::zeros();
        J.fixed_columns_mut::<3>(0).copy_from(&(by_p_body * -R_bh));
        J.fixed_columns_mut::<3>(3).copy_from(&by_attitude);
        Some(Residual { r: (point.pixel - pixel) / self.frame.corner_sigma_px, J })
    }
}

/// Λ and η of some points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Information {
    pub(super) Lambda: Matrix6<f64>,
    pub(super) eta: Vector6<f64>,
    pub(super) n_points: usize,
    /// Σ w rᵀ r.
    squares: f64,
}

impl Information {
    pub(super) fn none() -> Self {
        Self { Lambda: Matrix6::zeros(), eta: Vector6::zeros(), n_points: 0, squares: 0.0 }
    }

    pub(super) fn add(&mut self, residual: &Residual, weight: f64) {
        let weighted = residual.J.transpose() * weight;
        self.Lambda += weighted * residual.J;
        self.eta += weighted * residual.r;
        self.n_points += 1;
        self.squares += weight * residual.r.norm_squared();
    }

    /// Both together.
    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            Lambda: self.Lambda + other.Lambda,
            eta: self.eta + other.eta,
            n_points: self.n_points + other.n_points,
            squares: self.squares + other.squares,
        }
    }

    /// Without a part of it.
    pub(super) fn minus(&self, part: &Self) -> Self {
        Self {
            Lambda: self.Lambda - part.Lambda,
            eta: self.eta - part.eta,
            n_points: self.n_points - part.n_points,
            squares: self.squares - part.squares,
        }
    }

    /// Mean square of what is left of the residuals at `c`, 1 where they are as good as said.
    pub(super) fn excess_at(&self, c: &Vector6<f64>) -> f64 {
        let left = self.squares - 2.0 * c.dot(&self.eta) + c.dot(&(self.Lambda * c));
        #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
        let n = (2 * self.n_points.max(1)) as f64;
        left / n
    }

    /// The same about the pose moved by `c`: what its residuals leave there.
    pub(super) fn left_at(&self, c: &Vector6<f64>) -> Self {
        let pulled = self.Lambda * c;
        let squares = self.squares - 2.0 * c.dot(&self.eta) + c.dot(&pulled);
        Self { eta: self.eta - pulled, squares, ..*self }
    }

    fn scaled(&self, by: f64) -> Self {
        Self {
            Lambda: self.Lambda * by,
            eta: self.eta * by,
            n_points: self.n_points,
            squares: self.squares * by,
        }
    }
}

/// P̃ with its factor.
pub(super) struct PosePrior {
    pub(super) cov: Matrix6<f64>,
    factor: Cholesky<f64, Const<6>>,
    L: Matrix6<f64>,
}

impl PosePrior {
    /// `None` where P̃ is not positive definite.
    pub(super) fn new(
        state: &FilterState,
        motion: &Vector6<f64>,
        capture_sigma_s: f64,
    ) -> Option<Self> {
        let P = state.P.fixed_view::<6, 6>(0, 0).into_owned();
        let cov = P + motion * motion.transpose() * capture_sigma_s.powi(2);
        let factor = cov.cholesky()?;
        let L = factor.l();
        Some(Self { cov, factor, L })
    }

    /// `(I + Lᵀ Λ L)⁻¹`.
    fn middle(&self, Lambda: &Matrix6<f64>) -> Option<Matrix6<f64>> {
        let B = Matrix6::identity() + self.L.tr_mul(&(Lambda * self.L));
        Some(((B + B.transpose()) * 0.5).cholesky()?.inverse())
    }

    /// `C = (P̃⁻¹ + Λ)⁻¹`.
    pub(super) fn posterior(&self, Lambda: &Matrix6<f64>) -> Option<Matrix6<f64>> {
        Some(self.L * self.middle(Lambda)? * self.L.transpose())
    }

    /// `rᵀ S⁻¹ r` of one point with S = I + J P̃ Jᵀ.
    pub(super) fn distance2(&self, residual: &Residual) -> f64 {
        let S = Matrix2::identity() + residual.J * self.cov * residual.J.transpose();
        S.cholesky().map_or(f64::MAX, |S| residual.r.dot(&S.solve(&residual.r)))
    }
}

/// The weight of a squared length in σ; `None` outside the gate.
pub(super) fn weight_of(distance2: f64) -> Option<f64> {
    if distance2 <= HUBER_SIGMAS * HUBER_SIGMAS {
        Some(1.0)
    } else if distance2 <= POINT_GATE {
        Some(HUBER_SIGMAS / distance2.sqrt())
    } else {
        None
    }
}

/// One pass over points of a frame from `view` moved by `c`; gates against the prior in the first pass,
/// against the residuals afterwards.
fn collect(
    frame: &Frame,
    points: &[Sighting],
    view: &Viewpoint,
    c: &Vector6<f64>,
    gate: impl Fn(&Residual) -> f64,
) -> Information {
    let turn = c.fixed_rows::<3>(3).into_owned();
    let by_turn = (turn.norm() > 0.0).then(|| right_jacobian_so3(&turn));
    let projector = Projector::new(frame, &view.shifted(c));
    let mut all = Information::none();
    for point in points {
        let Some(mut residual) = projector.residual(point) else { continue };
        let Some(weight) = weight_of(gate(&residual)) else { continue };
        if let Some(J_r) = &by_turn {
            let by_attitude = residual.J.fixed_columns::<3>(3) * J_r;
            residual.J.fixed_columns_mut::<3>(3).copy_from(&by_attitude);
        }
        all.add(&residual, weight);
    }
    all
}

/// Where the passes ended: ĉ, the points seen from there, with η brought back to the prior.
struct Settled {
    c: Vector6<f64>,
    points: Information,
}

fn settle(frame: &Frame, view: &Viewpoint, prior: &PosePrior) -> Option<Settled> {
    let mut c = Vector6::zeros();
    let mut points = collect(frame, &frame.points, view, &c, |residual| prior.distance2(residual));
    for _ in 1..MAX_PASSES {
        let next = prior.posterior(&points.Lambda)? * (points.eta + points.Lambda * c);
        let step = next - c;
        c = next;
        let n_before = points.n_points;
        points = collect(frame, &frame.points, view, &c, |residual| residual.r.norm_squared());
        let is_settled = step.fixed_rows::<3>(0).norm() < SETTLED_M
            && step.fixed_rows::<3>(3).norm() < SETTLED_RAD;
        if is_settled && points.n_points == n_before {
            break;
        }
    }
    points.eta += points.Lambda * c;
    Some(Settled { c, points })
}

/// Fuses the points of a frame where they agree with the state; otherwise leaves it alone.
pub fn fuse(
    state: &mut FilterState,
    rate_radps: &Vector3<f64>,
    frame: &Frame,
) -> (TightOutcome, Option<Gain>) {
    let view = Viewpoint::of(state, rate_radps);
    let motion = view.motion();
    let mut outcome = TightOutcome {
        is_fused: false,
        n_points: frame.points.len(),
        n_used: 0,
        shift: Vector6::zeros(),
        shift_cov: Matrix6::zeros(),
        nis: f64::MAX,
        nis_gate: chi2_gate_99(2 * frame.points.len()),
        sigma_factor: 1.0,
    };
    if state.places.is_some() {
        let gain = placed::fuse(state, &view, frame, &mut outcome);
        outcome.is_fused = gain.is_some();
        return (outcome, gain);
    }
    let gain = PosePrior::new(state, &motion, frame.capture_sigma_s).and_then(|prior| {
        let Settled { c, points } = settle(frame, &view, &prior)?;
        outcome.n_used = points.n_points;
        outcome.nis_gate = chi2_gate_99(2 * points.n_points);
        // Points that disagree among each other are worse than they were said to be.
        #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
        let excess = points.squares / (2 * points.n_points.max(1)) as f64;
        let is_worse = points.squares > outcome.nis_gate;
        let points = if is_worse { points.scaled(1.0 / excess) } else { points };
        outcome.sigma_factor = if is_worse { excess.sqrt() } else { 1.0 };
        let posterior = prior.posterior(&points.Lambda)?;
        outcome.shift = if is_worse { posterior * points.eta } else { c };
        outcome.shift_cov = prior.cov - posterior;
        outcome.nis = points.squares + outcome.shift.dot(&prior.factor.solve(&outcome.shift));
        let is_agreed = 2 * points.n_points > frame.points.len() && outcome.nis <= outcome.nis_gate;
        is_agreed.then(|| apply(state, &prior, &motion, frame.capture_sigma_s, &points)).flatten()
    });
    outcome.is_fused = gain.is_some();
    (outcome, gain)
}

/// The update itself from Λ and η, both about the prior.
fn apply(
    state: &mut FilterState,
    prior: &PosePrior,
    motion: &Vector6<f64>,
    capture_sigma_s: f64,
    points: &Information,
) -> Option<Gain> {
    let Lambda = points.Lambda;
    // (I + Λ P̃)⁻¹ = L⁻ᵀ (I + Lᵀ Λ L)⁻¹ Lᵀ
    let right = prior.middle(&Lambda)? * prior.L.transpose();
    let inverse = prior.L.tr_solve_lower_triangular(&right)?;
    let G: SMatrix<f64, 15, 6> = state.P.fixed_columns::<6>(0) * inverse;
    let pull = Lambda * motion * capture_sigma_s;
    let gain = Gain { first: 0, U: G * Lambda };
    state.absorb(&gain, &G, &(Lambda + pull * pull.transpose()), &points.eta);
    Some(gain)
}

#[cfg(test)]
mod tests;
