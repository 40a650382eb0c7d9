//! The reprojection error, its derivative, and the search for its minimum.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::PointFeature;
use crate::geometry::{Body, Camera, Hall, Point, Transform, skew};
use crate::localization::camera_model::CameraModel;
use nalgebra::{Matrix2x3, Matrix2x6, Matrix3, Matrix6, Vector2, Vector6};

const MAX_ITERATIONS: usize = 60;
/// Huber's threshold in σ: a residual of two coordinates keeps below it in 86 of 100 cases.
const HUBER_SIGMAS: f64 = 2.0;
/// Where the redescending loss has lost half of its slope's growth, in σ.
const REDESCENDING_SIGMAS: f64 = 3.0;
/// Points that a wrong pose puts behind the camera cost as much as one at this many σ.
const UNSEEN_SIGMAS: f64 = 200.0;

/// What a residual costs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Loss {
    /// Its square: the paper's.
    Square,
    /// Its length beyond a threshold (Huber 1964): convex, finds the pose from afar.
    Huber,
    /// Bounded (Geman and `McClure` 1987): outliers lose their pull.
    Redescending,
}

impl Loss {
    /// Cost of a residual length in σ, and the weight of its square.
    fn of(self, sigmas: f64) -> (f64, f64) {
        let square = sigmas * sigmas;
        match self {
            Self::Huber if sigmas > HUBER_SIGMAS => {
                (HUBER_SIGMAS * (sigmas - 0.5 * HUBER_SIGMAS), HUBER_SIGMAS / sigmas)
            }
            Self::Square | Self::Huber => (0.5 * square, 1.0),
            Self::Redescending => {
                let share = 1.0 / (1.0 + square / (REDESCENDING_SIGMAS * REDESCENDING_SIGMAS));
                (0.5 * square * share, share * share)
            }
        }
    }
}

/// Projects hall points from one pose; what the points share is computed once.
pub(in crate::localization) struct Reprojector<'a> {
    camera: &'a CameraModel,
    body_from_hall: Transform<Body, Hall>,
    camera_from_body: Transform<Camera, Body>,
    R_cb: Matrix3<f64>,
    R_ch: Matrix3<f64>,
}

impl<'a> Reprojector<'a> {
    pub(in crate::localization) fn new(
        camera: &'a CameraModel,
        hall_from_body: &Transform<Hall, Body>,
    ) -> Self {
        let body_from_hall = hall_from_body.inverse();
        let camera_from_body = camera.body_from_camera.inverse();
        let R_cb = camera_from_body.rotation.matrix();
        let R_ch = R_cb * body_from_hall.rotation.matrix();
        Self { camera, body_from_hall, camera_from_body, R_cb, R_ch }
    }

    /// Pixel of a hall point, and its derivative by the pose (2×6).
    ///
    /// ```text
    /// p_c = R_cb (Rᵀ (P − p) − t_bc),   ∂p_c/∂p = −R_cb Rᵀ,   ∂p_c/∂θ = R_cb [Rᵀ (P − p)]^
    /// ```
    pub(in crate::localization) fn reproject(
        &self,
        place: &Point<Hall>,
    ) -> Option<(Vector2<f64>, Matrix2x6<f64>)> {
        let p_body = self.body_from_hall * *place;
        let (pixel, by_p_camera) = self.camera.project(&(self.camera_from_body * p_body))?;
        let mut J = Matrix2x6::zeros();
        J.fixed_columns_mut::<3>(0).copy_from(&(by_p_camera * -self.R_ch));
        J.fixed_columns_mut::<3>(3).copy_from(&(by_p_camera * self.R_cb * skew(&p_body.coords)));
        Some((pixel, J))
    }

    /// The derivative of the pixel by the place of its point, from that by the pose (2×3).
    ///
    /// ```text
    /// ∂p_c/∂P = R_cb Rᵀ = −∂p_c/∂p
    /// ```
    pub(in crate::localization) fn by_place(J: &Matrix2x6<f64>) -> Matrix2x3<f64> {
        -J.fixed_columns::<3>(0)
    }
}

/// Where a search ended.
#[derive(Debug, Clone, Copy)]
pub(super) struct Minimum {
    pub(super) pose: Transform<Hall, Body>,
    /// Sum of the losses; twice this is a χ² for the square loss.
    pub(super) cost: f64,
    /// JᵀJ/σ² at the minimum, weighted.
    pub(super) information: Matrix6<f64>,
}

struct Normal {
    JtJ: Matrix6<f64>,
    Jtr: Vector6<f64>,
    cost: f64,
}

fn normal_equations(
    camera: &CameraModel,
    features: &[PointFeature],
    pose: &Transform<Hall, Body>,
    (sigma_px, loss): (f64, Loss),
) -> Normal {
    let mut normal = Normal { JtJ: Matrix6::zeros(), Jtr: Vector6::zeros(), cost: 0.0 };
    let reprojector = Reprojector::new(camera, pose);
    for feature in features {
        let Some((pixel, J)) = reprojector.reproject(&feature.place) else {
            normal.cost += loss.of(UNSEEN_SIGMAS).0;
            continue;
        };
        let residual = (feature.pixel - pixel) / sigma_px;
        let (cost, weight) = loss.of(residual.norm());
        let J = J / sigma_px;
        normal.JtJ += J.transpose() * J * weight;
        normal.Jtr += J.transpose() * residual * weight;
        normal.cost += cost;
    }
    normal
}

/// The cost of a pose before any search.
pub(super) fn cost(
    camera: &CameraModel,
    features: &[PointFeature],
    pose: &Transform<Hall, Body>,
    (sigma_px, loss): (f64, Loss),
) -> f64 {
    let reprojector = Reprojector::new(camera, pose);
    let sigmas = features.iter().map(|feature| {
        let seen = reprojector.reproject(&feature.place);
        seen.map_or(UNSEEN_SIGMAS, |(pixel, _)| (feature.pixel - pixel).norm() / sigma_px)
    });
    sigmas.map(|sigmas| loss.of(sigmas).0).sum()
}

pub(super) fn moved(pose: &Transform<Hall, Body>, step: &Vector6<f64>) -> Transform<Hall, Body> {
    pose.perturbed(&step.fixed_rows::<3>(0).into_owned(), &step.fixed_rows::<3>(3).into_owned())
}

/// Levenberg–Marquardt from one start; `None` if the normal equations are singular.
pub(super) fn minimize(
    camera: &CameraModel,
    features: &[PointFeature],
    start: &Transform<Hall, Body>,
    (sigma_px, loss): (f64, Loss),
) -> Option<Minimum> {
    let mut pose = *start;
    let mut normal = normal_equations(camera, features, &pose, (sigma_px, loss));
    let mut damping = 1e-4;
    for _ in 0..MAX_ITERATIONS {
        let damped = normal.JtJ + Matrix6::from_diagonal(&normal.JtJ.diagonal()) * damping;
        let step = damped.cholesky()?.solve(&normal.Jtr);
        let candidate = moved(&pose, &step);
        let next = normal_equations(camera, features, &candidate, (sigma_px, loss));
        if next.cost < normal.cost {
            let gained = normal.cost - next.cost;
            (pose, normal) = (candidate, next);
            damping = (damping * 0.2).max(1e-12);
            if gained < 1e-9 * (1.0 + normal.cost) {
                break;
            }
        } else {
            damping *= 8.0;
            if step.norm() < 1e-10 || damping > 1e10 {
                break;
            }
        }
    }
    Some(Minimum { pose, cost: normal.cost, information: normal.JtJ })
}
