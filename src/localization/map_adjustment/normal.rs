//! The normal equations of the adjustment, with the frames eliminated.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::start::Located;
use super::{KnownTag, Survey, Tape, corners_in_tag};
use crate::geometry::{Body, Hall, Tag, Transform, skew};
use crate::localization::vision_fix::Reprojector;
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{MatMut, MatRef, Side};
use nalgebra::{
    DMatrix, DVector, Matrix2x3, Matrix2x6, Matrix6, SMatrix, Vector2, Vector3, Vector6,
};

/// Huber's threshold in σ.
const HUBER_SIGMAS: f64 = 2.0;
/// A corner that a wrong pose puts behind the camera costs as much as one at this many σ.
pub(super) const UNSEEN_SIGMAS: f64 = 200.0;

/// The state with what it is judged by.
#[derive(Debug, Clone)]
pub(super) struct Problem<'a> {
    pub(super) survey: &'a Survey,
    pub(super) tags: Vec<Option<Transform<Hall, Tag>>>,
    pub(super) bodies: Vec<Option<Transform<Hall, Body>>>,
    log_scale: f64,
    /// First of the six rows of each located tag.
    rows: Vec<Option<usize>>,
    /// Bit k of `kept[view][sighting]`: corner k counts.
    pub(super) kept: Vec<Vec<u8>>,
    /// Huber's loss, or the square.
    pub(super) is_robust: bool,
}

/// The pixel of a corner and its derivatives.
pub(super) struct Corner {
    pub(super) residual_px: Vector2<f64>,
    pub(super) by_body: Matrix2x6<f64>,
    pub(super) by_tag: Matrix2x6<f64>,
    pub(super) by_scale: Vector2<f64>,
}

/// First of the six rows of each located tag.
fn rows_of(tags: &[Option<Transform<Hall, Tag>>]) -> Vec<Option<usize>> {
    let mut next = 0;
    let row = |tag: &Option<Transform<Hall, Tag>>| {
        tag.map(|_| {
            next += 6;
            next - 6
        })
    };
    tags.iter().map(row).collect()
}

/// A step of all unknowns.
pub(super) struct Step {
    reduced: DVector<f64>,
    bodies: Vec<Vector6<f64>>,
}

/// One frame's part: its own block and how it is tied to the tags it shows and to the scale.
struct FramePart {
    H: Matrix6<f64>,
    b: Vector6<f64>,
    /// First row of the unknowns, and W for six tag rows.
    tags: Vec<(usize, Matrix6<f64>)>,
    scale: Vector6<f64>,
}

/// The equations at a state.
pub(super) struct Normal {
    pub(super) cost: f64,
    S: DMatrix<f64>,
    b: DVector<f64>,
    frames: Vec<FramePart>,
}

impl<'a> Problem<'a> {
    pub(super) fn new(survey: &'a Survey, located: Located) -> Self {
        let rows = rows_of(&located.tags);
        let kept = survey.views.iter().map(|view| vec![0b1111; view.sightings.len()]).collect();
        Self {
            survey,
            tags: located.tags,
            bodies: located.bodies,
            log_scale: located.edge_factor.ln(),
            rows,
            kept,
            is_robust: true,
        }
    }

    /// Where everything is now.
    pub(super) fn located(&self) -> Located {
        Located {
            tags: self.tags.clone(),
            bodies: self.bodies.clone(),
            edge_factor: self.edge_factor(),
        }
    }

    pub(super) fn tags(&self) -> &[Option<Transform<Hall, Tag>>] {
        &self.tags
    }

    pub(super) fn bodies(&self) -> &[Option<Transform<Hall, Body>>] {
        &self.bodies
    }

    pub(super) fn rows(&self) -> &[Option<usize>] {
        &self.rows
    }

    pub(super) fn edge_factor(&self) -> f64 {
        self.log_scale.exp()
    }

    pub(super) const fn corner_sigma_px(&self) -> f64 {
        self.survey.corner_sigma_px
    }

    /// To be called after tags were left out.
    pub(super) fn renumber(&mut self) {
        self.rows = rows_of(&self.tags);
    }

    fn n_reduced(&self) -> usize {
        6 * self.rows.iter().flatten().count() + 1
    }

    pub(super) fn n_unknowns(&self) -> usize {
        self.n_reduced() + 6 * self.bodies.iter().flatten().count()
    }

    pub(super) fn n_prior_rows(&self) -> usize {
        6 * self.known().count() + self.usable_tapes().count() + 1
    }

    fn known(&self) -> impl Iterator<Item = &KnownTag> {
        self.survey.known.iter().filter(|known| self.tags[known.tag].is_some())
    }

    fn usable_tapes(&self) -> impl Iterator<Item = &Tape> {
        self.survey
            .tapes
            .iter()
            .filter(|tape| tape.tags.iter().all(|tag| self.tags[*tag].is_some()))
    }

    /// Corner `k` of a tag from a body, against where it was seen; `None` behind the camera.
    ///
    /// ```text
    /// P = t + R e^s c,   ∂P/∂t = I,   ∂P/∂θ = −R [e^s c]^,   ∂P/∂s = R e^s c
    /// ```
    pub(super) fn corner(
        &self,
        reprojector: &Reprojector<'_>,
        tag: usize,
        k: usize,
        seen_px: [f64; 2],
    ) -> Option<Corner> {
        let pose = self.tags[tag]?;
        let in_tag = corners_in_tag(self.survey.edges_m[tag] * self.edge_factor())[k];
        let (pixel, by_body) = reprojector.reproject(&(pose * in_tag))?;
        let by_place: Matrix2x3<f64> = Reprojector::by_place(&by_body);
        let R = pose.rotation.matrix();
        let mut by_tag = Matrix2x6::zeros();
        by_tag.fixed_columns_mut::<3>(0).copy_from(&by_place);
        by_tag.fixed_columns_mut::<3>(3).copy_from(&(by_place * -(R * skew(&in_tag.coords))));
        let by_scale = by_place * (R * in_tag.coords);
        Some(Corner { residual_px: Vector2::from(seen_px) - pixel, by_body, by_tag, by_scale })
    }

    /// Calls for every corner that counts: view, place of the sighting, corner, and what it is.
    pub(super) fn each_corner(&self, mut work: impl FnMut(usize, usize, usize, Option<Corner>)) {
        for (v, view) in self.survey.views.iter().enumerate() {
            let Some(body) = &self.bodies[v] else { continue };
            let reprojector = Reprojector::new(&self.survey.cameras[view.camera], body);
            for (i, sighting) in view.sightings.iter().enumerate() {
                if self.tags[sighting.tag].is_none() {
                    continue;
                }
                for k in (0..4).filter(|k| self.kept[v][i] >> k & 1 == 1) {
                    let seen_px = sighting.corners_px[k];
                    work(v, i, k, self.corner(&reprojector, sighting.tag, k, seen_px));
                }
            }
        }
    }

    /// Half the loss of a residual in σ, and the weight of its square.
    pub(super) fn loss(&self, sigmas: f64) -> (f64, f64) {
        if self.is_robust && sigmas > HUBER_SIGMAS {
            (HUBER_SIGMAS * (sigmas - 0.5 * HUBER_SIGMAS), HUBER_SIGMAS / sigmas)
        } else {
            (0.5 * sigmas * sigmas, 1.0)
        }
    }

    pub(super) fn normal(&self) -> Normal {
        let n = self.n_reduced();
        let mut normal =
            Normal { cost: 0.0, S: DMatrix::zeros(n, n), b: DVector::zeros(n), frames: Vec::new() };
        let empty = || FramePart {
            H: Matrix6::zeros(),
            b: Vector6::zeros(),
            tags: Vec::new(),
            scale: Vector6::zeros(),
        };
        normal.frames.resize_with(self.bodies.len(), empty);
        let sigma_px = self.survey.corner_sigma_px;
        self.each_corner(|v, i, _, corner| {
            let Some(corner) = corner else {
                normal.cost += self.loss(UNSEEN_SIGMAS).0;
                return;
            };
            let (cost, weight) = self.loss(corner.residual_px.norm() / sigma_px);
            let tag = self.survey.views[v].sightings[i].tag;
            normal.cost += cost;
            normal.add_corner(v, self.rows[tag].unwrap_or(n), &corner, weight / sigma_px.powi(2));
        });
        self.add_known(&mut normal);
        for tape in self.usable_tapes() {
            self.add_tape(&mut normal, tape);
        }
        let information = 1.0 / self.survey.scale_sigma.powi(2);
        normal.cost += 0.5 * self.log_scale.powi(2) * information;
        normal.S[(n - 1, n - 1)] += information;
        normal.b[n - 1] -= self.log_scale * information;
        normal
    }

    /// A known tag: σ of each corner makes σ/2 of the middle, and σ/edge of each turn.
    fn add_known(&self, normal: &mut Normal) {
        for known in self.known() {
            let (Some(pose), Some(row)) = (self.tags[known.tag], self.rows[known.tag]) else {
                continue;
            };
            let position = (pose.origin - known.hall_from_tag.origin).coords;
            let turn = pose.rotation.minus(&known.hall_from_tag.rotation);
            let place_info = 4.0 / known.corner_sigma_m.powi(2);
            let turn_info = (self.survey.edges_m[known.tag] / known.corner_sigma_m).powi(2);
            for axis in 0..3 {
                for (offset, off, information) in
                    [(0, position[axis], place_info), (3, turn[axis], turn_info)]
                {
                    normal.cost += 0.5 * off * off * information;
                    normal.S[(row + offset + axis, row + offset + axis)] += information;
                    normal.b[row + offset + axis] -= off * information;
                }
            }
        }
    }

    /// A distance and its derivatives.
    ///
    /// ```text
    /// d = ‖t_a − t_b‖,   ∂d/∂t_a = (t_a − t_b)ᵀ/d = −∂d/∂t_b
    /// ```
    fn add_tape(&self, normal: &mut Normal, tape: &Tape) {
        let [a, b] = tape.tags;
        let (Some(pose_a), Some(pose_b)) = (self.tags[a], self.tags[b]) else { return };
        let (Some(row_a), Some(row_b)) = (self.rows[a], self.rows[b]) else { return };
        let line = (pose_a.origin - pose_b.origin).coords;
        let direction: Vector3<f64> = line.normalize();
        let information = 1.0 / tape.sigma_m.powi(2);
        let residual = tape.distance_m - line.norm();
        normal.cost += 0.5 * residual * residual * information;
        for (row, sign) in [(row_a, 1.0), (row_b, -1.0)] {
            for (other, other_sign) in [(row_a, 1.0), (row_b, -1.0)] {
                let block = direction * direction.transpose() * (sign * other_sign * information);
                let mut part = normal.S.fixed_view_mut::<3, 3>(row, other);
                part += block;
            }
            let mut part = normal.b.fixed_rows_mut::<3>(row);
            part += direction * (sign * residual * information);
        }
    }

    /// The state after a step.
    pub(super) fn moved(&self, step: &Step) -> Self {
        let mut next = self.clone();
        for (tag, row) in next.tags.iter_mut().zip(&self.rows) {
            if let (Some(tag), Some(row)) = (tag, row) {
                let part = |from: usize| step.reduced.fixed_rows::<3>(from).into_owned();
                *tag = tag.perturbed(&part(*row), &part(row + 3));
            }
        }
        for (body, step) in next.bodies.iter_mut().zip(&step.bodies) {
            if let Some(body) = body {
                let part = |from: usize| step.fixed_rows::<3>(from).into_owned();
                *body = body.perturbed(&part(0), &part(3));
            }
        }
        next.log_scale += step.reduced[step.reduced.len() - 1];
        next
    }

    /// Corners that count, and the sum of their squares in σ².
    pub(super) fn sum_of_squares(&self) -> (usize, f64) {
        let (mut n, mut squares) = (0, 0.0);
        self.each_corner(|_, _, _, corner| {
            if let Some(corner) = corner {
                n += 1;
                squares += (corner.residual_px / self.survey.corner_sigma_px).norm_squared();
            }
        });
        (n, squares)
    }

    /// Frames in which each tag counts.
    pub(super) fn n_views(&self) -> Vec<usize> {
        let mut n_views = vec![0; self.tags.len()];
        for (v, view) in self.survey.views.iter().enumerate() {
            for (i, sighting) in view.sightings.iter().enumerate() {
                let counts = self.bodies[v].is_some() && self.kept[v][i] != 0;
                n_views[sighting.tag] += usize::from(counts);
            }
        }
        n_views
    }
}

impl Normal {
    fn add_corner(&mut self, v: usize, row: usize, corner: &Corner, weight: f64) {
        let Corner { residual_px, by_body, by_tag, by_scale } = corner;
        let frame = &mut self.frames[v];
        frame.H += by_body.transpose() * by_body * weight;
        frame.b += by_body.transpose() * residual_px * weight;
        frame.scale += by_body.transpose() * by_scale * weight;
        let W = by_tag.transpose() * by_body * weight;
        match frame.tags.iter_mut().find(|(at, _)| *at == row) {
            Some((_, sum)) => *sum += W,
            None => frame.tags.push((row, W)),
        }
        let last = self.b.len() - 1;
        let mut part = self.S.fixed_view_mut::<6, 6>(row, row);
        part += by_tag.transpose() * by_tag * weight;
        let cross: Vector6<f64> = by_tag.transpose() * by_scale * weight;
        let mut part = self.S.fixed_view_mut::<6, 1>(row, last);
        part += cross;
        let mut part = self.S.fixed_view_mut::<1, 6>(last, row);
        part += cross.transpose();
        self.S[(last, last)] += by_scale.norm_squared() * weight;
        let mut part = self.b.fixed_rows_mut::<6>(row);
        part += by_tag.transpose() * residual_px * weight;
        self.b[last] += by_scale.dot(residual_px) * weight;
    }

    /// What is left of the equations without the frames, diagonals enlarged.
    ///
    /// ```text
    /// S − Σ W H⁻¹ Wᵀ,   b − Σ W H⁻¹ b_f
    /// ```
    fn reduced(&self, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (mut S, mut b) = (self.S.clone(), self.b.clone());
        let last = b.len() - 1;
        for k in 0..=last {
            S[(k, k)] *= 1.0 + damping;
        }
        for frame in self.frames.iter().filter(|frame| !frame.tags.is_empty()) {
            let inverse = frame.damped(damping).cholesky()?.inverse();
            for (row, W) in &frame.tags {
                let WH = W * inverse;
                for (other, W_other) in &frame.tags {
                    let mut part = S.fixed_view_mut::<6, 6>(*row, *other);
                    part -= WH * W_other.transpose();
                }
                let cross: Vector6<f64> = WH * frame.scale;
                let mut part = S.fixed_view_mut::<6, 1>(*row, last);
                part -= cross;
                let mut part = S.fixed_view_mut::<1, 6>(last, *row);
                part -= cross.transpose();
                let mut part = b.fixed_rows_mut::<6>(*row);
                part -= WH * frame.b;
            }
            let H_scale: SMatrix<f64, 6, 1> = inverse * frame.scale;
            S[(last, last)] -= frame.scale.dot(&H_scale);
            b[last] -= H_scale.dot(&frame.b);
        }
        Some((S, b))
    }

    /// A damped step; `None` if the equations are singular.
    pub(super) fn step(&self, damping: f64) -> Option<Step> {
        let (S, b) = self.reduced(damping)?;
        let factor = factor(&S)?;
        let mut reduced = b;
        let n = reduced.len();
        factor.solve_in_place(MatMut::from_column_major_slice_mut(reduced.as_mut_slice(), n, 1));
        let last = reduced.len() - 1;
        let of_frame = |frame: &FramePart| {
            if frame.tags.is_empty() {
                return Some(Vector6::zeros());
            }
            let mut rest = frame.b - frame.scale * reduced[last];
            for (row, W) in &frame.tags {
                rest -= W.transpose() * reduced.fixed_rows::<6>(*row);
            }
            Some(frame.damped(damping).cholesky()?.solve(&rest))
        };
        let bodies = self.frames.iter().map(of_frame).collect::<Option<_>>()?;
        Some(Step { reduced, bodies })
    }

    /// The covariance of tags and scale; `None` if some direction is free.
    pub(super) fn reduced_covariance(&self) -> Option<DMatrix<f64>> {
        let inverse = factor(&self.reduced(0.0)?.0)?.inverse();
        Some(DMatrix::from_fn(inverse.nrows(), inverse.ncols(), |r, c| inverse[(r, c)]))
    }
}

/// The system is dense: each tag is tied to many. `faer` factors it ten times faster than nalgebra.
fn factor(S: &DMatrix<f64>) -> Option<Llt<f64>> {
    MatRef::from_column_major_slice(S.as_slice(), S.nrows(), S.ncols()).llt(Side::Lower).ok()
}

impl FramePart {
    fn damped(&self, damping: f64) -> Matrix6<f64> {
        self.H + Matrix6::from_diagonal(&self.H.diagonal()) * damping
    }
}
